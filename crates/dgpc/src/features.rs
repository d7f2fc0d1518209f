//! What inducing points explain of the prior at other points.

use crate::error::Result;
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, View, add_symmetric_product_lower, multiply_lower, scale_into, squared_norm};
use crate::prior::Prior;

/// Events that one block takes: M × 256 doubles stay in the second-level cache.
pub(crate) const BLOCK: usize = 256;

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
    pub(crate) fn from_cross(cholesky: Cholesky, mut cross: Matrix, diagonal: &[f64]) -> Self {
        cholesky.solve_lower_matrix(&mut cross);
        let left = |(n, k): (usize, &f64)| (k - squared_norm(cross.column(n))).max(0.0);
        let residual = diagonal.iter().enumerate().map(left).collect();
        Self { cholesky, by_event: cross, residual }
    }

    /// Those of `inputs`, with K_MM factorised beforehand.
    pub(crate) fn of_inputs(prior: &Prior, inputs: &Inputs, points: &Inputs, cholesky: Cholesky) -> Result<Self> {
        Ok(Self::from_cross(cholesky, prior.kernel().cross(points, inputs)?, &prior.kernel().diagonal(inputs)?))
    }

    /// Φᵀ of the events `first..end`.
    pub(crate) fn block(&self, first: usize, end: usize) -> View<'_> {
        self.by_event.view().subcols(first, end - first)
    }

    /// ΦᵀΩΦ, M×M, by blocks of events. O(NM²).
    pub(crate) fn precision(&self, omega: &[f64], out: &mut Matrix) {
        (0..out.columns()).for_each(|column| out.column_mut(column).fill(0.0));
        let mut scaled = Matrix::zeros(out.rows(), BLOCK.min(omega.len()));
        for first in (0..omega.len()).step_by(BLOCK) {
            let width = BLOCK.min(omega.len() - first);
            for column in 0..width {
                let event = first + column;
                scale_into(omega[event].sqrt(), self.by_event.column(event), scaled.column_mut(column));
            }
            add_symmetric_product_lower(1.0, scaled.view().subcols(0, width), out);
        }
        out.mirror_lower();
    }

    /// residual_n + φ_nᵀS⁻¹φ_n for S = `cholesky`, by blocks of events. O(NM²).
    pub(crate) fn add_variance(&self, cholesky: &Cholesky, variance: &mut [f64]) {
        let points = self.by_event.rows();
        // A product with L⁻¹ is faster than a solve with L; S has no eigenvalue below 1, so that both are as exact.
        let mut inverse = Matrix::zeros(points, points);
        cholesky.invert_lower(&mut inverse);
        let mut solved = Matrix::zeros(points, BLOCK.min(variance.len()));
        for first in (0..variance.len()).step_by(BLOCK) {
            let end = variance.len().min(first + BLOCK);
            multiply_lower(&inverse, self.block(first, end), &mut solved);
            let events = variance[first..end].iter_mut().zip(&self.residual[first..end]);
            for (column, (variance, residual)) in events.enumerate() {
                *variance = residual + squared_norm(solved.column(column));
            }
        }
    }
}
