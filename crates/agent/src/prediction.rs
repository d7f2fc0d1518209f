//! What a vehicle predicts.

use dgpc::{Matrix, Posterior};

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::attempt::Attempt;
use crate::model::Model;

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

/// What is said of an attempt.
pub(crate) struct Shown {
    pub(crate) asked: Attempt,
    /// What it is said of: the attempt itself, or a part of its link.
    pub(crate) of: Attempt,
    pub(crate) predicted: Prediction,
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

    /// What is predicted of each attempt. Takes in what arrived since the last time, up to some events beside the last
    /// fit, and fits nothing again: see [`Agent::refit_due`]. O(n²) an attempt.
    ///
    /// Where nothing is known the probability goes to even odds, and so it would rise again on the far side of all data. Of
    /// a link longer than the longest that was tried, and of its two parts of that length (the one from the transmitter, and
    /// the one to the receiver), what is predicted is that of the least, unless [`Agent::rising_beyond`] says so.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn predictions(
        &mut self,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<Prediction>, AgentError> {
        Ok(self.shown(attempts)?.into_iter().map(|shown| shown.predicted).collect())
    }

    /// The same by its own events alone, under the team's model.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn own_probabilities(
        &mut self,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<f64>, AgentError> {
        self.update()?;
        let shown = self.shown_under(&self.beliefs.own, self.own_longest_m(), attempts)?;
        Ok(shown.into_iter().map(|shown| shown.predicted.probability).collect())
    }

    /// The same by another posterior under its model than its own, such as one that heard other things.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn probabilities_under(
        &self,
        posterior: &Posterior,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<f64>, AgentError> {
        let shown = self.shown_under(posterior, self.longest_m(), attempts)?;
        Ok(shown.into_iter().map(|shown| shown.predicted.probability).collect())
    }

    /// Share of the variance of each attempt's log-odds that what was observed and told took away, from 0 (nothing is known beyond the
    /// prior) to 1. Of a link longer than the longest that was tried it is that of what [`Agent::predictions`] are of. O(n²) an attempt.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn explained_shares(
        &mut self,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<f64>, AgentError> {
        let shown = self.shown(attempts)?;
        let of: Vec<Attempt> = shown.iter().map(|shown| shown.of).collect();
        let model = self.model();
        let before = model.prior.kernel().diagonal(&model.inputs(&of)?)?;
        let share = |(shown, before): (&Shown, &f64)| (1.0 - shown.predicted.variance / before).clamp(0.0, 1.0);
        Ok(shown.iter().zip(&before).map(share).collect())
    }

    /// Log-odds of these attempts as they may be together, a column for each column of standard normals: drawn from a posterior under
    /// its model such as [`Agent::wide_posterior`]. Beyond the longest link that was tried each is of what [`Agent::predictions`] are
    /// of. O(Mn² + M²n + M³) for M attempts.
    ///
    /// # Errors
    /// As [`Agent::probability`], and for normals of another number of rows.
    pub fn draws(
        &mut self,
        posterior: &Posterior,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
        normals: &Matrix,
    ) -> Result<Matrix, AgentError> {
        let of: Vec<Attempt> = self.shown(attempts)?.into_iter().map(|shown| shown.of).collect();
        Ok(posterior.draws(&self.model().inputs(&of)?, normals)?.0)
    }

    pub(crate) fn shown(
        &mut self,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<Shown>, AgentError> {
        self.update()?;
        self.shown_under(&self.beliefs.fused, self.longest_m(), attempts)
    }

    /// What a posterior under its model says, of which links up to `longest_m` were tried.
    fn shown_under(
        &self,
        posterior: &Posterior,
        longest_m: Option<f64>,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<Shown>, AgentError> {
        let attempts = attempts.into_iter().map(Into::into).collect();
        Ok(shown(self.model(), posterior, longest_m.filter(|_| !self.may_rise), attempts)?)
    }

    /// Length of the longest link that its own events tried, that others told of whom it believes, or that is known of the
    /// place; `None` before any.
    pub fn longest_m(&self) -> Option<f64> {
        let believed = self.believed();
        let packets = believed.packets.keys().filter_map(|&key| self.memory.packets.get(key));
        let doubted = self.doubted();
        let is_believed = |member: &u8| !doubted.contains(member);
        let told_m = self.memory.placed().longest_m.iter().filter(|(member, _)| is_believed(member)).map(|(_, &m)| m);
        packets.map(|packet| packet.longest_m).chain(told_m).chain(self.own_longest_m()).reduce(f64::max)
    }

    fn own_longest_m(&self) -> Option<f64> {
        let own_m = self.memory.longest_m();
        let place = self.model().place.iter();
        let before_m = place.flat_map(|place| place.links()).map(|link| link.range_m());
        before_m.chain(own_m).reduce(f64::max)
    }
}

/// What a posterior says of each attempt, or of the least of its parts if it is longer than the longest.
fn shown(
    model: &Model,
    posterior: &Posterior,
    longest_m: Option<f64>,
    attempts: Vec<Attempt>,
) -> dgpc::Result<Vec<Shown>> {
    let predicted = predictions(model, posterior, &attempts)?;
    let itself = |(asked, predicted)| Shown { asked, of: asked, predicted };
    let mut shown: Vec<Shown> = attempts.into_iter().zip(predicted).map(itself).collect();
    let Some(longest_m) = longest_m else { return Ok(shown) };
    let beyond = |shown: &&mut Shown| shown.asked.link.range_m() > longest_m;
    let beyond: Vec<&mut Shown> = shown.iter_mut().filter(beyond).collect();
    let parts = |shown: &&mut Shown| {
        let link = shown.asked.link;
        let parts = [link.shortened_to(longest_m), link.swapped().shortened_to(longest_m).swapped()];
        parts.map(|link| Attempt { link, ..shown.asked })
    };
    let parts: Vec<Attempt> = beyond.iter().flat_map(parts).collect();
    let predicted = predictions(model, posterior, &parts)?;
    for (shown, (parts, predicted)) in beyond.into_iter().zip(parts.chunks(2).zip(predicted.chunks(2))) {
        for (&of, &predicted) in parts.iter().zip(predicted) {
            if predicted.probability < shown.predicted.probability {
                (shown.of, shown.predicted) = (of, predicted);
            }
        }
    }
    Ok(shown)
}

/// What a posterior says of each attempt, wherever it is.
fn predictions(model: &Model, posterior: &Posterior, attempts: &[Attempt]) -> dgpc::Result<Vec<Prediction>> {
    let latent = posterior.latent(&model.inputs(attempts)?)?;
    let moments = latent.mean.iter().zip(&latent.variance).zip(latent.probability());
    Ok(moments.map(|((&mean, &variance), probability)| Prediction { mean, variance, probability }).collect())
}
