//! Summaries in units of the latent function, and their kernel-free factors.

use crate::error::Result;
use crate::factor::Factor;
use crate::linalg::{Matrix, product};
use crate::summary::Summary;

impl Summary {
    /// Returns G = LĜLᵀ, M×M. For a variational summary G = K_MN Ω K_NM.
    pub fn precision(&self) -> Matrix {
        let lower = self.cholesky().lower();
        let half = product(lower.view(), self.whitened_precision().view());
        product(half.view(), lower.t())
    }

    /// Returns b = Lb̂, M. For a variational summary b = K_MN κ̃.
    pub fn shift(&self) -> Vec<f64> {
        self.cholesky().lower_times(self.whitened_shift())
    }

    /// Returns the mean (M) and covariance (M×M) of f(Z) given this message alone: μ₀ + L(I+Ĝ)⁻¹b̂ and L(I+Ĝ)⁻¹Lᵀ.
    /// O(M³).
    ///
    /// # Errors
    /// [`crate::Error::NotPositiveDefinite`] if I + Ĝ is not, for example after subtracting events that were never
    /// added.
    pub fn moments(&self) -> Result<(Vec<f64>, Matrix)> {
        let total = self.total()?;
        let mut mean = self.whitened_shift().to_vec();
        total.solve(&mut mean);
        let prior_mean = self.prior().mean().values(self.inducing_points())?;
        let mean = self.cholesky().lower_times(&mean).iter().zip(&prior_mean).map(|(m, prior)| m + prior).collect();
        let mut half = self.cholesky().lower().transposed();
        total.solve_lower_matrix(&mut half);
        Ok((mean, product(half.t(), half.view())))
    }

    /// Returns the kernel-free factor exp(−½fᵀPf + ηᵀf) of f = f(Z). O(M³).
    ///
    /// # Errors
    /// [`crate::Error::NegativeEigenvalue`] if the precision has a clearly negative eigenvalue,
    /// [`crate::Error::NotFinite`] if numbers near the end of the floating-point range overflow.
    pub fn factor(&self) -> Result<Factor> {
        let mut half = self.root()?;
        self.cholesky().solve_upper_matrix(&mut half);
        let precision = product(half.view(), half.t());
        let mut shift = self.whitened_shift().to_vec();
        self.cholesky().solve_upper(&mut shift);
        let prior_mean = self.prior().mean().values(self.inducing_points())?;
        let offset = precision.times(&prior_mean);
        let shift = shift.iter().zip(&offset).map(|(h, offset)| h + offset).collect();
        Factor::new(self.inducing_points().clone(), precision, shift)
    }
}
