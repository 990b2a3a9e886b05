//! What a drive without a LiDAR amounts to: the path by the odometry alone, and the floor along it. There is no map.

use crate::solve::{Solution, Surroundings, explain, paint_floor};
use crate::stopwatch::ScanTimes;
use anyhow::ensure;
use floorprint::odometry::DeadReckoning;
use floorprint::{Config, Frames, Phase, Profiler, Slam};
use floorprint_io::DataSet;
use std::collections::BTreeMap;

/// Whether a data set has nothing but odometry to go by. In a recording that holds no scan it is rather the topic that is
/// missing.
pub(crate) fn is_without_lidar(data_set: &DataSet) -> bool {
    data_set.bag.is_none() && data_set.scans().next().is_none()
}

/// Integrates the odometry of a drive without a LiDAR.
///
/// # Errors
/// There is no odometry either; a session is to be gone on with; the camera's calibration cannot work.
pub(crate) fn dead_reckon(
    data_set: &DataSet,
    config: &Config,
    paints: bool,
    around: &mut Surroundings<'_>,
) -> anyhow::Result<Solution> {
    around.profiler.enter(Phase::Synchronise);
    ensure!(
        around.earlier.is_none(),
        "a session cannot be gone on with where there is no LiDAR: run without --continue"
    );
    let dead_reckoned = Frames::without_scans(data_set.records.as_slice(), config);
    let (trajectory, summary) = dead_reckoned.map_err(|error| explain(error, data_set))?;
    around.interrupt.is_preparing(false);
    let path = DeadReckoning::new(trajectory.iter().copied());
    let floor = if paints { paint_floor(data_set, config, &path, &trajectory, around)? } else { None };
    let nothing = Slam::new(config).finish();
    Ok(Solution {
        steps: Vec::new(),
        trajectory,
        odometry: Vec::new(),
        closures: nothing.closures,
        uncertainties: nothing.uncertainties,
        kidnappings: nothing.kidnappings,
        graph: None,
        odometry_scale: None,
        session: nothing.session,
        map: nothing.map,
        floor,
        summary,
        refused: BTreeMap::new(),
        scan_times: ScanTimes::default(),
        finish_s: 0.0,
        partial: around.interrupt.requested(),
    })
}
