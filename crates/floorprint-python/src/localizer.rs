//! A robot found and followed in a finished map.

use crate::arrays::{PoseTuple, map_raster, pose, pose_tuple};
use crate::configuration::Layers;
use crate::errors::{OrRaise, failed};
use crate::recording::Frame;
use crate::records::record;
use crate::session::Session;
use floorprint::localization::{self, LocalizationMap, Start};
use floorprint::odometry::Synchronizer;
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// Finds a robot in a finished map and follows it; the map is never changed.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct Localizer(Mutex<Live>);

struct Live {
    synchronizer: Synchronizer,
    localizer: localization::Localizer,
}

impl Localizer {
    fn new(py: Python<'_>, map: Option<LocalizationMap>, layers: &Layers, start: Option<PoseTuple>) -> PyResult<Self> {
        let config = layers.config()?;
        let synchronizer = Synchronizer::new(&config, None).or_raise()?;
        let nothing =
            || PyValueError::new_err("the map shows no wall next to free space: there is nothing to be localised by");
        let map = map.filter(|map| !map.is_empty()).ok_or_else(nothing)?;
        let start = start.map_or(Start::Unknown, |start| Start::At(pose(start)));
        let localizer = py.detach(|| localization::Localizer::new(Arc::new(map), start, &config));
        Ok(Self(Mutex::new(Live { synchronizer, localizer })))
    }

    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Live) -> anyhow::Result<T> + Send) -> PyResult<T> {
        py.detach(|| work(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))).map_err(|error| failed(&error))
    }
}

#[pymethods]
impl Localizer {
    #[staticmethod]
    fn in_session(py: Python<'_>, session: &Session, layers: Layers, start: Option<PoseTuple>) -> PyResult<Self> {
        let map = py.detach(|| LocalizationMap::of_session(&session.0.session));
        Self::new(py, map, &layers, start)
    }

    #[staticmethod]
    fn in_map(
        py: Python<'_>,
        cells: PyReadonlyArray2<'_, i8>,
        resolution_m: f64,
        origin_m: (f64, f64),
        layers: Layers,
        start: Option<PoseTuple>,
    ) -> PyResult<Self> {
        let raster = map_raster(&cells, resolution_m, origin_m)?;
        let map = py.detach(|| LocalizationMap::new(&raster));
        Self::new(py, Some(map), &layers, start)
    }

    /// Takes in a record; gives a report for each scan that is ready by now.
    fn push(&self, py: Python<'_>, object: &Bound<'_, PyAny>) -> PyResult<Vec<LocalizationReport>> {
        let record = record(object)?;
        self.with(py, |live| {
            let frames = live.synchronizer.push(record)?;
            frames.iter().map(|frame| Ok(LocalizationReport(live.localizer.process(frame)?))).collect()
        })
    }

    /// Takes in a frame of a recording.
    fn process(&self, py: Python<'_>, frame: &Frame) -> PyResult<LocalizationReport> {
        self.with(py, |live| Ok(LocalizationReport(live.localizer.process(&frame.0)?)))
    }
}

/// What is known of the robot's place after a scan.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct LocalizationReport(localization::LocalizationReport);

#[pymethods]
impl LocalizationReport {
    /// Number of the scan.
    #[getter]
    fn index(&self) -> usize {
        self.0.index
    }

    /// The scan's stamp, seconds.
    #[getter]
    fn stamp_s(&self) -> f64 {
        self.0.stamp_s
    }

    /// The pose that is claimed in the map's frame (x, y, theta), metres and radians; None as long as no place stands
    /// alone, and when the robot is lost.
    #[getter]
    fn pose(&self) -> Option<PoseTuple> {
        self.0.pose.as_ref().map(pose_tuple)
    }

    /// (3, 3): covariance over (x, y, theta) in the map's axes, m² and rad².
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let covariance = &self.0.covariance;
        let rows: Vec<Vec<f64>> = (0..3).map(|row| (0..3).map(|column| covariance[(row, column)]).collect()).collect();
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// How probable it is that the robot is not where the heaviest mode has it.
    #[getter]
    fn lost_probability(&self) -> f64 {
        self.0.lost_probability
    }

    /// Poses that are considered with their weights, the most probable first: ((x, y, theta), weight).
    #[getter]
    fn modes(&self) -> Vec<(PoseTuple, f64)> {
        self.0.modes.iter().map(|mode| (pose_tuple(&mode.pose), mode.weight)).collect()
    }

    /// Whether a search over the whole map is under way.
    #[getter]
    fn is_searching(&self) -> bool {
        self.0.is_searching
    }

    fn __repr__(&self) -> String {
        format!("LocalizationReport(index={}, stamp_s={}, pose={:?})", self.0.index, self.0.stamp_s, self.pose())
    }
}
