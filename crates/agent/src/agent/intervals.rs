//! Intervals of predicted probabilities.

use dgpc::{Latent, Posterior, Summary};

use crate::agent::prediction::{CappedPrediction, Interval, Prediction};
use crate::agent::state::{Agent, Which};
use crate::agent::unknown_headings::HeadingAverage;
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

    /// Predicts each query with an interval, from the fused posterior. O(n²) a query. The first call after a change
    /// costs ten to thirty iterations of [`Agent::refit`].
    ///
    /// # Errors
    /// As [`Agent::predict`].
    pub fn predict_intervals(
        &mut self,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
    ) -> Result<Vec<Prediction>, AgentError> {
        let capped = self.capped(Which::Fused, queries)?;
        let part = self.widened(capped.iter().map(|capped| capped.evaluated_at))?;
        let whole = self.widened(capped.iter().map(|capped| capped.query))?;
        let end = |latent: &Latent, n: usize, reach: f64| {
            dgpc::success_probability(latent.mean[n] + reach * latent.variance[n].sqrt(), 0.0)
        };
        let predicted = |(n, CappedPrediction { prediction, .. }): (usize, CappedPrediction)| {
            let interval = Interval {
                // Where the prediction was capped the interval reaches down to the lower end for the whole link.
                low: end(&part, n, -REACH).min(end(&whole, n, -REACH)).min(prediction.probability),
                high: end(&part, n, REACH).max(prediction.probability),
                mean: part.mean[n],
                variance: part.variance[n],
            };
            Prediction { interval: Some(interval), ..prediction }
        };
        Ok(capped.into_iter().enumerate().map(predicted).collect())
    }

    fn widened(&mut self, queries: impl Iterator<Item = LinkQuery>) -> Result<Latent, AgentError> {
        let queries: Vec<LinkQuery> = queries.collect();
        self.interval_posterior()?;
        let posterior = self.interval_cache.get().unwrap_or(&self.posteriors.fused);
        let mut latent = HeadingAverage::new(&self.team().model, posterior, &queries)?.latent;
        latent.variance.iter_mut().for_each(|variance| *variance *= INTERVAL_WIDENING * INTERVAL_WIDENING);
        Ok(latent)
    }
}
