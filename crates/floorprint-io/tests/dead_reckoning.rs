//! Dead reckoning on real drives: late encoder stamps, gyro bias, wheels against gyro.

#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise")]

mod data_folder;

use data_folder::data;
use floorprint::Config;
use floorprint::Frames;
use floorprint::SensorId;
use floorprint::evaluation::{TrajectoryError, TrajectoryErrorOptions};
use floorprint::geometry::wrap_angle;
use floorprint::odometry::{DeadReckoning, Finding, GyroBias, OdometrySource};
use floorprint::sensors::{Record, Scan, ScanGeometry, Stream};
use floorprint_io::{DataSet, OpenOptions, open, read_trajectory};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

fn config(drive: &DataSet) -> Config {
    Config { robot: drive.robot.clone(), ..Config::default() }
}

/// A drive without a LiDAR, with a scan at its beginning and at its end so that it has frames.
fn with_two_scans(mut drive: DataSet) -> DataSet {
    let geometry = Arc::new(ScanGeometry {
        angles_rad: vec![0.0],
        time_offsets_s: vec![0.0],
        range_min_m: 0.1,
        range_max_m: 30.0,
        below_minimum_is_no_return: true,
    });
    let scan = |stamp_s| {
        Record::Scan(Scan {
            sensor: SensorId::default(),
            stamp_s,
            ranges_m: vec![1.0],
            geometry: Arc::clone(&geometry),
            odometry: None,
        })
    };
    let stamps: Vec<f64> = drive.records.iter().map(Record::stamp_s).collect();
    drive.records.extend([scan(stamps[0]), scan(stamps[stamps.len() - 1])]);
    drive
}

fn open_drive(folder: &Path, number: u32) -> DataSet {
    open(folder, &OpenOptions { drive: Some(number), ..OpenOptions::default() }).unwrap()
}

/// Root mean square of how far the wheels' and the gyro's turn disagree, mrad per 25 ms.
fn disagreement_mrad(drive: &DataSet, config: &Config) -> f64 {
    let path = |source| {
        let mut config = config.clone();
        config.odometry.source = source;
        Frames::new(&drive.records, &config).unwrap().dead_reckoning()
    };
    let (wheels, gyro): (DeadReckoning, DeadReckoning) =
        (path(OdometrySource::Wheels), path(OdometrySource::WheelsAndGyro));
    let [first_s, last_s] = wheels.span_s().unwrap();
    let count = ((last_s - first_s) / 0.025) as usize;
    let squares: f64 = (0..count)
        .map(|step| first_s + 0.025 * step as f64)
        .map(|from_s| {
            let turn = |path: &DeadReckoning| path.motion(from_s, from_s + 0.025).theta;
            wrap_angle(turn(&wheels) - turn(&gyro)).powi(2)
        })
        .sum();
    1e3 * (squares / count as f64).sqrt()
}

#[test]
fn putting_late_encoder_stamps_back_makes_the_wheels_agree_with_the_truth() {
    let Some(data) = data() else { return };
    let folder = data.join("ece276a/semi20");
    let drive = open(&folder, &OpenOptions::default()).unwrap();
    let truth = read_trajectory(&folder.join("truth.tum")).unwrap();
    let speed_error_mm = |repair, survey| {
        let mut config = config(&drive);
        config.odometry.repair_encoder_stamps = repair;
        config.odometry.survey = survey;
        let dead_reckoning = Frames::new(&drive.records, &config).unwrap().dead_reckoning();
        let squares: f64 = truth
            .windows(2)
            .map(|pair| {
                let driven = dead_reckoning.motion(pair[0].stamp_s, pair[1].stamp_s);
                let [forward, _, _] = pair[0].pose.between(&pair[1].pose).log();
                (driven.log()[0] - forward).powi(2)
            })
            .sum();
        1e3 * (squares / truth.len() as f64).sqrt()
    };
    let stamped = speed_error_mm(false, true);
    for survey in [true, false] {
        let repaired = speed_error_mm(true, survey);
        println!(
            "distance between scans against the truth: {stamped:.2} mm as stamped, {repaired:.2} mm repaired (survey: {survey})"
        );
        assert!(repaired < 0.6 * stamped && repaired < 1.4, "{stamped} {repaired}");
    }
}

#[test]
fn every_correction_brings_dead_reckoning_nearer_to_the_truth() {
    let Some(data) = data() else { return };
    let folder = data.join("ece276a/semi20");
    let drive = open(&folder, &OpenOptions::default()).unwrap();
    let truth = read_trajectory(&folder.join("truth.tum")).unwrap();
    let error_m = |source, repair, bias| {
        let mut config = config(&drive);
        config.odometry.source = source;
        config.odometry.repair_encoder_stamps = repair;
        config.odometry.gyro_bias = bias;
        let frames = Frames::new(&drive.records, &config).unwrap();
        let poses = frames.dead_reckoned_poses();
        let error = TrajectoryError::new(&poses, &truth, &TrajectoryErrorOptions::default()).unwrap();
        println!(
            "{source:?}, repaired {repair}, {bias:?}: {:.3} m, {:.2}°",
            error.translation_m.rmse, error.rotation_deg.rmse
        );
        error.translation_m.rmse
    };
    let raw = error_m(OdometrySource::WheelsAndGyro, false, GyroBias::None);
    let repaired = error_m(OdometrySource::WheelsAndGyro, true, GyroBias::None);
    let one_bias = error_m(OdometrySource::WheelsAndGyro, true, GyroBias::Standstill);
    let drift = error_m(OdometrySource::WheelsAndGyro, true, GyroBias::StandstillWithDrift);
    let wheels = error_m(OdometrySource::Wheels, true, GyroBias::StandstillWithDrift);
    assert!(repaired <= 1.01 * raw && one_bias < 0.9 * repaired && drift <= 1.01 * one_bias && drift < wheels);
}

#[test]
fn de_skewing_sharpens_the_walls_seen_in_a_turn() {
    let Some(data) = data() else { return };
    let folder = data.join("ece276a/semi20");
    let drive = open(&folder, &OpenOptions::default()).unwrap();
    let truth = read_trajectory(&folder.join("truth.tum")).unwrap();
    let turning = |index: usize| index > 0 && truth[index - 1].pose.between(&truth[index].pose).theta.abs() > 0.012;
    let occupied_cells = |deskew| {
        let mut config = config(&drive);
        config.scan.deskew = deskew;
        config.scan.range_max_m = 10.0;
        let frames = Frames::new(&drive.records, &config).unwrap();
        let cells: BTreeSet<_> = frames
            .iter()
            .enumerate()
            .filter(|&(index, _)| turning(index))
            .map(|(index, frame)| (truth[index].pose, frame.scan.hits))
            .flat_map(|(pose, hits)| {
                hits.iter().map(|hit| pose.transform_point(hit.map(f64::from))).collect::<Vec<_>>()
            })
            .map(|point| point.map(|coordinate_m| (coordinate_m / 0.02).floor() as i32))
            .collect();
        cells.len()
    };
    let (skewed, deskewed) = (occupied_cells(false), occupied_cells(true));
    println!("cells of 2 cm in which walls are seen in turns: {skewed}, de-skewed {deskewed}");
    assert!(10 * deskewed < 9 * skewed, "{skewed} {deskewed}");
}

#[test]
fn wheels_and_gyro_agree_better_once_the_stamps_are_put_back() {
    let Some(data) = data() else { return };
    for (number, share) in [(20, 0.95), (21, 0.75), (23, 1.01)] {
        let drive = with_two_scans(open_drive(&data.join("ece276a/real"), number));
        let mut config = config(&drive);
        let repaired = disagreement_mrad(&drive, &config);
        config.odometry.repair_encoder_stamps = false;
        let stamped = disagreement_mrad(&drive, &config);
        println!("drive {number}: {stamped:.3} mrad as stamped, {repaired:.3} mrad repaired");
        config.odometry.repair_encoder_stamps = true;
        config.odometry.survey = false;
        let causal = disagreement_mrad(&drive, &config);
        println!("  causal: {causal:.3} mrad repaired");
        assert!(causal < 1.05 * repaired, "{causal} {repaired}");
        config.odometry.survey = true;
        let frames = Frames::new(&drive.records, &config).unwrap();
        println!("  {:?}; end of the drive: {:?}", frames.summary().findings, frames.dead_reckoned_poses().last());
        assert!(repaired < share * stamped);
    }
}

#[test]
fn counters_read_with_the_scan_are_taken_as_stamped() {
    let Some(data) = data() else { return };
    for name in ["exp1", "exp2"] {
        let drive = open(&data.join(format!("encoders-urg/{name}.dat.gz")), &OpenOptions::default()).unwrap();
        let end = |repair| {
            let mut config = config(&drive);
            config.odometry.repair_encoder_stamps = repair;
            let frames = Frames::new(&drive.records, &config).unwrap();
            // This robot's laser stamps its scans when they have arrived, well after the counters were read.
            let findings = frames.summary().findings;
            assert!(
                matches!(findings[..], [Finding::Lag { sensor: Stream::Encoders, late_s }, Finding::NoImu]
                    if (-0.2..-0.13).contains(&late_s)),
                "{findings:?}"
            );
            assert_eq!((frames.len(), frames.summary().dropped.total()), (drive.scans().count(), 0));
            frames.dead_reckoned_poses()
        };
        assert_eq!(end(true), end(false));
    }
}

#[test]
fn a_log_s_own_poses_are_followed_scan_by_scan() {
    let Some(data) = data() else { return };
    let log = open(&data.join("relations/intel/intel.clf.gz"), &OpenOptions::default()).unwrap();
    let frames = Frames::new(&log.records, &config(&log)).unwrap();
    let stated: Vec<_> = log.scans().filter_map(|scan| scan.odometry).collect();
    assert_eq!(frames.len(), stated.len());
    let backwards = log.scans().zip(log.scans().skip(1)).filter(|(a, b)| b.stamp_s < a.stamp_s).count();
    assert_eq!(backwards, 631);
    for (frame, pair) in frames.iter().skip(1).zip(stated.windows(2)) {
        assert!(frame.motion.unwrap().between(&pair[0].between(&pair[1])).distance() < 1e-9);
        assert!(frame.elapsed_s >= 0.0);
    }
}
