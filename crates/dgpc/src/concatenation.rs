//! Concatenation, the paper's fusion of summaries ([`crate::method::fusion`]).

use crate::error::{Error, Result};
use crate::inputs::Inputs;
use crate::latent::Latent;
use crate::linalg::{Cholesky, Matrix, dot, product, squared_norm};
use crate::prior::Prior;
use crate::summary::Summary;

/// A concatenation of summaries: their means and covariances stacked, block by block.
///
/// Concatenation counts the prior once per summary. It is correct only if the summaries' regions do not overlap. It
/// predicts, but cannot absorb further events or summaries. Vehicles use [`crate::Posterior`] instead.
#[derive(Debug, Clone)]
pub struct Concatenation {
    prior: Prior,
    /// The inducing points of all summaries, M.
    support: Inputs,
    /// Cholesky factor of K_MM.
    gram: Cholesky,
    /// The stacked means about μ₀, whitened with the whole K_MM.
    weights: Vec<f64>,
    /// The stacked covariances, whitened likewise.
    covariance: Matrix,
    jitter: f64,
}

impl Concatenation {
    /// Stacks summaries. O(M³) for M inducing points in total.
    ///
    /// # Errors
    /// * [`Error::DifferentPriors`] if a summary was formed under another prior.
    /// * [`Error::SizeMismatch`] if the dimensions of the summaries differ.
    /// * [`Error::NotPositiveDefinite`] if inducing points coincide too closely for any small jitter.
    pub fn new(prior: &Prior, summaries: &[&Summary]) -> Result<Self> {
        let dimension = summaries.first().map_or(prior.dimension_min(), |first| first.inducing_points().dimension());
        let mut support = Inputs::empty(dimension);
        for summary in summaries {
            if summary.prior() != prior {
                return Err(Error::DifferentPriors { what: "a concatenation and a summary" });
            }
            support.append(summary.inducing_points())?;
        }
        let size = support.len();
        let gram = Cholesky::with_jitter("K_MM of all summaries", &prior.kernel().gram(&support)?)?;
        let mut covariance = Matrix::zeros(size, size);
        let mut weights = Vec::with_capacity(size);
        for summary in summaries {
            let first = weights.len();
            let (mean, block) = summary.moments()?;
            let prior_mean = prior.mean().values(summary.inducing_points())?;
            weights.extend(mean.iter().zip(&prior_mean).map(|(mean, prior)| mean - prior));
            for column in 0..block.columns() {
                covariance.column_mut(first + column)[first..first + block.rows()]
                    .copy_from_slice(block.column(column));
            }
        }
        gram.solve_lower(&mut weights);
        let covariance = gram.whiten(covariance);
        let jitter = summaries.iter().map(|summary| summary.jitter()).fold(gram.jitter(), f64::max);
        Ok(Self { prior: prior.clone(), support, gram, weights, covariance, jitter })
    }

    /// Returns the largest jitter of all factorisations behind the concatenation (ordinarily 0).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Returns the latent mean and variance at every point. With t the whitened k(Z, x) and C the whitened stacked
    /// covariance, the variance is k(x, x) − tᵀt + tᵀCt. O(M²) a point, in blocks.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the inputs have another dimension than the summaries, [`Error::BadColumn`] if they do
    /// not fit the prior, and [`Error::NotFinite`] if numbers near the end of the floating-point range overflow.
    pub fn latent(&self, inputs: &Inputs) -> Result<Latent> {
        self.support.check_dimension(inputs)?;
        Latent::in_blocks(&self.prior, inputs, self.support.len().pow(2), |block, mean, variance, ()| {
            let mut features = self.prior.kernel().cross(&self.support, block)?;
            self.gram.solve_lower_matrix(&mut features);
            let stacked = product(self.covariance.view(), features.view());
            for (n, (mean, variance)) in mean.iter_mut().zip(variance).enumerate() {
                let features = features.column(n);
                *mean += dot(features, &self.weights);
                *variance += dot(features, stacked.column(n));
                *variance -= squared_norm(features);
            }
            Ok(())
        })
    }

    /// Returns the probability of success at every point. See [`Concatenation::latent`].
    ///
    /// # Errors
    /// As [`Concatenation::latent`].
    pub fn probability(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        Ok(self.latent(inputs)?.probability())
    }
}
