//! Sessions: what is stored of a drive is enough to go on, to put drives together, and to change the map.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod simulation;

use floorprint::config::Layer;
use floorprint::geometry::{Polygon, Pose2};
use floorprint::map::{Occupancy, Raster, difference};
use floorprint::sensors::RobotConfig;
use floorprint::session::{Region, Session, SessionMemory};
use floorprint::simulator::{SimulatedDrive, World, simulate};
use floorprint::storage::{StorageTrouble, Store, StoreError};
use floorprint::{Config, Frame, Frames, Slam, SlamResult, StopSignal};
use simulation::quick;
use std::f64::consts::FRAC_PI_2;

struct Drive {
    simulated: SimulatedDrive,
    frames: Vec<Frame>,
    config: Config,
}

impl Drive {
    fn new(world: &str, seed: u64) -> Self {
        let simulated = simulate(World::named(world, seed).unwrap(), quick(), seed).unwrap();
        let config = Config::resolve(&[Layer::from_robot(&RobotConfig::ece276a())]).unwrap();
        let records = simulated.records();
        let frames = Frames::new(&records, &config).unwrap().iter().collect();
        Self { simulated, frames, config }
    }

    fn solve(&self, frames: &[Frame]) -> SlamResult {
        self.go_on(Slam::new(&self.config), frames)
    }

    fn go_on(&self, mut slam: Slam, frames: &[Frame]) -> SlamResult {
        for frame in frames {
            slam.process(frame).unwrap();
        }
        slam.finish()
    }

    /// The session as it comes back from where it was stored.
    fn restored(&self, session: &Session) -> Session {
        let state = session.state(&self.config.matcher);
        Session::restore(state, session.poses().to_vec(), session.scans().to_vec()).unwrap()
    }

    /// The largest distance of a pose from the true one, metres; `true_start` is where the session's world begins.
    fn largest_error_m(&self, result: &SlamResult, from_frame: usize) -> f64 {
        let errors = result.trajectory[from_frame..]
            .iter()
            .map(|pose| self.simulated.true_pose(pose.stamp_s).between(&pose.pose).distance());
        errors.fold(0.0, f64::max)
    }
}

/// Loops are closed until the signal is given, and what is left at the end is left out.
#[test]
fn a_signal_ends_the_work_early_and_what_was_seen_counts() {
    let drive = Drive::new("rooms", 1);
    let whole = drive.solve(&drive.frames);
    assert!(whole.closures.len() > 3, "the test needs loops");
    let (signal, half) = (StopSignal::default(), drive.frames.len() / 2);
    let mut slam = Slam::new(&drive.config);
    slam.stop_on(&signal);
    let steps: Vec<_> = drive.frames[..half].iter().map(|frame| slam.process(frame).unwrap()).collect();
    let closures_until_then = slam.session().places().map_or(0, |places| places.reports().len());
    assert!(!signal.give() && signal.give(), "it was given but once before");
    // What was on its way is still tracked.
    for frame in &drive.frames[half..half + 50] {
        slam.process(frame).unwrap();
    }
    let stopped = slam.finish();
    assert_eq!(steps.len(), half);
    assert_eq!(stopped.trajectory.len(), half + 50);
    assert_eq!(stopped.closures.len(), closures_until_then);
    assert!(drive.largest_error_m(&stopped, 0) < 1.0);
    assert!(stopped.map.to_raster().unwrap().cells.contains(&Occupancy::Occupied));
    // The session of a run that was stopped can be gone on with.
    let again = Slam::resume(drive.restored(&stopped.session), &drive.config).unwrap();
    let gone_on = drive.go_on(again, &drive.frames[half + 50..]);
    assert_eq!(gone_on.trajectory.len(), drive.frames.len());
    assert!(gone_on.closures.len() > closures_until_then);
}

fn occupied(map: &Raster<Occupancy>, polygon: &Polygon) -> usize {
    let cells = (0..map.cells.len()).filter(|&cell| map.cells[cell] == Occupancy::Occupied);
    cells.filter(|&cell| polygon.contains(map.center_m(cell))).count()
}

#[test]
fn what_is_stored_is_the_same_session() {
    let drive = Drive::new("rooms", 1);
    let result = drive.solve(&drive.frames);
    let restored = drive.restored(&result.session);
    assert_eq!(restored.trajectory(), result.trajectory);
    assert_eq!(restored.map().to_raster(), result.map.to_raster());
}

#[test]
fn a_drive_in_pieces_is_as_good_as_in_one_go() {
    let drive = Drive::new("loop", 2);
    let whole = drive.solve(&drive.frames);
    let third = drive.frames.len() / 3;
    let mut session: Option<Session> = None;
    let mut pieces = None;
    for frames in [&drive.frames[..third], &drive.frames[third..2 * third], &drive.frames[2 * third..]] {
        let slam = match session.take() {
            Some(session) => Slam::resume(session, &drive.config).unwrap(),
            None => Slam::new(&drive.config),
        };
        let result = drive.go_on(slam, frames);
        session = Some(drive.restored(&result.session));
        pieces = Some(result);
    }
    let pieces = pieces.unwrap();
    assert_eq!(pieces.trajectory.len(), drive.frames.len());
    let (of_whole, of_pieces) = (drive.largest_error_m(&whole, 0), drive.largest_error_m(&pieces, 0));
    assert!(of_pieces < of_whole + 0.02, "{of_pieces} m in pieces, {of_whole} m in one go");
    assert!(pieces.kidnappings.is_empty(), "{:?}", pieces.kidnappings);
}

#[test]
fn a_second_drive_finds_its_place_on_the_first() {
    let drive = Drive::new("rooms", 3);
    let middle = drive.frames.len() / 2;
    let (first, second) = (drive.solve(&drive.frames[..middle]), drive.solve(&drive.frames[middle..]));
    let slam = Slam::resume(drive.restored(&first.session), &drive.config).unwrap();
    let merged = slam.append(&drive.restored(&second.session), &drive.config).unwrap().finish();
    assert!(merged.kidnappings.iter().all(|kidnapping| kidnapping.found.is_some()), "{:?}", merged.kidnappings);
    let error_m = drive.largest_error_m(&merged, middle);
    assert!(error_m < 0.1, "{error_m} m");
}

#[test]
fn a_robot_begins_where_it_is_said_to_be_and_finds_its_place() {
    let drive = Drive::new("rooms", 3);
    let middle = drive.frames.len() / 2;
    let first = drive.solve(&drive.frames[..middle]);
    let mut slam = Slam::resume(drive.restored(&first.session), &drive.config).unwrap();
    // Whoever says it knows it about.
    let said = drive.simulated.true_pose(drive.frames[middle].stamp_s).compose(&Pose2::new(0.3, -0.2, 0.1));
    slam.interrupt_at(&said);
    let beginning = Frame { motion: None, ..drive.frames[middle].clone() };
    let report = slam.process(&beginning).unwrap();
    assert!(report.is_lost && said.between(&report.pose).distance() < 0.15, "{said:?}, {report:?}");
    let result = drive.go_on(slam, &drive.frames[middle + 1..]);
    assert!(!result.kidnappings.is_empty(), "it was not taken to be anywhere");
    assert!(result.kidnappings.iter().all(|kidnapping| kidnapping.found.is_some()), "{:?}", result.kidnappings);
    let error_m = drive.largest_error_m(&result, middle);
    assert!(error_m < 0.1, "{error_m} m");
}

#[test]
fn drives_of_other_buildings_are_kept_apart() {
    for (one, other) in [("rooms", "pillars"), ("corridors", "rooms"), ("loop", "corridors")] {
        let (one, other) = (Drive::new(one, 1), Drive::new(other, 1));
        let (first, second) = (one.solve(&one.frames), other.solve(&other.frames));
        let slam = Slam::resume(first.session, &one.config).unwrap();
        let merged = slam.append(&second.session, &one.config).unwrap().finish();
        let apart = merged.kidnappings.iter().find(|kidnapping| kidnapping.frame == one.frames.len()).unwrap();
        assert!(apart.found.is_none(), "{apart:?}");
    }
}

#[test]
fn what_is_erased_is_gone_and_the_rest_stays() {
    let drive = Drive::new("rooms", 1);
    let result = drive.solve(&drive.frames);
    let before = result.session.map().to_raster().unwrap();
    // A square metre around the first occupied cell of the middle row.
    let middle = before.height / 2 * before.width;
    let wall = (middle..).find(|&cell| before.cells[cell] == Occupancy::Occupied).unwrap();
    let [x, y] = before.center_m(wall);
    let square =
        Polygon::new(vec![[x - 0.5, y - 0.5], [x + 0.5, y - 0.5], [x + 0.5, y + 0.5], [x - 0.5, y + 0.5]]).unwrap();
    let matcher = &drive.config.matcher;

    let erased = result.session.restricted_to(&Region::Outside(square.clone()), matcher).unwrap();
    let map = erased.map().to_raster().unwrap();
    // A cell at the rim may hold a hit beyond it.
    let inner =
        Polygon::new(square.corners_m().iter().map(|[cx, cy]| [x + 0.9 * (cx - x), y + 0.9 * (cy - y)]).collect());
    assert!(occupied(&before, &square) > 10 && occupied(&map, &inner.unwrap()) == 0);
    assert_eq!(erased.trajectory(), result.trajectory);
    let changed = |before: &_, after: &_| difference(before, after, 0.1, 0.0);
    let patches = changed(&before, &map);
    let corners = patches.iter().flat_map(|patch| patch.outlines_m.iter().flatten());
    assert!(corners.clone().all(|[cx, cy]| (cx - x).abs() < 0.6 && (cy - y).abs() < 0.6), "{patches:?}");
    // Who goes on with it sees what stands there again.
    let again = Slam::resume(drive.restored(&erased), &drive.config).unwrap().finish();
    assert_eq!(again.trajectory.len(), result.trajectory.len());

    let cropped = result.session.restricted_to(&Region::Inside(square.clone()), matcher).unwrap();
    assert!(cropped.map().to_raster().is_none_or(|map| {
        let all = (0..map.cells.len()).filter(|&cell| map.cells[cell] == Occupancy::Occupied);
        all.count() <= occupied(&before, &square) + 10
    }));
}

#[test]
fn a_session_is_turned_to_its_walls_and_goes_on_turned() {
    let drive = Drive::new("rooms", 1);
    let middle = drive.frames.len() / 2;
    let first = drive.solve(&drive.frames[..middle]).session;
    let matcher = &drive.config.matcher;
    let turn = Pose2::new(1.0, -2.0, 0.2);
    let angle_rad = first.angle_to_walls(matcher).unwrap();
    let moved = drive.restored(&first.clone().moved(&turn));
    let quarters = (moved.angle_to_walls(matcher).unwrap() - (angle_rad - turn.theta)) / FRAC_PI_2;
    assert!((quarters - quarters.round()).abs() < 1e-3, "{quarters} right angles");
    let straight = first.clone().moved(&Pose2::new(0.0, 0.0, angle_rad));
    assert!(straight.angle_to_walls(matcher).unwrap().abs() < 1e-3);
    let mut slam = Slam::resume(moved, &drive.config).unwrap();
    for frame in &drive.frames[middle..] {
        let report = slam.process(frame).unwrap();
        let true_pose = turn.compose(&drive.simulated.true_pose(frame.stamp_s));
        assert!(true_pose.between(&report.pose).distance() < 0.2, "{report:?}");
    }
    let result = slam.finish();
    let last = result.trajectory.last().unwrap();
    let true_pose = turn.compose(&drive.simulated.true_pose(last.stamp_s));
    assert!(true_pose.between(&last.pose).distance() < 0.1);
}

/// The drive to and fro, so many times: the way back is its scans in reverse order with inverted motions.
fn to_and_fro(frames: &[Frame], times: usize) -> impl Iterator<Item = Frame> {
    let back = frames.iter().enumerate().rev().map(|(k, frame)| {
        let motion = frames.get(k + 1).map_or(Some(Pose2::IDENTITY), |next| next.motion.map(|step| step.inverse()));
        Frame { motion, ..frame.clone() }
    });
    let there = frames.iter().enumerate().map(|(k, frame)| {
        let motion = if k == 0 { Some(Pose2::IDENTITY) } else { frame.motion };
        Frame { motion, ..frame.clone() }
    });
    let trip: Vec<Frame> = there.chain(back).collect();
    (0..times).flat_map(move |_| trip.clone())
}

/// A store that has room for so many pieces.
#[derive(Debug)]
struct Room {
    pieces: Vec<Vec<u8>>,
    most: usize,
}

impl Store for Room {
    fn put(&mut self, bytes: &[u8]) -> Result<u64, StoreError> {
        if self.pieces.len() >= self.most {
            return Err(StoreError("no room is left".to_owned()));
        }
        self.pieces.push(bytes.to_vec());
        Ok(self.pieces.len() as u64 - 1)
    }

    fn get(&mut self, key: u64, length: usize) -> Result<Vec<u8>, StoreError> {
        assert_eq!(self.pieces[key as usize].len(), length);
        Ok(self.pieces[key as usize].clone())
    }

    fn free(&mut self, key: u64, _: usize) {
        self.pieces[key as usize].clear();
    }
}

#[test]
fn with_bounded_memory_results_are_the_same_for_any_number_of_threads() {
    let mut drive = Drive::new("rooms", 1);
    drive.config.loop_closure.passes_kept = 2;
    let frames: Vec<Frame> = to_and_fro(&drive.frames, 3).collect();
    let rooms = |most| Box::new(Room { pieces: Vec::new(), most });
    // How much may lie in memory, how many pieces the store takes, threads.
    let solved = |bound: Option<(usize, usize)>, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut slam = Slam::new(&drive.config);
            let (half, rest) = frames.split_at(frames.len() / 2);
            half.iter().for_each(|frame| _ = slam.process(frame).unwrap());
            // What is there already is bounded, too.
            bound.into_iter().for_each(|(most_bytes, most)| slam.limit_memory(rooms(most), most_bytes));
            rest.iter().for_each(|frame| _ = slam.process(frame).unwrap());
            let (memory, on_the_way) = (slam.memory(), slam.map().to_raster().unwrap().cells);
            let restored = drive.restored(slam.session()).map().to_raster().unwrap().cells;
            let trouble = slam.storage_trouble();
            let result = slam.finish();
            let session = result.session.state(&drive.config.matcher);
            let kept = (result.session.scans().to_vec(), result.session.poses(), format!("{session:?}"));
            let end = (result.trajectory, result.map.to_raster().unwrap().cells, format!("{:?}", result.closures));
            (memory, trouble, (on_the_way, restored, kept, end))
        })
    };
    let (unbounded, _, expected) = solved(None, 1);
    assert_eq!(unbounded.put_away, 0);
    for (most_bytes, threads) in [(0, 1), (0, 8), (30_000, 2)] {
        let (memory, trouble, results) = solved(Some((most_bytes, usize::MAX)), threads);
        // What is not settled yet is held as before.
        assert!(memory.put_away > unbounded.key_scans / 2, "{memory:?} of {unbounded:?}");
        assert_eq!(trouble, None);
        assert!(results == expected, "{most_bytes} bytes, {threads} threads");
    }
    // When the store is full the drive goes on in memory.
    let (memory, trouble, results) = solved(Some((0, 10)), 1);
    assert_eq!(trouble, Some(StorageTrouble::Full("no room is left".to_owned())));
    assert!(memory.total() > unbounded.total() / 2 && results == expected);
}

#[test]
fn a_session_grows_with_the_area_and_not_with_the_distance() {
    let mut drive = Drive::new("rooms", 1);
    drive.config.loop_closure.passes_kept = 2;
    let mut slam = Slam::new(&drive.config);
    let mut sizes = Vec::new();
    for _ in 0..4 {
        for frame in to_and_fro(&drive.frames, 3) {
            slam.process(&frame).unwrap();
        }
        sizes.push(slam.memory());
    }
    let growth = |of: fn(&SessionMemory) -> usize| of(&sizes[3]) as f64 / of(&sizes[1]) as f64;
    assert!(growth(|memory| memory.trajectory) > 1.5, "{sizes:?}");
    assert!(growth(|memory| memory.key_scans) < 1.1, "{sizes:?}");
    assert!(growth(|memory| memory.looks) < 1.1, "{sizes:?}");
    assert!(growth(|memory| memory.comparisons) < 1.1, "{sizes:?}");
    // What was forgotten is missed neither by the map nor by the trajectory, nor by who goes on.
    let drawn = slam.map().to_raster().unwrap();
    let session = drive.restored(slam.session());
    let fresh = session.map().to_raster().unwrap();
    let differs = (0..drawn.cells.len()).filter(|&cell| fresh.at(drawn.center_m(cell)) != Some(&drawn.cells[cell]));
    assert!(differs.count() * 100 < drawn.cells.len());
    let stamps: Vec<f64> = to_and_fro(&drive.frames, 12).map(|frame| frame.stamp_s).collect();
    for result in [slam.finish(), Slam::resume(session, &drive.config).unwrap().finish()] {
        assert_eq!(result.trajectory.len(), stamps.len());
        for (frame, (pose, stamp_s)) in result.trajectory.iter().zip(&stamps).enumerate() {
            let error_m = drive.simulated.true_pose(*stamp_s).between(&pose.pose).distance();
            assert!(error_m < 0.15, "{error_m} m at frame {frame}");
        }
    }
}
