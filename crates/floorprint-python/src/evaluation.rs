//! Results against the truth, recordings examined, drives simulated.

use crate::arrays::{Columns, stamped_poses};
use crate::configuration::Layers;
use crate::errors::{OrRaise, failed};
use crate::recording::Choice;
use crate::watched::watched;
use floorprint::calibration::Calibration;
use floorprint::evaluation::{Alignment, RelationReport, Span, StampIndex, TrajectoryError, TrajectoryErrorOptions};
use floorprint::simulator::{SimulationConfig, World};
use floorprint_cli::{distances, examine_recording};
use numpy::PyReadonlyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::json;
use std::path::PathBuf;

/// Errors of a trajectory against the true one, as JSON.
#[pyfunction]
pub(crate) fn evaluate_trajectory(
    py: Python<'_>,
    truth: PyReadonlyArray2<'_, f64>,
    estimate: PyReadonlyArray2<'_, f64>,
    align: &str,
    spans_m: Vec<f64>,
) -> PyResult<String> {
    let (truth, estimate) = (stamped_poses(&truth)?, stamped_poses(&estimate)?);
    let alignment = match align {
        "none" => Alignment::None,
        "first" => Alignment::FirstPose,
        "best" => Alignment::LeastSquares,
        other => {
            return Err(PyValueError::new_err(format!("align is {other:?}, expected \"none\", \"first\" or \"best\"")));
        }
    };
    let spans = spans_m.into_iter().map(Span::DistanceM).collect();
    let options = TrajectoryErrorOptions { alignment, spans, ..TrajectoryErrorOptions::default() };
    let error = py.detach(|| TrajectoryError::new(&estimate, &truth, &options)).or_raise()?;
    serde_json::to_string(&error).or_raise()
}

/// How far a trajectory is from the true one at each time, as columns.
#[pyfunction]
pub(crate) fn errors_over_time<'py>(
    py: Python<'py>,
    truth: PyReadonlyArray2<'py, f64>,
    estimate: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let (truth, estimate) = (stamped_poses(&truth)?, stamped_poses(&estimate)?);
    let errors = py.detach(|| distances(&estimate, &StampIndex::new(&truth)));
    let column = |axis: usize| errors.iter().map(move |error| error[axis]);
    Ok(Columns::new(py)
        .with("stamp_s", column(0))?
        .with("translation_m", column(1))?
        .with("rotation_deg", column(2))?
        .into_dict())
}

/// A trajectory against relations of the Freiburg SLAM benchmark, as JSON.
#[pyfunction]
pub(crate) fn evaluate_relations(
    py: Python<'_>,
    relations: PathBuf,
    estimate: PyReadonlyArray2<'_, f64>,
) -> PyResult<String> {
    let estimate = stamped_poses(&estimate)?;
    let report = py.detach(|| {
        let relations = floorprint_io::read_relations(&relations)?;
        anyhow::Ok(RelationReport::new(&estimate, &relations)?)
    });
    serde_json::to_string(&report.map_err(|error| failed(&error))?).or_raise()
}

/// The poses of a TUM file, as columns.
#[pyfunction]
pub(crate) fn read_trajectory(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let poses = py.detach(|| floorprint_io::read_trajectory(&path)).or_raise()?;
    Ok(Columns::of_poses(py, &poses)?.into_dict())
}

/// Writes poses as a TUM file.
#[pyfunction]
pub(crate) fn write_trajectory(py: Python<'_>, path: PathBuf, poses: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
    let poses = stamped_poses(&poses)?;
    py.detach(|| floorprint_io::write_trajectory(&path, &poses)).or_raise()
}

/// What is wrong with a recording, as JSON.
#[pyfunction]
pub(crate) fn check(py: Python<'_>, path: PathBuf, choice: Choice, layers: Layers) -> PyResult<String> {
    let settings = layers.settings()?;
    let told = py.detach(|| examine_recording(&path, &choice.options(), &settings)).map_err(|error| failed(&error))?;
    serde_json::to_string(&told).or_raise()
}

/// What a drive tells of the robot, as JSON.
#[pyfunction]
pub(crate) fn calibrate(py: Python<'_>, path: PathBuf, choice: Choice, layers: Layers) -> PyResult<String> {
    let settings = layers.settings()?;
    let calibration = py.detach(|| {
        let data_set = floorprint_io::open(&path, &choice.options())?;
        let config = settings.resolve(Some(&data_set.robot))?;
        anyhow::Ok(Calibration::of(&data_set.records, &config)?)
    });
    let Calibration { parameters, stretches, residual: [residual_m, residual_rad], .. } =
        calibration.map_err(|error| failed(&error))?;
    let told = json!({
        "stretches": stretches, "residual_m": residual_m, "residual_rad": residual_rad, "parameters": parameters,
    });
    Ok(told.to_string())
}

/// Simulates a drive into a folder; gives its length in seconds.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "they are named on the side of Python")]
pub(crate) fn simulate(
    py: Python<'_>,
    out: PathBuf,
    world: String,
    seed: u64,
    drive: u32,
    settings_json: String,
    replace: bool,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<f64> {
    let config: SimulationConfig = serde_json::from_str(&settings_json)
        .map_err(|error| anyhow::anyhow!("cannot use the simulation's settings: {error}"))
        .map_err(|error| failed(&error))?;
    watched(py, progress, |watcher| {
        let simulated = floorprint::simulator::simulate(World::named(&world, seed)?, config, seed)?;
        floorprint_cli::write_simulation(&simulated, &out, drive, replace, watcher)?;
        Ok(Some(simulated.duration_s()))
    })
}
