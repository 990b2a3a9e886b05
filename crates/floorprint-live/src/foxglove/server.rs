//! Lets viewers in.

use super::protocol::SUBPROTOCOLS;
use super::viewer::Viewer;
use crate::board::Board;
use crate::connections::{Connections, Usage};
use crate::frame_names::FrameNames;
use crate::guard::{Guard, Token};
use crate::http::{ServerError, listen};
use hyper::header::{HeaderValue, SEC_WEBSOCKET_PROTOCOL};
use hyper::{Request, Response, StatusCode};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};
use tokio::net::TcpStream;
use tokio::sync::Semaphore;
use tokio::time::timeout;
use tokio_tungstenite::accept_hdr_async_with_config;
use tokio_tungstenite::tungstenite::handshake::server::{Callback, ErrorResponse};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;

/// Viewers that are told what happens, at most.
const MOST_VIEWERS: usize = 16;
/// A viewer has come in within this.
const HANDSHAKE_TIME: Duration = Duration::from_secs(5);
/// Longest request, bytes.
const LONGEST_REQUEST: usize = 64 << 10;
/// What is read and written at once, bytes.
const BUFFER: usize = 4 << 10;

/// A server for Foxglove on a thread of its own, which lives as long as the process.
#[derive(Debug)]
pub struct FoxgloveServer {
    address: SocketAddr,
}

/// What all viewers share.
pub(super) struct Hall {
    pub(super) board: Arc<Board>,
    pub(super) frames: FrameNames,
    /// Tells a viewer that comes back whether it is still the same session.
    pub(super) session_id: String,
    pub(super) places: Arc<Semaphore>,
    guard: Mutex<Guard>,
}

impl FoxgloveServer {
    /// Listens at an address and tells viewers what is on the board.
    ///
    /// # Errors
    /// When nothing can listen there, or other machines could come in without a token.
    pub fn start(
        address: SocketAddr,
        token: Option<Token>,
        board: Arc<Board>,
        frames: FrameNames,
    ) -> Result<Self, ServerError> {
        let guard = Mutex::new(Guard::new(address.ip(), token)?);
        let began = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let places = Arc::new(Semaphore::new(MOST_VIEWERS));
        let session_id = format!("{:x}", began.as_nanos());
        let hall = Arc::new(Hall { board, frames, session_id, places, guard });
        let address = listen("foxglove", address, async move |listener| {
            Connections::default().accept(&listener, |stream, usage| serve(stream, usage, Arc::clone(&hall))).await;
        })?;
        Ok(Self { address })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

async fn serve(stream: TcpStream, usage: Usage, hall: Arc<Hall>) {
    let config = WebSocketConfig::default()
        .read_buffer_size(BUFFER)
        .write_buffer_size(BUFFER)
        .max_message_size(Some(LONGEST_REQUEST))
        .max_frame_size(Some(LONGEST_REQUEST));
    let handshake = accept_hdr_async_with_config(stream, Greeting(Arc::clone(&hall)), Some(config));
    let Ok(Ok(socket)) = timeout(HANDSHAKE_TIME, handshake).await else { return };
    usage.asks();
    // A viewer that is gone is no failure.
    let _ = Viewer::new(hall, socket, usage).talk().await;
}

/// Lets a viewer in, in the newest protocol that it speaks.
struct Greeting(Arc<Hall>);

impl Callback for Greeting {
    fn on_request(self, request: &Request<()>, mut response: Response<()>) -> Result<Response<()>, ErrorResponse> {
        let refusal = |status: StatusCode, text: &str| {
            let mut answer = Response::new(Some(format!("{text}\n")));
            *answer.status_mut() = status;
            answer
        };
        let admitted = self.0.guard.lock().unwrap_or_else(PoisonError::into_inner).admit_viewer(request);
        admitted.map_err(|status| match status {
            StatusCode::UNAUTHORIZED => refusal(status, "This needs the token: open ws://…/?token=TOKEN"),
            status => refusal(status, &status.to_string()),
        })?;
        let offered: Vec<&str> = request
            .headers()
            .get_all(SEC_WEBSOCKET_PROTOCOL)
            .iter()
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(','))
            .map(str::trim)
            .collect();
        let Some(spoken) = SUBPROTOCOLS.into_iter().find(|known| offered.contains(known)) else {
            let text = format!("This speaks {}: connect to it with Foxglove", SUBPROTOCOLS.join(" and "));
            return Err(refusal(StatusCode::BAD_REQUEST, &text));
        };
        response.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(spoken));
        Ok(response)
    }
}
