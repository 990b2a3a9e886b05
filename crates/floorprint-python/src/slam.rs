//! SLAM, pushed by hand.

use crate::arrays::{Columns, PoseTuple, PyRaster, floor_array, map_array, pose_tuple};
use crate::configuration::Layers;
use crate::errors::{OrRaise, failed};
use crate::images::RgbdImage;
use crate::painter::Painter;
use crate::recording::Frame;
use crate::records::record;
use crate::session::Session;
use anyhow::Context as _;
use floorprint::odometry::Synchronizer;
use floorprint::sensors::Record;
use floorprint::texture::TextureMap;
use floorprint_cli::Stored;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Mutex;

/// Simultaneous localisation and mapping, live.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct Slam(Mutex<Option<Live>>);

/// What is pushed into, and what comes of it.
struct Live {
    synchronizer: Synchronizer,
    slam: floorprint::Slam,
    /// Where the robot states a camera.
    painter: Option<Painter>,
    config: floorprint::Config,
}

impl Live {
    fn new(config: floorprint::Config, slam: floorprint::Slam) -> anyhow::Result<Self> {
        let synchronizer = Synchronizer::new(&config, None)?;
        let painter = Painter::new(&config)?;
        Ok(Self { synchronizer, slam, painter, config })
    }

    fn push(&mut self, record: Record) -> anyhow::Result<Vec<StepReport>> {
        let frames = self.synchronizer.push(record)?;
        if let Some(painter) = &mut self.painter {
            painter.follow(self.synchronizer.dead_reckoning());
        }
        self.process(frames)
    }

    /// No record follows soon.
    fn flush(&mut self) -> anyhow::Result<Vec<StepReport>> {
        let frames = self.synchronizer.finish()?;
        if let Some(painter) = &mut self.painter {
            painter.flush(self.synchronizer.dead_reckoning());
        }
        self.process(frames)
    }

    /// The floor so far, where images showed any.
    fn floor(&mut self) -> Option<TextureMap> {
        let painter = self.painter.as_ref()?;
        painter.paint(&self.slam.trajectory())
    }

    fn process(&mut self, frames: Vec<floorprint::Frame>) -> anyhow::Result<Vec<StepReport>> {
        frames.iter().map(|frame| Ok(StepReport(self.slam.process(frame)?))).collect()
    }
}

impl Slam {
    /// Does something with what there is, without the interpreter's lock.
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Live) -> anyhow::Result<T> + Send) -> PyResult<T> {
        let outcome = py.detach(|| {
            let mut live = self.0.lock().ok()?;
            live.as_mut().map(work)
        });
        outcome.ok_or_else(finished)?.map_err(|error| failed(&error))
    }
}

fn finished() -> PyErr {
    PyRuntimeError::new_err("the drive is finished; begin another one with a new Slam")
}

#[pymethods]
impl Slam {
    #[new]
    fn new(layers: Layers) -> PyResult<Self> {
        let config = layers.config()?;
        let slam = floorprint::Slam::new(&config);
        Ok(Self(Mutex::new(Some(Live::new(config, slam).or_raise()?))))
    }

    /// Goes on with a session where it ended.
    #[staticmethod]
    fn resume(session: &Session, layers: Layers) -> PyResult<Self> {
        let config = layers.config()?;
        let slam = floorprint::Slam::resume(session.0.session.clone(), &config).or_raise()?;
        Ok(Self(Mutex::new(Some(Live::new(config, slam).or_raise()?))))
    }

    /// Takes in a record, or an image; gives a report for each scan that is ready by now.
    fn push(&self, py: Python<'_>, object: &Bound<'_, PyAny>) -> PyResult<Vec<StepReport>> {
        if let Ok(image) = object.cast::<RgbdImage>() {
            let image = image.get().clone();
            return self.with(py, |live| {
                let painter = live.painter.as_mut().context("the robot states no camera: [robot.depth_camera]")?;
                painter.push(image);
                painter.follow(live.synchronizer.dead_reckoning());
                Ok(Vec::new())
            });
        }
        let record = record(object)?;
        self.with(py, |live| live.push(record))
    }

    /// Takes in a frame of a recording.
    fn process(&self, py: Python<'_>, frame: &Frame) -> PyResult<StepReport> {
        self.with(py, |live| Ok(StepReport(live.slam.process(&frame.0)?)))
    }

    /// No record follows soon: scans that still wait for the odometry are taken in.
    fn flush(&self, py: Python<'_>) -> PyResult<Vec<StepReport>> {
        self.with(py, Live::flush)
    }

    /// The next frame may be from anywhere: the robot was switched off and may have been moved.
    fn interrupt(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |live| {
            live.slam.interrupt();
            Ok(())
        })
    }

    /// The map so far; None as long as nothing was seen.
    fn map<'py>(&self, py: Python<'py>) -> PyResult<Option<PyRaster<'py>>> {
        let map = self.with(py, |live| Ok(live.slam.map().to_raster()))?;
        map.map(|map| map_array(py, &map)).transpose()
    }

    /// The floor so far; None as long as no image showed any.
    fn floor<'py>(&self, py: Python<'py>) -> PyResult<Option<PyRaster<'py>>> {
        let floor = self.with(py, |live| Ok(live.floor()))?;
        floor.map(|floor| floor_array(py, &floor)).transpose()
    }

    /// The trajectory so far, as columns.
    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let poses = self.with(py, |live| Ok(live.slam.trajectory()))?;
        Ok(Columns::of_poses(py, &poses)?.into_dict())
    }

    /// The session so far.
    fn session(&self, py: Python<'_>) -> PyResult<Session> {
        let stored = self.with(py, |live| {
            let floor = live.floor();
            Ok(Stored::new(live.slam.session().clone(), live.config.clone(), floor))
        });
        Ok(Session(stored?))
    }

    /// Ends the drive: the waiting scans are taken in, the last loops closed, and all scans fitted to each other.
    fn finish(&self, py: Python<'_>) -> PyResult<Session> {
        let stored = py.detach(|| {
            let mut live = self.0.lock().ok()?.take()?;
            let finish = || {
                live.flush()?;
                let Live { slam, painter, config, .. } = live;
                let result = slam.finish();
                let floor = painter.and_then(|painter| painter.paint(&result.trajectory));
                Ok(Stored::new(result.session, config, floor))
            };
            Some(finish())
        });
        stored.ok_or_else(finished)?.map(Session).map_err(|error: anyhow::Error| failed(&error))
    }
}

/// What one step did.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct StepReport(floorprint::StepReport);

#[pymethods]
impl StepReport {
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

    /// The body's pose in the world as of now (x, y, theta), metres and radians.
    #[getter]
    fn pose(&self) -> PoseTuple {
        pose_tuple(&self.0.pose)
    }

    /// Dead reckoning since the start (x, y, theta), metres and radians.
    #[getter]
    fn dead_reckoning(&self) -> PoseTuple {
        pose_tuple(&self.0.dead_reckoning)
    }

    /// The transform that REP 105 calls map→odom (x, y, theta), metres and radians.
    #[getter]
    fn world_from_odom(&self) -> PoseTuple {
        pose_tuple(&self.0.world_from_odom)
    }

    /// Whether the robot seems to have been kidnapped and was not found again.
    #[getter]
    fn is_lost(&self) -> bool {
        self.0.is_lost
    }

    /// Standard deviation of the position, metres; None where nothing is known of it.
    #[getter]
    fn sigma_m(&self) -> Option<f64> {
        self.0.uncertainty.map(|uncertainty| uncertainty.sigma_m)
    }

    /// Standard deviation of the heading, radians; None where nothing is known of it.
    #[getter]
    fn sigma_rad(&self) -> Option<f64> {
        self.0.uncertainty.map(|uncertainty| uncertainty.sigma_rad)
    }

    /// Share of the scan's points that lie on the map.
    #[getter]
    fn inlier_share(&self) -> f64 {
        self.0.filter.inlier_share
    }

    /// How well the scan fits: mean log-likelihood per point, or the share of eq. 21's hits.
    #[getter]
    fn score(&self) -> f64 {
        self.0.filter.score
    }

    /// Effective number of particles.
    #[getter]
    fn effective_particles(&self) -> f64 {
        self.0.filter.effective_particles
    }

    fn __repr__(&self) -> String {
        let floorprint::StepReport { index, stamp_s, pose, is_lost, .. } = &self.0;
        let (x, y, theta) = pose_tuple(pose);
        format!("StepReport(index={index}, stamp_s={stamp_s}, pose=({x:.3}, {y:.3}, {theta:.3}), is_lost={is_lost})")
    }
}
