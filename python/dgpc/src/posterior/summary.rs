//! Summaries of events at a few inducing points.

use pyo3::prelude::*;

use super::sites::Sites;
use crate::border::{
    Numbers, Points, Share, Square, Table, Vector, array, bad_input, check_memory, decode, encode, long_work, matrix,
    reduce, vector,
};
use crate::prior::Prior;

/// A Gaussian message about the latent function at M inducing points, under a prior.
///
/// The static functions create summaries: `marginal`, `variational`, `empty`, `from_whitened` and `from_factor`.
/// `Posterior.summarise` creates one, too. No method changes a summary; each returns a new one. Summaries at the same
/// points can be added and subtracted.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=2.0, dimension=1))
///     >>> sites = dgpc.Sites([[0.0], [0.2], [2.0]], [1, 1, 0], [0.25, 0.25, 0.25])
///     >>> summary = dgpc.Summary.variational(prior, sites, [[0.1], [2.0]])
///     >>> summary
///     Summary at 2 inducing points
///     >>> received = dgpc.Summary.from_bytes(summary.to_bytes())
///     >>> bool((received.shift == summary.shift).all())
///     True
#[pyclass(frozen, module = "dgpc")]
pub struct Summary(pub dgpc::Summary);

/// Returns the summaries of a list.
pub fn references(summaries: &[Py<Summary>]) -> Vec<&dgpc::Summary> {
    summaries.iter().map(|summary| &summary.get().0).collect()
}

/// Returns copies of the summaries of a list.
pub fn copies(summaries: &[&dgpc::Summary]) -> Vec<dgpc::Summary> {
    summaries.iter().map(|&summary| summary.clone()).collect()
}

impl Summary {
    /// Returns a summary that `change` made from a copy of it.
    fn changed(
        &self,
        py: Python<'_>,
        change: impl FnOnce(&mut dgpc::Summary) -> dgpc::Result<()> + Send + 'static,
    ) -> PyResult<Self> {
        let mut summary = self.0.clone();
        long_work(py, move || change(&mut summary).map(|()| Self(summary)))
    }
}

#[pymethods]
impl Summary {
    /// Returns a summary without information.
    ///
    /// Parameters
    /// ----------
    /// prior : Prior
    /// points : array of shape (M, d)
    ///     The inducing points.
    #[staticmethod]
    fn empty(py: Python<'_>, prior: Py<Prior>, points: Points) -> PyResult<Self> {
        check_memory(&[points.0.len(), points.0.len()])?;
        long_work(py, move || dgpc::Summary::empty(&prior.get().0, &points.0).map(Self))
    }

    /// Returns the exact message of events about the latent function at the inducing points.
    ///
    /// The message is never overconfident, and it is not additive over events. O(N³).
    ///
    /// Parameters
    /// ----------
    /// prior : Prior
    /// sites : Sites
    ///     The N events.
    /// points : array of shape (M, d)
    ///     The inducing points.
    #[staticmethod]
    fn marginal(py: Python<'_>, prior: Py<Prior>, sites: Py<Sites>, points: Points) -> PyResult<Self> {
        check_memory(&[2, sites.get().0.len(), sites.get().0.len()])?;
        long_work(py, move || dgpc::Summary::marginal(&prior.get().0, &sites.get().0, &points.0).map(Self))
    }

    /// Returns the paper's summary of events, which is additive over events. O(NM²).
    ///
    /// The summary ignores the part of the prior variance that the inducing points do not explain.
    #[staticmethod]
    fn variational(py: Python<'_>, prior: Py<Prior>, sites: Py<Sites>, points: Points) -> PyResult<Self> {
        check_memory(&[points.0.len(), points.0.len()])?;
        long_work(py, move || dgpc::Summary::variational(&prior.get().0, &sites.get().0, &points.0).map(Self))
    }

    /// Returns the summary with these whitened parts: the inverse of `whitened_precision` and `whitened_shift`.
    ///
    /// Parameters
    /// ----------
    /// prior : Prior
    /// points : array of shape (M, d)
    /// precision : array of shape (M, M)
    /// shift : array of shape (M,)
    #[staticmethod]
    fn from_whitened(
        py: Python<'_>,
        prior: Py<Prior>,
        points: Points,
        precision: Square,
        shift: Numbers,
    ) -> PyResult<Self> {
        long_work(py, move || dgpc::Summary::from_whitened(&prior.get().0, &points.0, precision.0, shift.0).map(Self))
    }

    /// Returns the summary with this factor, which depends on no prior. See `factor`.
    #[staticmethod]
    fn from_factor(
        py: Python<'_>,
        prior: Py<Prior>,
        points: Points,
        precision: Square,
        shift: Numbers,
    ) -> PyResult<Self> {
        let factor = dgpc::Factor::new(points.0, precision.0, shift.0).map_err(bad_input)?;
        long_work(py, move || dgpc::Summary::from_factor(&prior.get().0, &factor).map(Self))
    }

    /// Returns the summary of the bytes. Damaged and newer bytes raise a `ValueError`.
    #[staticmethod]
    fn from_bytes(data: &[u8]) -> PyResult<Self> {
        decode(data).map(Self)
    }

    /// Returns the summary and its prior as bytes with a version and a checksum.
    fn to_bytes(&self) -> PyResult<Vec<u8>> {
        encode(&self.0)
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (Py<PyAny>,))> {
        reduce(slf.as_any())
    }

    /// The inducing points, shape (M, d).
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Table<'py>> {
        array(py, self.0.inducing_points())
    }

    /// The precision G of the message, shape (M, M).
    #[getter]
    fn precision(slf: Py<Self>, py: Python<'_>) -> PyResult<Table<'_>> {
        matrix(py, &long_work(py, move || Ok(slf.get().0.precision()))?)
    }

    /// The shift b of the message, shape (M,).
    #[getter]
    fn shift<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.shift())
    }

    /// The whitened precision, shape (M, M). It is well scaled, however close the points are.
    #[getter]
    fn whitened_precision<'py>(&self, py: Python<'py>) -> PyResult<Table<'py>> {
        matrix(py, self.0.whitened_precision())
    }

    /// The whitened shift, shape (M,).
    #[getter]
    fn whitened_shift<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.whitened_shift())
    }

    /// The prior under which the message was formed.
    #[getter]
    fn prior(&self) -> Prior {
        Prior(self.0.prior().clone())
    }

    /// The jitter on the diagonal of the prior covariance, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.0.jitter()
    }

    /// Returns the mean and the covariance of the latent function at the points, given this message alone.
    ///
    /// Returns
    /// -------
    /// mean : array of shape (M,)
    /// covariance : array of shape (M, M)
    fn moments(slf: Py<Self>, py: Python<'_>) -> PyResult<(Vector<'_>, Table<'_>)> {
        let (mean, covariance) = long_work(py, move || slf.get().0.moments())?;
        Ok((vector(py, mean), matrix(py, &covariance)?))
    }

    /// Returns the precision P and the shift η of the message as a factor that depends on no prior.
    ///
    /// Returns
    /// -------
    /// precision : array of shape (M, M)
    /// shift : array of shape (M,)
    fn factor(slf: Py<Self>, py: Python<'_>) -> PyResult<(Table<'_>, Vector<'_>)> {
        let factor = long_work(py, move || slf.get().0.factor())?;
        Ok((matrix(py, factor.precision())?, vector(py, factor.shift())))
    }

    /// Returns the summary with the variational message of more events. O(NM²).
    fn observe(&self, py: Python<'_>, sites: Py<Sites>) -> PyResult<Self> {
        self.changed(py, move |summary| summary.observe(&sites.get().0))
    }

    /// Returns the summary without the variational message of events that it contains.
    fn forget(&self, py: Python<'_>, sites: Py<Sites>) -> PyResult<Self> {
        self.changed(py, move |summary| summary.forget(&sites.get().0))
    }

    /// Returns the sum of two summaries at the same points: the message of both sets of events.
    fn merge(&self, py: Python<'_>, other: Py<Self>) -> PyResult<Self> {
        self.changed(py, move |summary| summary.merge(&other.get().0))
    }

    /// Returns the difference of two summaries at the same points.
    fn subtract(&self, py: Python<'_>, other: Py<Self>) -> PyResult<Self> {
        self.changed(py, move |summary| summary.subtract(&other.get().0))
    }

    fn __add__(&self, py: Python<'_>, other: Py<Self>) -> PyResult<Self> {
        self.merge(py, other)
    }

    fn __sub__(&self, py: Python<'_>, other: Py<Self>) -> PyResult<Self> {
        self.subtract(py, other)
    }

    /// Returns the message that a receiver lacks if it holds the summary `known` at the same points.
    fn residual(slf: Py<Self>, py: Python<'_>, known: Py<Self>) -> PyResult<Self> {
        long_work(py, move || slf.get().0.residual(&known.get().0).map(Self))
    }

    /// Returns the message with its factor raised to the power `share`, from 0 to 1.
    fn tempered(&self, share: Share) -> Self {
        Self(self.0.tempered(share.0))
    }

    /// Returns the message that has the same factor under another prior.
    fn under(slf: Py<Self>, py: Python<'_>, prior: Py<Prior>) -> PyResult<Self> {
        long_work(py, move || slf.get().0.under(&prior.get().0).map(Self))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        format!("Summary at {} inducing points", self.0.len())
    }
}
