//! Long work: on a thread of its own, while Python's main thread hears Ctrl-C and tells how far it is.

use crate::errors::failed;
use floorprint_cli::Watcher;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use std::panic::resume_unwind;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// Ctrl-C is heard, and progress told, this often.
const PERIOD: Duration = Duration::from_millis(50);

/// Does `work` without the interpreter's lock. `progress(task, done, total)` is called on the way; what it raises, and
/// Ctrl-C, ends the work. Warnings become Python's.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<Bound<'_, PyAny>>,
    work: impl FnOnce(&Watcher) -> anyhow::Result<Option<T>> + Send,
) -> PyResult<T> {
    let watcher = Watcher::default();
    let tell = || -> PyResult<()> {
        py.check_signals()?;
        if let Some((progress, state)) = progress.as_ref().zip(watcher.progress()) {
            progress.call1((state.task, state.done, state.total))?;
        }
        Ok(())
    };
    let mut raised = None;
    let outcome = thread::scope(|scope| {
        let (ended, end) = mpsc::channel::<()>();
        let worker = scope.spawn(|| {
            let outcome = work(&watcher);
            drop(ended);
            outcome
        });
        // The channel closes at the end.
        let wait = move || matches!(end.recv_timeout(PERIOD), Err(mpsc::RecvTimeoutError::Timeout));
        let wait = std::sync::Mutex::new(wait);
        while py.detach(|| wait.lock().is_ok_and(|wait| wait())) {
            if let Err(error) = tell() {
                watcher.stop();
                raised.get_or_insert(error);
            }
        }
        worker.join()
    });
    if let Some(error) = raised {
        return Err(error);
    }
    tell()?;
    let warn = py.import("warnings")?.getattr("warn")?;
    for warning in watcher.take_warnings() {
        warn.call1((warning, py.import("floorprint._errors")?.getattr("DataWarning")?, 3))?;
    }
    match outcome {
        Ok(Ok(Some(value))) => Ok(value),
        Ok(Ok(None)) => Err(PyKeyboardInterrupt::new_err(())),
        Ok(Err(error)) => Err(failed(&error)),
        Err(panic) => resume_unwind(panic),
    }
}
