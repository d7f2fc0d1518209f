//! What a summary says in units of the latent function, and without any kernel.

use crate::error::Result;
use crate::factor::Factor;
use crate::linalg::{Matrix, product};
use crate::summary::Summary;

impl Summary {
    /// G = LĜLᵀ, M×M: K_MN Ω K_NM for a variational summary.
    pub fn precision(&self) -> Matrix {
        let lower = self.cholesky().lower();
        let half = product(lower.view(), self.whitened_precision().view());
        product(half.view(), lower.t())
    }

    /// b = Lb̂, M: K_MN κ̃ for a variational summary.
    pub fn shift(&self) -> Vec<f64> {
        self.cholesky().lower_times(self.whitened_shift())
    }

    /// Mean (M) and covariance (M×M) of f(Z) given this message alone: μ₀ + L(I+Ĝ)⁻¹b̂ and L(I+Ĝ)⁻¹Lᵀ. O(M³).
    ///
    /// # Errors
    /// [`crate::Error::NotPositiveDefinite`] when I + Ĝ is not, as after subtracting what was never observed.
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

    /// The kernel-free factor: exp(−½fᵀPf + ηᵀf) in f = f(Z). O(M³).
    ///
    /// # Errors
    /// [`crate::Error::NegativeEigenvalue`] when the precision has a clearly negative one, [`crate::Error::NotFinite`] when numbers
    /// near the end of the range overflow.
    pub fn factor(&self) -> Result<Factor> {
        let mut half = self.root(0.0)?;
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
