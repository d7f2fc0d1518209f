//! What events say about the latent function once ω is known.

use crate::error::{Result, positive, same_size};
use crate::inputs::Inputs;
use crate::observations::Observations;
use crate::prior_mean::PriorMean;

/// Gaussian sites: given ω, the likelihood of event n is proportional to exp(κ_n f_n − ½ ω_n f_n²). Weights are already
/// in both numbers. Sites know no kernel and no prior mean; κ̃ = κ − Ωμ₀ follows under any (sections 1 and 2 of
/// [`crate::method`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Sites {
    inputs: Inputs,
    omega: Vec<f64>,
    kappa: Vec<f64>,
}

impl Sites {
    /// The sites of `observations` at the given ω (N).
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] for another number of ω than events, [`crate::Error::OutOfRange`] for an ω that
    /// is not finite and positive.
    pub fn new(observations: &Observations, omega: Vec<f64>) -> Result<Self> {
        same_size("Pólya-Gamma variables, one per event", observations.len(), omega.len())?;
        for &omega in &omega {
            positive("Pólya-Gamma variable ω", omega)?;
        }
        Ok(Self { inputs: observations.inputs().clone(), omega, kappa: observations.kappa() })
    }

    /// Sites of any ω and κ.
    pub(crate) fn gaussian(inputs: Inputs, omega: Vec<f64>, kappa: Vec<f64>) -> Self {
        Self { inputs, omega, kappa }
    }

    /// No sites, of inputs of dimension `dimension`.
    pub fn empty(dimension: usize) -> Self {
        Self { inputs: Inputs::empty(dimension), omega: Vec::new(), kappa: Vec::new() }
    }

    /// Number of sites N.
    pub fn len(&self) -> usize {
        self.omega.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.omega.is_empty()
    }

    /// Where the sites lie, N×d.
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// Site precisions ω, N, all positive.
    pub fn omega(&self) -> &[f64] {
        &self.omega
    }

    /// κ = weight · (y − ½), N.
    pub fn kappa(&self) -> &[f64] {
        &self.kappa
    }

    /// The sites at `indices`, in that order.
    ///
    /// # Panics
    /// Beyond the last one.
    pub fn select(&self, indices: &[usize]) -> Self {
        Self {
            inputs: self.inputs.select(indices),
            omega: indices.iter().map(|&n| self.omega[n]).collect(),
            kappa: indices.iter().map(|&n| self.kappa[n]).collect(),
        }
    }

    /// Appends the sites of `other`.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] when the dimensions differ.
    pub fn append(&mut self, other: &Sites) -> Result<()> {
        self.inputs.append(&other.inputs)?;
        self.omega.extend_from_slice(&other.omega);
        self.kappa.extend_from_slice(&other.kappa);
        Ok(())
    }

    /// κ̃ = κ − Ωμ₀(X), N: the shift of the sites about a prior mean.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`] when the prior mean names a column that the inputs do not have.
    pub fn shift(&self, mean: &PriorMean) -> Result<Vec<f64>> {
        let mean = mean.values(&self.inputs)?;
        Ok(self.kappa.iter().zip(&self.omega).zip(&mean).map(|((kappa, omega), mean)| kappa - omega * mean).collect())
    }
}
