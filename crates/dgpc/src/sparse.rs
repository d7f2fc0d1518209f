//! The Gaussian posterior of a mean field on M inducing points, and how its evidence bound changes with the prior (docs/method.md,
//! sections 2, 3, 7).

use crate::data::Data;
use crate::error::Result;
use crate::inputs::Inputs;
use crate::linalg::{
    Cholesky, CholeskyScratch, Matrix, add_lower_gram, add_symmetric_product, dot, multiply_vector, product,
    squared_norm,
};
use crate::mean_field::Engine;
use crate::prior_mean::Prior;

/// Events that one block takes: M × 256 doubles stay in the second-level cache.
const BLOCK: usize = 256;

/// Φᵀ = L⁻¹K_MN of events against inducing points, K_MM = LLᵀ, and what it leaves of each event's prior variance.
pub(crate) struct Features {
    pub(crate) cholesky: Cholesky,
    /// Φᵀ, M×N.
    pub(crate) by_event: Matrix,
    /// diag(K_NN − ΦΦᵀ), N, not negative.
    pub(crate) residual: Vec<f64>,
}

impl Features {
    /// Those of `inputs`. O(NM²).
    pub(crate) fn new(prior: &Prior, inputs: &Inputs, points: &Inputs) -> Result<Self> {
        Self::of_inputs(prior, inputs, points, Cholesky::with_jitter("K_MM", &prior.kernel().gram(points)?)?)
    }

    /// From K_MN (M×N), the diagonal of K_NN and the factor of K_MM. O(NM²).
    fn from_cross(cholesky: Cholesky, mut cross: Matrix, diagonal: &[f64]) -> Self {
        cholesky.solve_lower_matrix(&mut cross);
        let left = |(n, k): (usize, &f64)| (k - squared_norm(cross.column(n))).max(0.0);
        let residual = diagonal.iter().enumerate().map(left).collect();
        Self { cholesky, by_event: cross, residual }
    }

    /// Those of `inputs`, with K_MM factorised beforehand.
    pub(crate) fn of_inputs(prior: &Prior, inputs: &Inputs, points: &Inputs, cholesky: Cholesky) -> Result<Self> {
        Ok(Self::from_cross(cholesky, prior.kernel().cross(points, inputs)?, &prior.kernel().diagonal(inputs)?))
    }

    /// ΦᵀΩΦ, M×M, by blocks of events. O(NM²).
    pub(crate) fn precision(&self, omega: &[f64], out: &mut Matrix) {
        (0..out.columns()).for_each(|column| out.column_mut(column).fill(0.0));
        let mut block = Matrix::zeros(out.rows(), BLOCK.min(omega.len()));
        for first in (0..omega.len()).step_by(BLOCK) {
            let width = BLOCK.min(omega.len() - first);
            for column in 0..width {
                let root = omega[first + column].sqrt();
                let features = self.by_event.column(first + column);
                block.column_mut(column).iter_mut().zip(features).for_each(|(out, phi)| *out = root * phi);
            }
            add_symmetric_product(1.0, block.view().subcols(0, width), out);
        }
    }

    /// residual_n + φ_nᵀS⁻¹φ_n for S = `cholesky`, by blocks of events. O(NM²).
    fn add_variance(&self, cholesky: &Cholesky, variance: &mut [f64]) {
        let points = self.by_event.rows();
        let mut block = Matrix::zeros(points, BLOCK.min(variance.len()));
        for first in (0..variance.len()).step_by(BLOCK) {
            let width = BLOCK.min(variance.len() - first);
            for column in 0..width {
                block.column_mut(column).copy_from_slice(self.by_event.column(first + column));
            }
            cholesky.solve_lower_matrix(&mut block);
            for column in 0..width {
                let n = first + column;
                variance[n] = self.residual[n] + squared_norm(block.column(column));
            }
        }
    }
}

/// Features and the factor of I + Ĝ, Ĝ = ΦᵀΩΦ. Everything in the order of [`Data`].
pub(crate) struct Sparse<'a> {
    points: &'a Inputs,
    pub(crate) features: Features,
    cholesky: Cholesky,
    scratch: CholeskyScratch,
    precision: Matrix,
    /// (I+Ĝ)⁻¹b̂.
    weights: Vec<f64>,
    alpha: Vec<f64>,
}

impl<'a> Sparse<'a> {
    pub(crate) fn new(prior: &Prior, data: &Data<'_>, points: &'a Inputs) -> Result<Self> {
        let cholesky = Cholesky::with_jitter("K_MM", &prior.kernel().gram(points)?)?;
        let cross = data.cross(prior.kernel(), points)?;
        let features = Features::from_cross(cholesky, cross, &data.diagonal(prior.kernel())?);
        let (cholesky, scratch) = Cholesky::reserve(points.len());
        let precision = Matrix::zeros(points.len(), points.len());
        let (weights, alpha) = (vec![0.0; points.len()], vec![0.0; data.len()]);
        Ok(Self { points, features, cholesky, scratch, precision, weights, alpha })
    }

    /// Adds Σ ∂E/∂K_MN : ∂K_MN and Σ ∂E/∂diag(K_NN) : ∂diag(K_NN) over the events and messages to the gradient, by blocks:
    /// ∂E/∂K_MN = γαᵀ + L⁻ᵀ(I − (I+Ĝ)⁻¹)ΦᵀΩ, γ = L⁻ᵀ(I+Ĝ)⁻¹b̂. O(NM²).
    fn add_event_gradient(
        &self,
        prior: &Prior,
        data: &Data<'_>,
        omega: &[f64],
        gamma: &[f64],
        explained: &Matrix,
        gradient: &mut [f64],
    ) {
        let (kernel, inputs) = (prior.kernel(), data.observations.inputs());
        let mut add = |part: Vec<f64>| gradient.iter_mut().zip(part).for_each(|(sum, entry)| *sum += entry);
        let weights = |first: usize, end: usize| {
            let scaled = |m: usize, n: usize| omega[first + n] * self.features.by_event[(m, first + n)];
            let scaled = Matrix::from_fn(gamma.len(), end - first, scaled);
            let mut weights = product(explained.view(), scaled.view());
            for column in 0..end - first {
                let alpha = self.alpha[first + column];
                weights.column_mut(column).iter_mut().zip(gamma).for_each(|(entry, gamma)| *entry += alpha * gamma);
            }
            weights
        };
        for first in (0..data.events()).step_by(BLOCK) {
            let end = data.events().min(first + BLOCK);
            let block = inputs.slice(first..end);
            add(kernel.cross_gradient(self.points, &block, &weights(first, end)));
            let halves: Vec<f64> = omega[first..end].iter().map(|omega| -0.5 * omega).collect();
            add(kernel.diagonal_gradient(&block, &halves));
        }
        if data.has_messages() {
            add(data.message_cross_gradient(kernel, self.points, &weights(data.events(), data.len())));
            add(data.message_diagonal_gradient(kernel, -0.5));
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
        multiply_vector(self.features.by_event.view(), shift, &mut self.weights);
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

    fn kernel_gradient(&self, prior: &Prior, data: &Data<'_>, omega: &[f64]) -> Vec<f64> {
        let points = self.points.len();
        // C = I − (I+Ĝ)⁻¹, and L⁻ᵀC.
        let mut inverse = Matrix::zeros(points, points);
        self.cholesky.invert_lower(&mut inverse);
        let mut explained = Matrix::zeros(points, points);
        explained.add_to_diagonal(1.0);
        add_lower_gram(-1.0, &inverse, &mut explained);
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
        self.add_event_gradient(prior, data, omega, &gamma, &explained, &mut gradient);
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
}
