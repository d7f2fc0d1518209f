//! The posterior on the inducing points of a sparse fit, from the sums of its events.

use std::sync::Arc;

use super::messages::Messages;
use super::point_posterior::PointPosterior;
use crate::cross::Sums;
use crate::error::{Result, all_finite};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::linalg::{Cholesky, Matrix, squared_norm};
use crate::prior::Prior;

/// The posterior of all events, whose shards send sums, and of the messages of peers.
pub(crate) struct Coordinator {
    pub(super) points: Inputs,
    /// K_MM = LLᵀ.
    cholesky: Arc<Cholesky>,
    pub(super) messages: Messages,
    /// Ĝ, of events and messages.
    pub(super) precision: Matrix,
    posterior: Arc<PointPosterior>,
}

impl Coordinator {
    /// Creates the coordinator at the prior, without the sites of the events and the messages. O(M³).
    pub(crate) fn new(prior: &Prior, likelihood: &Likelihood<'_>, points: &Inputs) -> Result<Self> {
        let cholesky = Arc::new(Cholesky::with_jitter("K_MM", &prior.kernel().gram(points)?)?);
        let messages = Messages::new(prior, likelihood, points, &cholesky)?;
        let precision = Matrix::zeros(points.len(), points.len());
        let posterior = Arc::new(PointPosterior::prior(points.len()));
        Ok(Self { points: points.clone(), cholesky, messages, precision, posterior })
    }

    /// Returns L with K_MM = LLᵀ.
    pub(crate) fn cholesky(&self) -> &Arc<Cholesky> {
        &self.cholesky
    }

    pub(crate) fn posterior(&self) -> &Arc<PointPosterior> {
        &self.posterior
    }

    /// Sets the posterior to that of the messages and of the events with the given sums. An error leaves the posterior
    /// as it was. O(M³).
    pub(crate) fn take(&mut self, sums: &Sums) -> Result<()> {
        let mut precision = sums.precision.clone();
        precision.add_scaled(1.0, &self.messages.sums.precision);
        let mut s = precision.clone();
        s.add_to_diagonal(1.0);
        let inner = Cholesky::new("I + ΦᵀΩΦ", s)?;
        let both = sums.shift.iter().zip(&self.messages.sums.shift);
        let mut weights: Vec<f64> = both.map(|(own, others)| own + others).collect();
        inner.solve_lower(&mut weights);
        all_finite("whitened posterior mean", &weights)?;
        (self.precision, self.posterior) = (precision, Arc::new(PointPosterior { inner, weights }));
        Ok(())
    }

    /// Returns E at the posterior and its sites. `bound` is the sum of the terms that depend on single sites.
    pub(super) fn evidence(&self, bound: f64) -> f64 {
        let PointPosterior { inner, weights } = &*self.posterior;
        0.5 * squared_norm(weights) - 0.5 * inner.log_determinant() + bound + self.messages.bound
    }
}
