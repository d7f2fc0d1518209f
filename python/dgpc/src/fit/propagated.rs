//! Expectation propagation.

use dgpc::{Inputs, Monitor};
use pyo3::prelude::*;

use crate::border::long_work;
use crate::posterior::{Parts, Posterior, Sites, copies};

/// The result of expectation propagation. `Fit.propagated` returns it.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
///     >>> fit = dgpc.fit(prior, [[0.0], [1.0], [2.0], [3.0]], [1, 1, 0, 0])
///     >>> propagated = fit.propagated()
///     >>> propagated.converged
///     True
///     >>> propagated.posterior().probability([[0.5], [2.5]]).round(2)
///     array([0.76, 0.24])
#[pyclass(frozen, module = "dgpc")]
pub struct Propagated {
    propagated: dgpc::Propagated,
    prior: dgpc::Prior,
    inducing_points: Option<Inputs>,
    messages: Vec<dgpc::Summary>,
}

impl Propagated {
    /// Runs expectation propagation from a fit.
    pub fn of(fit: &dgpc::Fit, messages: &[&dgpc::Summary], monitor: Monitor<'_>) -> dgpc::Result<Self> {
        Ok(Self {
            propagated: fit.propagated_monitored(messages, monitor)?,
            prior: fit.prior().clone(),
            inducing_points: fit.inducing_points().cloned(),
            messages: copies(messages),
        })
    }
}

#[pymethods]
impl Propagated {
    /// Returns the posterior.
    fn posterior(slf: Py<Self>, py: Python<'_>) -> PyResult<Posterior> {
        long_work(py, move || {
            let this = slf.get();
            let sites = this.propagated.sites();
            let condense = |points| dgpc::Summary::variational(&this.prior, sites, points);
            let condensed = this.inducing_points.as_ref().map(condense).transpose()?;
            let kept = if condensed.is_some() { sites.select(&[]) } else { sites.clone() };
            let messages: Vec<_> = this.messages.iter().collect();
            Posterior::of(Parts::of_fit(&this.prior, kept, condensed, &messages)?)
        })
    }

    /// The sites of the events.
    #[getter]
    fn sites(&self) -> Sites {
        Sites(self.propagated.sites().clone())
    }

    /// Number of iterations.
    #[getter]
    fn iterations(&self) -> usize {
        self.propagated.iterations()
    }

    /// Whether the iteration reached its tolerance.
    #[getter]
    fn converged(&self) -> bool {
        self.propagated.converged()
    }
}
