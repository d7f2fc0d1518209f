//! The paper's way to put summaries together (section 6 of [`crate::method`]).

use crate::error::{Error, Result};
use crate::inputs::Inputs;
use crate::latent::Latent;
use crate::linalg::{Cholesky, Matrix, dot, product, squared_norm};
use crate::prior::Prior;
use crate::summary::Summary;

/// Concatenation: the means and covariances of several summaries stacked, block by block.
///
/// Right only where the summaries' regions do not overlap, because each of them counts the prior once more; what
/// vehicles use is [`crate::Posterior`]. It predicts, and takes nothing in.
#[derive(Debug, Clone)]
pub struct Concatenation {
    prior: Prior,
    /// The inducing points of all summaries, M.
    support: Inputs,
    /// Of K_MM.
    gram: Cholesky,
    /// The stacked means about μ₀, whitened with the whole K_MM.
    weights: Vec<f64>,
    /// The stacked covariances, whitened likewise.
    covariance: Matrix,
    jitter: f64,
}

impl Concatenation {
    /// Stacks summaries. O(M³) for M inducing points in all.
    ///
    /// # Errors
    /// [`Error::DifferentPriors`] when a summary was formed under another prior, [`Error::SizeMismatch`] when their
    /// dimensions differ, [`Error::NotPositiveDefinite`] when the inducing points of all summaries together coincide
    /// too closely for any small jitter.
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

    /// The largest jitter that any factorisation behind it needed (0 in the ordinary case).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Latent mean and variance at every point: with t the whitened k(Z, x), k(x, x) − tᵀt + tᵀCt. O(M²) a point, in
    /// blocks.
    ///
    /// # Errors
    /// [`Error::BadColumn`] when the inputs do not fit the prior, [`Error::NotFinite`] when numbers
    /// near the end of the range overflow.
    pub fn latent(&self, inputs: &Inputs) -> Result<Latent> {
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

    /// Probability of success at every point. See [`Concatenation::latent`].
    ///
    /// # Errors
    /// As [`Concatenation::latent`].
    pub fn probability(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        Ok(self.latent(inputs)?.probability())
    }
}
