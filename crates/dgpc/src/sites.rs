//! Gaussian sites: the likelihood of events given ω.

use crate::error::{Result, positive, same_size};
#[cfg(feature = "serde")]
use crate::error::{all_finite, not_negative};
use crate::inputs::Inputs;
use crate::observations::Observations;
use crate::prior_mean::PriorMean;

/// Gaussian sites of N events.
///
/// Given ω, the likelihood of event n is proportional to exp(κ_n f_n − ½ ω_n f_n²). Both numbers include the event's
/// weight. Sites depend on no kernel and no prior mean; κ̃ = κ − Ωμ₀ follows from them under any prior mean
/// ([`crate::method::likelihood`]).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Sites {
    inputs: Inputs,
    omega: Vec<f64>,
    kappa: Vec<f64>,
}

impl Sites {
    /// Creates the sites of `observations` at the given ω (N).
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] if the number of ω differs from the number of events,
    /// [`crate::Error::OutOfRange`] for an ω that is not finite and positive.
    pub fn new(observations: &Observations, omega: Vec<f64>) -> Result<Self> {
        same_size("Pólya-Gamma variables, one per event", observations.len(), omega.len())?;
        for &omega in &omega {
            positive("Pólya-Gamma variable ω", omega)?;
        }
        Ok(Self { inputs: observations.inputs().clone(), omega, kappa: observations.kappa() })
    }

    /// Creates sites of arbitrary ω and κ, without checks.
    pub(crate) fn gaussian(inputs: Inputs, omega: Vec<f64>, kappa: Vec<f64>) -> Self {
        Self { inputs, omega, kappa }
    }

    /// Creates an empty set of sites, for inputs of dimension `dimension`.
    pub fn empty(dimension: usize) -> Self {
        Self { inputs: Inputs::empty(dimension), omega: Vec::new(), kappa: Vec::new() }
    }

    /// Returns the number of sites N.
    pub fn len(&self) -> usize {
        self.omega.len()
    }

    /// Returns whether there are no sites.
    pub fn is_empty(&self) -> bool {
        self.omega.is_empty()
    }

    /// Returns the inputs of the sites, N×d.
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// Returns the site precisions ω, N, all positive.
    pub fn omega(&self) -> &[f64] {
        &self.omega
    }

    /// Returns κ = weight · (y − ½), N.
    pub fn kappa(&self) -> &[f64] {
        &self.kappa
    }

    /// Returns the sites at `indices`, in that order.
    ///
    /// # Panics
    /// If an index is not below the number of sites.
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
    /// [`crate::Error::SizeMismatch`] if the dimensions differ.
    pub fn append(&mut self, other: &Sites) -> Result<()> {
        self.inputs.append(&other.inputs)?;
        self.omega.extend_from_slice(&other.omega);
        self.kappa.extend_from_slice(&other.kappa);
        Ok(())
    }

    /// Returns κ̃ = κ − Ωμ₀(X), N: the shift of the sites about a prior mean.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`] if the prior mean names a column that the inputs do not have.
    pub fn shift(&self, mean: &PriorMean) -> Result<Vec<f64>> {
        let mean = mean.values(&self.inputs)?;
        Ok(self.kappa.iter().zip(&self.omega).zip(&mean).map(|((kappa, omega), mean)| kappa - omega * mean).collect())
    }
}

/// The serialised form of [`Sites`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    inputs: Inputs,
    omega: Vec<f64>,
    kappa: Vec<f64>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Sites {
    type Error = crate::error::Error;

    fn try_from(Parts { inputs, omega, kappa }: Parts) -> Result<Self> {
        same_size("Pólya-Gamma variables, one per site", inputs.len(), omega.len())?;
        same_size("κ, one per site", inputs.len(), kappa.len())?;
        // Expectation propagation may give a site no precision.
        omega.iter().try_for_each(|&omega| not_negative("Pólya-Gamma variable ω", omega).map(drop))?;
        all_finite("κ of the sites", &kappa)?;
        Ok(Self { inputs, omega, kappa })
    }
}

#[cfg(feature = "serde")]
impl From<Sites> for Parts {
    fn from(Sites { inputs, omega, kappa }: Sites) -> Self {
        Self { inputs, omega, kappa }
    }
}
