//! Options of the page in the browser.

use crate::outcome::BadArguments;
use crate::terminal::Terminal;
use clap::Args;
use floorprint_live::{Board, Server, ServerError, Token};
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
    /// What viewers have to know: 16 or more letters and digits. FLOORPRINT_TOKEN in the environment does the same.
    #[arg(long, value_name = "TOKEN")]
    token: Option<String>,
}

impl Page {
    /// Starts the server, where one is asked for.
    ///
    /// # Errors
    /// It cannot listen there, or everybody could come in.
    pub(crate) fn show(&self, board: &Arc<Board>, terminal: &Terminal) -> anyhow::Result<()> {
        let Some(address) = self.http else { return Ok(()) };
        let token = self.token.clone().or_else(|| std::env::var(TOKEN_VARIABLE).ok());
        let token =
            token.map(|token| Token::new(&token)).transpose().map_err(|error| BadArguments(error.to_string()))?;
        let has_token = token.is_some();
        let server = Server::start(address, token, Arc::clone(board)).map_err(|error| match error {
            ServerError::Access(error) => anyhow::Error::from(BadArguments(error.to_string())),
            error @ ServerError::Address { .. } => error.into(),
        })?;
        let key = if has_token { "/?token=TOKEN" } else { "/" };
        terminal.say(&format!("the page is at http://{}{key}", server.address()));
        Ok(())
    }
}
