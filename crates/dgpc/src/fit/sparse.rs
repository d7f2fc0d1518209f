//! The Gaussian posterior of a mean field on M inducing points, and how its evidence bound changes with the prior
//! (sections 2, 3 and 7 of [`crate::method`]).

use super::fixed_point::Engine;
use crate::error::Result;
use crate::features::{BLOCK, Features};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::linalg::{
    Cholesky, CholeskyScratch, Matrix, add_scaled, dot, lower_gram, multiply_vector, product, squared_norm,
};
use crate::prior::Prior;

/// Features and the factor of I + Ĝ, Ĝ = ΦᵀΩΦ. Everything in the order of [`Likelihood`].
pub(crate) struct Sparse<'a> {
    points: &'a Inputs,
    pub(crate) features: Features,
    cholesky: Cholesky,
    scratch: CholeskyScratch,
    precision: Matrix,
    /// b̂.
    shift: Vec<f64>,
    /// (I+Ĝ)⁻¹b̂.
    weights: Vec<f64>,
    alpha: Vec<f64>,
}

impl<'a> Sparse<'a> {
    pub(crate) fn new(prior: &Prior, likelihood: &Likelihood<'_>, points: &'a Inputs) -> Result<Self> {
        let cholesky = Cholesky::with_jitter("K_MM", &prior.kernel().gram(points)?)?;
        let cross = likelihood.cross(prior.kernel(), points)?;
        let features = Features::from_cross(cholesky, cross, &likelihood.diagonal(prior.kernel())?);
        let (cholesky, scratch) = Cholesky::reserve(points.len());
        let precision = Matrix::zeros(points.len(), points.len());
        let (shift, weights) = (vec![0.0; points.len()], vec![0.0; points.len()]);
        let alpha = vec![0.0; likelihood.len()];
        Ok(Self { points, features, cholesky, scratch, precision, shift, weights, alpha })
    }

    /// Adds Σ ∂E/∂K_MN : ∂K_MN and Σ ∂E/∂diag(K_NN) : ∂diag(K_NN) over the events and messages to the gradient, by
    /// blocks: ∂E/∂K_MN = γαᵀ + L⁻ᵀ(I − (I+Ĝ)⁻¹)ΦᵀΩ, γ = L⁻ᵀ(I+Ĝ)⁻¹b̂. O(NM²).
    fn add_event_gradient(
        &self,
        prior: &Prior,
        likelihood: &Likelihood<'_>,
        omega: &[f64],
        gamma: &[f64],
        explained: &Matrix,
        gradient: &mut [f64],
    ) {
        let (kernel, inputs) = (prior.kernel(), likelihood.observations.inputs());
        let mut add = |part: Vec<f64>| gradient.iter_mut().zip(part).for_each(|(sum, entry)| *sum += entry);
        let weights = |first: usize, end: usize| {
            let mut weights = product(explained.view(), self.features.block(first, end));
            for (column, (omega, alpha)) in omega[first..end].iter().zip(&self.alpha[first..end]).enumerate() {
                let column = weights.column_mut(column);
                column.iter_mut().for_each(|entry| *entry *= omega);
                add_scaled(*alpha, gamma, column);
            }
            weights
        };
        for first in (0..likelihood.events()).step_by(BLOCK) {
            let end = likelihood.events().min(first + BLOCK);
            let block = inputs.slice(first..end);
            add(kernel.cross_gradient(self.points, &block, &weights(first, end)));
            let halves: Vec<f64> = omega[first..end].iter().map(|omega| -0.5 * omega).collect();
            add(kernel.diagonal_gradient(&block, &halves));
        }
        if likelihood.has_messages() {
            add(likelihood.message_cross_gradient(
                kernel,
                self.points,
                &weights(likelihood.events(), likelihood.len()),
            ));
            add(likelihood.message_diagonal_gradient(kernel, -0.5));
        }
    }
}

impl Engine for Sparse<'_> {
    fn pass(&mut self, omega: &[f64], shift: &[f64], mean: &mut [f64], variance: &mut [f64]) -> Result<f64> {
        self.features.precision(omega, &mut self.precision);
        let precision = &self.precision;
        self.cholesky.refactorise("I + ΦᵀΩΦ", &mut self.scratch, |b| {
            b.copy_from(precision);
            b.add_to_diagonal(1.0);
        })?;
        multiply_vector(self.features.by_event.view(), shift, &mut self.shift);
        self.weights.copy_from_slice(&self.shift);
        self.cholesky.solve_lower(&mut self.weights);
        let explained = squared_norm(&self.weights);
        self.cholesky.solve_upper(&mut self.weights);
        multiply_vector(self.features.by_event.t(), &self.weights, mean);
        self.features.add_variance(&self.cholesky, variance);
        for n in 0..shift.len() {
            self.alpha[n] = shift[n] - omega[n] * mean[n];
        }
        let slack = dot(omega, &self.features.residual);
        Ok(0.5 * explained - 0.5 * self.cholesky.log_determinant() - 0.5 * slack)
    }

    fn kernel_gradient(&mut self, prior: &Prior, likelihood: &Likelihood<'_>, omega: &[f64]) -> Vec<f64> {
        let points = self.points.len();
        // C = I − (I+Ĝ)⁻¹, and L⁻ᵀC.
        let mut inverse = Matrix::zeros(points, points);
        self.cholesky.invert_lower(&mut inverse);
        let mut explained = Matrix::zeros(points, points);
        let mut left = Matrix::zeros(points, points);
        lower_gram(&inverse, &mut left);
        explained.add_to_diagonal(1.0);
        explained.add_scaled(-1.0, &left);
        // ∂E/∂K_MM = −½γγᵀ + ½L⁻ᵀ(C − Ĝ)L⁻¹.
        let mut gamma = self.weights.clone();
        self.features.cholesky.solve_upper(&mut gamma);
        let mut middle = explained.clone();
        middle.add_scaled(-1.0, &self.precision);
        self.features.cholesky.solve_upper_matrix(&mut middle);
        let mut middle = middle.transposed();
        self.features.cholesky.solve_upper_matrix(&mut middle);
        middle.symmetrise();
        let weights = Matrix::from_fn(points, points, |i, j| 0.5 * (middle[(i, j)] - gamma[i] * gamma[j]));
        let mut gradient = prior.kernel().gram_gradient(self.points, &weights);

        self.features.cholesky.solve_upper_matrix(&mut explained);
        self.add_event_gradient(prior, likelihood, omega, &gamma, &explained, &mut gradient);
        gradient
    }

    fn alpha(&self) -> &[f64] {
        &self.alpha
    }

    fn residual(&self, events: usize) -> Vec<f64> {
        self.features.residual[..events].to_vec()
    }

    fn jitter(&self) -> f64 {
        self.features.cholesky.jitter()
    }

    fn condensed(&self) -> Option<(Matrix, Vec<f64>)> {
        Some((self.precision.clone(), self.shift.clone()))
    }
}
