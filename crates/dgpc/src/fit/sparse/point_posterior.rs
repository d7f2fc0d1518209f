//! The posterior on the inducing points of a sparse fit.

use std::sync::Arc;

use crate::linalg::{Cholesky, Matrix};

/// A posterior on inducing points, whitened by L with K_MM = LLᵀ: S = I + Ĝ and b̂.
///
/// With S = L_S·L_Sᵀ, the features ψ = (L·L_S)⁻¹k of an event give all its moments. The posterior mean is (L_S⁻¹b̂)ᵀψ,
/// and the explained variance is ‖ψ‖². The sum Σ ωψψᵀ is the next Ĝ in the coordinates of this posterior. A walk that
/// visits every event once therefore leads from one posterior to the next, and needs no result of the walk before.
#[derive(Debug, Clone)]
pub(crate) struct PointPosterior {
    /// L_S.
    pub(super) inner: Cholesky,
    /// L_S⁻¹b̂.
    pub(super) weights: Vec<f64>,
}

impl PointPosterior {
    /// Returns the prior on `points` inducing points.
    pub(super) fn prior(points: usize) -> Self {
        Self { inner: Cholesky::of_identity(points), weights: vec![0.0; points] }
    }

    /// Returns whether the numbers of both posteriors are equal.
    pub(super) fn is_same_as(self: &Arc<Self>, other: &Arc<Self>) -> bool {
        let is_equal = || self.weights == other.weights && lower(&self.inner).eq(lower(&other.inner));
        Arc::ptr_eq(self, other) || is_equal()
    }
}

/// Returns the entries of the lower triangle, column by column.
pub(super) fn lower_entries(matrix: &Matrix) -> impl Iterator<Item = f64> + '_ {
    (0..matrix.columns()).flat_map(|column| matrix.column(column)[column..].iter().copied())
}

pub(super) fn lower(cholesky: &Cholesky) -> impl Iterator<Item = f64> + '_ {
    lower_entries(cholesky.factor())
}
