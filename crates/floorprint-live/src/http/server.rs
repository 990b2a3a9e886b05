//! Takes connections: so many at most, and none that dawdles in the way of others.

use super::api::{Api, EVENTS};
use super::guard::{AccessError, Guard, Token};
use crate::board::Board;
use hyper::header::CONTENT_TYPE;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread;
use std::time::Duration;
use thiserror::Error;
use tokio::task::JoinHandle;

/// Connections at a time.
const MOST_CONNECTIONS: usize = 64;
/// A request's head comes within this.
const HEAD_TIME: Duration = Duration::from_secs(5);
/// And is no longer than this, bytes.
const LONGEST_HEAD: usize = 16 << 10;
/// After a connection could not be taken (too many files are open).
const REST: Duration = Duration::from_millis(100);

/// Why there is no page.
#[derive(Debug, Error)]
pub enum ServerError {
    /// Nobody may come in, or everybody could.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The address cannot be listened at.
    #[error("cannot listen at {address}: {error}")]
    Address {
        /// The address.
        address: SocketAddr,
        /// Why.
        error: io::Error,
    },
}

/// A server on a thread of its own, which lives as long as the process.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
}

impl Server {
    /// Listens at an address and shows what is on the board.
    ///
    /// # Errors
    /// When nothing can listen there, or other machines could come in without a token.
    pub fn start(address: SocketAddr, token: Option<Token>, board: Arc<Board>) -> Result<Self, ServerError> {
        let guard = Guard::new(address.ip(), token)?;
        let refused = |error| ServerError::Address { address, error };
        let listener = TcpListener::bind(address).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        let address = listener.local_addr().map_err(refused)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(refused)?;
        let api = Arc::new(Api::new(board, guard));
        let serve = move || {
            runtime.block_on(async {
                if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                    accept(&listener, &api).await;
                }
            });
        };
        thread::Builder::new().name("page".to_owned()).spawn(serve).map_err(refused)?;
        Ok(Self { address })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// A connection and what it is used for.
struct Connection {
    task: JoinHandle<()>,
    usage: Arc<AtomicU8>,
}

/// Nothing was asked for yet.
const SILENT: u8 = 0;
/// Something was.
const ASKING: u8 = 1;
/// It is told what happens.
const VIEWING: u8 = 2;

async fn accept(listener: &tokio::net::TcpListener, api: &Arc<Api>) {
    let mut connections: VecDeque<Connection> = VecDeque::new();
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(REST).await;
            continue;
        };
        connections.retain(|connection| !connection.task.is_finished());
        if connections.len() >= MOST_CONNECTIONS {
            make_room(&mut connections);
        }
        let usage = Arc::new(AtomicU8::new(SILENT));
        let (api, used) = (Arc::clone(api), Arc::clone(&usage));
        let service = service_fn(move |request| {
            let (api, used) = (Arc::clone(&api), Arc::clone(&used));
            async move {
                used.store(ASKING, Ordering::Relaxed);
                let answer = api.answer(request).await;
                if answer.headers().get(CONTENT_TYPE).is_some_and(|kind| kind == EVENTS) {
                    used.store(VIEWING, Ordering::Relaxed);
                }
                Ok::<_, Infallible>(answer)
            }
        });
        let mut http = http1::Builder::new();
        http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIME).max_buf_size(LONGEST_HEAD);
        // A viewer that is gone is no failure.
        let task = tokio::spawn(async move { _ = http.serve_connection(TokioIo::new(stream), service).await });
        connections.push_back(Connection { task, usage });
    }
}

/// Ends the oldest connection that asks for nothing, or else that is told nothing: of viewers there are fewer than
/// connections, and a browser that asks again is let in again.
fn make_room(connections: &mut VecDeque<Connection>) {
    let oldest = |usage| connections.iter().position(|connection| connection.usage.load(Ordering::Relaxed) == usage);
    if let Some(ended) = oldest(SILENT).or(oldest(ASKING)).and_then(|at| connections.remove(at)) {
        ended.task.abort();
    }
}
