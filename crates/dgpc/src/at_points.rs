//! Predictions at the same points under a posterior and under its extensions.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::inputs::Inputs;
use crate::latent::{Latent, POINTS};
use crate::linalg::Matrix;
use crate::parts::{on_parts, stretches};
use crate::posterior::Posterior;

/// A posterior at fixed points.
///
/// It predicts there under the posterior and under any extension of it, for example by each of several reports. For m
/// additional rows a prediction takes O(nm) a point instead of O(n²).
#[derive(Debug)]
pub struct PosteriorAtPoints<'p> {
    posterior: &'p Posterior,
    blocks: Vec<Block>,
}

/// Some of the points. With t the whitened covariance of a point with the support and φ = L_B⁻¹Rᵀt, the mean about μ₀
/// is tᵀb̂ − φᵀg with g = L_B⁻¹RᵀTb̂. The explained variance is ‖φ‖² ([`crate::method::fusion`]).
#[derive(Debug)]
struct Block {
    inputs: Inputs,
    /// φᵀ, a row for each point.
    features: Matrix,
    prior_mean: Vec<f64>,
    /// tᵀb̂.
    shifted: Vec<f64>,
    /// Prior variance minus the explained variance.
    variance: Vec<f64>,
}

impl<'p> PosteriorAtPoints<'p> {
    /// Prepares predictions at `inputs`. O(n²) time and O(n) memory a point.
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn new(posterior: &'p Posterior, inputs: &Inputs) -> Result<Self> {
        let block = |range: Range<usize>| {
            let mut block = Block::before_evidence(posterior, inputs.slice(range))?;
            block.extend(posterior)?;
            Ok(block)
        };
        let blocks = on_parts(stretches(0..inputs.len(), POINTS).collect(), block);
        Ok(Self { posterior, blocks: blocks.into_iter().collect::<Result<_>>()? })
    }

    /// Returns mean and variance of the latent function at the points under `posterior`: the posterior of
    /// [`PosteriorAtPoints::new`], or an extension of it by [`Posterior::absorb_events`] or
    /// [`Posterior::absorb_summaries`].
    ///
    /// # Errors
    /// [`Error::NotAnExtension`] for any other posterior, and as [`Posterior::latent`].
    pub fn latent(&mut self, posterior: &Posterior) -> Result<Latent> {
        if !posterior.extends(self.posterior) {
            return Err(Error::NotAnExtension { rows: self.posterior.len(), found: posterior.len() });
        }
        let blocks = self.blocks.iter_mut().collect();
        let moments = on_parts(blocks, |block: &mut Block| block.moments(posterior));
        let (mut mean, mut variance) = (Vec::new(), Vec::new());
        for moments in moments {
            let (means, variances) = moments?;
            mean.extend(means);
            variance.extend(variances);
        }
        Latent::checked(mean, variance)
    }
}

impl Block {
    fn before_evidence(posterior: &Posterior, inputs: Inputs) -> Result<Self> {
        let prior_mean = posterior.prior().mean().values(&inputs)?;
        let variance = posterior.prior().kernel().diagonal(&inputs)?;
        let (features, shifted) = (Matrix::zeros(inputs.len(), 0), vec![0.0; inputs.len()]);
        Ok(Self { inputs, features, prior_mean, shifted, variance })
    }

    /// Adds the rows of a posterior that the block lacks.
    fn extend(&mut self, posterior: &Posterior) -> Result<()> {
        let old = self.features.columns();
        let shifted = posterior.append_features(&self.inputs, &mut self.features)?;
        self.shifted.iter_mut().zip(shifted).for_each(|(sum, shifted)| *sum += shifted);
        for row in old..posterior.len() {
            let features = self.features.column(row);
            self.variance.iter_mut().zip(features).for_each(|(variance, feature)| *variance -= feature * feature);
        }
        Ok(())
    }

    /// Returns means and variances under an extension, without checks. The block stays as it is.
    fn moments(&mut self, posterior: &Posterior) -> Result<(Vec<f64>, Vec<f64>)> {
        let (rows, shifted, variance) = (self.features.columns(), self.shifted.clone(), self.variance.clone());
        let extended = self.extend(posterior);
        let correction = extended.map(|()| self.features.times(posterior.solved_target()));
        self.features.truncate_columns(rows);
        let shifted = std::mem::replace(&mut self.shifted, shifted);
        let variance = std::mem::replace(&mut self.variance, variance);
        let about_prior_mean = shifted.iter().zip(correction?).map(|(shifted, correction)| shifted - correction);
        let mean = self.prior_mean.iter().zip(about_prior_mean).map(|(prior, mean)| prior + mean).collect();
        Ok((mean, variance))
    }
}
