//! The commands of the program, and event logs.

use std::ffi::OsString;
use std::path::PathBuf;

use pingmap_trial::EventLog;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors::failed;
use crate::work::{work, work_and_warn};

/// Returns the command line with the program's name before the arguments.
fn command_line(arguments: Vec<OsString>) -> Vec<OsString> {
    [OsString::from("pingmap")].into_iter().chain(arguments).collect()
}

/// Runs one command, and returns the text that it prints. Calls `warn` with each warning.
#[pyfunction]
#[pyo3(signature = (arguments, warn, /))]
pub fn run(py: Python<'_>, arguments: Vec<OsString>, warn: &Bound<'_, PyAny>) -> PyResult<String> {
    let printed = work_and_warn(py, warn, |interrupt| {
        let mut printed = Vec::new();
        pingmap::run_until(command_line(arguments), &mut printed, interrupt).map(|()| printed)
    })?;
    match printed {
        Ok(printed) => String::from_utf8(printed).map_err(|error| PyValueError::new_err(error.to_string())),
        // The help or the version.
        Err(failure) if failure.status == 0 => Ok(failure.message),
        Err(failure) => Err(failed(failure)),
    }
}

/// Runs the program, which prints to the standard output and error of the process. Returns the exit status.
#[pyfunction]
#[pyo3(signature = (arguments, /))]
pub fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| pingmap::main_with(command_line(arguments)))
}

/// Reads an event log, and returns it as CSV with standard columns.
#[pyfunction]
#[pyo3(signature = (path, /))]
pub fn read_log(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    let log = work(py, |_| EventLog::open(&path).map(|log| log.to_csv()))?;
    log.map_err(|error| PyValueError::new_err(error.to_string()))
}
