//! What a robot may do to its synchroniser.

use super::*;
use crate::odometry::NoReturn;
use crate::odometry::deskew::deskewed;
use crate::sensors::{LidarConfig, ScanGeometry, StampAt, WheelConfig};
use crate::simulator::Arrival;
use proptest::prelude::*;
use std::sync::Arc;

const M_PER_TICK: f64 = 0.002;

fn geometry() -> Arc<ScanGeometry> {
    Arc::new(ScanGeometry {
        angles_rad: vec![-1.0, 0.0, 1.0],
        time_offsets_s: vec![0.0; 3],
        range_min_m: 0.1,
        range_max_m: 30.0,
        below_minimum_is_no_return: false,
    })
}

fn scan_of(sensor: u8, stamp_s: f64, odometry: Option<Pose2>) -> Record {
    let sensor = SensorId(sensor);
    Record::Scan(Scan { sensor, stamp_s, ranges_m: vec![1.0, 2.0, 3.0], geometry: geometry(), odometry })
}

fn scan(stamp_s: f64) -> Record {
    scan_of(0, stamp_s, None)
}

fn ticks(stamp_s: f64, left_ticks: f64, right_ticks: f64) -> Record {
    Record::Encoders(EncoderReading { stamp_s, left_ticks, right_ticks })
}

fn gyro(stamp_s: f64, rate: f64) -> Record {
    let angular_velocity_rad_s = [0.0, 0.0, rate];
    Record::Imu(ImuReading { stamp_s, angular_velocity_rad_s, linear_acceleration_m_s2: [0.0, 0.0, 9.81] })
}

fn pose(stamp_s: f64, x: f64) -> Record {
    Record::Odometry(StampedPose { stamp_s, pose: Pose2::new(x, 0.0, 0.0) })
}

fn config() -> Config {
    let mut config = Config::default();
    config.robot.lidar.sweep_duration_s = 0.02;
    config.robot.wheels =
        Some(WheelConfig { left_m_per_tick: M_PER_TICK, right_m_per_tick: M_PER_TICK, track_width_m: 0.5 });
    config
}

/// A drive of ten seconds: wheels at 50 Hz, a gyro at 100 Hz, a LiDAR at 20 Hz.
fn drive() -> Vec<Record> {
    let mut records = Vec::new();
    for k in 0..1000 {
        let time_s = f64::from(k) * 0.01;
        records.push(gyro(time_s, 0.4 * time_s.sin()));
        if k % 2 == 0 {
            records.push(ticks(time_s + 0.003, 4.0, 4.0 + f64::from(k % 3)));
        }
        if k % 5 == 2 {
            records.push(scan(time_s + 0.001));
        }
    }
    records
}

/// Everything that a frame says, so that equal means equal bytes.
fn bytes(frames: &[Frame]) -> Vec<String> {
    frames.iter().map(|frame| format!("{frame:?}")).collect()
}

fn synchronised(records: impl IntoIterator<Item = Record>, config: &Config) -> (Vec<Frame>, SynchronisationSummary) {
    let mut synchronizer = Synchronizer::new(config, None).unwrap();
    let mut frames = Vec::new();
    for record in records {
        frames.extend(synchronizer.push(record).unwrap());
    }
    frames.extend(synchronizer.finish().unwrap());
    assert_eq!(synchronizer.waiting(), 0);
    (frames, synchronizer.summary())
}

fn sum(frames: &[Frame]) -> Pose2 {
    frames.iter().fold(Pose2::IDENTITY, |sum, frame| sum.compose(&frame.motion.unwrap_or(Pose2::IDENTITY)))
}

#[test]
fn frames_wait_no_longer_than_the_delay_allows_and_memory_is_bounded() {
    let config = config();
    let mut synchronizer = Synchronizer::new(&config, None).unwrap();
    let (mut clock_s, mut longest_s, mut most_knots) = (0.0_f64, 0.0_f64, 0);
    for round in 0..20 {
        for mut record in drive() {
            let shift_s = 10.0 * f64::from(round);
            match &mut record {
                Record::Scan(scan) => scan.stamp_s += shift_s,
                Record::Encoders(reading) => reading.stamp_s += shift_s,
                Record::Imu(reading) => reading.stamp_s += shift_s,
                Record::Odometry(stamped) => stamped.stamp_s += shift_s,
            }
            // From second 100 on the wheels say nothing more.
            if matches!(record, Record::Encoders(_)) && shift_s >= 100.0 {
                continue;
            }
            clock_s = clock_s.max(record.stamp_s());
            for frame in synchronizer.push(record).unwrap() {
                longest_s = longest_s.max(clock_s - frame.stamp_s);
            }
            most_knots = most_knots.max(synchronizer.dead_reckoning().knots().count());
            assert!(synchronizer.waiting() < 20);
        }
    }
    let bound_s = 2.0 * config.odometry.delay_s + config.robot.lidar.sweep_duration_s;
    assert!(longest_s > 0.5 * bound_s && longest_s < bound_s + 0.02, "{longest_s} s");
    assert!(most_knots > 100 && most_knots < 1000, "{most_knots} knots");
}

#[test]
fn with_wheels_and_gyro_a_frame_waits_for_the_next_readings_only() {
    let mut synchronizer = Synchronizer::new(&config(), None).unwrap();
    let mut longest_s = 0.0_f64;
    for record in drive() {
        let now_s = record.stamp_s();
        for frame in synchronizer.push(record).unwrap() {
            if now_s > 3.0 {
                longest_s = longest_s.max(now_s - frame.stamp_s);
            }
        }
    }
    assert!(longest_s < 0.05, "{longest_s} s");
}

#[test]
fn without_odometry_the_motion_is_unknown() {
    let (frames, summary) = synchronised([scan(1.0), scan(1.5), scan(2.0)], &config());
    assert_eq!(frames.len(), 3);
    assert!(frames.iter().all(|frame| frame.motion.is_none() && frame.dead_reckoning == Pose2::IDENTITY));
    assert_eq!(summary.findings, [Finding::NoOdometry]);
}

#[test]
fn odometry_that_stops_leaves_the_motion_unknown_and_goes_on_where_it_left_off() {
    let silent = |record: &Record| !matches!(record, Record::Encoders(_)) || !(4.0..6.0).contains(&record.stamp_s());
    let (frames, summary) = synchronised(drive().into_iter().filter(silent), &config());
    assert_eq!(frames.len(), 200);
    let unknown: Vec<f64> = frames.iter().filter(|frame| frame.motion.is_none()).map(|frame| frame.stamp_s).collect();
    assert!(unknown.iter().all(|stamp_s| (4.0..6.1).contains(stamp_s)), "{unknown:?}");
    assert!((30..=45).contains(&unknown.len()), "{unknown:?}");
    assert!(matches!(summary.findings[..], [.., Finding::OutsideOdometry { scans }] if scans >= 30));
    let later = frames.iter().filter(|frame| frame.stamp_s > 6.2);
    assert!(later.clone().count() > 70 && later.clone().all(|frame| frame.motion.unwrap().distance() > 0.001));
}

#[test]
fn a_gyro_that_stops_leaves_the_yaw_to_the_wheels() {
    let silent = |record: &Record| !matches!(record, Record::Imu(_)) || record.stamp_s() < 5.0;
    let (frames, summary) = synchronised(drive().into_iter().filter(silent), &config());
    assert!(frames.iter().all(|frame| frame.motion.is_some()));
    assert_eq!(summary.source, OdometrySource::WheelsAndGyro);
    let silent_s = summary.findings.iter().find_map(|finding| match finding {
        Finding::ImuSilent { for_s } => Some(*for_s),
        _ => None,
    });
    assert!((silent_s.unwrap() - 5.0).abs() < 0.2, "{summary:?}");
    // The wheels turn by 0.004 rad a reading in the mean.
    let turned_rad: f64 =
        frames.iter().filter(|frame| frame.stamp_s > 5.1).map(|frame| frame.motion.unwrap().theta).sum();
    assert!((turned_rad - 4.86 * 50.0 * 0.004).abs() < 0.03, "{turned_rad}");
}

#[test]
fn a_gyro_that_starts_late_is_used_from_then_on() {
    let late = |record: &Record| !matches!(record, Record::Imu(_)) || record.stamp_s() > 2.0;
    let (frames, summary) = synchronised(drive().into_iter().filter(late), &config());
    assert_eq!((frames.len(), summary.source), (200, OdometrySource::WheelsAndGyro));
    let turned_rad: f64 =
        frames.iter().filter(|frame| frame.stamp_s > 2.1).map(|frame| frame.motion.unwrap().theta).sum();
    let first_s = frames.iter().rev().find(|frame| frame.stamp_s <= 2.1).unwrap().stamp_s;
    let last_s = frames[199].stamp_s;
    assert!((turned_rad - 0.4 * (first_s.cos() - last_s.cos())).abs() < 0.02, "{turned_rad}");
}

#[test]
fn what_comes_twice_counts_once() {
    let doubled: Vec<Record> = drive().into_iter().flat_map(|record| [record.clone(), record]).collect();
    let ((once, _), (twice, summary)) = (synchronised(drive(), &config()), synchronised(doubled, &config()));
    assert_eq!(once.len(), twice.len());
    assert!(once.iter().zip(&twice).all(|(a, b)| a.motion == b.motion && a.scan.hits == b.scan.hits));
    assert_eq!((summary.dropped.scans_repeated, summary.dropped.readings_repeated), (200, 500));
    assert_eq!(summary.dropped.readings_too_late, 1000);
}

#[test]
fn poses_that_come_late_are_no_loss_where_scans_carry_their_own() {
    let late = |carries: bool| {
        let carried = |x| carries.then(|| Pose2::new(x, 0.0, 0.0));
        let records = [0.0, 0.2, 0.4, 0.6].into_iter().flat_map(|stamp_s| {
            [scan_of(0, stamp_s, carried(stamp_s)), pose(stamp_s + 0.1, stamp_s), pose(stamp_s, 9.0)]
        });
        synchronised(records, &config())
    };
    let ((frames, summary), (_, without)) = (late(true), late(false));
    assert_eq!((summary.dropped.total(), without.dropped.readings_too_late), (0, 4));
    assert!(frames.iter().skip(1).all(|frame| (frame.motion.unwrap().x - 0.2).abs() < 1e-9));
}

#[test]
fn stamps_that_run_backwards_keep_the_log_s_order_and_wait_for_nothing() {
    let at = |x| Some(Pose2::new(x, 0.0, 0.0));
    let mut config = config();
    config.robot.lidar = LidarConfig::default();
    let mut synchronizer = Synchronizer::new(&config, None).unwrap();
    let mut frames = Vec::new();
    for (count, record) in
        [scan_of(0, 10.0, at(5.0)), scan_of(0, 9.0, at(6.0)), scan_of(0, 11.0, at(8.0)), scan_of(0, 10.9, at(9.0))]
            .into_iter()
            .enumerate()
    {
        frames.extend(synchronizer.push(record).unwrap());
        // Only the very first stamp is in question until the second confirms it.
        assert_eq!(frames.len(), if count == 0 { 0 } else { count + 1 });
    }
    let motions: Vec<_> = frames.iter().filter_map(|frame| frame.motion).map(|motion| motion.x).collect();
    assert_eq!(motions, [0.0, 1.0, 2.0, 1.0]);
    assert_eq!(frames.iter().map(|frame| frame.elapsed_s).collect::<Vec<_>>(), [0.0, 0.0, 2.0, 0.0]);
}

#[test]
fn scans_between_the_log_s_poses_are_interpolated() {
    let mut records: Vec<Record> = (0..40).map(|k| pose(f64::from(k) * 0.1, f64::from(k))).collect();
    records.insert(20, scan(1.95));
    records.insert(30, scan(2.75));
    let (frames, summary) = synchronised(records, &config());
    assert!((frames[1].motion.unwrap().x - 8.0).abs() < 1e-9);
    assert_eq!(summary.source, OdometrySource::Log);
}

#[test]
fn a_jump_of_the_odometry_that_no_robot_can_make_is_not_believed() {
    let places = [(0.0, 0.0), (0.2, 1.0), (0.4, 701.0), (0.6, 702.0)];
    let records = places.map(|(stamp_s, x)| scan_of(0, stamp_s, Some(Pose2::new(x, 0.0, 0.0))));
    let (frames, summary) = synchronised(records, &config());
    let motions: Vec<_> = frames.iter().map(|frame| frame.motion.map(|motion| motion.x)).collect();
    assert_eq!(motions, [Some(0.0), Some(1.0), None, Some(1.0)]);
    assert!(summary.findings.contains(&Finding::Jumps { count: 1, largest_m: 700.0 }));
}

#[test]
fn one_stray_stamp_costs_one_record() {
    let mut records = drive();
    records.insert(700, gyro(1e9, 1.0));
    records.insert(800, ticks(1e9, 100.0, 100.0));
    records.insert(900, scan(1e9));
    let ((clean, _), (stray, summary)) = (synchronised(drive(), &config()), synchronised(records, &config()));
    assert_eq!((stray.len(), summary.dropped.readings_of_stray_stamp), (201, 2));
    let known: Vec<&Frame> = stray.iter().filter(|frame| frame.stamp_s < 1e6).collect();
    assert!(clean.iter().zip(known).all(|(a, b)| a.dead_reckoning == b.dead_reckoning && a.stamp_s == b.stamp_s));
}

#[test]
fn two_lidars_are_merged_by_their_stamps() {
    let mut config = config();
    config.robot.further_lidars.push(LidarConfig::default());
    let mut records = drive();
    records.extend((0..100).map(|k| scan_of(1, f64::from(k) * 0.1 + 0.0005, None)));
    // One after the other, as they would never come.
    let (frames, summary) = synchronised(records.clone(), &config);
    assert!(summary.dropped.scans_too_late > 50 && frames.len() < 250);
    records.sort_by(|a, b| a.stamp_s().total_cmp(&b.stamp_s()));
    let (frames, summary) = synchronised(records, &config);
    assert_eq!((frames.len(), summary.dropped.total()), (300, 0));
    assert!(frames.windows(2).all(|pair| pair[0].stamp_s <= pair[1].stamp_s && pair[0].index + 1 == pair[1].index));
}

#[test]
fn a_clock_that_stands_still_fills_no_memory() {
    let mut synchronizer = Synchronizer::new(&config(), None).unwrap();
    let mut frames = 0;
    for k in 0..5000 {
        let mut record = scan(1.0);
        if let Record::Scan(scan) = &mut record {
            scan.ranges_m[0] = 1.0 + k as f32 / 1000.0;
        }
        frames += synchronizer.push(record).unwrap().len();
    }
    assert!(frames > 3900 && synchronizer.waiting() < 1100);
}

#[test]
fn without_odometry_points_come_with_the_times_to_undo_the_motion_by() {
    let mut config = config();
    config.odometry.source = OdometrySource::ScanMatching;
    config.robot.lidar.stamp_at = StampAt::Middle;
    config.scan.no_return = NoReturn::Clear;
    let frames = |config: &Config| {
        let mut synchronizer = Synchronizer::new(config, None).unwrap();
        synchronizer.push(scan(1.0)).unwrap();
        synchronizer.finish().unwrap()
    };
    let skewed = frames(&config).remove(0).scan;
    let skew = skewed.skew.clone().unwrap();
    assert_eq!((skew.hits_s.len(), skew.free_ends_s.len()), (skewed.hits.len(), skewed.free_ends.len()));
    // The first ray is taken 10 ms before the stamp, from 10 mm behind.
    assert!((skew.hits_s[0] + 0.01).abs() < 1e-6);
    let still = deskewed(&skewed, [1.0, 0.0, 0.0]);
    let ([x, y], [moved_x, moved_y]) = (skewed.hits.iter().next().unwrap(), still.hits.iter().next().unwrap());
    assert!((moved_x - x + 0.01).abs() < 1e-6 && (moved_y - y).abs() < 1e-6);
    assert_eq!(still.skew, None);
    config.scan.deskew = false;
    assert_eq!(frames(&config)[0].scan.skew, None);
}

/// As from a driver that states milliseconds for seconds.
#[test]
fn sweeps_that_take_longer_than_until_the_next_scan_are_not_undone_and_told() {
    let mut config = config();
    config.odometry.source = OdometrySource::ScanMatching;
    let usual_s = config.robot.lidar.sweep_duration_s;
    let solved = |sweep_duration_s: f64| {
        let mut config = config.clone();
        config.robot.lidar.sweep_duration_s = sweep_duration_s;
        let mut synchronizer = Synchronizer::new(&config, None).unwrap();
        let scans = (0..20).map(|k| scan(1.0 + 0.1 * f64::from(k)));
        let mut frames: Vec<Frame> = scans.flat_map(|scan| synchronizer.push(scan).unwrap()).collect();
        frames.extend(synchronizer.finish().unwrap());
        let is_told =
            synchronizer.summary().findings.iter().any(|finding| matches!(finding, Finding::LongSweep { .. }));
        (frames.last().unwrap().scan.skew.is_some(), is_told)
    };
    assert_eq!(solved(usual_s), (true, false));
    assert_eq!(solved(1000.0 * usual_s), (false, true));
}

#[test]
fn encoders_without_calibration_and_odometry_that_never_came_are_errors() {
    let mut records: Vec<Record> = (0..100).map(|k| ticks(f64::from(k) * 0.02, 0.0, 0.0)).collect();
    records.extend([scan(2.0), scan(2.1)]);
    let solve = |config: &Config| {
        let mut synchronizer = Synchronizer::new(config, None).unwrap();
        records.iter().try_for_each(|record| synchronizer.push(record.clone()).map(drop))?;
        synchronizer.finish().map(drop)
    };
    assert_eq!(solve(&Config::default()), Err(OdometryError::NoWheelCalibration));
    let mut config = config();
    config.odometry.source = OdometrySource::WheelsAndGyro;
    assert!(matches!(solve(&config), Err(OdometryError::SourceMissing { missing: "IMU readings", .. })));
}

/// How long a record waits at the most for the next of its sensor that confirms its stamp, seconds.
fn longest_wait_s(records: &[Record]) -> f64 {
    let mut stamps_s = std::collections::BTreeMap::<_, Vec<f64>>::new();
    for record in records {
        stamps_s.entry(record.sensor()).or_default().push(record.stamp_s());
    }
    // Who repeats what was said confirms nothing.
    stamps_s.values_mut().for_each(Vec::dedup);
    let waits = stamps_s.values().flat_map(|of_sensor| {
        let leaps = |at: usize| at == 0 || of_sensor[at] - of_sensor[at - 1] > crate::odometry::LEAP_S;
        (1..of_sensor.len()).filter(move |at| leaps(at - 1)).map(|at| of_sensor[at] - of_sensor[at - 1])
    });
    waits.fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// How the sensors' records come mixed changes nothing, whatever falls silent. At the start and after a pause a sensor's
    /// first record waits for its second, which counts as lateness: that is within the delay, too. No sensor pauses twice: what
    /// speaks only between two pauses is a known exception.
    #[test]
    fn jitter_changes_no_byte(
        seed in any::<u64>(), jitter_s in 0.0..0.22_f64, dropped_share in 0.0..0.5_f64, doubled_share in 0.0..0.2_f64,
        pauses in prop::collection::btree_map(0..4_usize, (0.0..10.0_f64, 0.0..3.0_f64), 0..4), low_pass in any::<bool>(),
        lidars in 1..3_usize, log in any::<bool>(),
    ) {
        let mut config = config();
        config.odometry.gyro_low_pass_hz = if low_pass { 8.0 } else { 0.0 };
        config.robot.further_lidars = vec![LidarConfig::default(); lidars - 1];
        let mut records = drive();
        if lidars > 1 {
            records.extend((0..150).map(|k| scan_of(1, f64::from(k) * 0.067 + 0.0005, None)));
        }
        if log {
            records.extend((0..100).map(|k| pose(f64::from(k) * 0.1 + 0.05, f64::from(k) * 0.03)));
        }
        let sensors = [(crate::sensors::Stream::Scans, 0), (crate::sensors::Stream::Encoders, 0),
            (crate::sensors::Stream::Imu, 0), (crate::sensors::Stream::Odometry, 0)];
        records.retain(|record| !pauses.iter().any(|(&sensor, &(from_s, for_s))| {
            let (stream, id) = record.sensor();
            sensors[sensor] == (stream, usize::from(id.0)) && (from_s..from_s + for_s).contains(&record.stamp_s())
        }));
        records.sort_by(|a, b| a.stamp_s().total_cmp(&b.stamp_s()));
        let lost = Arrival { dropped_share, doubled_share, ..Arrival::default() };
        let records = lost.of(records, seed);
        prop_assume!(longest_wait_s(&records) + jitter_s <= config.odometry.delay_s);
        let jittered = Arrival { jitter_s, ..Arrival::default() }.of(records.clone(), seed ^ 1);
        let ((plain, a), (mixed, b)) = (synchronised(records, &config), synchronised(jittered, &config));
        prop_assert_eq!(bytes(&plain), bytes(&mixed));
        prop_assert_eq!(a, b);
    }

    #[test]
    fn motions_add_up_to_dead_reckoning(every in 1..4_usize, seed in any::<u64>(), jitter_s in 0.0..0.3_f64) {
        let mut config = config();
        config.scan.every = every;
        let (frames, _) = synchronised(Arrival { jitter_s, ..Arrival::default() }.of(drive(), seed), &config);
        prop_assert_eq!(frames.len(), 200_usize.div_ceil(every));
        let last = frames.last().unwrap().dead_reckoning;
        prop_assert!(sum(&frames).between(&last).distance() < 1e-9 && last.distance() > 0.5);
    }

    /// Records in any order and with any stamp are survived.
    #[test]
    fn any_records_are_survived(stamps in prop::collection::vec((any::<f64>(), 0.0..9.0_f64, 0..6_u8), 0..200)) {
        let records = stamps.into_iter().map(|(any_s, usual_s, kind)| match kind {
            0 => ticks(usual_s, 1.0, 2.0),
            1 => gyro(usual_s, 0.1),
            2 => scan(usual_s),
            3 => pose(usual_s, 1.0),
            4 => scan(any_s),
            _ => gyro(any_s, f64::NAN),
        });
        let (frames, summary) = synchronised(records, &config());
        prop_assert_eq!(frames.len(), summary.frames);
        prop_assert!(frames.iter().all(|frame| frame.dead_reckoning.is_finite()));
    }
}
