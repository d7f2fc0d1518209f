//! Gradient of the evidence bound of a sparse mean field by the prior's parameters ([`crate::method::learning`]).

use std::ops::Range;

use super::coordinator::Coordinator;
use super::events::EventCovariances;
use super::point_posterior::PointPosterior;
use crate::cross::Cross;
use crate::error::Result;
use crate::fit::mean_field::omega;
use crate::likelihood::Likelihood;
use crate::linalg::{Cholesky, Matrix, add_scaled, lower_gram, product};
use crate::observations::Observations;
use crate::parts::{blocks, on_parts};
use crate::prior::Prior;

/// The matrices from which the derivatives of E by covariances are computed, at one posterior.
pub(super) struct Slope<'a> {
    cholesky: &'a Cholesky,
    /// S⁻¹b̂.
    weights: Vec<f64>,
    /// L⁻ᵀS⁻¹b̂.
    gamma: Vec<f64>,
    /// I − S⁻¹.
    shrinkage: Matrix,
    /// L⁻ᵀ(I − S⁻¹).
    explained: Matrix,
}

impl<'a> Slope<'a> {
    /// Computes the matrices, with K_MM = LLᵀ. O(M³).
    pub(super) fn new(cholesky: &'a Cholesky, posterior: &PointPosterior) -> Self {
        let points = posterior.weights.len();
        let mut weights = posterior.weights.clone();
        posterior.inner.solve_upper(&mut weights);
        let mut gamma = weights.clone();
        cholesky.solve_upper(&mut gamma);
        let (mut factor_inverse, mut inverse) = (Matrix::zeros(points, points), Matrix::zeros(points, points));
        posterior.inner.invert_lower(&mut factor_inverse);
        lower_gram(&factor_inverse, &mut inverse);
        inverse.mirror_lower();
        let mut shrinkage = Matrix::zeros(points, points);
        shrinkage.add_to_diagonal(1.0);
        shrinkage.add_scaled(-1.0, &inverse);
        let mut explained = shrinkage.clone();
        cholesky.solve_upper_matrix(&mut explained);
        Self { cholesky, weights, gamma, shrinkage, explained }
    }

    /// Returns the share of some events in ∂E/∂(log parameters of the kernel, parameters of the prior mean), at the
    /// given tilts of their sites. O(NM²).
    pub(super) fn of_events(
        &self,
        covariances: &EventCovariances,
        observations: &Observations,
        tilts: &[f64],
    ) -> Result<Vec<f64>> {
        let cross = covariances.cross(observations.inputs());
        let prior = &covariances.prior;
        let events = Events { covariances, cross, observations, tilts };
        let mut gradient = vec![0.0; prior.kernel().parameter_count()];
        let mut alpha = Vec::with_capacity(observations.len());
        for part in on_parts(events.cross.parts(), |part| self.of_part(&events, part)) {
            let (of_part, alpha_of_part) = part?;
            add_scaled(1.0, &of_part, &mut gradient);
            alpha.extend(alpha_of_part);
        }
        gradient.extend(prior.mean().gradient(observations.inputs(), &alpha));
        Ok(gradient)
    }

    /// Returns the gradient by the covariances with some of the events, and α = κ̃ − Ωδ of these events. δ is the
    /// posterior mean minus the prior mean.
    fn of_part(&self, events: &Events<'_>, part: Range<usize>) -> Result<(Vec<f64>, Vec<f64>)> {
        let (kernel, inputs) = (events.covariances.prior.kernel(), events.observations.inputs());
        let points = &events.covariances.points;
        let (mut gradient, mut alpha) = (vec![0.0; kernel.parameter_count()], Vec::with_capacity(part.len()));
        let mut features = Matrix::default();
        for block in blocks(part) {
            let (omega, shift): (Vec<f64>, Vec<f64>) = block.clone().map(|n| events.site(n)).unzip();
            events.cross.write_features(block.clone(), self.cholesky, &mut features)?;
            let (weights, alpha_of_block) = self.by_cross(&features, &omega, &shift);
            let inputs = inputs.slice(block);
            add_scaled(1.0, &kernel.cross_gradient(&inputs, points, &weights), &mut gradient);
            let halves: Vec<f64> = omega.iter().map(|omega| -0.5 * omega).collect();
            add_scaled(1.0, &kernel.diagonal_gradient(&inputs, &halves), &mut gradient);
            alpha.extend(alpha_of_block);
        }
        Ok((gradient, alpha))
    }

    /// Returns the share of the inducing points and the messages in the gradient.
    pub(super) fn of_points_and_messages(
        &self,
        coordinator: &Coordinator,
        prior: &Prior,
        likelihood: &Likelihood<'_>,
    ) -> Result<Vec<f64>> {
        let (kernel, points) = (prior.kernel(), &coordinator.points);
        let mut gradient = kernel.gram_gradient(points, &self.by_points(&coordinator.precision));
        if !likelihood.has_messages() {
            gradient.extend(prior.mean().parameters().iter().map(|_| 0.0));
            return Ok(gradient);
        }
        let messages = &coordinator.messages;
        let (weights, alpha) = self.by_cross(&messages.features, &vec![1.0; messages.shift.len()], &messages.shift);
        add_scaled(1.0, &likelihood.message_cross_gradient(kernel, points, weights), &mut gradient);
        add_scaled(1.0, &likelihood.message_diagonal_gradient(kernel, -0.5), &mut gradient);
        gradient.extend(likelihood.message_mean_gradient(prior.mean(), &alpha));
        Ok(gradient)
    }

    /// Returns ∂E/∂K_MM = −½γγᵀ + ½L⁻ᵀ(I − S⁻¹ − Ĝ)L⁻¹ for the given Ĝ.
    fn by_points(&self, precision: &Matrix) -> Matrix {
        let mut middle = self.shrinkage.clone();
        middle.add_scaled(-1.0, precision);
        self.cholesky.solve_upper_matrix(&mut middle);
        let mut middle = middle.transposed();
        self.cholesky.solve_upper_matrix(&mut middle);
        middle.symmetrise();
        let points = self.gamma.len();
        Matrix::from_fn(points, points, |i, j| 0.5 * (middle[(i, j)] - self.gamma[i] * self.gamma[j]))
    }

    /// Returns ∂E/∂K_NM = αγᵀ + ΩΦ(I − S⁻¹)L⁻¹ for some rows of Φ, and α.
    fn by_cross(&self, features: &Matrix, omega: &[f64], shift: &[f64]) -> (Matrix, Vec<f64>) {
        let mut alpha = features.times(&self.weights);
        for (entry, (omega, shift)) in alpha.iter_mut().zip(omega.iter().zip(shift)) {
            *entry = shift - omega * *entry;
        }
        let mut weights = product(features.view(), self.explained.t());
        for (column, gamma) in self.gamma.iter().enumerate() {
            let entries = weights.column_mut(column).iter_mut().zip(omega.iter().zip(&alpha));
            entries.for_each(|(entry, (omega, alpha))| *entry = omega * *entry + gamma * alpha);
        }
        (weights, alpha)
    }
}

/// The events of a shard, with the tilts of their sites.
struct Events<'a> {
    covariances: &'a EventCovariances,
    cross: Cross<'a>,
    observations: &'a Observations,
    tilts: &'a [f64],
}

impl Events<'_> {
    /// Returns ω̄ and κ̃ of an event.
    fn site(&self, n: usize) -> (f64, f64) {
        let omega = omega(self.observations.weights()[n], self.tilts[n]);
        (omega, self.observations.kappa_of(n) - omega * self.covariances.prior_mean[n])
    }
}
