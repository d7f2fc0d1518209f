//! Certificates: bounds on the information that inducing points omit.

use pyo3::prelude::*;

use crate::border::{Finite, Points, check_memory, long_work};
use crate::posterior::Sites;
use crate::prior::Prior;

/// Bounds on the divergence of a summary from the full posterior, given ω. All bounds are in nats. O(NM²).
///
/// Parameters
/// ----------
/// prior : Prior
/// sites : Sites
///     The N events.
/// points : array of shape (M, d)
///     The inducing points.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=2.0, dimension=1))
///     >>> sites = dgpc.Sites([[0.0], [0.2]], [1, 1], [0.25, 0.25])
///     >>> certificate = dgpc.Certificate(prior, sites, [[0.0], [0.2]])
///     >>> certificate.gap < 1e-9
///     True
#[pyclass(frozen, module = "dgpc")]
pub struct Certificate(dgpc::Certificate);

#[pymethods]
impl Certificate {
    #[new]
    fn new(py: Python<'_>, prior: Py<Prior>, sites: Py<Sites>, points: Points) -> PyResult<Self> {
        check_memory(&[points.0.len(), points.0.len() + sites.get().0.len()])?;
        long_work(py, move || dgpc::Certificate::new(&prior.get().0, &sites.get().0, &points.0).map(Self))
    }

    /// The prior variance at the events that the inducing points leave unexplained.
    #[getter]
    fn trace(&self) -> f64 {
        self.0.trace
    }

    /// Lower bound on log p(y | ω), up to a constant that all bounds share.
    #[getter]
    fn lower(&self) -> f64 {
        self.0.lower
    }

    /// Upper bound on log p(y | ω), up to the same constant.
    #[getter]
    fn upper(&self) -> f64 {
        self.0.upper
    }

    /// `upper` − `lower`: the certificate.
    #[getter]
    fn gap(&self) -> f64 {
        self.0.gap
    }

    /// A bound that vanishes with the trace.
    #[getter]
    fn closed_form(&self) -> f64 {
        self.0.closed_form
    }

    /// The paper's closed form, which does not vanish with the trace.
    #[getter]
    fn paper_closed_form(&self) -> f64 {
        self.0.paper_closed_form
    }

    /// The jitter on the diagonal of the prior covariance, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.0.jitter
    }

    /// Returns the divergence itself, from `dgpc.log_evidence` of the same sites.
    fn divergence(&self, log_evidence: Finite) -> f64 {
        self.0.divergence(log_evidence.0)
    }

    fn __repr__(&self) -> String {
        format!("Certificate with a gap of {:.6} nats", self.0.gap)
    }
}

/// Returns log p(y | ω) in nats, up to the constant that `Certificate` omits, too. O(N³).
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=2.0, dimension=1))
///     >>> sites = dgpc.Sites([[0.0], [0.2]], [1, 1], [0.25, 0.25])
///     >>> certificate = dgpc.Certificate(prior, sites, [[0.1]])
///     >>> certificate.lower <= dgpc.log_evidence(prior, sites) <= certificate.upper
///     True
#[pyfunction]
pub fn log_evidence(py: Python<'_>, prior: Py<Prior>, sites: Py<Sites>) -> PyResult<f64> {
    check_memory(&[2, sites.get().0.len(), sites.get().0.len()])?;
    long_work(py, move || dgpc::log_evidence(&prior.get().0, &sites.get().0))
}
