//! The server of the page: a thread that takes connections and has them answered.

use super::api::{Api, EVENTS};
use crate::board::Board;
use crate::connections::{Connections, Usage};
use crate::guard::{AccessError, Guard, Token};
use hyper::header::CONTENT_TYPE;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread;
use std::time::Duration;
use thiserror::Error;
use tokio::net::TcpStream;

/// A request's head comes within this.
const HEAD_TIME: Duration = Duration::from_secs(5);
/// And is no longer than this, bytes.
const LONGEST_HEAD: usize = 16 << 10;

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
        let api = Arc::new(Api::new(board, guard));
        let address = listen("page", address, async move |listener| {
            Connections::default().accept(&listener, |stream, usage| serve(stream, usage, Arc::clone(&api))).await;
        })?;
        Ok(Self { address })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// Listens at an address and serves on a thread of its own, which lives as long as the process; gives where it listens.
pub(crate) fn listen<F>(
    thread_name: &str,
    address: SocketAddr,
    serve: impl FnOnce(tokio::net::TcpListener) -> F + Send + 'static,
) -> Result<SocketAddr, ServerError>
where
    F: Future<Output = ()>,
{
    let refused = |error| ServerError::Address { address, error };
    let listener = TcpListener::bind(address).map_err(refused)?;
    listener.set_nonblocking(true).map_err(refused)?;
    let bound = listener.local_addr().map_err(refused)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(refused)?;
    let serve = move || {
        runtime.block_on(async {
            if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
                serve(listener).await;
            }
        });
    };
    thread::Builder::new().name(thread_name.to_owned()).spawn(serve).map_err(refused)?;
    Ok(bound)
}

async fn serve(stream: TcpStream, usage: Usage, api: Arc<Api>) {
    let service = service_fn(move |request| {
        let (api, usage) = (Arc::clone(&api), usage.clone());
        async move {
            usage.asks();
            let answer = api.answer(request).await;
            if answer.headers().get(CONTENT_TYPE).is_some_and(|kind| kind == EVENTS) {
                usage.views();
            }
            Ok::<_, Infallible>(answer)
        }
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD_TIME).max_buf_size(LONGEST_HEAD);
    // A viewer that is gone is no failure.
    _ = http.serve_connection(TokioIo::new(stream), service).await;
}
