//! Recordings: what was recorded, record by record, or as frames.

use crate::arrays::{PoseTuple, pose_tuple};
use crate::configuration::Layers;
use crate::errors::OrRaise;
use crate::images::RgbdImage;
use crate::records::object;
use floorprint::texture::{ImagePair, pair_by_time};
use floorprint::{Frames, Points};
use floorprint_io::{DataSet, ImageEntry, LoadedPair, OpenOptions, TopicChoice, USUAL_EXPANSION, open};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A recorded drive: an iterable of its records, in the order in which they are to be processed.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct Recording(DataSet);

/// Which drive of a folder, which topics of a bag (scans, odometry, truth, base), and how far files may expand.
#[derive(FromPyObject, Clone)]
pub(crate) struct Choice(Option<u32>, Vec<String>, Option<String>, Option<String>, Option<String>, Option<f64>);

impl Choice {
    pub(crate) fn options(&self) -> OpenOptions {
        let Self(drive, scans, odometry, truth, base, max_expansion) = self.clone();
        OpenOptions {
            drive,
            max_expansion: max_expansion.unwrap_or(USUAL_EXPANSION),
            topics: TopicChoice { scans, odometry, truth, base, ..TopicChoice::default() },
        }
    }
}

#[pymethods]
impl Recording {
    /// Reads a recording, recognised by its content.
    #[new]
    fn new(py: Python<'_>, path: PathBuf, choice: Choice) -> PyResult<Self> {
        py.detach(|| open(&path, &choice.options())).map(Self).or_raise()
    }

    fn __len__(&self) -> usize {
        self.0.records.len()
    }

    fn __getitem__<'py>(&self, py: Python<'py>, index: isize) -> PyResult<Bound<'py, PyAny>> {
        let length = self.0.records.len();
        let position = if index < 0 { index.checked_add_unsigned(length) } else { Some(index) };
        let record = position.and_then(|position| self.0.records.get(usize::try_from(position).ok()?));
        match record {
            Some(record) => object(py, record),
            None => Err(PyIndexError::new_err(format!("record {index} of {length}"))),
        }
    }

    fn __iter__(recording: Py<Self>) -> RecordIterator {
        RecordIterator { recording, next: 0 }
    }

    /// Name of the format as recognised.
    #[getter]
    fn format(&self) -> &'static str {
        self.0.format.name
    }

    /// The robot's calibration as JSON.
    #[getter]
    fn robot_json(&self) -> PyResult<String> {
        serde_json::to_string(&self.0.robot).or_raise()
    }

    /// What is missing, what was assumed.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }

    /// How much was not used, by reason.
    #[getter]
    fn dropped(&self) -> std::collections::BTreeMap<String, usize> {
        self.0.dropped.iter().map(|(reason, count)| (reason.description().to_owned(), count)).collect()
    }

    /// SHA-256 of the input.
    #[getter]
    fn input_sha256(&self) -> String {
        self.0.input_hash.clone()
    }

    /// The frames that `Slam.process` takes: scans with the motion that leads to them.
    fn frames(&self, py: Python<'_>, layers: Layers) -> PyResult<Vec<Frame>> {
        let config = layers.config()?;
        let frames = py.detach(|| {
            let frames = Frames::new(&self.0.records, &config)?;
            let mut pass = frames.iter();
            let made: Vec<Frame> = pass.by_ref().map(Frame).collect();
            pass.error().map_or(Ok(made), |error| Err(error.clone()))
        });
        frames.or_raise()
    }

    /// Colour images and the depth images that belong to them, as numbers of both.
    fn image_pairs(&self, layers: Layers) -> PyResult<Vec<(usize, usize)>> {
        let gap_max_s = layers.config()?.texture.pairing_gap_max_s;
        let Some(images) = &self.0.images else { return Ok(Vec::new()) };
        let stamps = |entries: &[ImageEntry]| entries.iter().map(|entry| entry.stamp_s).collect::<Vec<_>>();
        let pairing = pair_by_time(&stamps(&images.depth), &stamps(&images.color), gap_max_s);
        Ok(pairing.pairs.iter().map(|pair| (pair.depth, pair.color)).collect())
    }

    /// Reads images.
    fn images(&self, py: Python<'_>, pairs: Vec<(usize, usize)>) -> PyResult<Vec<RgbdImage>> {
        let Some(images) = &self.0.images else { return Ok(Vec::new()) };
        if pairs.iter().any(|(depth, color)| *depth >= images.depth.len() || *color >= images.color.len()) {
            return Err(PyIndexError::new_err("there is no such image"));
        }
        let pairs: Vec<ImagePair> = pairs.into_iter().map(|(depth, color)| ImagePair { depth, color }).collect();
        let take =
            |pair: LoadedPair| pair.map(|(depth, color)| RgbdImage { depth: Arc::new(depth), color: Arc::new(color) });
        py.detach(|| images.for_each_pair(&pairs, &|| false, &take)).into_iter().map(|image| image.or_raise()).collect()
    }

    fn __repr__(&self) -> String {
        format!("Recording({}, {} records, robot {:?})", self.0.format.name, self.0.records.len(), self.0.robot.name)
    }
}

/// Goes through a recording.
#[pyclass(module = "floorprint")]
pub(crate) struct RecordIterator {
    recording: Py<Recording>,
    next: usize,
}

#[pymethods]
impl RecordIterator {
    fn __iter__(iterator: PyRef<'_, Self>) -> PyRef<'_, Self> {
        iterator
    }

    fn __next__<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(record) = self.recording.get().0.records.get(self.next) else { return Ok(None) };
        self.next += 1;
        object(py, record).map(Some)
    }
}

/// A scan in the body's frame, with the motion that leads to it.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct Frame(pub(crate) floorprint::Frame);

#[pymethods]
impl Frame {
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

    /// Odometry since the previous frame (x, y, theta), metres and radians; None where nothing measured it.
    #[getter]
    fn motion(&self) -> Option<PoseTuple> {
        self.0.motion.as_ref().map(pose_tuple)
    }

    /// Dead reckoning since the start (x, y, theta), metres and radians.
    #[getter]
    fn dead_reckoning(&self) -> PoseTuple {
        pose_tuple(&self.0.dead_reckoning)
    }

    /// Where the LiDAR is in the body's frame (x, y), metres.
    #[getter]
    fn origin_m(&self) -> (f64, f64) {
        self.0.scan.origin_m.into()
    }

    /// (n, 2) float32: where rays ended on something, in the body's frame, metres.
    #[getter]
    fn hits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        array(py, &self.0.scan.hits)
    }

    /// (n, 2) float32: up to where rays without a return are taken to be free, in the body's frame, metres.
    #[getter]
    fn free_ends<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        array(py, &self.0.scan.free_ends)
    }
}

fn array<'py>(py: Python<'py>, points: &Points) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let rows = points.iter().flatten().collect();
    PyArray1::from_vec(py, rows).reshape([points.len(), 2])
}
