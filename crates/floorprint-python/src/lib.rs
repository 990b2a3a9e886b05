//! Floorprint for Python: the library's nouns as classes, numbers as numpy arrays.
//!
//! Thin: what is computed is computed in the other crates. What is nicer to say in Python (configuration by attributes,
//! pictures, a result in a notebook) is said there, in `python/floorprint`.

mod arrays;
mod configuration;
mod errors;
mod evaluation;
mod images;
mod localizer;
mod painter;
mod recording;
mod records;
mod session;
mod slam;
mod solved;
mod watched;

use pyo3::prelude::*;
use std::ffi::OsString;

/// What the Python modules of Floorprint are made of. Use `import floorprint`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::configuration::{options, resolve};
    #[pymodule_export]
    use super::evaluation::{
        calibrate, check, errors_over_time, evaluate_relations, evaluate_trajectory, read_trajectory, simulate,
        write_trajectory,
    };
    #[pymodule_export]
    use super::images::RgbdImage;
    #[pymodule_export]
    use super::localizer::{LocalizationReport, Localizer};
    #[pymodule_export]
    use super::recording::{Frame, RecordIterator, Recording};
    #[pymodule_export]
    use super::records::{Encoders, Imu, Odometry, Scan, ScanGeometry};
    #[pymodule_export]
    use super::session::Session;
    #[pymodule_export]
    use super::slam::{Slam, StepReport};
    #[pymodule_export]
    use super::solved::{Solved, map_png, solve};
    #[pymodule_export]
    use super::{main, version};
}

/// Runs the command line; gives its exit code. `start` is what starts it again.
#[pyfunction]
fn main(py: Python<'_>, start: Vec<OsString>, arguments: Vec<OsString>) -> u8 {
    let program = floorprint_cli::Program::part_of(start, arguments);
    py.detach(|| floorprint_cli::run(&program).code())
}

/// The version of the package.
#[pyfunction]
fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}
