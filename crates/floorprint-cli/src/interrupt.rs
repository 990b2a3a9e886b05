//! Ctrl-C: the first one asks for an orderly end, the second one ends at once. So does the first where nothing would be lost.

use floorprint::StopSignal;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Whether the user has asked to stop.
#[derive(Debug, Clone, Default)]
pub(crate) struct Interrupt(Arc<State>);

#[derive(Debug, Default)]
struct State {
    requested: StopSignal,
    /// When that was.
    since: OnceLock<Instant>,
    unfinished: OnceLock<PathBuf>,
    is_finishing: AtomicBool,
    is_preparing: AtomicBool,
    waker: Waker,
}

/// Who has to be woken to notice.
#[derive(Default)]
struct Waker(OnceLock<Box<dyn Fn() + Send + Sync>>);

impl fmt::Debug for Waker {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Waker")
    }
}

impl Interrupt {
    /// Listens for Ctrl-C (and SIGTERM) from now on.
    pub(crate) fn listen() -> Self {
        let interrupt = Self::default();
        let heard = interrupt.clone();
        // Where no handler can be set, Ctrl-C ends the program as it always does.
        let _ = ctrlc::set_handler(move || {
            if heard.0.is_preparing.load(Ordering::SeqCst) {
                heard.end();
            }
            heard.request();
        });
        interrupt
    }

    /// Names the folder that an end at once removes.
    pub(crate) fn removes(&self, unfinished: &Path) {
        // There is one for each command.
        let _ = self.0.unfinished.set(unfinished.to_path_buf());
    }

    /// Names what is done at once when an end is asked for.
    pub(crate) fn on_request(&self, wake: impl Fn() + Send + Sync + 'static) {
        // There is one for each command.
        let _ = self.0.waker.0.set(Box::new(wake));
        if self.requested() {
            self.wake();
        }
    }

    fn wake(&self) {
        if let Some(wake) = self.0.waker.0.get() {
            wake();
        }
    }

    /// Whether there is nothing yet that would be lost by an end at once.
    pub(crate) fn is_preparing(&self, is_preparing: bool) {
        self.0.is_preparing.store(is_preparing, Ordering::SeqCst);
    }

    /// From now on the results are moved into place, which is not interrupted.
    pub(crate) fn is_finishing(&self) {
        self.0.is_finishing.store(true, Ordering::SeqCst);
    }

    /// Asks for an orderly end; the second time ends the program.
    pub(crate) fn request(&self) {
        if self.0.is_finishing.load(Ordering::SeqCst) {
            return;
        }
        if self.0.requested.give() {
            self.end();
        }
        let _ = self.0.since.set(Instant::now());
        self.wake();
    }

    /// Ends the program; nothing unfinished is left.
    fn end(&self) -> ! {
        if let Some(folder) = self.0.unfinished.get() {
            let _ = fs::remove_dir_all(folder);
        }
        floorprint_io::remove_unpacked();
        std::process::exit(130);
    }

    /// How long ago the user asked to stop; none if he did not.
    pub(crate) fn elapsed(&self) -> Duration {
        self.0.since.get().map_or(Duration::ZERO, Instant::elapsed)
    }

    /// Whether to stop.
    pub(crate) fn requested(&self) -> bool {
        self.0.requested.is_given()
    }

    /// What tells work in the library to stop.
    pub(crate) fn signal(&self) -> &StopSignal {
        &self.0.requested
    }
}
