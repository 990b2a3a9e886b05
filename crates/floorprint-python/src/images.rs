//! Colour and depth images, to and from numpy.

use floorprint::sensors::{ColorImage, DepthImage};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::sync::Arc;

/// A colour image and the depth image that belongs to it.
///
/// stamp_s: when the colour image was taken, seconds. rgb: (height, width, 3) uint8. depth: (height, width), of a size of
/// its own; floats are metres along the optical axis, NaN or 0 where nothing was measured; uint16 is what the camera
/// stores: millimetres, or disparities of the course's Kinect. depth_stamp_s: when the depth image was taken, seconds;
/// with the colour image where nothing is said.
#[pyclass(frozen, module = "floorprint")]
#[derive(Clone)]
pub(crate) struct RgbdImage {
    pub(crate) depth: Arc<DepthImage>,
    pub(crate) color: Arc<ColorImage>,
}

#[pymethods]
impl RgbdImage {
    #[new]
    #[pyo3(signature = (stamp_s, rgb, depth, *, depth_stamp_s=None))]
    fn new(
        stamp_s: f64,
        rgb: &Bound<'_, PyAny>,
        depth: &Bound<'_, PyAny>,
        depth_stamp_s: Option<f64>,
    ) -> PyResult<Self> {
        let depth_stamp_s = depth_stamp_s.unwrap_or(stamp_s);
        if !(stamp_s.is_finite() && depth_stamp_s.is_finite()) {
            return Err(PyValueError::new_err("stamp_s, depth_stamp_s: expected finite numbers of seconds"));
        }
        Ok(Self { color: Arc::new(color(stamp_s, rgb)?), depth: Arc::new(depth_image(depth_stamp_s, depth)?) })
    }

    #[getter]
    fn stamp_s(&self) -> f64 {
        self.color.stamp_s
    }

    #[getter]
    fn depth_stamp_s(&self) -> f64 {
        self.depth.stamp_s
    }

    #[getter]
    fn rgb<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let values = self.color.rgb.as_flattened().to_vec();
        PyArray1::from_vec(py, values).reshape([self.color.height, self.color.width, 3])
    }

    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u16>>> {
        PyArray1::from_slice(py, &self.depth.values).reshape([self.depth.height, self.depth.width])
    }

    fn __repr__(&self) -> String {
        let Self { depth, color } = self;
        format!(
            "RgbdImage(stamp_s={}, {}×{} colour, {}×{} depth)",
            color.stamp_s, color.width, color.height, depth.width, depth.height
        )
    }
}

fn color(stamp_s: f64, rgb: &Bound<'_, PyAny>) -> PyResult<ColorImage> {
    let array = rgb.extract::<PyReadonlyArray3<'_, u8>>().ok().filter(|array| array.shape()[2] == 3);
    let array = array.ok_or_else(|| expected("rgb", "an array of shape (height, width, 3) of uint8", rgb))?;
    let pixels = array.as_array();
    let rgb = pixels.rows().into_iter().map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    Ok(ColorImage { stamp_s, width: array.shape()[1], height: array.shape()[0], rgb })
}

fn depth_image(stamp_s: f64, depth: &Bound<'_, PyAny>) -> PyResult<DepthImage> {
    // What is beyond the range of the integers is farther than any floor: not measured.
    let millimetres = |metres: f64| {
        let value = (1e3 * metres).round();
        if value >= 1.0 && value <= f64::from(u16::MAX) { value as u16 } else { 0 }
    };
    let (values, shape): (Vec<u16>, [usize; 2]) = if let Ok(array) = depth.extract::<PyReadonlyArray2<'_, u16>>() {
        (array.as_array().iter().copied().collect(), [array.shape()[0], array.shape()[1]])
    } else if let Ok(array) = depth.extract::<PyReadonlyArray2<'_, f32>>() {
        let values = array.as_array().iter().map(|&metres| millimetres(f64::from(metres))).collect();
        (values, [array.shape()[0], array.shape()[1]])
    } else if let Ok(array) = depth.extract::<PyReadonlyArray2<'_, f64>>() {
        let values = array.as_array().iter().map(|&metres| millimetres(metres)).collect();
        (values, [array.shape()[0], array.shape()[1]])
    } else {
        return Err(expected("depth", "an array of shape (height, width) of uint16 or floats", depth));
    };
    Ok(DepthImage { stamp_s, width: shape[1], height: shape[0], values })
}

fn expected(name: &str, what: &str, found: &Bound<'_, PyAny>) -> PyErr {
    let of = |attribute| found.getattr(attribute).and_then(|value| value.str()).map(|text| text.to_string()).ok();
    let kind = found.get_type().name().map_or("an object".to_owned(), |name| name.to_string());
    let shape =
        of("shape").zip(of("dtype")).map_or(String::new(), |(shape, dtype)| format!(" of shape {shape}, {dtype}"));
    PyTypeError::new_err(format!("{name}: expected {what}, found {kind}{shape}"))
}
