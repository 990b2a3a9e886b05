//! What the odometry states, held against what the scans show.

use super::Symptom;
use super::ego_motion::{EgoMotion, ego_motions, tracked_motions};
use crate::config::Config;
use crate::frame::Frame;
use crate::frames::Frames;
use crate::geometry::{Pose2, wrap_angle};
use crate::odometry::median;
use crate::sensors::Record;
use crate::slam::StepReport;

/// Fewer moments than this prove nothing.
const LEAST_MOMENTS: usize = 12;
/// A motion says something of its kind from here on, metres and radians.
const DRIVEN_M: f64 = 0.06;
const TURNED_RAD: f64 = 0.04;
/// A turn so small is straight on, radians.
const STRAIGHT_RAD: f64 = 0.03;
/// Positions are taken from scans that fix them to this, metres.
const CERTAIN_M: f64 = 0.02;

/// Odometry that is off by less than these shares is ordinary.
const DISTANCE_TOLERANCE: f64 = 0.1;
const YAW_TOLERANCE: f64 = 0.2;
/// What the odometry states times this, degrees taken for radians, …
const DEGREES_PER_RADIAN: f64 = 180.0 / std::f64::consts::PI;
/// … then agrees with the scans to this, radians: an error of theirs of half a degree, as many times as large …
const DEGREES_TOLERANCE_RAD: f64 = 0.6;
/// … at this share of the moments; by chance it does at a fifth.
const DEGREES_SHARE: f64 = 0.6;
/// A correlation this strong, reversed, is no chance.
const REVERSED: f64 = 0.7;
/// A mount that is off by less does no harm, radians.
const MOUNT_TOLERANCE_RAD: f64 = 0.07;
/// The directions of a straight drive scatter by less than this where the mount is at fault, radians.
const MOUNT_SCATTER_RAD: f64 = 0.1;
/// Lags that are looked at, and in which steps, seconds.
const LONGEST_LAG_S: f64 = 0.4;
const LAG_STEP_S: f64 = 0.01;
/// Lags below this are ordinary, seconds.
const LAG_TOLERANCE_S: f64 = 0.06;
/// With its lag undone the odometry fits the scans' turns at least this much better.
const LAG_GAIN: f64 = 0.5;
/// No gyro on wheels states more than this, rad/s.
const FASTEST_TURN_RAD_S: f64 = 35.0;

/// A moment: what the scans show, and what the odometry states.
struct Moment {
    shown: EgoMotion,
    stated: Pose2,
}

/// What the scans show of a recording, against its odometry.
pub(super) fn examine(frames: &Frames<'_>, records: &[Record], config: &Config) -> Vec<Symptom> {
    let mut pass = frames.iter();
    let all: Vec<Frame> = pass.by_ref().collect();
    if !all.iter().any(|frame| frame.motion.is_some_and(|motion| motion != Pose2::IDENTITY)) {
        return gyro_units(records).into_iter().collect();
    }
    let path = pass.dead_reckoning();
    compare(&ego_motions(&all, &config.matcher), |from_s, to_s| path.motion(from_s, to_s), records)
}

/// What a solved drive shows, against its odometry.
pub(super) fn examine_solved(steps: &[StepReport], records: &[Record]) -> Vec<Symptom> {
    let Some((first, last)) = steps.first().zip(steps.last()) else { return Vec::new() };
    if first.dead_reckoning == last.dead_reckoning {
        return gyro_units(records).into_iter().collect();
    }
    let stated = |from_s: f64, to_s: f64| reckoned_at(steps, from_s).between(&reckoned_at(steps, to_s));
    compare(&tracked_motions(steps), stated, records)
}

/// Dead reckoning at any time, between the scans by a share of the way from one to the next.
fn reckoned_at(steps: &[StepReport], stamp_s: f64) -> Pose2 {
    let next = steps.partition_point(|step| step.stamp_s < stamp_s).clamp(1, steps.len().max(2) - 1);
    let (Some(before), Some(after)) = (steps.get(next - 1), steps.get(next)) else { return Pose2::IDENTITY };
    let share = (stamp_s - before.stamp_s) / (after.stamp_s - before.stamp_s).max(1e-9);
    let twist = before.dead_reckoning.between(&after.dead_reckoning).log();
    before.dead_reckoning.compose(&Pose2::exp(twist.map(|rate| rate * share.clamp(0.0, 1.0))))
}

fn compare(shown: &[EgoMotion], stated: impl Fn(f64, f64) -> Pose2, records: &[Record]) -> Vec<Symptom> {
    let mut found: Vec<Symptom> = gyro_units(records).into_iter().collect();
    let moments: Vec<Moment> =
        shown.iter().map(|&shown| Moment { shown, stated: stated(shown.stamps_s[0], shown.stamps_s[1]) }).collect();
    let yaw = yaw(&moments);
    found.extend(gyro_axis(records, &moments));
    found.extend(yaw);
    if !matches!(yaw, Some(Symptom::YawReversed { .. } | Symptom::YawUnits { .. })) {
        found.extend(late(shown, stated));
    }
    found.extend(distance(&moments));
    found.extend(reverse(&moments));
    found.extend(mount(&moments));
    found
}

/// Reversed, in degrees, or out of scale.
fn yaw(moments: &[Moment]) -> Option<Symptom> {
    let turning = moments.iter().filter(|moment| moment.shown.motion.theta.abs() > TURNED_RAD);
    let share_that_fits = |factor: f64| {
        let off = |moment: &Moment| wrap_angle(moment.stated.theta - factor * moment.shown.motion.theta).abs();
        let fitting = turning.clone().filter(|moment| off(moment) < DEGREES_TOLERANCE_RAD).count();
        fitting as f64 / turning.clone().count().max(1) as f64
    };
    if turning.clone().count() >= LEAST_MOMENTS
        && share_that_fits(DEGREES_PER_RADIAN) > DEGREES_SHARE
        && share_that_fits(1.0) < DEGREES_SHARE
    {
        return Some(Symptom::YawUnits { ratio: DEGREES_PER_RADIAN });
    }
    let turns: Vec<[f64; 2]> = moments
        .iter()
        .map(|moment| [moment.shown.motion.theta, moment.stated.theta])
        .filter(|[shown, stated]| shown.abs() > TURNED_RAD && stated.abs() > 0.2 * TURNED_RAD)
        .collect();
    if turns.len() < LEAST_MOMENTS {
        return None;
    }
    let sum = |value: fn(&[f64; 2]) -> f64| turns.iter().map(value).sum::<f64>();
    let correlation = sum(|[shown, stated]| shown * stated)
        / (sum(|[shown, _]| shown * shown) * sum(|[_, stated]| stated * stated)).sqrt();
    if correlation < -REVERSED {
        return Some(Symptom::YawReversed { correlation: -correlation });
    }
    let ratio = median(&mut turns.iter().map(|[shown, stated]| stated / shown).collect::<Vec<_>>())?;
    ((ratio - 1.0).abs() > YAW_TOLERANCE && correlation > REVERSED).then_some(Symptom::YawScale { ratio })
}

fn distance(moments: &[Moment]) -> Option<Symptom> {
    let mut ratios: Vec<f64> = moments
        .iter()
        .filter(|moment| moment.shown.sigma_m < CERTAIN_M && moment.shown.motion.distance() > DRIVEN_M)
        .filter(|moment| moment.shown.motion.theta.abs() < 3.0 * STRAIGHT_RAD && moment.stated.distance() > 1e-3)
        .map(|moment| moment.stated.distance() / moment.shown.motion.distance())
        .collect();
    if ratios.len() < LEAST_MOMENTS {
        return None;
    }
    let ratio = median(&mut ratios)?;
    ((ratio - 1.0).abs() > DISTANCE_TOLERANCE).then_some(Symptom::DistanceScale { ratio })
}

/// Where the scans show the robot backing up, and the odometry says as often that it drives on.
fn reverse(moments: &[Moment]) -> Option<Symptom> {
    let certain =
        moments.iter().filter(|moment| moment.shown.sigma_m < CERTAIN_M && moment.stated.x.abs() > 0.5 * DRIVEN_M);
    let (mut agree, mut lost, mut forwards) = (0, 0, 0);
    for moment in certain {
        match (moment.shown.motion.x, moment.stated.x) {
            (shown, stated) if shown < -DRIVEN_M && stated < 0.0 => agree += 1,
            (shown, stated) if shown < -DRIVEN_M && stated > 0.0 => lost += 1,
            (shown, stated) if shown > DRIVEN_M && stated > 0.0 => forwards += 1,
            _ => {}
        }
    }
    // A LiDAR that looks backwards is another matter: then it is lost forwards, too.
    (lost >= LEAST_MOMENTS / 2 && agree == 0 && forwards > lost).then_some(Symptom::ReverseSignLost { times: lost })
}

/// Where straight on leads, as the scans see it.
fn mount(moments: &[Moment]) -> Option<Symptom> {
    let directions: Vec<f64> = moments
        .iter()
        .filter(|moment| moment.shown.sigma_m < CERTAIN_M && moment.shown.motion.distance() > DRIVEN_M)
        .filter(|moment| moment.shown.motion.theta.abs() < STRAIGHT_RAD && moment.stated.distance() > 0.5 * DRIVEN_M)
        .map(|moment| {
            let direction = |motion: &Pose2| motion.y.atan2(motion.x);
            wrap_angle(direction(&moment.stated) - direction(&moment.shown.motion))
        })
        .collect();
    if directions.len() < LEAST_MOMENTS {
        return None;
    }
    // Directions near ±π are turned so that their middle is one number.
    let [sin, cos] = [f64::sin, f64::cos].map(|of| directions.iter().map(|angle| of(*angle)).sum::<f64>());
    let mean = sin.atan2(cos);
    let off_rad =
        wrap_angle(mean + median(&mut directions.iter().map(|angle| wrap_angle(angle - mean)).collect::<Vec<_>>())?);
    let scatter = median(&mut directions.iter().map(|angle| wrap_angle(angle - off_rad).abs()).collect::<Vec<_>>())?;
    (off_rad.abs() > MOUNT_TOLERANCE_RAD && scatter < MOUNT_SCATTER_RAD.max(0.25 * off_rad.abs()))
        .then_some(Symptom::MountYaw { off_rad })
}

/// The lag at which the odometry's turns fit the scans' best.
fn late(shown: &[EgoMotion], stated: impl Fn(f64, f64) -> Pose2) -> Option<Symptom> {
    let turning = shown.iter().filter(|shown| shown.motion.theta.abs() > TURNED_RAD).count();
    if turning < LEAST_MOMENTS {
        return None;
    }
    let misfit = |lag_s: f64| -> f64 {
        let off = |shown: &EgoMotion| {
            let [from_s, to_s] = shown.stamps_s.map(|stamp_s| stamp_s + lag_s);
            wrap_angle(stated(from_s, to_s).theta - shown.motion.theta).abs().min(TURNED_RAD)
        };
        shown.iter().map(off).sum()
    };
    let steps = (LONGEST_LAG_S / LAG_STEP_S) as i32;
    let lags = (-steps..=steps).map(|step| f64::from(step) * LAG_STEP_S);
    let (lag_s, least) = lags.map(|lag_s| (lag_s, misfit(lag_s))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    (lag_s.abs() > LAG_TOLERANCE_S && lag_s.abs() < LONGEST_LAG_S - LAG_STEP_S && least < LAG_GAIN * misfit(0.0))
        .then_some(Symptom::Late { odometry_by_s: lag_s })
}

fn yaw_rates(records: &[Record]) -> impl Iterator<Item = (f64, [f64; 3])> {
    records.iter().filter_map(|record| match record {
        Record::Imu(reading) if reading.angular_velocity_rad_s.iter().all(|rate| rate.is_finite()) => {
            Some((reading.stamp_s, reading.angular_velocity_rad_s))
        }
        _ => None,
    })
}

fn gyro_units(records: &[Record]) -> Option<Symptom> {
    // Single wild readings happen; one in a hundred is a habit.
    let mut rates: Vec<f64> = yaw_rates(records).map(|(_, [_, _, z])| z.abs()).collect();
    let place = rates.len() - rates.len() / 100;
    if rates.len() < 100 {
        return None;
    }
    let (_, &mut largest, _) = rates.select_nth_unstable_by(place - 1, f64::total_cmp);
    (largest > FASTEST_TURN_RAD_S).then_some(Symptom::GyroUnits { largest })
}

/// Turns of the scans that another axis of the gyro shows better than its z axis.
fn gyro_axis(records: &[Record], moments: &[Moment]) -> Option<Symptom> {
    let rates: Vec<(f64, [f64; 3])> = yaw_rates(records).collect();
    let turning: Vec<&Moment> = moments.iter().filter(|moment| moment.shown.motion.theta.abs() > TURNED_RAD).collect();
    if rates.is_empty() || turning.len() < LEAST_MOMENTS {
        return None;
    }
    let turned = |moment: &Moment, axis: usize| -> f64 {
        let [from_s, to_s] = moment.shown.stamps_s;
        let first = rates.partition_point(|(stamp_s, _)| *stamp_s < from_s);
        let within: Vec<f64> =
            rates[first..].iter().take_while(|(stamp_s, _)| *stamp_s <= to_s).map(|(_, rate)| rate[axis]).collect();
        within.iter().sum::<f64>() / within.len().max(1) as f64 * (to_s - from_s)
    };
    let explained = |axis: usize| -> f64 {
        let pairs: Vec<[f64; 2]> =
            turning.iter().map(|moment| [moment.shown.motion.theta, turned(moment, axis)]).collect();
        let product = |a: usize, b: usize| pairs.iter().map(|pair| pair[a] * pair[b]).sum::<f64>();
        (product(0, 1) / product(0, 0)).abs()
    };
    let [x, y, z] = [0, 1, 2].map(explained);
    let (axis, best) = if x > y { (0, x) } else { (1, y) };
    (z < 0.2 && (0.5..2.0).contains(&best)).then_some(Symptom::GyroAxis { axis })
}
