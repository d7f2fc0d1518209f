//! Intervals of predicted probabilities.

use std::sync::Arc;

use dgpc::{Latent, Monitor, Posterior, Summary};

use crate::agent::averaging::{ModelPredictions, mixture};
use crate::agent::prediction::{CappedPrediction, Interval, Prediction, predict};
use crate::agent::state::Agent;
use crate::error::AgentError;
use crate::inference::accepted::{packets_with, summaries};
use crate::inference::alternative::AlternativeModel;
use crate::inference::event_fit::EventFit;
use crate::inference::posteriors::IntervalPosteriors;
use crate::types::interrupt::Interrupt;
use crate::types::query::LinkQuery;

/// Standard deviations that contain nine in ten of a normal distribution, to either side of its mean.
const REACH: f64 = 1.644_854;

/// Factor on the standard deviations of intervals. It allows for learned hyperparameters and for edges that no kernel
/// represents. It was chosen on simulated trials such that intervals of 90 % contain that share
/// (docs/evaluation/intervals.md).
pub const INTERVAL_WIDENING: f64 = 1.7;

impl Agent {
    /// Returns the posteriors by expectation propagation, begun at the last fits. Their variances are not too small
    /// where all outcomes are equal, as those of the mean field are. The result is kept until data change. Ten to
    /// thirty iterations of [`Agent::refit`]; without a fit, the posteriors of predictions.
    pub(crate) fn interval_posteriors(&mut self) -> Result<Arc<IntervalPosteriors>, AgentError> {
        self.update()?;
        if let Some(known) = self.interval_cache.get() {
            return Ok(known.clone());
        }
        let packets = packets_with(&self.memory, &*self.trusted().packets);
        let site = self.team().model.site_summary().into_iter();
        let messages: Vec<&Summary> = site.chain(summaries(&packets)).collect();
        let fused = self.propagated(self.posteriors.last_fit(), &messages)?;
        let of_alternative = |alternative: &AlternativeModel| -> Result<Posterior, AgentError> {
            let posterior = self.propagated(alternative.last_fit(), &alternative.site())?;
            Ok(posterior.unwrap_or_else(|| alternative.posterior.clone()))
        };
        let posteriors = IntervalPosteriors {
            fused: fused.unwrap_or_else(|| self.posteriors.pair.fused().clone()),
            alternative: self.posteriors.alternative.as_ref().map(of_alternative).transpose()?,
        };
        Ok(self.interval_cache.get_or_init(|| Arc::new(posteriors)).clone())
    }

    /// Returns the posterior by expectation propagation of a fit, of these messages, and of own events since that fit;
    /// `None` without a fit.
    fn propagated(&self, last: Option<&EventFit>, messages: &[&Summary]) -> Result<Option<Posterior>, AgentError> {
        let Some(last) = last else { return Ok(None) };
        let interrupt = Interrupt::attached();
        let monitor = |progress| interrupt.monitor(progress);
        let mut posterior = last.fit.propagated_monitored(messages, Monitor::new(&monitor))?.posterior()?;
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
    fn interval_moments(&mut self, by_model: &ModelPredictions) -> Result<[Latent; 2], AgentError> {
        let posteriors = self.interval_posteriors()?;
        let first = self.widened(&posteriors.fused, &by_model.first)?;
        let (Some(alternative), Some(second)) = (&posteriors.alternative, &by_model.second) else {
            return Ok(first);
        };
        let (second, weight) = (self.widened(alternative, second)?, self.alternative_weight());
        let mixture = |[first, second]: [Latent; 2]| mixture(&first, &second, weight);
        let [[first_part, first_whole], [second_part, second_whole]] = [first, second];
        Ok([[first_part, second_part], [first_whole, second_whole]].map(mixture))
    }

    fn widened(&self, posterior: &Posterior, capped: &[CappedPrediction]) -> Result<[Latent; 2], AgentError> {
        let widened = |queries: Vec<LinkQuery>| -> Result<Latent, AgentError> {
            let predicted = predict(&self.team().model, posterior, &queries)?.into_iter();
            let widened = |prediction: Prediction| prediction.variance * (INTERVAL_WIDENING * INTERVAL_WIDENING);
            let (mean, variance) = predicted.map(|prediction| (prediction.mean, widened(prediction))).unzip();
            Ok(Latent { mean, variance })
        };
        let part = widened(capped.iter().map(|capped| capped.evaluated_at).collect())?;
        Ok([part, widened(capped.iter().map(|capped| capped.query).collect())?])
    }
}
