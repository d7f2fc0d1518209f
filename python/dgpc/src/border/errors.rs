//! Errors of the crate as exceptions of Python.

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

pyo3::create_exception!(
    dgpc,
    Error,
    PyRuntimeError,
    "A computation failed, although its arguments were valid.\n\n\
     A matrix could not be factorised, or numbers near the end of the floating-point range overflowed."
);

/// Returns the exception for a refused argument: always a `ValueError`.
pub fn bad_input(error: dgpc::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Returns the exception for an error of a computation whose numbers were checked before.
///
/// Only the computation itself can then meet a matrix that cannot be factorised, or an infinity. All other errors are
/// due to the arguments.
pub fn failed(error: dgpc::Error) -> PyErr {
    match error {
        dgpc::Error::NotFinite { .. }
        | dgpc::Error::NotPositiveDefinite { .. }
        | dgpc::Error::NegativeEigenvalue { .. }
        | dgpc::Error::NoEigenvalues { .. } => Error::new_err(error.to_string()),
        error => bad_input(error),
    }
}
