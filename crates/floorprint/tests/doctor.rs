//! Each fault of a recording is found and named, and healthy recordings have none.

#![allow(clippy::unwrap_used, reason = "a test ends where a step fails")]

mod simulation;

use floorprint::config::{Config, Layer};
use floorprint::doctor::{Severity, Symptom, examine};
use floorprint::geometry::Pose2;
use floorprint::sensors::{Record, RobotConfig, Scan, ScanGeometry, StampedPose};
use floorprint::simulator::{World, simulate};
use simulation::quick;
use std::sync::{Arc, OnceLock};

/// A healthy drive with wheels and gyro.
fn with_wheels() -> &'static [Record] {
    static RECORDS: OnceLock<Vec<Record>> = OnceLock::new();
    RECORDS.get_or_init(|| simulate(World::named("rooms", 1).unwrap(), quick(), 1).unwrap().records())
}

/// The same with the true poses as what the robot's odometry states.
fn with_odometry() -> Vec<Record> {
    let drive = simulate(World::named("rooms", 1).unwrap(), quick(), 1).unwrap();
    let start = drive.true_pose(drive.truth()[0].stamp_s);
    let scans = drive.records().into_iter().filter(|record| matches!(record, Record::Scan(_)));
    let mut records: Vec<Record> = scans.collect();
    let (first_s, last_s) = (records[0].stamp_s(), records[records.len() - 1].stamp_s());
    let ticks = ((last_s - first_s + 1.0) / 0.02) as usize;
    records.extend((0..ticks).map(|tick| {
        let stamp_s = first_s - 0.5 + tick as f64 * 0.02;
        Record::Odometry(StampedPose { stamp_s, pose: start.between(&drive.true_pose(stamp_s)) })
    }));
    records.sort_by(|a, b| a.stamp_s().total_cmp(&b.stamp_s()));
    records
}

fn config() -> Config {
    Config::resolve(&[Layer::from_robot(&RobotConfig::ece276a())]).unwrap()
}

fn symptoms(records: &[Record]) -> Vec<Symptom> {
    examine(records, &config())
}

/// The recording with each scan changed.
fn scans_changed(records: &[Record], change: impl Fn(&mut Scan)) -> Vec<Record> {
    let mut records = records.to_vec();
    for record in &mut records {
        if let Record::Scan(scan) = record {
            change(scan);
        }
    }
    records
}

/// The recording with each pose of the odometry changed.
fn odometry_changed(change: impl Fn(&StampedPose, &StampedPose) -> StampedPose) -> Vec<Record> {
    let mut records = with_odometry();
    let mut before: Option<StampedPose> = None;
    for record in &mut records {
        if let Record::Odometry(stamped) = record {
            let original = *stamped;
            *stamped = change(&before.unwrap_or(original), &original);
            before = Some(original);
        }
    }
    records
}

/// Odometry made of steps that are changed one by one.
fn steps_changed(change: impl Fn(Pose2) -> Pose2) -> Vec<Record> {
    let mut pose = Pose2::IDENTITY;
    let pose = std::cell::RefCell::new(&mut pose);
    odometry_changed(|before, now| {
        let mut pose = pose.borrow_mut();
        **pose = pose.compose(&change(before.pose.between(&now.pose)));
        StampedPose { pose: **pose, ..*now }
    })
}

#[test]
fn healthy_recordings_show_nothing() {
    assert_eq!(symptoms(with_wheels()), []);
    assert_eq!(symptoms(&with_odometry()), []);
    for world in ["corridors", "glass", "people", "figure_of_eight"] {
        let records = simulate(World::named(world, 2).unwrap(), quick(), 2).unwrap().records();
        assert_eq!(symptoms(&records), [], "{world}");
    }
}

#[test]
fn ranges_in_millimetres_and_angles_in_degrees_make_no_map() {
    for (factor, name) in [(1000.0, "millimetres"), (100.0, "centimetres")] {
        let records = scans_changed(with_wheels(), |scan| scan.ranges_m.iter_mut().for_each(|range| *range *= factor));
        let found = symptoms(&records);
        assert!(
            matches!(found[..], [Symptom::RangeUnits { per_metre, .. }] if per_metre == f64::from(factor)),
            "{found:?}"
        );
        assert!(found[0].severity() == Severity::Fatal && found[0].to_string().contains(name));
    }
    let records = scans_changed(with_wheels(), |scan| {
        let angles_rad = scan.geometry.angles_rad.iter().map(|angle| angle.to_degrees()).collect();
        scan.geometry = Arc::new(ScanGeometry { angles_rad, ..(*scan.geometry).clone() });
    });
    assert!(matches!(symptoms(&records)[..], [Symptom::AngleUnits { span }] if (span - 270.0).abs() < 1.0));
}

#[test]
fn a_lidar_that_sees_nothing_repeats_itself_or_lies_about_its_rays_is_named() {
    let blind = scans_changed(with_wheels(), |scan| {
        let limit = scan.geometry.range_max_m;
        scan.ranges_m.iter_mut().enumerate().filter(|(ray, _)| ray % 50 > 0).for_each(|(_, range)| *range = limit);
    });
    assert!(symptoms(&blind).iter().any(|symptom| matches!(symptom, Symptom::FewReturns { .. })));

    let first = with_wheels().iter().find_map(|record| match record {
        Record::Scan(scan) => Some(scan.ranges_m.clone()),
        _ => None,
    });
    let frozen = scans_changed(with_wheels(), |scan| scan.ranges_m.clone_from(first.as_ref().unwrap()));
    assert!(symptoms(&frozen).iter().any(|symptom| matches!(symptom, Symptom::FrozenScans { .. })));

    let wide = scans_changed(with_wheels(), |scan| {
        let angles_rad = scan.geometry.angles_rad.iter().map(|angle| 1.5 * angle).collect();
        scan.geometry = Arc::new(ScanGeometry { angles_rad, ..(*scan.geometry).clone() });
    });
    assert!(symptoms(&wide).iter().any(|symptom| matches!(symptom, Symptom::MoreThanATurn { .. })));
}

#[test]
fn clocks_that_do_not_agree_are_named() {
    let mut apart = with_odometry();
    for record in &mut apart {
        if let Record::Odometry(stamped) = record {
            stamped.stamp_s += 86_400.0;
        }
    }
    let found = symptoms(&apart);
    let later = found.iter().find_map(|symptom| match symptom {
        Symptom::ClocksApart { later_s, .. } => Some(*later_s),
        _ => None,
    });
    assert!(later.is_some_and(|later_s| (later_s - 86_400.0).abs() < 2.0), "{found:?}");

    let mut set_back = with_odometry();
    let half = set_back.len() / 2;
    for record in &mut set_back[half..] {
        match record {
            Record::Odometry(stamped) => stamped.stamp_s -= 3600.0,
            Record::Scan(scan) => scan.stamp_s -= 3600.0,
            _ => {}
        }
    }
    assert!(symptoms(&set_back).iter().any(|symptom| matches!(symptom, Symptom::ClockSetBack { times: 1, .. })));

    for per_second in [1e3, 1e6, 1e9] {
        let in_parts = with_odometry().into_iter().map(|record| match record {
            Record::Odometry(stamped) => {
                Record::Odometry(StampedPose { stamp_s: per_second * stamped.stamp_s, ..stamped })
            }
            Record::Scan(scan) => Record::Scan(Scan { stamp_s: per_second * scan.stamp_s, ..scan }),
            other => other,
        });
        let found = symptoms(&in_parts.collect::<Vec<_>>());
        let is_named =
            |symptom: &Symptom| matches!(symptom, Symptom::StampUnits { per_second: told, .. } if *told == per_second);
        assert!(found.iter().any(is_named), "{per_second}: {found:?}");
    }

    let doubled: Vec<Record> = with_odometry().into_iter().flat_map(|record| [record.clone(), record]).collect();
    let found = symptoms(&doubled);
    assert!(found.iter().all(|symptom| matches!(symptom, Symptom::Doubled { .. })) && found.len() == 2, "{found:?}");

    for late_s in [0.15, -0.15] {
        let late = odometry_changed(|_, now| StampedPose { stamp_s: now.stamp_s + late_s, ..*now });
        let found = symptoms(&late);
        let is_named = |symptom: &Symptom| matches!(symptom, Symptom::Late { odometry_by_s } if (odometry_by_s - late_s).abs() < 0.03);
        assert!(found.iter().any(is_named), "{late_s} s: {found:?}");
    }
}

#[test]
fn odometry_with_wrong_signs_units_and_scales_is_named() {
    let found = symptoms(&steps_changed(|step| Pose2::new(step.x, step.y, -step.theta)));
    assert!(found.iter().any(|symptom| matches!(symptom, Symptom::YawReversed { .. })), "{found:?}");
    let found = symptoms(&steps_changed(|step| Pose2::new(step.x, step.y, step.theta.to_degrees())));
    assert!(found.iter().any(|symptom| matches!(symptom, Symptom::YawUnits { .. })), "{found:?}");
    let found = symptoms(&steps_changed(|step| Pose2::new(step.x, step.y, 0.7 * step.theta)));
    assert!(
        found.iter().any(|symptom| matches!(symptom, Symptom::YawScale { ratio } if (ratio - 0.7).abs() < 0.05)),
        "{found:?}"
    );
    let found = symptoms(&steps_changed(|step| Pose2::new(1.3 * step.x, 1.3 * step.y, step.theta)));
    assert!(
        found.iter().any(|symptom| matches!(symptom, Symptom::DistanceScale { ratio } if (ratio - 1.3).abs() < 0.05)),
        "{found:?}"
    );
    let found = symptoms(&steps_changed(|step| Pose2::new(step.x.abs(), step.y, step.theta)));
    assert!(found.iter().any(|symptom| matches!(symptom, Symptom::ReverseSignLost { .. })), "{found:?}");
}

#[test]
fn a_lidar_that_is_mounted_otherwise_is_named() {
    for off_rad in [0.2, std::f64::consts::FRAC_PI_2, 3.0] {
        let turned = scans_changed(&with_odometry(), |scan| {
            let angles_rad = scan.geometry.angles_rad.iter().map(|angle| angle - off_rad).collect();
            scan.geometry = Arc::new(ScanGeometry { angles_rad, ..(*scan.geometry).clone() });
        });
        let found = symptoms(&turned);
        let is_named = |symptom: &Symptom| matches!(symptom, Symptom::MountYaw { off_rad: found } if (found - off_rad).abs() < 0.05);
        assert!(found.iter().any(is_named), "{off_rad} rad: {found:?}");
    }
    let mirrored = scans_changed(&with_odometry(), |scan| {
        let angles_rad = scan.geometry.angles_rad.iter().map(|angle| -angle).collect();
        scan.geometry = Arc::new(ScanGeometry { angles_rad, ..(*scan.geometry).clone() });
    });
    let found = symptoms(&mirrored);
    assert!(found.iter().any(|symptom| matches!(symptom, Symptom::YawReversed { .. })), "{found:?}");
}

#[test]
fn a_gyro_in_degrees_or_on_its_side_is_named() {
    let gyro_changed = |change: fn([f64; 3]) -> [f64; 3]| {
        let mut records = with_wheels().to_vec();
        for record in &mut records {
            if let Record::Imu(reading) = record {
                reading.angular_velocity_rad_s = change(reading.angular_velocity_rad_s);
            }
        }
        symptoms(&records)
    };
    let found = gyro_changed(|rates| rates.map(f64::to_degrees));
    assert!(
        found.iter().any(|symptom| matches!(symptom, Symptom::GyroUnits { .. } | Symptom::YawUnits { .. })),
        "{found:?}"
    );
    let found = gyro_changed(|[x, y, z]| [z, x, y]);
    assert!(found.iter().any(|symptom| matches!(symptom, Symptom::GyroAxis { axis: 0 })), "{found:?}");
}
