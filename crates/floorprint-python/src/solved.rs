//! A drive solved as `floorprint run` solves it.

use crate::arrays::{Columns, PyRaster, floor_array, map_array, map_raster};
use crate::configuration::Layers;
use crate::errors::{OrRaise, failed};
use crate::recording::Choice;
use crate::session::Session;
use crate::watched::watched;
use floorprint::back_end::{ClosureReport, Verdict};
use floorprint::{Config, StepReport};
use floorprint_cli::{Request, Stored, map_picture, solve_drive};
use floorprint_io::png_bytes;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A drive with what was made of it.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct Solved(Mutex<floorprint_cli::Solved>);

/// Solves a drive without writing anything.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "they are named on the side of Python")]
pub(crate) fn solve(
    py: Python<'_>,
    path: PathBuf,
    choice: Choice,
    layers: Layers,
    threads: Option<u16>,
    paints_floor: bool,
    call: String,
    fetched_from: Option<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<Solved> {
    let request = Request { path, options: choice.options(), settings: layers.settings()?, threads, paints_floor };
    let mut solved = watched(py, progress, |watcher| solve_drive(&request, watcher))?;
    solved.made_by(call);
    if let Some(address) = fetched_from {
        solved.fetched_from(address);
    }
    Ok(Solved(Mutex::new(solved)))
}

/// A map as a PNG file's bytes.
#[pyfunction]
pub(crate) fn map_png<'py>(
    py: Python<'py>,
    cells: PyReadonlyArray2<'_, i8>,
    resolution_m: f64,
    origin_m: (f64, f64),
) -> PyResult<Bound<'py, PyBytes>> {
    let map = map_raster(&cells, resolution_m, origin_m)?;
    let bytes = py.detach(|| png_bytes(&map_picture(&map))).or_raise()?;
    Ok(PyBytes::new(py, &bytes))
}

impl Solved {
    fn solved(&self) -> MutexGuard<'_, floorprint_cli::Solved> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Solved {
    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let solution = &self.solved().solution;
        let sigmas = |of: fn(&floorprint::back_end::Uncertainty) -> f64| {
            (0..solution.trajectory.len()).map(move |pose| solution.uncertainties.get(pose).map_or(f64::NAN, of))
        };
        Ok(Columns::of_poses(py, &solution.trajectory)?
            .with("sigma_m", sigmas(|uncertainty| uncertainty.sigma_m))?
            .with("sigma_rad", sigmas(|uncertainty| uncertainty.sigma_rad))?
            .into_dict())
    }

    fn odometry<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        Ok(Columns::of_poses(py, &self.solved().solution.odometry)?.into_dict())
    }

    /// The true trajectory; None where it is not known.
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let solved = self.solved();
        let truth = solved.true_trajectory();
        (!truth.is_empty()).then(|| Ok(Columns::of_poses(py, truth)?.into_dict())).transpose()
    }

    fn steps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let solved = self.solved();
        let steps = solved.solution.steps.iter();
        let sigma_m = |step: &StepReport| step.uncertainty.map_or(f64::NAN, |uncertainty| uncertainty.sigma_m);
        let sigma_rad = |step: &StepReport| step.uncertainty.map_or(f64::NAN, |uncertainty| uncertainty.sigma_rad);
        Ok(Columns::new(py)
            .with("index", steps.clone().map(|step| step.index as u64))?
            .with("stamp_s", steps.clone().map(|step| step.stamp_s))?
            .with_poses(steps.clone().map(|step| &step.pose))?
            .with("sigma_m", steps.clone().map(sigma_m))?
            .with("sigma_rad", steps.clone().map(sigma_rad))?
            .with("score", steps.clone().map(|step| step.filter.score))?
            .with("inlier_share", steps.clone().map(|step| step.filter.inlier_share))?
            .with("effective_particles", steps.clone().map(|step| step.filter.effective_particles))?
            .with("resampled", steps.clone().map(|step| step.filter.resampled))?
            .with("odometry_rejected", steps.clone().map(|step| step.filter.odometry_rejected))?
            .with("is_lost", steps.map(|step| step.is_lost))?
            .into_dict())
    }

    /// Columns of the comparisons of two places.
    fn closures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let solved = self.solved();
        let solution = &solved.solution;
        let closures = solution.closures.iter();
        let stamp_s = |place: usize| {
            let poses = &solution.trajectory;
            move |closure: &ClosureReport| poses.get(closure.frames[place]).map_or(f64::NAN, |pose| pose.stamp_s)
        };
        Ok(Columns::new(py)
            .with("older_frame", closures.clone().map(|closure| closure.frames[0] as u64))?
            .with("newer_frame", closures.clone().map(|closure| closure.frames[1] as u64))?
            .with("older_stamp_s", closures.clone().map(stamp_s(0)))?
            .with("newer_stamp_s", closures.clone().map(stamp_s(1)))?
            .with_poses(closures.clone().map(|closure| &closure.middle_from_middle))?
            .with("correction_m", closures.clone().map(|closure| closure.correction_m))?
            .with("correction_rad", closures.clone().map(|closure| closure.correction_rad))?
            .with("inlier_share", closures.clone().map(|closure| closure.inlier_shares[0]))?
            .with("distinctness", closures.clone().map(|closure| closure.distinctness))?
            .with("sigma_m", closures.clone().map(|closure| closure.sigma_m))?
            .with("accepted", closures.map(|closure| closure.verdict == Verdict::Accepted))?
            .into_dict())
    }

    /// What became of each comparison, in words.
    fn verdicts(&self) -> Vec<&'static str> {
        self.solved().solution.closures.iter().map(|closure| closure.verdict.meaning()).collect()
    }

    fn map<'py>(&self, py: Python<'py>) -> PyResult<PyRaster<'py>> {
        map_array(py, &self.solved().map)
    }

    fn floor<'py>(&self, py: Python<'py>) -> PyResult<Option<PyRaster<'py>>> {
        self.solved().solution.floor.as_ref().map(|floor| floor_array(py, &floor.map)).transpose()
    }

    fn session(&self) -> Session {
        let solved = self.solved();
        let floor = solved.solution.floor.as_ref().map(|floor| floor.map.clone());
        Session(Stored::new(solved.solution.session.clone(), solved.config.clone(), floor))
    }

    fn report_json(&self) -> PyResult<String> {
        self.solved().report_json().map_err(|error| failed(&error))
    }

    fn config_toml(&self) -> String {
        Config::to_toml(&self.solved().config)
    }

    fn picture_png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| self.solved().picture_png()).map_err(|error| failed(&error))?;
        Ok(PyBytes::new(py, &bytes))
    }

    fn save(&self, py: Python<'_>, out: PathBuf, replace: bool) -> PyResult<()> {
        py.detach(|| self.solved().save(&out, replace)).map_err(|error| failed(&error))
    }
}
