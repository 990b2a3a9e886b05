//! Who watches work that another program asked for: it is told how far the work is, and may end it.

use crate::interrupt::Interrupt;
use crate::terminal::Terminal;
use indicatif::ProgressBar;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Watches work from another thread, in the place of a terminal and of Ctrl-C.
#[derive(Debug, Clone, Default)]
pub struct Watcher {
    pub(crate) interrupt: Interrupt,
    heard: Arc<Mutex<Heard>>,
}

#[derive(Debug, Default)]
struct Heard {
    bar: Option<(&'static str, ProgressBar)>,
    warnings: Vec<String>,
}

/// How far the work is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// What is done: `reading`, `solving`, `painting` …
    pub task: &'static str,
    /// Steps done.
    pub done: u64,
    /// Steps in all; 0 where that is not known.
    pub total: u64,
}

impl Watcher {
    /// How far the work is; `None` before it begins.
    #[must_use]
    pub fn progress(&self) -> Option<Progress> {
        let heard = self.heard();
        let (task, bar) = heard.bar.as_ref()?;
        Some(Progress { task, done: bar.position(), total: bar.length().unwrap_or(0) })
    }

    /// What the user should know: warnings since the last time.
    #[must_use]
    pub fn take_warnings(&self) -> Vec<String> {
        std::mem::take(&mut self.heard().warnings)
    }

    /// Asks for an orderly end.
    pub fn stop(&self) {
        if !self.interrupt.requested() {
            self.interrupt.request();
        }
    }

    /// The terminal that this watcher stands in for.
    pub(crate) fn terminal(&self) -> Terminal {
        Terminal::watched(self.clone())
    }

    pub(crate) fn show(&self, task: &'static str, bar: &ProgressBar) {
        self.heard().bar = Some((task, bar.clone()));
    }

    pub(crate) fn warn(&self, text: &str) {
        self.heard().warnings.push(text.to_owned());
    }

    fn heard(&self) -> MutexGuard<'_, Heard> {
        // What is kept is whole after every statement.
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
