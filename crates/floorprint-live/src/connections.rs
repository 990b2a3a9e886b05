//! Connections at a time: so many at most, and none that dawdles in the way of others.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;

/// Connections of a server at a time.
const MOST_CONNECTIONS: usize = 64;
/// After a connection could not be taken (too many files are open).
const REST: Duration = Duration::from_millis(100);

/// What a connection is used for.
#[derive(Debug, Clone, Default)]
pub(crate) struct Usage(Arc<AtomicU8>);

/// Nothing was asked for yet.
const SILENT: u8 = 0;
/// Something was.
const ASKING: u8 = 1;
/// It is told what happens.
const VIEWING: u8 = 2;

impl Usage {
    /// Something is asked for.
    pub(crate) fn asks(&self) {
        self.0.store(ASKING, Ordering::Relaxed);
    }

    /// It is told what happens from now on.
    pub(crate) fn views(&self) {
        self.0.store(VIEWING, Ordering::Relaxed);
    }

    fn is(&self, usage: u8) -> bool {
        self.0.load(Ordering::Relaxed) == usage
    }
}

/// The connections of a server, the oldest first.
#[derive(Debug, Default)]
pub(crate) struct Connections(VecDeque<(JoinHandle<()>, Usage)>);

impl Connections {
    /// Takes connections for ever and has each served by a task of its own.
    pub(crate) async fn accept<F>(mut self, listener: &TcpListener, serve: impl Fn(TcpStream, Usage) -> F)
    where
        F: Future<Output = ()> + Send + 'static,
    {
        loop {
            let Ok((stream, _)) = listener.accept().await else {
                tokio::time::sleep(REST).await;
                continue;
            };
            self.0.retain(|(task, _)| !task.is_finished());
            if self.0.len() >= MOST_CONNECTIONS {
                self.make_room();
            }
            let usage = Usage::default();
            self.0.push_back((tokio::spawn(serve(stream, usage.clone())), usage));
        }
    }

    /// Ends the oldest connection that asks for nothing, or else that is told nothing: of viewers there are fewer than
    /// connections, and a browser that asks again is let in again.
    fn make_room(&mut self) {
        let oldest = |usage| self.0.iter().position(|(_, used)| used.is(usage));
        if let Some((task, _)) = oldest(SILENT).or(oldest(ASKING)).and_then(|at| self.0.remove(at)) {
            task.abort();
        }
    }
}
