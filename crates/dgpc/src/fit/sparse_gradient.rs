//! Gradient of the evidence bound of a sparse mean field by the prior's parameters ([`crate::method::learning`]).

use std::ops::Range;

use super::natural::FixedPoint;
use super::sparse::Sparse;
use crate::error::Result;
use crate::likelihood::Likelihood;
use crate::linalg::{Matrix, add_scaled, lower_gram, product};
use crate::parts::{blocks, on_parts};
use crate::prior::Prior;

/// Returns ∂E/∂(log parameters of the kernel, parameters of the prior mean) at the sites of `fixed_point`. The engine
/// must hold the posterior of these sites. O(NM²).
pub(super) fn gradient(
    engine: &Sparse<'_>,
    fixed_point: &FixedPoint,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
) -> Result<Vec<f64>> {
    let slope = Slope::new(engine, fixed_point, prior, likelihood);
    let mut gradient = prior.kernel().gram_gradient(engine.points, &slope.by_points);
    let mut alpha = Vec::with_capacity(likelihood.len());
    for part in on_parts(engine.cross.parts(), |part| slope.of_part(part)) {
        let (of_part, alpha_of_part) = part?;
        add_scaled(1.0, &of_part, &mut gradient);
        alpha.extend(alpha_of_part);
    }
    if likelihood.has_messages() {
        let (of_messages, alpha_of_messages) = slope.of_messages();
        add_scaled(1.0, &of_messages, &mut gradient);
        alpha.extend(alpha_of_messages);
    }
    gradient.extend(likelihood.mean_gradient(prior.mean(), &alpha));
    Ok(gradient)
}

/// The matrices from which ∂E/∂K is computed.
struct Slope<'a> {
    engine: &'a Sparse<'a>,
    fixed_point: &'a FixedPoint,
    prior: &'a Prior,
    likelihood: &'a Likelihood<'a>,
    /// S⁻¹b̂.
    weights: Vec<f64>,
    /// L⁻ᵀS⁻¹b̂.
    gamma: Vec<f64>,
    /// L⁻ᵀ(I − S⁻¹).
    explained: Matrix,
    /// ∂E/∂K_MM = −½γγᵀ + ½L⁻ᵀ(I − S⁻¹ − Ĝ)L⁻¹.
    by_points: Matrix,
}

impl<'a> Slope<'a> {
    fn new(
        engine: &'a Sparse<'a>,
        fixed_point: &'a FixedPoint,
        prior: &'a Prior,
        likelihood: &'a Likelihood<'a>,
    ) -> Self {
        let points = engine.points.len();
        let mut weights = engine.weights.clone();
        engine.inner.solve_upper(&mut weights);
        let mut gamma = weights.clone();
        engine.cholesky.solve_upper(&mut gamma);
        let (mut factor_inverse, mut inverse) = (Matrix::zeros(points, points), Matrix::zeros(points, points));
        engine.inner.invert_lower(&mut factor_inverse);
        lower_gram(&factor_inverse, &mut inverse);
        inverse.mirror_lower();
        let mut explained = Matrix::zeros(points, points);
        explained.add_to_diagonal(1.0);
        explained.add_scaled(-1.0, &inverse);
        let mut middle = explained.clone();
        middle.add_scaled(-1.0, &engine.precision);
        engine.cholesky.solve_upper_matrix(&mut middle);
        let mut middle = middle.transposed();
        engine.cholesky.solve_upper_matrix(&mut middle);
        middle.symmetrise();
        let by_points = Matrix::from_fn(points, points, |i, j| 0.5 * (middle[(i, j)] - gamma[i] * gamma[j]));
        engine.cholesky.solve_upper_matrix(&mut explained);
        Self { engine, fixed_point, prior, likelihood, weights, gamma, explained, by_points }
    }

    /// Returns the gradient by the covariances with some of the events, and α = κ̃ − Ωδ of these events. δ is the
    /// posterior mean minus the prior mean.
    fn of_part(&self, part: Range<usize>) -> Result<(Vec<f64>, Vec<f64>)> {
        let (kernel, inputs) = (self.prior.kernel(), self.engine.cross.inputs());
        let (mut gradient, mut alpha) = (vec![0.0; kernel.parameter_count()], Vec::with_capacity(part.len()));
        let mut features = Matrix::default();
        for block in blocks(part) {
            let omega = self.fixed_point.omega(self.likelihood, block.clone());
            let about_mean = |(n, omega): (usize, &f64)| {
                self.likelihood.observations.kappa_of(n) - omega * self.engine.prior_mean[n]
            };
            let shift: Vec<f64> = block.clone().zip(&omega).map(about_mean).collect();
            self.engine.cross.write_features(block.clone(), &self.engine.cholesky, &mut features)?;
            let (weights, alpha_of_block) = self.by_cross(&features, &omega, &shift);
            let inputs = inputs.slice(block);
            add_scaled(1.0, &kernel.cross_gradient(&inputs, self.engine.points, &weights), &mut gradient);
            let halves: Vec<f64> = omega.iter().map(|omega| -0.5 * omega).collect();
            add_scaled(1.0, &kernel.diagonal_gradient(&inputs, &halves), &mut gradient);
            alpha.extend(alpha_of_block);
        }
        Ok((gradient, alpha))
    }

    fn of_messages(&self) -> (Vec<f64>, Vec<f64>) {
        let (kernel, messages) = (self.prior.kernel(), &self.engine.messages);
        let (weights, alpha) = self.by_cross(&messages.features, &vec![1.0; messages.shift.len()], &messages.shift);
        let mut gradient = self.likelihood.message_cross_gradient(kernel, self.engine.points, weights);
        add_scaled(1.0, &self.likelihood.message_diagonal_gradient(kernel, -0.5), &mut gradient);
        (gradient, alpha)
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
