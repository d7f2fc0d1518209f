//! What a vehicle predicts.

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::attempt::Attempt;

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
        let attempts: Vec<Attempt> = attempts.into_iter().map(Into::into).collect();
        let mut predicted = self.as_known(&attempts)?;
        let Some(longest_m) = self.longest_m().filter(|_| !self.may_rise) else { return Ok(predicted) };
        let beyond: Vec<usize> = (0..attempts.len()).filter(|&n| attempts[n].link.range_m() > longest_m).collect();
        let part = |&n: &usize| Attempt { link: attempts[n].link.shortened_to(longest_m), ..attempts[n] };
        let parts = self.as_known(&beyond.iter().map(part).collect::<Vec<_>>())?;
        for (n, part) in beyond.into_iter().zip(parts) {
            if part.probability < predicted[n].probability {
                predicted[n] = part;
            }
        }
        Ok(predicted)
    }

    /// What the posterior says, wherever it is asked.
    fn as_known(&mut self, attempts: &[Attempt]) -> Result<Vec<Prediction>, AgentError> {
        let inputs = self.model().inputs(attempts)?;
        let latent = self.posterior()?.latent(&inputs)?;
        let moments = latent.mean.iter().zip(&latent.variance);
        let predicted = moments.zip(latent.probability());
        Ok(predicted.map(|((&mean, &variance), probability)| Prediction { mean, variance, probability }).collect())
    }

    /// Length of the longest link that its own events tried, or that others told of; `None` before any.
    pub fn longest_m(&self) -> Option<f64> {
        let told = self.heard().into_iter().filter_map(|key| self.memory.packets.get(key));
        let told_m = told.map(|packet| packet.longest_m);
        let own_m = (self.memory.events.len() > 0).then(|| self.memory.events.longest_m());
        told_m.chain(own_m).reduce(f64::max)
    }
}
