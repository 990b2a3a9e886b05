//! By how much the clocks of odometry and LiDAR differ.
//!
//! Where the robot begins or ends a turn, the turn between two scans tells when it happened. Some such moments of the
//! drive are looked at: the scans alone show the turn, and the lag is the one at which the odometry states the same.

use crate::SensorId;
use crate::config::Config;
use crate::frame::BodyScan;
use crate::geometry::{Pose2, wrap_angle};
use crate::odometry::median;
use crate::odometry::scan_projection::ScanProjection;
use crate::scan_matcher::SearchWindow;
use crate::sensors::{Record, Records, Scan};
use crate::survey::scan_pair::motion_between;
use rayon::prelude::*;

/// So many moments are looked at, no two within this time, seconds.
const MOMENTS: usize = 36;
const APART_S: f64 = 0.5;
/// Fewer that fit prove nothing.
const LEAST_MOMENTS: usize = 8;
/// The two scans of a moment are so far apart, seconds: long enough for a turn to show, and short enough for the rate to
/// change within it.
const SHORTEST_S: f64 = 0.15;
const LONGEST_S: f64 = 1.0;
/// The yaw rate must change by this much for a moment to tell the time, rad/s …
const LEAST_CHANGE_RAD_S: f64 = 0.15;
/// … and by at least this share of the largest change of all: slow bends tell little, and hide what the others tell.
const LEAST_SHARE: f64 = 0.3;
/// Faster turns smear scans, rad/s.
const FASTEST_RAD_S: f64 = 2.0;
/// Lags that are looked at, and in which steps, seconds.
const LONGEST_LAG_S: f64 = 0.4;
const LAG_STEP_S: f64 = 0.005;
/// Lags below this do no harm, seconds.
const LEAST_LAG_S: f64 = 0.03;
/// What differs by more is not a matter of the clock, radians.
const CAP_RAD: f64 = 0.15;
/// With the lag undone the turns differ by no more than this share of what they did …
const GAIN: f64 = 0.6;
/// … and by at least this much less on average, radians: what differs by less is within the reach of scan matching, and
/// drives come out the same whether or not it is put right.
const LEAST_GAIN_RAD: f64 = 0.05;
/// At so many moments first, spread over all; more are looked at when these speak for a lag.
const FIRST_MOMENTS: usize = 12;
/// Both halves of the moments tell the same lag but for this, seconds.
const AGREEMENT_S: f64 = 0.03;

/// What a sensor states of the body's turns: stamps (seconds, ascending) and the turn since the first (radians).
#[derive(Debug, Default)]
pub(super) struct Turns {
    stamps_s: Vec<f64>,
    turned_rad: Vec<f64>,
}

impl Turns {
    /// Adds a turn that ended at a time, unless that is not later than the last.
    pub(super) fn add(&mut self, stamp_s: f64, turn_rad: f64) {
        if self.stamps_s.last().is_none_or(|last_s| stamp_s > *last_s) && turn_rad.is_finite() {
            let before_rad = self.turned_rad.last().copied().unwrap_or(0.0);
            self.stamps_s.push(stamp_s);
            self.turned_rad.push(before_rad + turn_rad);
        }
    }

    fn at(&self, stamp_s: f64) -> f64 {
        let next = self.stamps_s.partition_point(|known_s| *known_s < stamp_s).clamp(1, self.stamps_s.len().max(2) - 1);
        let known = |index: usize| Some((*self.stamps_s.get(index)?, *self.turned_rad.get(index)?));
        let (Some((from_s, from_rad)), Some((to_s, to_rad))) = (known(next - 1), known(next)) else { return 0.0 };
        from_rad + (to_rad - from_rad) * ((stamp_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0)
    }

    fn between(&self, from_s: f64, to_s: f64) -> f64 {
        self.at(to_s) - self.at(from_s)
    }
}

/// Two scans of the first LiDAR.
#[derive(Debug, Clone, Copy)]
struct Moment {
    positions: [usize; 2],
    stamps_s: [f64; 2],
}

/// A turn between two scans as they show it.
#[derive(Debug, Clone, Copy)]
struct Shown {
    stamps_s: [f64; 2],
    turn_rad: f64,
}

/// By how much the stamps of the sensor that states `turns` are late beside the LiDAR's, seconds; `None` where that is
/// little, or does not show. `scans` are positions and stamps of the first LiDAR's scans in order of time.
pub(super) fn find<R: Records + ?Sized>(
    records: &R,
    scans: &[(usize, f64)],
    turns: &Turns,
    config: &Config,
) -> Option<f64> {
    let moments = moments(scans, turns);
    if moments.len() < LEAST_MOMENTS {
        return None;
    }
    let (first, rest): (Vec<Moment>, Vec<Moment>) = {
        let stride = (moments.len() / FIRST_MOMENTS).max(1);
        let mut all = moments.into_iter().enumerate().collect::<Vec<_>>();
        let rest = all.extract_if(.., |(index, _)| !index.is_multiple_of(stride)).map(|(_, moment)| moment).collect();
        (all.into_iter().map(|(_, moment)| moment).collect(), rest)
    };
    let mut shown = show(records, first, turns, config);
    let all: Vec<&Shown> = shown.iter().collect();
    let gain_rad = misfit(&all, turns, 0.0) - misfit(&all, turns, likely_lag_s(&all, turns));
    if gain_rad < 0.5 * LEAST_GAIN_RAD {
        return None;
    }
    shown.extend(show(records, rest, turns, config));
    shown.sort_by(|a, b| a.stamps_s[0].total_cmp(&b.stamps_s[0]));
    lag_s(&shown, turns)
}

/// What the scans show at some moments.
fn show<R: Records + ?Sized>(records: &R, moments: Vec<Moment>, turns: &Turns, config: &Config) -> Vec<Shown> {
    // Records are made in order, and compared side by side.
    let pairs: Vec<(Moment, [Scan; 2])> = moments
        .into_iter()
        .filter_map(|moment| {
            let [before, after] = moment.positions.map(|position| match records.record(position)?.into_owned() {
                Record::Scan(scan) => Some(scan),
                _ => None,
            });
            Some((moment, [before?, after?]))
        })
        .collect();
    let shown: Vec<Option<Shown>> =
        pairs.par_iter().map(|(moment, scans)| turn(moment, scans, turns, config)).collect();
    shown.into_iter().flatten().collect()
}

/// The moments at which the yaw rate changes most.
fn moments(scans: &[(usize, f64)], turns: &Turns) -> Vec<Moment> {
    let mut later = 0;
    let mut found: Vec<(f64, Moment)> = Vec::new();
    for &(position, from_s) in scans {
        while scans.get(later).is_some_and(|(_, stamp_s)| *stamp_s < from_s + SHORTEST_S) {
            later += 1;
        }
        let Some(&(later_position, to_s)) = scans.get(later).filter(|(_, stamp_s)| *stamp_s <= from_s + LONGEST_S)
        else {
            continue;
        };
        let elapsed_s = to_s - from_s;
        // How much a shift of the odometry's clock changes the turn.
        let half_s = 0.5 * elapsed_s.max(SHORTEST_S);
        let rate = |at_s: f64| turns.between(at_s - half_s, at_s + half_s) / (2.0 * half_s);
        let change = (rate(to_s) - rate(from_s)).abs();
        let turn_rad = turns.between(from_s, to_s);
        if change >= LEAST_CHANGE_RAD_S && turn_rad.abs() <= FASTEST_RAD_S * elapsed_s {
            found.push((change, Moment { positions: [position, later_position], stamps_s: [from_s, to_s] }));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.positions.cmp(&b.1.positions)));
    let least = found.first().map_or(0.0, |(largest, _)| LEAST_SHARE * largest);
    let mut chosen: Vec<Moment> = Vec::new();
    for (_, moment) in found.into_iter().take_while(|(change, _)| *change >= least) {
        if chosen.iter().all(|other| (other.stamps_s[0] - moment.stamps_s[0]).abs() >= APART_S) {
            chosen.push(moment);
        }
        if chosen.len() == MOMENTS {
            break;
        }
    }
    chosen.sort_by_key(|moment| moment.positions);
    chosen
}

fn turn(moment: &Moment, scans: &[Scan; 2], turns: &Turns, config: &Config) -> Option<Shown> {
    let lidar = config.robot.lidar_of(SensorId::default());
    let [before, after]: [BodyScan; 2] = [0, 1]
        .map(|index| ScanProjection::new(&scans[index].geometry, lidar, &config.scan).project(&scans[index], None));
    let [from_s, to_s] = moment.stamps_s;
    let elapsed_s = to_s - from_s;
    let window = SearchWindow { distance_m: 1.2 * elapsed_s + 0.1, angle_rad: elapsed_s.min(0.4) + 0.1 };
    let expected = Pose2::new(0.0, 0.0, turns.between(from_s, to_s));
    let (motion, _) = motion_between(&before, &after, &expected, window, &config.matcher)?;
    Some(Shown { stamps_s: moment.stamps_s, turn_rad: motion.theta })
}

fn lag_s(shown: &[Shown], turns: &Turns) -> Option<f64> {
    if shown.len() < LEAST_MOMENTS {
        return None;
    }
    let all: Vec<&Shown> = shown.iter().collect();
    let [even, odd] = [0, 1].map(|first| shown.iter().skip(first).step_by(2).collect::<Vec<_>>());
    let lag_s = likely_lag_s(&all, turns);
    let agrees = (likely_lag_s(&even, turns) - likely_lag_s(&odd, turns)).abs() <= AGREEMENT_S;
    let [with_rad, without_rad] = [lag_s, 0.0].map(|lag_s| misfit(&all, turns, lag_s));
    let gains = with_rad < GAIN * without_rad && without_rad - with_rad >= LEAST_GAIN_RAD;
    let is_inside = lag_s.abs() < LONGEST_LAG_S - LAG_STEP_S;
    (agrees && gains && is_inside && lag_s.abs() >= LEAST_LAG_S).then_some(lag_s)
}

/// The lag of least misfit.
fn likely_lag_s(shown: &[&Shown], turns: &Turns) -> f64 {
    let steps = (LONGEST_LAG_S / LAG_STEP_S) as i32;
    let fits: Vec<(f64, f64)> = (-steps..=steps)
        .map(|step| f64::from(step) * LAG_STEP_S)
        .map(|lag_s| (lag_s, misfit(shown, turns, lag_s)))
        .collect();
    fits.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |(lag_s, _)| lag_s)
}

/// By how much the turns differ at a lag, radians on average; the odometry's scale is left open.
fn misfit(shown: &[&Shown], turns: &Turns, lag_s: f64) -> f64 {
    let pairs: Vec<[f64; 2]> = shown
        .iter()
        .map(|shown| [shown.turn_rad, turns.between(shown.stamps_s[0] + lag_s, shown.stamps_s[1] + lag_s)])
        .collect();
    let mut ratios: Vec<f64> =
        pairs.iter().filter(|[_, stated]| stated.abs() > 0.03).map(|[shown, stated]| shown / stated).collect();
    let scale = median(&mut ratios).unwrap_or(1.0).clamp(0.5, 2.0);
    let off = |[shown, stated]: &[f64; 2]| wrap_angle(shown - scale * stated).abs().min(CAP_RAD);
    pairs.iter().map(off).sum::<f64>() / pairs.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A robot that turns to and fro, its turns stated late.
    fn late_by(late_s: f64, noise_rad: f64) -> Option<f64> {
        let angle = |time_s: f64| 0.6 * (2.5 * time_s).sin();
        let mut turns = Turns::default();
        for k in 0..2000 {
            let time_s = f64::from(k) * 0.02;
            turns.add(time_s + late_s, angle(time_s) - angle(time_s - 0.02));
        }
        let shown: Vec<Shown> = (0..30)
            .map(|k| {
                let from_s = 1.0 + f64::from(k) * 1.17;
                let noise = noise_rad * f64::from(k % 5 - 2);
                Shown { stamps_s: [from_s, from_s + 0.3], turn_rad: angle(from_s + 0.3) - angle(from_s) + noise }
            })
            .collect();
        lag_s(&shown, &turns)
    }

    #[test]
    fn a_lag_is_found_and_none_is_made_up() {
        for late_s in [0.2, -0.15] {
            let found_s = late_by(late_s, 0.002);
            assert!(found_s.is_some_and(|found_s| (found_s - late_s).abs() < 0.011), "{late_s}: {found_s:?}");
        }
        assert_eq!(late_by(0.0, 0.002), None);
        assert_eq!(late_by(0.03, 0.002), None, "scan matching takes care of that");
        assert_eq!(late_by(0.15, 0.3), None, "noise tells nothing");
    }
}
