//! Binary outcomes at inputs.

use crate::error::{Result, positive, same_size};
use crate::inputs::Inputs;

/// N binary outcomes at N inputs, each with a weight. The default weight is 1; an event of weight 0.5 counts half.
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    inputs: Inputs,
    outcomes: Vec<bool>,
    weights: Vec<f64>,
}

impl Observations {
    /// Creates observations of weight 1.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] if the lengths differ.
    pub fn new(inputs: Inputs, outcomes: Vec<bool>) -> Result<Self> {
        let weights = vec![1.0; outcomes.len()];
        Self::weighted(inputs, outcomes, weights)
    }

    /// Creates weighted observations. The log-likelihood of event n is multiplied by `weights[n]`.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] if the lengths differ, [`crate::Error::OutOfRange`] for a weight that is not
    /// finite and positive.
    pub fn weighted(inputs: Inputs, outcomes: Vec<bool>, weights: Vec<f64>) -> Result<Self> {
        same_size("outcomes, one per input", inputs.len(), outcomes.len())?;
        same_size("weights, one per input", inputs.len(), weights.len())?;
        for &weight in &weights {
            positive("event weight", weight)?;
        }
        Ok(Self { inputs, outcomes, weights })
    }

    /// Returns the number of events N.
    pub fn len(&self) -> usize {
        self.outcomes.len()
    }

    /// Returns whether there are no events.
    pub fn is_empty(&self) -> bool {
        self.outcomes.is_empty()
    }

    /// Returns the inputs of the events, N×d.
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// Returns the outcomes, N.
    pub fn outcomes(&self) -> &[bool] {
        &self.outcomes
    }

    /// Returns the weights of the events, N.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Returns the events at `indices`, in that order.
    ///
    /// # Panics
    /// If an index is not below the number of events.
    pub fn select(&self, indices: &[usize]) -> Self {
        Self {
            inputs: self.inputs.select(indices),
            outcomes: indices.iter().map(|&n| self.outcomes[n]).collect(),
            weights: indices.iter().map(|&n| self.weights[n]).collect(),
        }
    }

    /// Returns κ_n = weight · (y_n − ½), N.
    pub(crate) fn kappa(&self) -> Vec<f64> {
        (0..self.len()).map(|n| self.kappa_of(n)).collect()
    }

    /// Returns κ of event `n`.
    pub(crate) fn kappa_of(&self, n: usize) -> f64 {
        let sign = if self.outcomes[n] { 0.5 } else { -0.5 };
        sign * self.weights[n]
    }
}
