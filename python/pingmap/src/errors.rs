//! Errors of the crates as exceptions of Python.

use pingmap::Failure;
use pingmap_agent::AgentError;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

pyo3::create_exception!(
    pingmap,
    Error,
    PyRuntimeError,
    "A command or a computation failed, although its input was valid.\n\n\
     A file could not be written, for example, or a matrix could not be factorised."
);

/// Returns the exception for the failure of a command: a `ValueError` for bad input.
///
/// A request for help is no result of a function, so it is bad input, too.
pub fn failed(Failure { message, status }: Failure) -> PyErr {
    let message = message.trim_end().to_owned();
    if status == 1 { Error::new_err(message) } else { PyValueError::new_err(message) }
}

/// Returns the exception for an error of an agent: a `ValueError` unless the computation itself failed.
pub fn agent_failed(error: AgentError) -> PyErr {
    match error {
        AgentError::Method(_) | AgentError::CountersUsedUp { .. } => Error::new_err(error.to_string()),
        error => PyValueError::new_err(error.to_string()),
    }
}
