//! Real recordings are read whole, with their known traps.

mod data_folder;

use data_folder::data;
use floorprint::Frames;
use floorprint::config::Layer;
use floorprint::evaluation::{Alignment, RelationReport, TrajectoryError, TrajectoryErrorOptions, WallSharpness};
use floorprint::geometry::Pose2;
use floorprint::sensors::Record;
use floorprint::{Config, Frame, Slam, SlamError, SlamResult};
use floorprint_io::{DropReason, OpenOptions, open, read_relations, read_trajectory};

#[test]
fn every_scan_of_the_benchmark_logs_is_read() {
    let Some(data) = data() else { return };
    for (name, scans, rays, no_return_m, relations) in
        [("intel", 13631, 180, 81.83, 2984), ("aces", 7374, 180, 50.0, 1279), ("mit-csail", 1988, 361, 81.91, 1172)]
    {
        let folder = data.join("relations").join(name);
        let log = open(&folder.join(format!("{name}.clf.gz")), &OpenOptions::default()).unwrap();
        assert_eq!(log.scans().count(), scans);
        assert_eq!(log.dropped.total(), 0);
        for scan in log.scans() {
            assert_eq!(scan.ranges_m.len(), rays);
            assert!(scan.odometry.is_some());
            let limit = scan.geometry.range_max_m;
            assert!(limit <= no_return_m && limit > no_return_m - 0.02, "{name}: {limit}");
        }
        assert_eq!(read_relations(&folder.join(format!("{name}.relations"))).unwrap().len(), relations);
    }
}

/// Maps what these frames show; tells also how uncertain each step's pose was said to be at the time, sorted, metres.
fn solve(frames: &[Frame], config: &Config) -> Result<(SlamResult, Vec<f64>), SlamError> {
    let mut slam = Slam::new(config);
    let mut sigmas_m = Vec::new();
    for frame in frames {
        sigmas_m.extend(slam.process(frame)?.uncertainty.map(|uncertainty| uncertainty.sigma_m));
    }
    sigmas_m.sort_by(f64::total_cmp);
    Ok((slam.finish(), sigmas_m))
}

/// One configuration serves all logs: errors stay where they are (BENCHMARK.md), and walls that were seen on several
/// passes are single.
#[test]
fn the_benchmark_logs_are_solved_by_default() {
    let Some(data) = data() else { return };
    for (name, bound_m, bound_deg, bound_doubled) in
        [("intel", 0.0145, 0.23, 0.035), ("aces", 0.035, 0.33, 0.0165), ("mit-csail", 0.0275, 0.34, 0.03)]
    {
        let folder = data.join("relations").join(name);
        let log = open(&folder.join(format!("{name}.clf.gz")), &OpenOptions::default()).unwrap();
        let relations = read_relations(&folder.join(format!("{name}.relations"))).unwrap();
        let config = Config::resolve(&[Layer::from_robot(&log.robot)]).unwrap();
        let frames: Vec<Frame> = Frames::new(&log.records, &config).unwrap().iter().collect();
        let (result, sigmas_m) = solve(&frames, &config).unwrap();
        // Stamps that jitter by the whole interval once made hundreds of metres of it.
        let [median_m, largest_m] = [sigmas_m.len() / 2, sigmas_m.len() - 1].map(|index| sigmas_m[index]);
        assert!(median_m < 2.0 && largest_m < 15.0, "{name}: {median_m} m, {largest_m} m");
        let errors = RelationReport::new(&result.trajectory, &relations).unwrap().all;
        let (translation, rotation) = (errors.translation_m.unwrap(), errors.rotation_deg.unwrap());
        assert!(translation.mean < bound_m && rotation.mean < bound_deg, "{name}: {translation:?}, {rotation:?}");
        let walls = WallSharpness::of(&result.map.to_raster().unwrap()).unwrap();
        assert!(walls.doubled_share < bound_doubled, "{name}: {walls:?}");
        assert!(result.kidnappings.is_empty(), "{name}: {:?}", result.kidnappings);
    }
}

/// By the walls ahead of the robot, whose distance the scans measure, intel's odometry reads 3.4 to 4.1 % too long.
#[test]
fn odometry_that_reads_too_long_is_noticed() {
    let Some(data) = data() else { return };
    let log = open(&data.join("relations/intel/intel.clf.gz"), &OpenOptions::default()).unwrap();
    let config = Config::resolve(&[Layer::from_robot(&log.robot)]).unwrap();
    let mut slam = Slam::new(&config);
    for frame in Frames::new(&log.records, &config).unwrap().iter() {
        slam.process(&frame).unwrap();
    }
    let reads = 1.0 / slam.odometry_scale().unwrap();
    assert!((1.034..1.042).contains(&reads), "{reads}");
}

/// A robot whose scans come rarely turns and drives far between two of them: it sees much that is new, but was not
/// carried elsewhere.
#[test]
fn logs_of_which_few_scans_are_left_are_solved_too() {
    let Some(data) = data() else { return };
    for (name, every, first, bound_m) in [
        ("aces", 4, 1, 0.05),
        ("aces", 3, 0, 0.05),
        ("mit-csail", 3, 0, 0.05),
        ("mit-csail", 3, 2, 0.07),
        ("mit-csail", 4, 3, 0.1),
    ] {
        let folder = data.join("relations").join(name);
        let log = open(&folder.join(format!("{name}.clf.gz")), &OpenOptions::default()).unwrap();
        let relations = read_relations(&folder.join(format!("{name}.relations"))).unwrap();
        let config = Config::resolve(&[Layer::from_robot(&log.robot)]).unwrap();
        let (mut frames, mut motion): (Vec<Frame>, _) = (Vec::new(), Pose2::IDENTITY);
        for (index, mut frame) in Frames::new(&log.records, &config).unwrap().iter().enumerate() {
            motion = frame.motion.map_or(motion, |step| motion.compose(&step));
            if index % every == first {
                (frame.index, frame.motion) = (frames.len(), Some(std::mem::replace(&mut motion, Pose2::IDENTITY)));
                frames.push(frame);
            }
        }
        let (result, _) = solve(&frames, &config).unwrap();
        let errors = RelationReport::new(&result.trajectory, &relations).unwrap().all.translation_m.unwrap();
        assert!(result.kidnappings.is_empty(), "{name}, each {every}: {:?}", result.kidnappings);
        assert!(errors.mean < bound_m, "{name}, each {every}: {errors:?}");
    }
}

/// In buildings that were scanned a metre and more apart much of every scan is new, and walls were hit far apart: that is
/// ordinary there, and nobody carried the robot.
#[test]
fn buildings_scanned_a_metre_apart_are_not_torn_apart() {
    let Some(data) = data() else { return };
    for (name, bound_m) in [("acapulco", 0.3), ("edmonton", 0.5), ("seattle", 0.1)] {
        let folder = data.join("radish");
        let log = open(&folder.join(format!("{name}.log.gz")), &OpenOptions::default()).unwrap();
        let reference = read_trajectory(&folder.join(format!("{name}.truth.tum.gz"))).unwrap();
        let config = Config::resolve(&[Layer::from_robot(&log.robot)]).unwrap();
        let frames: Vec<Frame> = Frames::new(&log.records, &config).unwrap().iter().collect();
        let (result, _) = solve(&frames, &config).unwrap();
        assert!(result.kidnappings.is_empty(), "{name}: {:?}", result.kidnappings);
        let options =
            TrajectoryErrorOptions { alignment: Alignment::LeastSquares, ..TrajectoryErrorOptions::default() };
        let error = TrajectoryError::new(&result.trajectory, &reference, &options).unwrap().translation_m;
        assert!(error.rmse < bound_m, "{name}: {error:?}");
    }
}

#[test]
fn the_courses_drive_is_read_with_its_images() {
    let Some(data) = data() else { return };
    let folder = data.join("ece276a/semi20");
    let drive = open(&folder, &OpenOptions::default()).unwrap();
    let truth = read_trajectory(&folder.join("truth.tum")).unwrap();
    let stamps: Vec<f64> = drive.scans().map(|scan| scan.stamp_s).collect();
    assert_eq!(stamps.len(), 4962);
    assert!(stamps.iter().zip(&truth).all(|(stamp, truth)| (stamp - truth.stamp_s).abs() < 2e-6));
    assert!(drive.records.is_sorted_by(|a, b| a.stamp_s() <= b.stamp_s()));
    let scan = drive.scans().next().unwrap();
    assert_eq!((scan.ranges_m.len(), scan.geometry.range_max_m), (1081, 30.0));
    assert!((scan.geometry.angles_rad[1080] - 135_f64.to_radians()).abs() < 1e-6);
    let (mut ticks, mut imu) = (0.0, 0);
    for record in &drive.records {
        match record {
            Record::Encoders(reading) => ticks += (reading.left_ticks + reading.right_ticks) / 2.0,
            Record::Imu(_) => imu += 1,
            _ => {}
        }
    }
    assert_eq!(imu, 12187);
    // The drive's path is 93 m long; it is driven forwards but for a few metres.
    assert!((ticks * 0.0022 - 93.0).abs() < 6.0, "{} m", ticks * 0.0022);
    let images = drive.images.unwrap();
    assert_eq!((images.depth.len(), images.color.len()), (121, 114));
    let (disparity, color) = (images.depth[60].load_depth().unwrap(), images.color[60].load_color().unwrap());
    assert_eq!((disparity.width, disparity.height, disparity.values.len()), (640, 480, 640 * 480));
    assert_eq!((color.width, color.height, color.rgb.len()), (640, 480, 640 * 480));
}

#[test]
fn parts_that_are_missing_are_named() {
    let Some(data) = data() else { return };
    let folder = data.join("ece276a/real");
    let error = open(&folder, &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("20, 21, 23"), "{error}");
    let drive = open(&folder, &OpenOptions { drive: Some(23), ..OpenOptions::default() }).unwrap();
    assert!(drive.scans().next().is_none() && drive.robot.wheels.is_some() && drive.robot.camera.is_none());
    assert!(
        drive.notes.iter().any(|note| note.contains("Hokuyo"))
            && drive.notes.iter().any(|note| note.contains("Kinect"))
    );
    let without_images = open(&folder, &OpenOptions { drive: Some(20), ..OpenOptions::default() }).unwrap();
    assert_eq!(without_images.dropped.count(DropReason::MissingImage), 2407 + 2289);
    assert!(without_images.images.is_none() && without_images.robot.camera.is_none());
}

#[test]
fn encoder_logs_keep_every_count() {
    let Some(data) = data() else { return };
    for (name, scans, ticks) in [("exp1", 756, [182_565.0, 185_111.0]), ("exp2", 641, [177_534.0, 179_420.0])] {
        let log = open(&data.join("encoders-urg").join(format!("{name}.dat.gz")), &OpenOptions::default()).unwrap();
        assert_eq!((log.scans().count(), log.dropped.total()), (scans, 0));
        let sum = log.records.iter().fold([0.0; 2], |[left, right], record| match record {
            Record::Encoders(reading) => [left + reading.left_ticks, right + reading.right_ticks],
            _ => [left, right],
        });
        assert_eq!(sum, ticks);
    }
}
