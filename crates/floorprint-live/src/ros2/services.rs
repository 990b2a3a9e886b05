//! What the node can be asked to do.

use super::announcer::occupancy_grid;
use super::node::{Node, NodeError};
use super::service::Service;
use crate::board::{Board, Mode};
use crate::inbox::{Change, Refusal};
use floorprint::localization::Start;
use floorprint_io::ros::{DeserializeRequest, pose_of, text_of, truth_of};
use floorprint_io::write_map;
use futures::executor::block_on;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// After what could not be understood.
const REST: Duration = Duration::from_millis(20);

/// `std_srvs/Empty` and other answers without a field: a structure holds a byte in DDS.
const EMPTY: [u8; 1] = [0];
/// `bool status` of `slam_toolbox/srv/Pause`.
const PAUSED: [u8; 1] = [1];
/// `uint8 result` of services of slam_toolbox.
const DONE: [u8; 1] = [0];
const BAD_NAME: [u8; 1] = [1];
const BAD_MATCH_TYPE: [u8; 1] = [2];
const UNREADABLE: [u8; 1] = [3];
const FAILED: [u8; 1] = [255];

/// `int8 match_type` of `slam_toolbox/srv/DeserializePoseGraph`.
const START_AT_FIRST_NODE: u8 = 1;
const START_AT_GIVEN_POSE: u8 = 2;
const LOCALIZE_AT_POSE: u8 = 3;

/// From a request in CDR to the fields of its answer; `None` where it is no such request, and nobody's.
type Answer = Box<dyn Fn(&Board, &[u8]) -> Option<Vec<u8>> + Send>;

/// Begins to answer.
pub(super) fn serve(node: &mut Node, board: &Arc<Board>) -> Result<(), NodeError> {
    let folder = node.options().save_to.clone();
    let map_frame = node.options().map_frame.clone();
    let toolbox = |kind| ("slam_toolbox", kind);
    let mut offer =
        |place, name: &str, kind, answer: Answer| spawn(answering(node, place, name, kind)?, Arc::clone(board), answer);
    let into = folder.clone();
    offer(
        Place::Node,
        "save_map",
        toolbox("SaveMap"),
        Box::new(move |board, request| {
            let is_saved = save_map(board, &into, &text_of(request)?);
            Some((if is_saved { DONE } else { FAILED }).to_vec())
        }),
    )?;
    let into = folder.clone();
    offer(
        Place::Node,
        "serialize_map",
        toolbox("SerializePoseGraph"),
        Box::new(move |board, request| {
            let path = session_path(&into, &text_of(request)?);
            let is_saved = path.is_some_and(|path| board.inbox.save_session(path));
            Some((if is_saved { DONE } else { FAILED }).to_vec())
        }),
    )?;
    offer(
        Place::Node,
        "deserialize_map",
        toolbox("DeserializePoseGraph"),
        Box::new(move |board, request| Some(load(board, &folder, &DeserializeRequest::of(request)?).to_vec())),
    )?;
    offer(
        Place::Node,
        "pause_new_measurements",
        toolbox("Pause"),
        Box::new(|board, _| {
            board.inbox.pause(!board.inbox.is_paused());
            Some(PAUSED.to_vec())
        }),
    )?;
    offer(
        Place::Node,
        "reset",
        toolbox("Reset"),
        Box::new(|board, request| {
            let pauses = truth_of(request)?;
            let done = board.inbox.change(Change::Reset);
            // As with slam_toolbox: it is set, not toggled.
            done.is_ok().then(|| board.inbox.pause(pauses));
            Some((if done.is_ok() { DONE } else { FAILED }).to_vec())
        }),
    )?;
    // Nodes are not moved by hand, so that there is no such change to be taken back.
    offer(Place::Node, "clear_changes", toolbox("Clear"), Box::new(|_, _| Some(EMPTY.to_vec())))?;
    offer(
        Place::Node,
        "dynamic_map",
        ("nav_msgs", "GetMap"),
        Box::new(move |board, _| {
            let stamp_s = board.situation().step.as_ref().map_or(0.0, |step| step.stamp_s);
            // Without the four bytes of CDR.
            Some(occupancy_grid(&board.picture().map, stamp_s, &map_frame).split_off(4))
        }),
    )?;
    if board.mode != Mode::Localization {
        return Ok(());
    }
    let empty = ("std_srvs", "Empty");
    offer(
        Place::Namespace,
        "reinitialize_global_localization",
        empty,
        Box::new(|board, _| {
            board.inbox.set_start(Start::Unknown);
            Some(EMPTY.to_vec())
        }),
    )?;
    // Every scan counts, also of a robot that stands still: there is nothing to be asked for.
    offer(Place::Namespace, "request_nomotion_update", empty, Box::new(|_, _| Some(EMPTY.to_vec())))?;
    offer(
        Place::Namespace,
        "set_initial_pose",
        ("nav2_msgs", "SetInitialPose"),
        Box::new(|board, request| {
            let (_, pose) = pose_of(request)?;
            board.inbox.set_start(Start::At(pose));
            Some(EMPTY.to_vec())
        }),
    )
}

/// Goes on with the session of a file, or in its map where a finished map is used; says what became of it.
fn load(board: &Board, folder: &Path, request: &DeserializeRequest) -> [u8; 1] {
    let at = match (request.match_type, board.mode) {
        (START_AT_FIRST_NODE, Mode::Mapping) => None,
        (START_AT_GIVEN_POSE, Mode::Mapping) | (LOCALIZE_AT_POSE, Mode::Localization) => Some(request.pose),
        _ => return BAD_MATCH_TYPE,
    };
    let Some(path) = session_path(folder, &request.name) else { return BAD_NAME };
    match board.inbox.change(Change::Load(path, at)) {
        Ok(()) => DONE,
        Err(Refusal::Unreadable(_)) => UNREADABLE,
        Err(_) => FAILED,
    }
}

/// The file of a session that is called so; `None` where the name would lead elsewhere.
fn session_path(folder: &Path, name: &str) -> Option<PathBuf> {
    plain_name(name).map(|name| folder.join(format!("{name}.gpkg")))
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

fn answering(node: &mut Node, place: Place, name: &str, kind: (&str, &str)) -> Result<Service, NodeError> {
    let full = match place {
        Place::Node => node.options().full_name(&format!("{}/{name}", node.options().name)),
        Place::Namespace => node.options().full_name(name),
    };
    node.service(&full, kind)
}

/// Answers on a thread of its own.
fn spawn(service: Service, board: Arc<Board>, answer: Answer) -> Result<(), NodeError> {
    let serve = move || {
        loop {
            let sent = block_on(service.next()).and_then(|(asked, request)| {
                let (prefix, request) = asked.take_apart(request)?;
                let fields = answer(&board, &request)?;
                service.send(&asked, [prefix, fields].concat())
            });
            if sent.is_none() {
                // What is no request may come often.
                thread::sleep(REST);
            }
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
