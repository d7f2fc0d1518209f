//! Expectation propagation.

use dgpc::{Inputs, Monitor};
use pyo3::prelude::*;

use crate::border::work;
use crate::posterior::{Parts, Posterior, Sites, copies};

/// The result of expectation propagation. `Fit.propagated` returns it.
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
    fn posterior(&self, py: Python<'_>) -> PyResult<Posterior> {
        work(py, || {
            let sites = self.propagated.sites();
            let condense = |points| dgpc::Summary::variational(&self.prior, sites, points);
            let condensed = self.inducing_points.as_ref().map(condense).transpose()?;
            let kept = if condensed.is_some() { sites.select(&[]) } else { sites.clone() };
            let messages: Vec<_> = self.messages.iter().collect();
            Posterior::of(Parts::of_fit(&self.prior, kept, condensed, &messages)?)
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
