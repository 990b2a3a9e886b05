//! Options of what is shown to others: the page in the browser, and Foxglove.

use crate::outcome::BadArguments;
use crate::terminal::Terminal;
use clap::Args;
#[cfg(feature = "foxglove")]
use floorprint_live::FoxgloveServer;
use floorprint_live::{Board, FrameNames, Server, ServerError, Token};
use std::net::SocketAddr;
use std::sync::Arc;

/// Where a token may be kept out of the list of processes.
const TOKEN_VARIABLE: &str = "FLOORPRINT_TOKEN";

/// The page in the browser.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Page {
    /// Show a page at this address, e.g. 127.0.0.1:8080. From other machines it can be reached at 0.0.0.0:8080, with a token.
    #[arg(long, value_name = "ADDRESS")]
    pub(crate) http: Option<SocketAddr>,
    /// Show it to Foxglove at this address, e.g. 127.0.0.1:8765: open the connection ws://127.0.0.1:8765 there.
    #[cfg(feature = "foxglove")]
    #[arg(long, value_name = "ADDRESS")]
    foxglove: Option<SocketAddr>,
    /// What viewers have to know: 16 or more letters and digits. FLOORPRINT_TOKEN in the environment does the same.
    #[arg(long, value_name = "TOKEN")]
    token: Option<String>,
}

impl Page {
    /// Starts the servers that are asked for.
    ///
    /// # Errors
    /// They cannot listen there, or everybody could come in.
    pub(crate) fn show(&self, board: &Arc<Board>, frames: &FrameNames, terminal: &Terminal) -> anyhow::Result<()> {
        let token = self.token.clone().or_else(|| std::env::var(TOKEN_VARIABLE).ok());
        let token =
            token.map(|token| Token::new(&token)).transpose().map_err(|error| BadArguments(error.to_string()))?;
        let key = if token.is_some() { "/?token=TOKEN" } else { "/" };
        if let Some(address) = self.http {
            let server = Server::start(address, token.clone(), Arc::clone(board)).map_err(explain)?;
            terminal.say(&format!("the page is at http://{}{key}", server.address()));
        }
        let _ = frames;
        #[cfg(feature = "foxglove")]
        if let Some(address) = self.foxglove {
            let server = FoxgloveServer::start(address, token, Arc::clone(board), frames.clone()).map_err(explain)?;
            terminal.say(&format!("Foxglove finds it at ws://{}{key}", server.address()));
        }
        Ok(())
    }

    /// Whether anything is shown.
    pub(crate) fn is_asked_for(&self) -> bool {
        #[cfg(feature = "foxglove")]
        if self.foxglove.is_some() {
            return true;
        }
        self.http.is_some()
    }
}

/// Who may come in is a matter of the arguments.
fn explain(error: ServerError) -> anyhow::Error {
    match error {
        ServerError::Access(error) => BadArguments(error.to_string()).into(),
        error @ ServerError::Address { .. } => error.into(),
    }
}
