//! What the node can be asked to do: small requests with small answers.

use super::node::{Node, NodeError, reliable};
use crate::board::{Board, Mode};
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

/// `std_msgs/String name` of `slam_toolbox/srv/SaveMap`, `string filename` of `slam_toolbox/srv/SerializePoseGraph`: the same
/// bytes.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct SaveRequest {
    name: String,
}

/// `uint8 result` of both: 0 saved, 255 not.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct SaveResponse {
    result: u8,
}

impl SaveResponse {
    fn of(is_saved: bool) -> Self {
        Self { result: if is_saved { 0 } else { 255 } }
    }
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

impl Message for SaveRequest {}
impl Message for SaveResponse {}
impl Message for Empty {}
impl Message for PauseResponse {}

/// Begins to answer.
pub(super) fn serve(node: &mut Node, board: &Arc<Board>) -> Result<(), NodeError> {
    let folder = node.options().save_to.clone();
    let (of_save, into) = (Arc::clone(board), folder.clone());
    let save = answering(node, Place::Node, "save_map", ("slam_toolbox", "SaveMap"))?;
    spawn(save, move |SaveRequest { name }| SaveResponse::of(save_map(&of_save, &into, &name)))?;
    let of_serialize = Arc::clone(board);
    let serialize = answering(node, Place::Node, "serialize_map", ("slam_toolbox", "SerializePoseGraph"))?;
    spawn(serialize, move |SaveRequest { name }| {
        let is_saved =
            plain_name(&name).is_some_and(|name| of_serialize.inbox.save_session(folder.join(format!("{name}.gpkg"))));
        SaveResponse::of(is_saved)
    })?;
    let of_pause = Arc::clone(board);
    let pause = answering(node, Place::Node, "pause_new_measurements", ("slam_toolbox", "Pause"))?;
    spawn(pause, move |_: Empty| {
        of_pause.inbox.pause(!of_pause.inbox.is_paused());
        PauseResponse { status: true }
    })?;
    if board.mode != Mode::Localization {
        return Ok(());
    }
    let of_search = Arc::clone(board);
    let search = answering(node, Place::Namespace, "reinitialize_global_localization", ("std_srvs", "Empty"))?;
    spawn(search, move |empty: Empty| {
        of_search.inbox.set_start(Start::Unknown);
        empty
    })?;
    // Every scan counts, also of a robot that stands still: there is nothing to be asked for.
    let update = answering(node, Place::Namespace, "request_nomotion_update", ("std_srvs", "Empty"))?;
    spawn(update, |empty: Empty| empty)
}

/// A name for a file, `map` where none is given; `None` where it would lead elsewhere: whoever is in the network may ask, and
/// files are made in one folder only.
fn plain_name(name: &str) -> Option<&str> {
    let name = if name.is_empty() { "map" } else { name };
    name.chars().all(|letter| letter.is_alphanumeric() || "-_ ".contains(letter)).then_some(name)
}

/// Saves the map as PGM and YAML; tells whether it could.
fn save_map(board: &Board, folder: &Path, name: &str) -> bool {
    let raster = board.picture().map.to_raster();
    plain_name(name)
        .zip(raster)
        .is_some_and(|(name, map)| write_map(&folder.join(format!("{name}.yaml")), &map).is_ok())
}

/// Below what a service's name lies.
#[derive(Debug, Clone, Copy)]
enum Place {
    /// The node's name, as with slam_toolbox.
    Node,
    /// The namespace, as with AMCL.
    Namespace,
}

fn answering<Q, A>(
    node: &mut Node,
    place: Place,
    name: &str,
    (package, kind): (&str, &str),
) -> Result<Server<Q, A>, NodeError>
where
    Q: Message + Clone + 'static,
    A: Message + 'static,
{
    let full = match place {
        Place::Node => node.options().full_name(&format!("{}/{name}", node.options().name)),
        Place::Namespace => node.options().full_name(name),
    };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_lead_nowhere_else() {
        assert_eq!([plain_name(""), plain_name("ground floor_2")], [Some("map"), Some("ground floor_2")]);
        for name in ["../map", "/etc/map", "a.b", "a\0b", "C:map"] {
            assert_eq!(plain_name(name), None, "{name}");
        }
    }
}
