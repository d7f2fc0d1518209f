//! Arrays of Python as numbers of the crate, and back.
//!
//! An array is copied once, in blocks that NumPy converts. Any layout and any type of real numbers is accepted.

use dgpc::{Inputs, Matrix};
use numpy::npyffi::NPY_ORDER;
use numpy::{PyArray1, PyArray2, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyOverflowError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PySlice;

use super::errors::bad_input;
use super::work::check_memory;

/// Number of numbers that NumPy converts at once.
const BLOCK: usize = 65_536;

/// N points of d coordinates, from an array of shape (N, d).
pub struct Points(pub Inputs);

/// Finite numbers, from an array of one dimension.
pub struct Numbers(pub Vec<f64>);

/// A square matrix of finite numbers, from an array of shape (M, M).
pub struct Square(pub Matrix);

/// Outcomes, from an array of one dimension that contains only 0 and 1, or `False` and `True`.
pub struct Outcomes(pub Vec<bool>);

/// A number of things, at least 0.
#[derive(Clone, Copy)]
pub struct Count(pub usize);

/// A finite number.
#[derive(Clone, Copy)]
pub struct Finite(pub f64);

/// A standard deviation, finite and at least 0.
#[derive(Clone, Copy)]
pub struct Deviation(pub f64);

/// A share, from 0 to 1.
#[derive(Clone, Copy)]
pub struct Share(pub f64);

/// Whole numbers, at least 0, from an array of one dimension.
pub struct Whole(pub Vec<usize>);

/// Returns the object as an array of real numbers, without a copy if it is one.
fn real<'py>(object: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let py = object.py();
    let numpy = py.import("numpy")?;
    if object.is_instance(&numpy.getattr("ma")?.getattr("MaskedArray")?)? {
        return Err(PyValueError::new_err("masked arrays are not supported: fill or drop the masked entries"));
    }
    let array = numpy.call_method1("asarray", (object,))?.cast_into::<PyUntypedArray>()?;
    if b"biuf".contains(&array.dtype().kind()) {
        return Ok(array);
    }
    let found = array.dtype().str()?;
    Err(PyValueError::new_err(format!("expected an array of real numbers, found the data type {found}")))
}

/// Returns the object as an array of `dimensions` dimensions.
fn shaped<'py>(object: &Bound<'py, PyAny>, dimensions: usize) -> PyResult<Bound<'py, PyUntypedArray>> {
    let array = real(object)?;
    if array.ndim() == dimensions {
        return Ok(array);
    }
    let (expected, found) = (["a number", "one dimension", "two dimensions"][dimensions], array.ndim());
    let hint = if (dimensions, found) == (2, 1) { "; reshape(-1, 1) makes a column of it" } else { "" };
    Err(PyValueError::new_err(format!("expected an array of {expected}, found {found}{hint}")))
}

/// Copies an array of one or two dimensions, row by row.
fn copied(array: &Bound<'_, PyUntypedArray>) -> PyResult<Vec<f64>> {
    let (py, shape) = (array.py(), array.shape());
    let (rows, width) = (shape[0], shape[1..].iter().product::<usize>());
    check_memory(&[rows, width])?;
    let convert = py.import("numpy")?.getattr("require")?;
    let mut numbers = Vec::with_capacity(rows * width);
    let step = (BLOCK / width.max(1)).max(1);
    for first in (0..rows).step_by(step) {
        let block = array.get_item(PySlice::new(py, first as isize, rows.min(first + step) as isize, 1))?;
        let block = convert.call1((block, "float64", ["C_CONTIGUOUS", "ALIGNED"]))?.call_method1("reshape", (-1,))?;
        let block = block.cast_into::<PyArray1<f64>>()?;
        numbers.extend_from_slice(block.try_readonly()?.as_slice()?);
    }
    Ok(numbers)
}

/// Checks that all numbers are finite.
fn finite(numbers: Vec<f64>) -> PyResult<Vec<f64>> {
    match numbers.iter().position(|number| !number.is_finite()) {
        Some(place) => {
            Err(PyValueError::new_err(format!("numbers must be finite, found {} at place {place}", numbers[place])))
        }
        None => Ok(numbers),
    }
}

impl<'py> FromPyObject<'_, 'py> for Points {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array = shaped(&object, 2)?;
        Inputs::new(copied(&array)?, array.shape()[1]).map(Self).map_err(bad_input)
    }
}

impl<'py> FromPyObject<'_, 'py> for Numbers {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        finite(copied(&shaped(&object, 1)?)?).map(Self)
    }
}

impl<'py> FromPyObject<'_, 'py> for Square {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array = shaped(&object, 2)?;
        let (rows, columns) = (array.shape()[0], array.shape()[1]);
        let numbers = finite(copied(&array)?)?;
        Ok(Self(Matrix::from_fn(rows, columns, |row, column| numbers[row * columns + column])))
    }
}

impl<'py> FromPyObject<'_, 'py> for Outcomes {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let numbers = copied(&shaped(&object, 1)?)?;
        let outcome = |(place, &number): (usize, &f64)| match number {
            0.0 => Ok(false),
            1.0 => Ok(true),
            _ => Err(PyValueError::new_err(format!("outcomes must be 0 or 1, found {number} at place {place}"))),
        };
        numbers.iter().enumerate().map(outcome).collect::<PyResult<_>>().map(Self)
    }
}

impl<'py> FromPyObject<'_, 'py> for Count {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        object.extract().map(Self).map_err(|error| match error.is_instance_of::<PyOverflowError>(object.py()) {
            true => PyValueError::new_err("expected a whole number, at least 0 and below 2^64"),
            false => error,
        })
    }
}

/// Returns the object as a number for which `is_valid` holds.
fn number(object: &Bound<'_, PyAny>, expected: &str, is_valid: impl Fn(f64) -> bool) -> PyResult<f64> {
    let number: f64 = object.extract()?;
    if is_valid(number) {
        return Ok(number);
    }
    Err(PyValueError::new_err(format!("expected {expected}, found {number}")))
}

impl<'py> FromPyObject<'_, 'py> for Finite {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        number(&object, "a finite number", f64::is_finite).map(Self)
    }
}

impl<'py> FromPyObject<'_, 'py> for Deviation {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let is_valid = |number: f64| number.is_finite() && number >= 0.0;
        number(&object, "a finite standard deviation, at least 0", is_valid).map(Self)
    }
}

impl<'py> FromPyObject<'_, 'py> for Share {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        number(&object, "a share from 0 to 1", |number| (0.0..=1.0).contains(&number)).map(Self)
    }
}

impl<'py> FromPyObject<'_, 'py> for Whole {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let numbers = copied(&shaped(&object, 1)?)?;
        let whole = |(place, &number): (usize, &f64)| {
            if number.fract() == 0.0 && (0.0..9e15).contains(&number) {
                return Ok(number as usize);
            }
            let expected = "expected whole numbers, at least 0";
            Err(PyValueError::new_err(format!("{expected}, found {number} at place {place}")))
        };
        numbers.iter().enumerate().map(whole).collect::<PyResult<_>>().map(Self)
    }
}

/// Checks that all indices are below `count`.
pub fn indices(Whole(indices): Whole, count: usize) -> PyResult<Vec<usize>> {
    match indices.iter().find(|&&index| index >= count) {
        Some(index) => Err(PyValueError::new_err(format!("index {index} is out of range for {count} rows"))),
        None => Ok(indices),
    }
}

/// An array of one dimension that Python receives.
pub type Vector<'py> = Bound<'py, PyArray1<f64>>;

/// An array of two dimensions that Python receives.
pub type Table<'py> = Bound<'py, PyArray2<f64>>;

/// Returns numbers as an array. A vector is moved, a slice is copied.
pub fn vector(py: Python<'_>, numbers: impl Into<Vec<f64>>) -> Vector<'_> {
    PyArray1::from_vec(py, numbers.into())
}

/// Returns points as an array of shape (N, d).
pub fn array<'py>(py: Python<'py>, inputs: &Inputs) -> PyResult<Table<'py>> {
    let values = inputs.rows().flatten().copied().collect();
    PyArray1::from_vec(py, values).reshape([inputs.len(), inputs.dimension()])
}

/// Returns a matrix as an array.
pub fn matrix<'py>(py: Python<'py>, matrix: &Matrix) -> PyResult<Table<'py>> {
    let entries = (0..matrix.columns()).flat_map(|column| matrix.column(column)).copied().collect();
    PyArray1::from_vec(py, entries).reshape_with_order([matrix.rows(), matrix.columns()], NPY_ORDER::NPY_FORTRANORDER)
}
