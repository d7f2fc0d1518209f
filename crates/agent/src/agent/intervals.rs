//! Intervals of predicted probabilities.

use dgpc::{Latent, Posterior, Summary};

use crate::agent::averaging::{ByModel, mixture};
use crate::agent::prediction::{CappedPrediction, Interval, Prediction};
use crate::agent::state::Agent;
use crate::agent::unknown_headings::HeadingAverage;
use crate::error::AgentError;
use crate::inference::accepted::{packets_with, summaries};
use crate::inference::event_fit::EventFit;
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
            let packets = packets_with(&self.memory, &*self.trusted().packets);
            let site = self.team().model.site_summary().into_iter();
            let messages: Vec<&Summary> = site.chain(summaries(&packets)).collect();
            let posterior = self.propagated(self.posteriors.last_fit(), &messages)?;
            self.interval_cache.set(posterior.unwrap_or_else(|| self.posteriors.fused.clone())).ok();
        }
        Ok(self.interval_cache.get().unwrap_or(&self.posteriors.fused))
    }

    /// Returns the posterior by expectation propagation of a fit, of these messages, and of own events since that fit;
    /// `None` without a fit.
    fn propagated(&self, last: Option<&EventFit>, messages: &[&Summary]) -> Result<Option<Posterior>, AgentError> {
        let Some(last) = last else { return Ok(None) };
        let mut posterior = last.fit.propagated_with(messages)?.posterior()?;
        for known in self.posteriors.absorbed_own() {
            dgpc::absorb_observations(&mut posterior, &self.memory.observation(&known.event)?)?;
        }
        Ok(Some(posterior))
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
        let queries: Vec<LinkQuery> = queries.into_iter().map(Into::into).collect();
        let by_model = self.by_model(queries)?;
        let predictions = by_model.average(self.alternative_weight());
        let [part, whole] = self.interval_moments(&by_model)?;
        let end = |latent: &Latent, n: usize, reach: f64| {
            dgpc::success_probability(latent.mean[n] + reach * latent.variance[n].sqrt(), 0.0)
        };
        let predicted = |(n, prediction): (usize, Prediction)| {
            let interval = Interval {
                // Where the prediction was capped the interval reaches down to the lower end for the whole link.
                low: end(&part, n, -REACH).min(end(&whole, n, -REACH)).min(prediction.probability),
                high: end(&part, n, REACH).max(prediction.probability),
                mean: part.mean[n],
                variance: part.variance[n],
            };
            Prediction { interval: Some(interval), ..prediction }
        };
        Ok(predictions.into_iter().enumerate().map(predicted).collect())
    }

    /// Returns the moments of the log-odds from which intervals follow: at the links where the capped predictions were
    /// evaluated, and at the whole links. With an alternative model they are those of the mixture.
    fn interval_moments(&mut self, by_model: &ByModel) -> Result<[Latent; 2], AgentError> {
        self.interval_posterior()?;
        let first = self.widened(self.interval_cache.get().unwrap_or(&self.posteriors.fused), &by_model.first)?;
        let (Some(alternative), Some(second)) = (&self.posteriors.alternative, &by_model.second) else {
            return Ok(first);
        };
        let posterior = self.propagated(alternative.last_fit(), &alternative.site())?;
        let second = self.widened(posterior.as_ref().unwrap_or(&alternative.posterior), second)?;
        let mixture = |[first, second]: [Latent; 2]| mixture(&first, &second, alternative.weight());
        let [[first_part, first_whole], [second_part, second_whole]] = [first, second];
        Ok([[first_part, second_part], [first_whole, second_whole]].map(mixture))
    }

    fn widened(&self, posterior: &Posterior, capped: &[CappedPrediction]) -> Result<[Latent; 2], AgentError> {
        let widened = |queries: Vec<LinkQuery>| -> Result<Latent, AgentError> {
            let mut latent = HeadingAverage::new(&self.team().model, posterior, &queries)?.latent;
            latent.variance.iter_mut().for_each(|variance| *variance *= INTERVAL_WIDENING * INTERVAL_WIDENING);
            Ok(latent)
        };
        let part = widened(capped.iter().map(|capped| capped.evaluated_at).collect())?;
        Ok([part, widened(capped.iter().map(|capped| capped.query).collect())?])
    }
}
