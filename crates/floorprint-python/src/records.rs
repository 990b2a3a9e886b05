//! What sensors deliver.

use crate::arrays::{PoseTuple, floats, pose, pose_tuple, single_floats};
use floorprint::SensorId;
use floorprint::sensors::{self, Record, StampedPose};
use numpy::PyArray1;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::sync::Arc;

/// What a LiDAR's rays have in common from scan to scan.
///
/// angles_rad: (n,) angle of each ray in the LiDAR's frame, radians, counter-clockwise from its x axis.
/// range_min_m, range_max_m: ranges below are no measurement; at or beyond, nothing came back.
/// time_offsets_s: (n,) when each ray was taken relative to the scan's stamp, seconds; 0 where nothing is said.
/// below_minimum_is_no_return: whether a range below the least means that nothing came back.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct ScanGeometry(Arc<sensors::ScanGeometry>);

#[pymethods]
impl ScanGeometry {
    #[new]
    #[pyo3(signature = (angles_rad, range_min_m, range_max_m, *, time_offsets_s=None, below_minimum_is_no_return=false))]
    fn new(
        angles_rad: &Bound<'_, PyAny>,
        range_min_m: f32,
        range_max_m: f32,
        time_offsets_s: Option<&Bound<'_, PyAny>>,
        below_minimum_is_no_return: bool,
    ) -> PyResult<Self> {
        let angles_rad = floats(angles_rad, "angles_rad")?;
        let time_offsets_s = time_offsets_s.map(|offsets| single_floats(offsets, "time_offsets_s")).transpose()?;
        let time_offsets_s = time_offsets_s.unwrap_or_else(|| vec![0.0; angles_rad.len()]);
        if time_offsets_s.len() != angles_rad.len() {
            let (offsets, angles) = (time_offsets_s.len(), angles_rad.len());
            return Err(PyValueError::new_err(format!("time_offsets_s: {offsets} values for {angles} angles")));
        }
        let geometry =
            sensors::ScanGeometry { angles_rad, time_offsets_s, range_min_m, range_max_m, below_minimum_is_no_return };
        Ok(Self(Arc::new(geometry)))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    #[getter]
    fn angles_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.angles_rad)
    }

    #[getter]
    fn time_offsets_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.time_offsets_s)
    }

    #[getter]
    fn range_min_m(&self) -> f32 {
        self.0.range_min_m
    }

    #[getter]
    fn range_max_m(&self) -> f32 {
        self.0.range_max_m
    }
}

/// One turn of a planar LiDAR.
///
/// stamp_s: seconds. ranges_m: (n,) raw ranges, metres, one for each ray of `geometry`; single precision, others are
/// converted. odometry: (x, y, theta) of the robot's base by its own odometry at this scan, metres and radians, if known.
/// sensor: which LiDAR, from 0.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct Scan(sensors::Scan);

#[pymethods]
impl Scan {
    #[new]
    #[pyo3(signature = (stamp_s, ranges_m, geometry, *, odometry=None, sensor=0))]
    fn new(
        stamp_s: f64,
        ranges_m: &Bound<'_, PyAny>,
        geometry: &ScanGeometry,
        odometry: Option<PoseTuple>,
        sensor: u8,
    ) -> PyResult<Self> {
        let ranges_m = single_floats(ranges_m, "ranges_m")?;
        if ranges_m.len() != geometry.0.len() {
            let (ranges, rays) = (ranges_m.len(), geometry.0.len());
            return Err(PyValueError::new_err(format!("ranges_m: {ranges} ranges for {rays} rays of the geometry")));
        }
        let geometry = Arc::clone(&geometry.0);
        let odometry = odometry.map(pose);
        Ok(Self(sensors::Scan { sensor: SensorId(sensor), stamp_s, ranges_m, geometry, odometry }))
    }

    #[getter]
    fn stamp_s(&self) -> f64 {
        self.0.stamp_s
    }

    #[getter]
    fn ranges_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.ranges_m)
    }

    #[getter]
    fn geometry(&self) -> ScanGeometry {
        ScanGeometry(Arc::clone(&self.0.geometry))
    }

    #[getter]
    fn odometry(&self) -> Option<PoseTuple> {
        self.0.odometry.as_ref().map(pose_tuple)
    }

    #[getter]
    fn sensor(&self) -> u8 {
        self.0.sensor.0
    }

    fn __repr__(&self) -> String {
        format!("Scan(stamp_s={}, {} rays)", self.0.stamp_s, self.0.ranges_m.len())
    }
}

/// A pose that the robot's own odometry states: stamp_s in seconds, x and y in metres, theta in radians.
#[pyclass(frozen, get_all, module = "floorprint")]
pub(crate) struct Odometry {
    stamp_s: f64,
    x: f64,
    y: f64,
    theta: f64,
}

#[pymethods]
impl Odometry {
    #[new]
    fn new(stamp_s: f64, x: f64, y: f64, theta: f64) -> Self {
        Self { stamp_s, x, y, theta }
    }

    fn __repr__(&self) -> String {
        format!("Odometry(stamp_s={}, x={}, y={}, theta={})", self.stamp_s, self.x, self.y, self.theta)
    }
}

/// Ticks of the wheels since the previous reading, left and right, positive forward; stamp_s in seconds.
#[pyclass(frozen, get_all, module = "floorprint")]
pub(crate) struct Encoders {
    stamp_s: f64,
    left_ticks: f64,
    right_ticks: f64,
}

#[pymethods]
impl Encoders {
    #[new]
    fn new(stamp_s: f64, left_ticks: f64, right_ticks: f64) -> Self {
        Self { stamp_s, left_ticks, right_ticks }
    }

    fn __repr__(&self) -> String {
        format!("Encoders(stamp_s={}, left_ticks={}, right_ticks={})", self.stamp_s, self.left_ticks, self.right_ticks)
    }
}

/// A reading of an IMU in the body's axes (x ahead, y left, z up).
///
/// stamp_s: seconds. angular_velocity_rad_s: about x, y, z. linear_acceleration_m_s2: specific force along x, y, z.
#[pyclass(frozen, get_all, module = "floorprint")]
pub(crate) struct Imu {
    stamp_s: f64,
    angular_velocity_rad_s: [f64; 3],
    linear_acceleration_m_s2: [f64; 3],
}

#[pymethods]
impl Imu {
    #[new]
    #[pyo3(signature = (stamp_s, angular_velocity_rad_s, linear_acceleration_m_s2=[0.0; 3]))]
    fn new(stamp_s: f64, angular_velocity_rad_s: [f64; 3], linear_acceleration_m_s2: [f64; 3]) -> Self {
        Self { stamp_s, angular_velocity_rad_s, linear_acceleration_m_s2 }
    }

    fn __repr__(&self) -> String {
        format!("Imu(stamp_s={}, angular_velocity_rad_s={:?})", self.stamp_s, self.angular_velocity_rad_s)
    }
}

/// A record from Python.
pub(crate) fn record(object: &Bound<'_, PyAny>) -> PyResult<Record> {
    if let Ok(scan) = object.cast::<Scan>() {
        return Ok(Record::Scan(scan.get().0.clone()));
    }
    if let Ok(stated) = object.cast::<Odometry>() {
        let &Odometry { stamp_s, x, y, theta } = stated.get();
        return Ok(Record::Odometry(StampedPose { stamp_s, pose: pose((x, y, theta)) }));
    }
    if let Ok(reading) = object.cast::<Encoders>() {
        let &Encoders { stamp_s, left_ticks, right_ticks } = reading.get();
        return Ok(Record::Encoders(sensors::EncoderReading { stamp_s, left_ticks, right_ticks }));
    }
    if let Ok(reading) = object.cast::<Imu>() {
        let &Imu { stamp_s, angular_velocity_rad_s, linear_acceleration_m_s2 } = reading.get();
        return Ok(Record::Imu(sensors::ImuReading { stamp_s, angular_velocity_rad_s, linear_acceleration_m_s2 }));
    }
    let kind = object.get_type().name()?;
    Err(PyTypeError::new_err(format!("expected a Scan, Odometry, Encoders or Imu, found {kind}")))
}

/// A record for Python.
pub(crate) fn object<'py>(py: Python<'py>, record: &Record) -> PyResult<Bound<'py, PyAny>> {
    Ok(match record {
        Record::Scan(scan) => Scan(scan.clone()).into_pyobject(py)?.into_any(),
        Record::Odometry(StampedPose { stamp_s, pose }) => {
            Odometry::new(*stamp_s, pose.x, pose.y, pose.theta).into_pyobject(py)?.into_any()
        }
        Record::Encoders(reading) => {
            Encoders::new(reading.stamp_s, reading.left_ticks, reading.right_ticks).into_pyobject(py)?.into_any()
        }
        Record::Imu(reading) => {
            Imu::new(reading.stamp_s, reading.angular_velocity_rad_s, reading.linear_acceleration_m_s2)
                .into_pyobject(py)?
                .into_any()
        }
    })
}
