//! What a vehicle predicts, and how sure it is.

use dgpc::{Latent, Posterior, Summary};

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::attempt::Attempt;
use crate::said::{said, summaries};

/// Standard deviations within which nine in ten of a normal distribution lie, to either side.
const REACH: f64 = 1.644_854;

/// By how much intervals are wider than what is known under the model as it is.
const WIDENING: f64 = 1.7;

/// What is predicted of an attempt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Mean of its log-odds.
    pub mean: f64,
    /// Variance of its log-odds.
    pub variance: f64,
    /// Probability that it succeeds.
    pub probability: f64,
}

impl Agent {
    /// Probability of success of an attempt, or over a link between typical vehicles at a typical time.
    ///
    /// # Errors
    /// [`AgentError::Method`] when a position is not finite.
    pub fn probability(&mut self, attempt: impl Into<Attempt>) -> Result<f64, AgentError> {
        Ok(self.probabilities([attempt])?[0])
    }

    /// Probability of success of each attempt: that of [`Agent::predictions`].
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn probabilities(
        &mut self,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<f64>, AgentError> {
        Ok(self.predictions(attempts)?.into_iter().map(|predicted| predicted.probability).collect())
    }

    /// What is predicted of each attempt. Takes in what arrived since the last time, up to 64 events beside the last
    /// fit, and fits nothing again: see [`Agent::refit_due`]. O(n²) an attempt.
    ///
    /// Where nothing is known the probability goes to even odds, and so it would rise again on the far side of all data. Over
    /// a link longer than the longest that was tried nothing better is predicted than over its part of that length from the
    /// transmitter, unless [`Agent::rising_beyond`] says so.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn predictions(
        &mut self,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<Prediction>, AgentError> {
        Ok(self.shown(attempts)?.into_iter().map(|(_, predicted)| predicted).collect())
    }

    /// What it knows by expectation propagation, begun at the last fit: the same probabilities to a few hundredths, and
    /// variances that are not too small where outcomes are of one kind, as those of predictions are. What
    /// [`Agent::intervals`] are made from. Ten to thirty times the cost of an iteration of [`Agent::refit`]; where nothing
    /// was fitted, what it knows as it is.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn wide_posterior(&mut self) -> Result<Posterior, AgentError> {
        self.update()?;
        let Some(fit) = self.beliefs.fit_of_fused() else { return Ok(self.beliefs.fused.clone()) };
        let left_out = self.beliefs.left_out();
        let believed = self.heard().into_iter().filter(|key| !left_out.contains(&key.0)).collect::<Vec<_>>();
        let packets = said(&self.memory, believed.iter());
        let place = self.model().place_summary().into_iter();
        let messages: Vec<&Summary> = place.chain(summaries(&packets)).collect();
        let mut wide = fit.propagated_with(&messages)?.posterior()?;
        for event in self.beliefs.beside() {
            let observation = self.model().observations([event])?;
            wide.absorb_events(&dgpc::sites_given(&wide, &observation)?)?;
        }
        Ok(wide)
    }

    /// Log-odds of each attempt as widely as intervals take them: those of a [`Agent::wide_posterior`], with standard
    /// deviations 1.7 times as large. That the numbers of the kernel are learned, and that water has edges which no kernel
    /// knows, is in that factor: it was chosen on simulated trials such that intervals of 90 % hold what they should
    /// (docs/evaluation.md). O(n²) an attempt.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn wide_latent(
        &mut self,
        wide: &Posterior,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Latent, AgentError> {
        let shown: Vec<Attempt> = self.shown(attempts)?.into_iter().map(|(attempt, _)| attempt).collect();
        Ok(self.widened(wide, &shown)?)
    }

    /// Where the probability of each attempt lies: nine in ten do. The interval holds what [`Agent::predictions`] says.
    /// O(n²) an attempt.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn intervals(
        &mut self,
        wide: &Posterior,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<(f64, f64)>, AgentError> {
        let (attempts, predicted): (Vec<_>, Vec<_>) = self.shown(attempts)?.into_iter().unzip();
        let latent = self.widened(wide, &attempts)?;
        let interval = |((mean, variance), predicted): ((&f64, &f64), &Prediction)| {
            let reach = REACH * variance.sqrt();
            let end = |log_odds: f64| dgpc::success_probability(log_odds, 0.0);
            (end(mean - reach).min(predicted.probability), end(mean + reach).max(predicted.probability))
        };
        Ok(latent.mean.iter().zip(&latent.variance).zip(&predicted).map(interval).collect())
    }

    fn widened(&self, wide: &Posterior, attempts: &[Attempt]) -> dgpc::Result<Latent> {
        let mut latent = wide.latent(&self.model().inputs(attempts)?)?;
        latent.variance.iter_mut().for_each(|variance| *variance *= WIDENING * WIDENING);
        Ok(latent)
    }

    /// What is predicted of each attempt, and of which attempt that is the prediction: itself, or its part.
    fn shown(
        &mut self,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<(Attempt, Prediction)>, AgentError> {
        let attempts: Vec<Attempt> = attempts.into_iter().map(Into::into).collect();
        let predicted = self.as_known(&attempts)?;
        let mut shown: Vec<(Attempt, Prediction)> = attempts.into_iter().zip(predicted).collect();
        let Some(longest_m) = self.longest_m().filter(|_| !self.may_rise) else { return Ok(shown) };
        let beyond: Vec<usize> = (0..shown.len()).filter(|&n| shown[n].0.link.range_m() > longest_m).collect();
        let part = |&n: &usize| Attempt { link: shown[n].0.link.shortened_to(longest_m), ..shown[n].0 };
        let parts: Vec<Attempt> = beyond.iter().map(part).collect();
        let predicted = self.as_known(&parts)?;
        for (n, part) in beyond.into_iter().zip(parts.into_iter().zip(predicted)) {
            if part.1.probability < shown[n].1.probability {
                shown[n] = part;
            }
        }
        Ok(shown)
    }

    /// What the posterior says, wherever it is asked.
    fn as_known(&mut self, attempts: &[Attempt]) -> Result<Vec<Prediction>, AgentError> {
        let inputs = self.model().inputs(attempts)?;
        let latent = self.posterior()?.latent(&inputs)?;
        let moments = latent.mean.iter().zip(&latent.variance);
        let predicted = moments.zip(latent.probability());
        Ok(predicted.map(|((&mean, &variance), probability)| Prediction { mean, variance, probability }).collect())
    }

    /// Length of the longest link that its own events tried, that others told of, or that is known of the place; `None` before any.
    pub fn longest_m(&self) -> Option<f64> {
        let told = self.heard().into_iter().filter_map(|key| self.memory.packets.get(key));
        let told_m = told.map(|packet| packet.longest_m);
        let own_m = (self.memory.events.len() > 0).then(|| self.memory.events.longest_m());
        let place = self.model().place.iter();
        let before_m = place.flat_map(|place| place.links()).map(|link| link.range_m());
        told_m.chain(own_m).chain(before_m).reduce(f64::max)
    }
}
