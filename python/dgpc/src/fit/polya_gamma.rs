//! Pólya-Gamma variables and probabilities, number by number. The Python functions broadcast their arguments.

use dgpc::{Place, polya_gamma};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::border::{Count, Numbers, Vector, Whole, generator, interruptible, vector, work};

/// Largest shape of a variable that is drawn, as a sum of that many variables of shape 1.
const SHAPE_MAX: usize = 1_000_000;

/// Checks that two arrays are equally long.
fn same_length(first: usize, second: usize) -> PyResult<()> {
    let message = || format!("expected arrays of equal length, found {first} and {second}");
    if first == second { Ok(()) } else { Err(PyValueError::new_err(message())) }
}

/// Draws from PG(shape, tilt) for every pair of numbers.
#[pyfunction]
pub fn polya_gamma_draws<'py>(py: Python<'py>, shape: Whole, tilt: Numbers, seed: Count) -> PyResult<Vector<'py>> {
    let (Whole(shape), Numbers(tilt)) = (shape, tilt);
    same_length(shape.len(), tilt.len())?;
    if let Some(bad) = shape.iter().find(|shape| !(1..=SHAPE_MAX).contains(shape)) {
        return Err(PyValueError::new_err(format!("shape must be a whole number from 1 to {SHAPE_MAX}, found {bad}")));
    }
    let (mut generator, mut draws) = (generator(seed, 0), Vec::with_capacity(tilt.len()));
    interruptible(py, tilt.len(), |place| {
        let sum =
            (0..shape[place]).map(|_| polya_gamma::sample(&mut generator, tilt[place])).sum::<dgpc::Result<f64>>();
        sum.map(|sum| draws.push(sum))
    })?;
    Ok(vector(py, draws))
}

/// Returns the mean and the variance of PG(shape, tilt) for every pair of numbers.
#[pyfunction]
pub fn polya_gamma_moments<'py>(
    py: Python<'py>,
    shape: Numbers,
    tilt: Numbers,
) -> PyResult<(Vector<'py>, Vector<'py>)> {
    same_length(shape.0.len(), tilt.0.len())?;
    if let Some(bad) = shape.0.iter().find(|shape| **shape <= 0.0) {
        return Err(PyValueError::new_err(format!("shape must be positive, found {bad}")));
    }
    let each = |of: fn(f64, f64) -> f64| -> dgpc::Result<Vec<f64>> {
        let values: Vec<f64> = shape.0.iter().zip(&tilt.0).map(|(&shape, &tilt)| of(shape, tilt)).collect();
        let (what, overflow) = ("moment of a Pólya-Gamma variable", values.iter().position(|value| !value.is_finite()));
        let error = |place| dgpc::Error::NotFinite { what, place: Place::Element(place), value: values[place] };
        overflow.map(error).map_or(Ok(()), Err)?;
        Ok(values)
    };
    let (mean, variance) = work(py, || Ok((each(polya_gamma::mean)?, each(polya_gamma::variance)?)))?;
    Ok((vector(py, mean), vector(py, variance)))
}

/// Returns the probability of success for every mean and variance of the latent function.
#[pyfunction]
pub fn success_probabilities<'py>(py: Python<'py>, mean: Numbers, variance: Numbers) -> PyResult<Vector<'py>> {
    same_length(mean.0.len(), variance.0.len())?;
    if let Some(bad) = variance.0.iter().find(|variance| **variance < 0.0) {
        return Err(PyValueError::new_err(format!("variance must be at least 0, found {bad}")));
    }
    let probabilities: Vec<f64> = work(py, || {
        let pairs = mean.0.iter().zip(&variance.0);
        Ok(pairs.map(|(&mean, &variance)| dgpc::success_probability(mean, variance)).collect())
    })?;
    Ok(vector(py, probabilities))
}
