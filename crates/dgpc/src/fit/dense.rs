//! Full Gaussian posterior of a mean field, and the gradient of its evidence bound ([`crate::method::inference`] and
//! [`crate::method::learning`]).

use std::sync::{Mutex, PoisonError};

use super::newton::Newton;
use super::pass::Pass;
use crate::error::Result;
use crate::likelihood::Likelihood;
use crate::linalg::{Cholesky, CholeskyScratch, Matrix, dot, fill_scaled, lower_gram, multiply_vector, squared_norm};
use crate::prior::Prior;

/// Smallest product of ω and prior variance at which a posterior variance comes from diag(B⁻¹). Below it, that formula
/// cancels, and the variance comes from a solve.
const INFORMATIVE: f64 = 1e-4;

/// K and the factors of B = I + Ω^½KΩ^½. All entries are in the order of [`Likelihood`].
///
/// Without messages, the matrices keep their storage from one prior to the next.
pub(crate) struct Dense {
    gram: Matrix,
    cholesky: Cholesky,
    scratch: CholeskyScratch,
    /// L⁻¹ with B = LLᵀ.
    factor_inverse: Matrix,
    /// B⁻¹, which Newton steps and gradients need but passes do not.
    inverse: Matrix,
    roots: Vec<f64>,
    /// α = κ̃ − Ωδ = K⁻¹δ, with δ the posterior mean minus the prior mean.
    alpha: Vec<f64>,
}

impl Default for Dense {
    fn default() -> Self {
        Self::with_size(0)
    }
}

impl Dense {
    pub(crate) fn new(prior: &Prior, likelihood: &Likelihood<'_>) -> Result<Self> {
        let mut engine = Self::default();
        engine.prepare(prior, likelihood)?;
        Ok(engine)
    }

    /// Prepares passes under another prior. Without messages, it allocates only if the number of
    /// observations changed.
    fn prepare(&mut self, prior: &Prior, likelihood: &Likelihood<'_>) -> Result<()> {
        let size = likelihood.len();
        if self.roots.len() != size {
            *self = Self::with_size(size);
        }
        likelihood.write_gram(prior.kernel(), &mut self.gram)
    }

    fn with_size(size: usize) -> Self {
        let (cholesky, scratch) = Cholesky::reserve(size);
        let square = || Matrix::zeros(size, size);
        let (roots, alpha) = (vec![0.0; size], vec![0.0; size]);
        Self { gram: square(), cholesky, scratch, factor_inverse: square(), inverse: square(), roots, alpha }
    }

    /// Returns s_n = (1 − (B⁻¹)_nn)/ω_n, where B⁻¹ = L⁻ᵀL⁻¹.
    fn variance(&self, n: usize) -> f64 {
        let (root, prior) = (self.roots[n], self.gram[(n, n)]);
        let omega = root * root;
        if omega * prior > INFORMATIVE {
            return ((1.0 - squared_norm(&self.factor_inverse.column(n)[n..])) / omega).max(0.0);
        }
        let mut column: Vec<f64> = self.gram.column(n).iter().zip(&self.roots).map(|(k, root)| k * root).collect();
        self.cholesky.solve_lower(&mut column);
        (prior - squared_norm(&column)).max(0.0)
    }

    /// Writes the variance and the posterior mean minus the prior mean of all observations. Returns the terms of E that
    /// depend on the covariance.
    pub(super) fn pass(&mut self, omega: &[f64], shift: &[f64], mean: &mut [f64], variance: &mut [f64]) -> Result<f64> {
        self.roots.iter_mut().zip(omega).for_each(|(root, omega)| *root = omega.sqrt());
        let (gram, roots) = (&self.gram, &self.roots);
        self.cholesky.refactorise("I + Ω^½KΩ^½", &mut self.scratch, |b| fill_scaled(b, gram, roots))?;
        self.cholesky.invert_lower(&mut self.factor_inverse);
        // α = κ̃ − Ω^½B⁻¹Ω^½Kκ̃, δ = Kα.
        multiply_vector(gram.view(), shift, &mut self.alpha);
        self.alpha.iter_mut().zip(roots).for_each(|(entry, root)| *entry *= root);
        self.cholesky.solve(&mut self.alpha);
        for ((entry, root), shift) in self.alpha.iter_mut().zip(roots).zip(shift) {
            *entry = shift - root * *entry;
        }
        multiply_vector(gram.view(), &self.alpha, mean);
        variance.iter_mut().enumerate().for_each(|(n, variance)| *variance = self.variance(n));
        Ok(0.5 * dot(mean, shift) - 0.5 * self.cholesky.log_determinant())
    }

    /// Returns the Newton step from the last pass, in ln c of the events, or `None` if rounding spoils it.
    pub(super) fn newton(&mut self, pass: &Pass<'_>, log_tilts: &[f64]) -> Option<Vec<f64>> {
        lower_gram(&self.factor_inverse, &mut self.inverse);
        self.inverse.mirror_lower();
        Newton { inverse: &self.inverse, roots: &self.roots, pass, log_tilts }.step()
    }

    /// Returns ∂E/∂(log parameters of the kernel, parameters of the prior mean) at the ω and shift of the last pass.
    pub(super) fn gradient(&mut self, prior: &Prior, likelihood: &Likelihood<'_>) -> Vec<f64> {
        // ∂E/∂K = ½(ααᵀ − Ω^½B⁻¹Ω^½) overwrites B⁻¹; ∂E/∂μ₀ = α.
        lower_gram(&self.factor_inverse, &mut self.inverse);
        for column in 0..self.alpha.len() {
            let (alpha, root) = (0.5 * self.alpha[column], -0.5 * self.roots[column]);
            let rows = self.inverse.column_mut(column)[column..].iter_mut();
            let rows = rows.zip(&self.alpha[column..]).zip(&self.roots[column..]);
            rows.for_each(|((entry, row_alpha), row_root)| *entry = alpha * row_alpha + root * row_root * *entry);
        }
        let mut gradient = likelihood.gram_gradient(prior.kernel(), &mut self.inverse);
        gradient.extend(likelihood.mean_gradient(prior.mean(), &self.alpha));
        gradient
    }
}

/// Engines for successive fits of the same observations. Fits at the same time use different engines.
#[derive(Default)]
pub(crate) struct DenseEngines(Mutex<Vec<Dense>>);

impl DenseEngines {
    /// Prepares an engine that is not in use, and runs a fit with it.
    pub(super) fn run<R>(
        &self,
        prior: &Prior,
        likelihood: &Likelihood<'_>,
        fit: impl FnOnce(&mut Dense) -> Result<R>,
    ) -> Result<R> {
        let idle = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut engine = idle().pop().unwrap_or_default();
        let result = engine.prepare(prior, likelihood).and_then(|()| fit(&mut engine));
        idle().push(engine);
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::fixed_point::iterate;
    use crate::inputs::Inputs;
    use crate::kernel::{Kernel, Shape, Term};
    use crate::observations::Observations;
    use crate::prior_mean::PriorMean;

    #[test]
    fn an_engine_that_was_used_before_gives_equal_results_to_the_bit() -> Result<()> {
        let prior = |variance: f64| {
            let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, variance, 1.0, 1)?])?;
            Prior::new(kernel, PriorMean::Constant(0.3))
        };
        let inputs = Inputs::new((0..40).map(|n| f64::from(n) * 0.2).collect(), 1)?;
        let outcomes = inputs.rows().map(|x| x[0].sin() > 0.2).collect();
        let events = Observations::new(inputs, outcomes)?;
        let likelihood = Likelihood::new(&events, &[])?;
        let result = |engines: &DenseEngines, prior: &Prior| {
            engines.run(prior, &likelihood, |engine| {
                let fit = iterate(engine, prior, &likelihood, &Default::default())?;
                Ok((fit.evidence.to_bits(), fit.mean, engine.gradient(prior, &likelihood)))
            })
        };
        let used = DenseEngines::default();
        result(&used, &prior(9.0)?)?;
        assert!(result(&used, &prior(1e308)?).is_err());
        assert_eq!(result(&used, &prior(2.0)?)?, result(&DenseEngines::default(), &prior(2.0)?)?);
        Ok(())
    }
}
