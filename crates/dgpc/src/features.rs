//! What inducing points explain of the prior at other points.

use crate::error::Result;
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, add_symmetric_product, squared_norm};
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
    pub(crate) fn add_variance(&self, cholesky: &Cholesky, variance: &mut [f64]) {
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
