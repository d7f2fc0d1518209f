//! Kernels: sums of terms.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use super::mean::Prior;
use super::term::Term;
use crate::border::{Points, Table, Vector, bad_input, check_memory, long_work, matrix, vector, work};

/// A covariance function: the sum of its terms.
///
/// `term + term` makes a kernel, too. Functions that need a kernel also accept one term, or a prior.
///
/// Parameters
/// ----------
/// terms : sequence of Term
///     The terms, at least one.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> kernel = dgpc.Kernel([dgpc.Term("matern32", 1.0, variance=2.0, dimension=1)])
///     >>> kernel.gram([[0.0], [0.0]])
///     array([[2., 2.],
///            [2., 2.]])
#[pyclass(frozen, module = "dgpc")]
pub struct Kernel(pub dgpc::Kernel);

/// A kernel, from a kernel, a term or a prior.
pub struct AnyKernel(pub dgpc::Kernel);

impl<'py> FromPyObject<'_, 'py> for AnyKernel {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(kernel) = object.cast::<Kernel>() {
            return Ok(Self(kernel.get().0.clone()));
        }
        if let Ok(prior) = object.cast::<Prior>() {
            return Ok(Self(prior.get().0.kernel().clone()));
        }
        if let Ok(term) = object.cast::<Term>() {
            return Kernel::sum([&term.get().0]).map(|kernel| Self(kernel.0));
        }
        Err(PyTypeError::new_err(format!("expected a Kernel, a Term or a Prior, found {}", object.get_type().name()?)))
    }
}

impl Kernel {
    /// Returns the sum of terms.
    pub fn sum<'a>(terms: impl IntoIterator<Item = &'a dgpc::Term>) -> PyResult<Self> {
        dgpc::Kernel::new(terms.into_iter().cloned().collect()).map(Self).map_err(bad_input)
    }
}

#[pymethods]
impl Kernel {
    #[new]
    fn new(terms: Vec<Bound<'_, Term>>) -> PyResult<Self> {
        Self::sum(terms.iter().map(|term| &term.get().0))
    }

    /// The terms.
    #[getter]
    fn terms(&self) -> Vec<Term> {
        self.0.terms().iter().cloned().map(Term).collect()
    }

    /// Returns the covariances among N points, in O(N²d).
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (N, d)
    ///
    /// Returns
    /// -------
    /// array of shape (N, N)
    fn gram(slf: Py<Self>, py: Python<'_>, x: Points) -> PyResult<Table<'_>> {
        check_memory(&[x.0.len(), x.0.len()])?;
        matrix(py, &long_work(py, move || slf.get().0.gram(&x.0))?)
    }

    /// Returns the covariances between two sets of points.
    ///
    /// Parameters
    /// ----------
    /// a : array of shape (N, d)
    /// b : array of shape (M, d)
    ///
    /// Returns
    /// -------
    /// array of shape (N, M)
    fn cross(slf: Py<Self>, py: Python<'_>, a: Points, b: Points) -> PyResult<Table<'_>> {
        check_memory(&[a.0.len(), b.0.len()])?;
        matrix(py, &long_work(py, move || slf.get().0.cross(&a.0, &b.0))?)
    }

    /// Returns the prior variance at every point.
    ///
    /// Parameters
    /// ----------
    /// x : array of shape (N, d)
    ///
    /// Returns
    /// -------
    /// array of shape (N,)
    fn diagonal<'py>(&self, py: Python<'py>, x: Points) -> PyResult<Vector<'py>> {
        Ok(vector(py, work(py, || self.0.diagonal(&x.0))?))
    }

    fn __add__(&self, other: AnyKernel) -> PyResult<Self> {
        Self::sum(self.0.terms().iter().chain(other.0.terms()))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let count = self.0.terms().len();
        format!("Kernel of {count} term{}", if count == 1 { "" } else { "s" })
    }
}
