//! Errors as Python's exceptions, with the text of the command line.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// What makes an exception of the package's own class.
fn exception(class: &str, text: String) -> PyErr {
    Python::attach(|py| {
        let make = || py.import("floorprint._errors")?.getattr(class)?.call1((&text,));
        make().map_or_else(|_| PyRuntimeError::new_err(text.clone()), PyErr::from_value)
    })
}

/// An error of a recording, a file or a computation; or of the configuration, where that is its cause.
pub(crate) fn failed(error: &anyhow::Error) -> PyErr {
    let class = if floorprint_cli::is_about_arguments(error) { "ConfigError" } else { "Error" };
    exception(class, format!("{error:#}"))
}

/// Gives results the package's exceptions.
pub(crate) trait OrRaise<T> {
    /// The value, or the exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T, E: Into<anyhow::Error>> OrRaise<T> for Result<T, E> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(|error| failed(&error.into()))
    }
}
