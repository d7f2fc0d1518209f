//! Gaussian sites of events.

use pyo3::prelude::*;

use crate::border::{
    Numbers, Outcomes, Points, Table, Vector, Whole, array, bad_input, decode, encode, reduce, vector, work,
};
use crate::prior::Prior;

/// Returns observations from inputs, outcomes and weights. Every weight is 1 if none are given.
pub fn observations(x: Points, y: Outcomes, weights: Option<Numbers>) -> PyResult<dgpc::Observations> {
    let weights = weights.map_or_else(|| vec![1.0; y.0.len()], |weights| weights.0);
    dgpc::Observations::weighted(x.0, y.0, weights).map_err(bad_input)
}

/// Gaussian sites of N events: their likelihood given the Pólya-Gamma variables ω.
///
/// Sites depend on no kernel and no prior mean. A posterior under any prior can absorb them.
///
/// Parameters
/// ----------
/// x : array of shape (N, d)
/// y : array of shape (N,)
///     Outcomes, 0 or 1.
/// omega : array of shape (N,)
///     Precisions of the sites, positive. `Fit.omega` and Gibbs sampling give them.
/// weights : array of shape (N,), optional
///     The log-likelihood of each event is multiplied by its weight.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> sites = dgpc.Sites([[0.0], [1.0]], [True, False], [0.25, 0.2])
///     >>> len(sites), sites.kappa
///     (2, array([ 0.5, -0.5]))
#[pyclass(frozen, module = "dgpc")]
pub struct Sites(pub dgpc::Sites);

#[pymethods]
impl Sites {
    #[new]
    #[pyo3(signature = (x, y, omega, weights=None))]
    fn new(x: Points, y: Outcomes, omega: Numbers, weights: Option<Numbers>) -> PyResult<Self> {
        dgpc::Sites::new(&observations(x, y, weights)?, omega.0).map(Self).map_err(bad_input)
    }

    /// The inputs, shape (N, d).
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> PyResult<Table<'py>> {
        array(py, self.0.inputs())
    }

    /// The precisions ω, shape (N,).
    #[getter]
    fn omega<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.omega())
    }

    /// κ = weight · (y − ½), shape (N,).
    #[getter]
    fn kappa<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.kappa())
    }

    /// Returns the sites at `indices`, in that order.
    fn select(&self, indices: Whole) -> PyResult<Self> {
        Ok(Self(self.0.select(&crate::border::indices(indices, self.0.len())?)))
    }

    /// Returns κ̃ = κ − ωμ₀(x), shape (N,): the shift of the sites about a prior mean.
    fn shift<'py>(&self, py: Python<'py>, prior: &Prior) -> PyResult<Vector<'py>> {
        Ok(vector(py, work(py, || self.0.shift(prior.0.mean()))?))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        format!("Sites of {} events", self.0.len())
    }

    /// Returns the sites of the bytes. Damaged and newer bytes raise a `ValueError`.
    #[staticmethod]
    fn from_bytes(data: &[u8]) -> PyResult<Self> {
        decode(data).map(Self)
    }

    /// Returns the sites as bytes with a version and a checksum.
    fn to_bytes(&self) -> PyResult<Vec<u8>> {
        encode(&self.0)
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (Py<PyAny>,))> {
        reduce(slf.as_any())
    }
}
