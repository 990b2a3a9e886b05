//! Numbers to and from numpy.

use floorprint::geometry::Pose2;
use floorprint::map::{Occupancy, Raster};
use floorprint::sensors::StampedPose;
use floorprint::texture::TextureMap;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A pose as Python has it: x and y in metres, theta in radians.
pub(crate) type PoseTuple = (f64, f64, f64);

/// A pose as Python has it.
pub(crate) fn pose_tuple(pose: &Pose2) -> PoseTuple {
    (pose.x, pose.y, pose.theta)
}

/// A pose from Python.
pub(crate) fn pose((x, y, theta): PoseTuple) -> Pose2 {
    Pose2::new(x, y, theta)
}

/// One-dimensional floats: an array of either precision, or any sequence of numbers.
pub(crate) fn floats(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<f64>> {
    if let Ok(array) = value.extract::<PyReadonlyArray1<'_, f64>>() {
        return Ok(array.as_array().iter().copied().collect());
    }
    value.extract::<Vec<f64>>().map_err(|_| not_floats(value, name))
}

/// The same in single precision, which ranges have.
pub(crate) fn single_floats(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<f32>> {
    if let Ok(array) = value.extract::<PyReadonlyArray1<'_, f32>>() {
        return Ok(array.as_array().iter().copied().collect());
    }
    Ok(floats(value, name)?.into_iter().map(|value| value as f32).collect())
}

fn not_floats(value: &Bound<'_, PyAny>, name: &str) -> PyErr {
    let shape = value
        .getattr("shape")
        .and_then(|shape| shape.str())
        .map_or(String::new(), |shape| format!(" of shape {shape}"));
    let kind = value.get_type().name().map_or("an object".to_owned(), |name| name.to_string());
    PyTypeError::new_err(format!("{name}: expected a one-dimensional array of floats, found {kind}{shape}"))
}

/// Stamped poses from an array of rows `stamp_s, x, y, theta`.
pub(crate) fn stamped_poses(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<StampedPose>> {
    let array = array.as_array();
    if array.ncols() != 4 {
        return Err(PyValueError::new_err(format!(
            "poses: expected an array of shape (n, 4), stamp_s, x, y, theta; found {:?}",
            array.shape()
        )));
    }
    Ok(array
        .rows()
        .into_iter()
        .map(|row| StampedPose { stamp_s: row[0], pose: Pose2::new(row[1], row[2], row[3]) })
        .collect())
}

/// Columns of a table, which the Python side puts together to a structured array.
pub(crate) struct Columns<'py>(Bound<'py, PyDict>);

impl<'py> Columns<'py> {
    pub(crate) fn new(py: Python<'py>) -> Self {
        Self(PyDict::new(py))
    }

    /// One more column.
    pub(crate) fn with<T: numpy::Element>(self, name: &str, values: impl Iterator<Item = T>) -> PyResult<Self> {
        self.0.set_item(name, PyArray1::from_vec(self.0.py(), values.collect()))?;
        Ok(self)
    }

    /// Columns `x`, `y` and `theta`.
    pub(crate) fn with_poses<'a>(self, poses: impl Iterator<Item = &'a Pose2> + Clone) -> PyResult<Self> {
        self.with("x", poses.clone().map(|pose| pose.x))?
            .with("y", poses.clone().map(|pose| pose.y))?
            .with("theta", poses.map(|pose| pose.theta))
    }

    /// Stamped poses: `stamp_s`, `x`, `y`, `theta`.
    pub(crate) fn of_poses(py: Python<'py>, poses: &[StampedPose]) -> PyResult<Self> {
        Self::new(py)
            .with("stamp_s", poses.iter().map(|stamped| stamped.stamp_s))?
            .with_poses(poses.iter().map(|stamped| &stamped.pose))
    }

    pub(crate) fn into_dict(self) -> Bound<'py, PyDict> {
        self.0
    }
}

/// Rows of a raster from the lowest y on: those of a picture the other way round.
fn upwards<T>(raster: &Raster<T>) -> impl Iterator<Item = &T> {
    raster.cells.chunks(raster.width.max(1)).rev().flatten()
}

/// A raster's cells, resolution and origin as Python gets them.
pub(crate) type PyRaster<'py> = (Bound<'py, PyAny>, f64, (f64, f64));

/// The occupancy map as `int8` of shape (height, width): −1 unknown, 0 free, 100 occupied, row 0 at the lowest y.
pub(crate) fn map_array<'py>(py: Python<'py>, map: &Raster<Occupancy>) -> PyResult<PyRaster<'py>> {
    let value = |cell: &Occupancy| match cell {
        Occupancy::Unknown => -1_i8,
        Occupancy::Free => 0,
        Occupancy::Occupied => 100,
    };
    let cells = PyArray1::from_vec(py, upwards(map).map(value).collect());
    Ok((cells.reshape([map.height, map.width])?.into_any(), map.resolution_m, map.origin_m.into()))
}

/// The floor as `uint8` of shape (height, width, 4): red, green, blue, opacity; row 0 at the lowest y.
pub(crate) fn floor_array<'py>(py: Python<'py>, floor: &TextureMap) -> PyResult<PyRaster<'py>> {
    let color = |cell: &Option<[u8; 3]>| cell.map_or([0; 4], |[red, green, blue]| [red, green, blue, 255]);
    let cells = PyArray1::from_vec(py, upwards(floor).flat_map(color).collect());
    Ok((cells.reshape([floor.height, floor.width, 4])?.into_any(), floor.resolution_m, floor.origin_m.into()))
}

/// A map from Python's arrays.
pub(crate) fn map_raster(
    cells: &PyReadonlyArray2<'_, i8>,
    resolution_m: f64,
    origin_m: (f64, f64),
) -> PyResult<Raster<Occupancy>> {
    let array = cells.as_array();
    if array.is_empty() || !(resolution_m > 0.0 && resolution_m.is_finite()) {
        return Err(PyValueError::new_err("a map needs at least one cell, and a resolution above 0"));
    }
    let occupancy = |&value: &i8| match value {
        0..50 => Occupancy::Free,
        50.. => Occupancy::Occupied,
        _ => Occupancy::Unknown,
    };
    let rows = array.rows().into_iter().rev();
    let [height, width] = [cells.shape()[0], cells.shape()[1]];
    let cells = rows.flat_map(|row| row.iter().map(occupancy).collect::<Vec<_>>()).collect();
    Ok(Raster { width, height, resolution_m, origin_m: origin_m.into(), cells })
}
