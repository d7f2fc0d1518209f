//! Intervals of predicted probabilities.

use dgpc::{Latent, Posterior, Summary};

use crate::agent::prediction::CappedPrediction;
use crate::agent::state::Agent;
use crate::error::AgentError;
use crate::inference::accepted::{packets_with, summaries};
use crate::types::query::LinkQuery;

/// Standard deviations that contain nine in ten of a normal distribution, to either side of its mean.
const REACH: f64 = 1.644_854;

/// Factor on the standard deviations of intervals. It allows for learned hyperparameters and for edges that no kernel
/// represents. It was chosen on simulated trials such that intervals of 90 % contain that share
/// (docs/evaluation/intervals.md).
pub const INTERVAL_WIDENING: f64 = 1.7;

impl Agent {
    /// Returns the posterior by expectation propagation, begun at the last fit. Its variances are not too small where
    /// all outcomes are equal, as those of the mean field are. The result is kept until data change. Ten to thirty
    /// iterations of [`Agent::refit`]; without a fit, the fused posterior.
    ///
    /// # Errors
    /// [`AgentError::Method`] for a numerical failure.
    pub(crate) fn interval_posterior(&mut self) -> Result<&Posterior, AgentError> {
        self.update()?;
        if self.interval_cache.get().is_none() {
            let posterior = self.propagated()?;
            self.interval_cache.set(posterior).ok();
        }
        Ok(self.interval_cache.get().unwrap_or(&self.posteriors.fused))
    }

    fn propagated(&self) -> Result<Posterior, AgentError> {
        let Some(last) = self.posteriors.last_fit() else { return Ok(self.posteriors.fused.clone()) };
        let packets = packets_with(&self.memory, &*self.trusted().packets);
        let site = self.team().model.site_summary().into_iter();
        let messages: Vec<&Summary> = site.chain(summaries(&packets)).collect();
        let mut posterior = last.fit.propagated_with(&messages)?.posterior()?;
        for known in self.posteriors.absorbed_own() {
            dgpc::absorb_observations(&mut posterior, &self.memory.observation(&known.event)?)?;
        }
        Ok(posterior)
    }

    /// Returns the log-odds of each query from which its interval follows: the moments by expectation propagation, with
    /// standard deviations [`INTERVAL_WIDENING`] times as large. O(n²) a query. The first call after a change costs ten
    /// to thirty iterations of [`Agent::refit`].
    ///
    /// # Errors
    /// As [`Agent::predict`].
    pub fn interval_latent(
        &mut self,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
    ) -> Result<Latent, AgentError> {
        let evaluated_at = self.evaluated_at(queries)?;
        self.widened(&evaluated_at)
    }

    /// The interval of each prediction. It contains the predicted probability. Where the prediction was capped it
    /// reaches down to the lower end for the whole link.
    pub(crate) fn intervals(&mut self, capped: &[CappedPrediction]) -> Result<Vec<(f64, f64)>, AgentError> {
        let evaluated_at: Vec<LinkQuery> = capped.iter().map(|capped| capped.evaluated_at).collect();
        let queries: Vec<LinkQuery> = capped.iter().map(|capped| capped.query).collect();
        let (part, whole) = (self.widened(&evaluated_at)?, self.widened(&queries)?);
        let end = |latent: &Latent, n: usize, reach: f64| {
            dgpc::success_probability(latent.mean[n] + reach * latent.variance[n].sqrt(), 0.0)
        };
        let interval = |(n, capped): (usize, &CappedPrediction)| {
            let low = end(&part, n, -REACH).min(end(&whole, n, -REACH)).min(capped.prediction.probability);
            (low, end(&part, n, REACH).max(capped.prediction.probability))
        };
        Ok(capped.iter().enumerate().map(interval).collect())
    }

    fn widened(&mut self, queries: &[LinkQuery]) -> Result<Latent, AgentError> {
        let inputs = self.team().model.inputs(queries)?;
        let mut latent = self.interval_posterior()?.latent(&inputs)?;
        latent.variance.iter_mut().for_each(|variance| *variance *= INTERVAL_WIDENING * INTERVAL_WIDENING);
        Ok(latent)
    }
}
