//! Sessions: all that is needed to go on, in a file that QGIS and GDAL open.

use crate::arrays::{Columns, PyRaster, floor_array, map_array};
use crate::errors::failed;
use floorprint::map::{Change, difference};
use floorprint_cli::{Placement, Stored};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A drive, or several that were put together.
#[pyclass(frozen, module = "floorprint")]
pub(crate) struct Session(pub(crate) Stored);

/// A patch that changed: `new` or `gone`, its area in square metres, its outlines in metres.
type Patch = (&'static str, f64, Vec<Vec<[f64; 2]>>);

#[pymethods]
impl Session {
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        py.detach(|| Stored::load(&path)).map(Self).map_err(|error| failed(&error))
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.0.save_as_new(&path)).map_err(|error| failed(&error))
    }

    /// This session with the other looked for on it, and whether it was recognised.
    fn merge(&self, py: Python<'_>, other: &Self) -> PyResult<(Self, bool)> {
        let merged = py.detach(|| self.0.clone().merged(&other.0));
        let (merged, placement) = merged.map_err(|error| failed(&error))?;
        Ok((Self(merged), placement == Placement::Placed))
    }

    /// What changed since; None where the later session is not recognised on this one.
    fn diff(&self, py: Python<'_>, later: &Self, tolerance_m: f64, least_area_m2: f64) -> PyResult<Option<Vec<Patch>>> {
        let patches = py.detach(|| {
            let maps = self.0.clone().maps_with(later.0.session.clone())?;
            anyhow::Ok(maps.map(|[before, after]| difference(&before, &after, tolerance_m, least_area_m2)))
        });
        let patches = patches.map_err(|error| failed(&error))?;
        let word = |change| if change == Change::New { "new" } else { "gone" };
        let told = |patch: floorprint::map::ChangedPatch| (word(patch.change), patch.area_m2, patch.outlines_m);
        Ok(patches.map(|patches| patches.into_iter().map(told).collect()))
    }

    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let poses = py.detach(|| self.0.session.trajectory());
        Ok(Columns::of_poses(py, &poses)?.into_dict())
    }

    fn map<'py>(&self, py: Python<'py>) -> PyResult<Option<PyRaster<'py>>> {
        let map = py.detach(|| self.0.session.map().to_raster());
        map.map(|map| map_array(py, &map)).transpose()
    }

    fn floor<'py>(&self, py: Python<'py>) -> PyResult<Option<PyRaster<'py>>> {
        self.0.floor.as_ref().map(|floor| floor_array(py, floor)).transpose()
    }

    fn __len__(&self) -> usize {
        self.0.session.frames()
    }

    fn __repr__(&self) -> String {
        format!("Session({} frames, {} key scans)", self.0.session.frames(), self.0.session.scans().len())
    }
}
