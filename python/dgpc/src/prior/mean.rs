//! Priors, and their prior means.

use dgpc::{Parameter, PriorMean};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::kernel::{AnyKernel, Kernel};
use crate::border::{Numbers, Points, Vector, Whole, bad_input, decode, encode, reduce, vector, work};

/// A prior mean that falls with the distance between two groups of columns.
///
/// The log-odds of success are intercept − slope · ‖x[start] − x[end]‖.
///
/// Parameters
/// ----------
/// intercept : float
///     Log-odds at distance zero.
/// slope : float
///     Decrease of the log-odds for each unit of distance.
/// start, end : array of int
///     The columns of the two ends, equally many.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> mean = dgpc.RangeMean(intercept=3.0, slope=0.5, start=[0, 1], end=[2, 3])
///     >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, dimension=4), mean)
///     >>> prior.mean_at([[0.0, 0.0, 3.0, 4.0]])
///     array([0.5])
#[pyclass(frozen, module = "dgpc")]
pub struct RangeMean(dgpc::RangeMean);

#[pymethods]
impl RangeMean {
    #[new]
    fn new(intercept: f64, slope: f64, start: Whole, end: Whole) -> PyResult<Self> {
        dgpc::RangeMean::new(intercept, slope, &start.0, &end.0).map(Self).map_err(bad_input)
    }

    /// The log-odds at distance zero.
    #[getter]
    fn intercept(&self) -> f64 {
        self.0.intercept()
    }

    /// The decrease of the log-odds for each unit of distance.
    #[getter]
    fn slope(&self) -> f64 {
        self.0.slope()
    }

    fn __repr__(&self) -> String {
        format!("RangeMean({}, {}, {:?}, {:?})", self.0.intercept(), self.0.slope(), self.0.from(), self.0.to())
    }
}

/// A prior mean: zero, a constant, or one that falls with distance.
#[derive(FromPyObject)]
enum Mean<'py> {
    Range(Bound<'py, RangeMean>),
    Constant(f64),
}

/// A Gaussian-process prior over the latent function: a kernel and a prior mean.
///
/// The latent function gives the log-odds of success. Its unit is the nat.
///
/// Parameters
/// ----------
/// kernel : Kernel or Term
/// mean : float or RangeMean, optional
///     Prior mean of the latent function. `None` is zero and stays zero. A number is a constant that can be learned.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("matern52", [1.0, 3.0], variance=2.0), mean=0.5)
///     >>> prior.parameters
///     ['variance', 'length_scale', 'length_scale', 'intercept']
///     >>> prior == dgpc.Prior.from_json(prior.to_json())
///     True
#[pyclass(frozen, module = "dgpc")]
pub struct Prior(pub dgpc::Prior);

/// Returns the name of a kind of parameter.
fn name(parameter: &Parameter) -> &'static str {
    match parameter {
        Parameter::Variance => "variance",
        Parameter::Reciprocity => "reciprocity",
        Parameter::LengthScale => "length_scale",
        Parameter::Shape => "shape",
        Parameter::Intercept => "intercept",
        Parameter::Slope => "slope",
        _ => "other",
    }
}

#[pymethods]
impl Prior {
    #[new]
    #[pyo3(signature = (kernel, mean=None))]
    fn new(kernel: AnyKernel, mean: Option<Mean<'_>>) -> PyResult<Self> {
        let mean = match mean {
            None => PriorMean::Zero,
            Some(Mean::Constant(value)) => PriorMean::Constant(value),
            Some(Mean::Range(range)) => PriorMean::Range(range.get().0.clone()),
        };
        dgpc::Prior::new(kernel.0, mean).map(Self).map_err(bad_input)
    }

    /// The covariance function.
    #[getter]
    fn kernel(&self) -> Kernel {
        Kernel(self.0.kernel().clone())
    }

    /// The prior mean, as it was given.
    #[getter]
    fn mean(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        match self.0.mean() {
            PriorMean::Constant(value) => Ok(value.into_pyobject(py)?.into_any().unbind()),
            PriorMean::Range(range) => Ok(Py::new(py, RangeMean(range.clone()))?.into_any()),
            _ => Ok(py.None()),
        }
    }

    /// Returns the prior mean at every point.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (N, d)
    ///
    /// Returns
    /// -------
    /// array of shape (N,)
    fn mean_at<'py>(&self, py: Python<'py>, x: Points) -> PyResult<Vector<'py>> {
        Ok(vector(py, work(py, || self.0.mean().values(&x.0))?))
    }

    /// The kind of every learned parameter, in the order of `parameter_values`.
    #[getter]
    fn parameters(&self) -> Vec<&'static str> {
        self.0.parameters().iter().map(name).collect()
    }

    /// The learned parameters: logarithms, log-odds of a reciprocity, and the intercept itself.
    #[getter]
    fn parameter_values<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.parameter_values())
    }

    /// Returns a prior of the same structure with other parameters.
    ///
    /// Parameters
    /// ----------
    /// values : array of float
    ///     One number for each of `parameters`, on the scale of `parameter_values`.
    fn with_parameters(&self, values: Numbers) -> PyResult<Self> {
        let count = self.0.parameters().len();
        if values.0.len() != count {
            return Err(PyValueError::new_err(format!("expected {count} parameters, found {}", values.0.len())));
        }
        self.0.with_parameters(&values.0).map(Self).map_err(bad_input)
    }

    /// Returns the prior as JSON. All numbers keep their exact values.
    fn to_json(&self) -> PyResult<String> {
        serde_json::to_string(&self.0).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Returns the prior that `to_json` wrote.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        serde_json::from_str(text).map(Self).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Returns the prior as bytes with a version and a checksum.
    fn to_bytes(&self) -> PyResult<Vec<u8>> {
        encode(&self.0)
    }

    /// Returns the prior of the bytes. Damaged and newer bytes raise a `ValueError`.
    #[staticmethod]
    fn from_bytes(data: &[u8]) -> PyResult<Self> {
        decode(data).map(Self)
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (Py<PyAny>,))> {
        reduce(slf.as_any())
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let mean = match self.0.mean() {
            PriorMean::Constant(value) => format!("mean {value}"),
            PriorMean::Range(_) => "range mean".to_owned(),
            _ => "mean 0".to_owned(),
        };
        format!("Prior with a kernel of {} terms and {mean}", self.0.kernel().terms().len())
    }
}
