//! How sure a vehicle is of the probabilities that it predicts.

use dgpc::{Latent, Matrix, Posterior, Summary};

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::attempt::Attempt;
use crate::heard::{said, summaries};
use crate::prediction::Shown;
use crate::reports::Worth;

/// Standard deviations within which nine in ten of a normal distribution lie, to either side.
const REACH: f64 = 1.644_854;

/// By how much intervals are wider than what is known under the model as it is.
const WIDENING: f64 = 1.7;

impl Agent {
    /// What it knows by expectation propagation, begun at the last fit: the same probabilities to a few hundredths, and
    /// variances that are not too small where outcomes are of one kind, as those of predictions are. What
    /// [`Agent::intervals`] are made from. Ten to thirty times the cost of an iteration of [`Agent::refit`] with all packets that
    /// count beside the events; where nothing was fitted, what it knows as it is.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn wide_posterior(&mut self) -> Result<Posterior, AgentError> {
        self.update()?;
        let Some(fitted) = self.beliefs.fitted() else { return Ok(self.beliefs.fused.clone()) };
        let packets = said(&self.memory, &self.believed().packets, Worth::All);
        let place = self.model().place_summary().into_iter();
        let messages: Vec<&Summary> = place.chain(summaries(&packets)).collect();
        let mut wide = fitted.fit.propagated_with(&messages)?.posterior()?;
        for known in self.beliefs.beside() {
            dgpc::absorb_observations(&mut wide, &self.memory.observation(&known.event)?)?;
        }
        Ok(wide)
    }

    /// Log-odds of each attempt as widely as intervals take them: those of a [`Agent::wide_posterior`], with standard
    /// deviations 1.7 times as large. That the numbers of the kernel are learned, and that water has edges which no kernel
    /// knows, is in that factor: it was chosen on simulated trials such that intervals of 90 % hold what they should
    /// (docs/evaluation.md). Beyond the longest link that was tried they are of what [`Agent::predictions`] are of. O(n²) an
    /// attempt.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn wide_latent(
        &mut self,
        wide: &Posterior,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Latent, AgentError> {
        let of: Vec<Attempt> = self.shown(attempts)?.into_iter().map(|shown| shown.of).collect();
        Ok(self.widened(wide, &of)?)
    }

    /// [`Agent::draws`] of a [`Agent::wide_posterior`], as far from their mean as intervals take them to be ([`Agent::wide_latent`]).
    ///
    /// # Errors
    /// As [`Agent::draws`].
    pub fn wide_draws(
        &mut self,
        wide: &Posterior,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
        normals: &Matrix,
    ) -> Result<Matrix, AgentError> {
        let wider =
            Matrix::from_fn(normals.rows(), normals.columns(), |row, draw| WIDENING * normals.column(draw)[row]);
        self.draws(wide, attempts, &wider)
    }

    /// Where the probability of each attempt lies: nine in ten do. The interval holds what [`Agent::predictions`] says, and
    /// where that is of a part of the link it reaches down to what may be of the whole. O(n²) an attempt.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn intervals(
        &mut self,
        wide: &Posterior,
        attempts: impl IntoIterator<Item = impl Into<Attempt>>,
    ) -> Result<Vec<(f64, f64)>, AgentError> {
        let shown = self.shown(attempts)?;
        let all = |attempt: fn(&Shown) -> Attempt| self.widened(wide, &shown.iter().map(attempt).collect::<Vec<_>>());
        let (of, asked) = (all(|shown| shown.of)?, all(|shown| shown.asked)?);
        let end = |latent: &Latent, n: usize, reach: f64| {
            dgpc::success_probability(latent.mean[n] + reach * latent.variance[n].sqrt(), 0.0)
        };
        let interval = |(n, shown): (usize, &Shown)| {
            let low = end(&of, n, -REACH).min(end(&asked, n, -REACH)).min(shown.predicted.probability);
            (low, end(&of, n, REACH).max(shown.predicted.probability))
        };
        Ok(shown.iter().enumerate().map(interval).collect())
    }

    fn widened(&self, wide: &Posterior, attempts: &[Attempt]) -> dgpc::Result<Latent> {
        let mut latent = wide.latent(&self.model().inputs(attempts)?)?;
        latent.variance.iter_mut().for_each(|variance| *variance *= WIDENING * WIDENING);
        Ok(latent)
    }
}
