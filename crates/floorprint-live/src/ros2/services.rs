//! What the node can be asked to do: small requests with small answers.

use super::node::{Node, NodeError, reliable};
use crate::board::Board;
use floorprint::localization::Start;
use floorprint_io::write_map;
use futures::executor::block_on;
use ros2_client::{Message, Name, Server, ServiceMapping, ServiceTypeName};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fmt::Debug;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// After what could not be understood.
const REST: Duration = Duration::from_millis(20);

/// `std_msgs/String name` of `slam_toolbox/srv/SaveMap`.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct SaveMapRequest {
    name: String,
}

/// `uint8 result`: 0 saved, 255 not.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct SaveMapResponse {
    result: u8,
}

/// Empty structures hold a byte in DDS.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Empty {
    nothing: u8,
}

/// `bool status` of `slam_toolbox/srv/Pause`.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct PauseResponse {
    status: bool,
}

impl Message for SaveMapRequest {}
impl Message for SaveMapResponse {}
impl Message for Empty {}
impl Message for PauseResponse {}

/// Begins to answer.
pub(super) fn serve(node: &mut Node, board: &Arc<Board>) -> Result<(), NodeError> {
    let folder = node.options().save_to.clone();
    let of_save = Arc::clone(board);
    let save = answering(node, "save_map", ("slam_toolbox", "SaveMap"))?;
    spawn(save, move |SaveMapRequest { name }| SaveMapResponse {
        result: if save_map(&of_save, &folder, &name) { 0 } else { 255 },
    })?;
    let of_pause = Arc::clone(board);
    let pause = answering(node, "pause_new_measurements", ("slam_toolbox", "Pause"))?;
    spawn(pause, move |_: Empty| {
        of_pause.inbox.pause(!of_pause.inbox.is_paused());
        PauseResponse { status: true }
    })?;
    let of_search = Arc::clone(board);
    let search = answering(node, "reinitialize_global_localization", ("std_srvs", "Empty"))?;
    spawn(search, move |empty: Empty| {
        of_search.inbox.set_start(Start::Unknown);
        empty
    })
}

/// Saves the map as PGM and YAML under a plain name, `map` where none is given; tells whether it could.
fn save_map(board: &Board, folder: &Path, name: &str) -> bool {
    let name = if name.is_empty() { "map" } else { name };
    let is_plain = name.chars().all(|letter| letter.is_alphanumeric() || "-_ ".contains(letter));
    // Whoever is in the network may ask: files are made in one folder only.
    is_plain
        && board
            .picture()
            .map
            .to_raster()
            .is_some_and(|map| write_map(&folder.join(format!("{name}.yaml")), &map).is_ok())
}

fn answering<Q, A>(node: &mut Node, name: &str, (package, kind): (&str, &str)) -> Result<Server<Q, A>, NodeError>
where
    Q: Message + Clone + 'static,
    A: Message + 'static,
{
    let full = node.options().full_name(&format!("{}/{name}", node.options().name));
    let full = if full.starts_with('/') { full } else { format!("/{full}") };
    let parsed = Name::parse(&full).map_err(|error| NodeError::of(&full, format!("{error:?}")))?;
    let kind = ServiceTypeName::new(package, kind);
    node.node
        .create_server(ServiceMapping::Enhanced, &parsed, &kind, reliable(10), reliable(10))
        .map_err(|error| NodeError::of(&full, error))
}

fn spawn<Q, A>(server: Server<Q, A>, answer: impl Fn(Q) -> A + Send + 'static) -> Result<(), NodeError>
where
    Q: Message + Clone + DeserializeOwned + Debug + Send + 'static,
    A: Message + Send + 'static,
{
    let serve = move || {
        loop {
            let Ok((id, request)) = block_on(server.async_receive_request()) else {
                // What is no request is nobody's, and may come often.
                thread::sleep(REST);
                continue;
            };
            let _ = server.send_response(id, answer(request));
        }
    };
    thread::Builder::new()
        .name("ros2-service".to_owned())
        .spawn(serve)
        .map(drop)
        .map_err(|error| NodeError::of("no thread", error))
}
