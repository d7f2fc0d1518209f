//! Binary outcomes at inputs.

use crate::error::{Result, positive, same_size};
use crate::inputs::Inputs;

/// N binary outcomes at N inputs, each with a weight (1 unless said otherwise; 0.5 counts an event half).
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    inputs: Inputs,
    outcomes: Vec<bool>,
    weights: Vec<f64>,
}

impl Observations {
    /// Outcomes at inputs, all of weight 1.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] when the lengths differ.
    pub fn new(inputs: Inputs, outcomes: Vec<bool>) -> Result<Self> {
        let weights = vec![1.0; outcomes.len()];
        Self::weighted(inputs, outcomes, weights)
    }

    /// Outcomes at inputs with a weight each: the log-likelihood of event n counts `weights[n]` times.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] when the lengths differ, [`crate::Error::OutOfRange`] for a weight that is not
    /// finite and positive.
    pub fn weighted(inputs: Inputs, outcomes: Vec<bool>, weights: Vec<f64>) -> Result<Self> {
        same_size("outcomes, one per input", inputs.len(), outcomes.len())?;
        same_size("weights, one per input", inputs.len(), weights.len())?;
        for &weight in &weights {
            positive("event weight", weight)?;
        }
        Ok(Self { inputs, outcomes, weights })
    }

    /// Number of events N.
    pub fn len(&self) -> usize {
        self.outcomes.len()
    }

    /// Whether there are no events.
    pub fn is_empty(&self) -> bool {
        self.outcomes.is_empty()
    }

    /// Where the events happened, N×d.
    pub fn inputs(&self) -> &Inputs {
        &self.inputs
    }

    /// What happened, N.
    pub fn outcomes(&self) -> &[bool] {
        &self.outcomes
    }

    /// How much each event counts, N.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The events at `indices`, in that order.
    ///
    /// # Panics
    /// Beyond the last one.
    pub fn select(&self, indices: &[usize]) -> Self {
        Self {
            inputs: self.inputs.select(indices),
            outcomes: indices.iter().map(|&n| self.outcomes[n]).collect(),
            weights: indices.iter().map(|&n| self.weights[n]).collect(),
        }
    }

    /// κ_n = weight · (y_n − ½).
    pub(crate) fn kappa(&self) -> Vec<f64> {
        (0..self.len()).map(|n| self.kappa_of(n)).collect()
    }

    /// κ of one of them.
    pub(crate) fn kappa_of(&self, n: usize) -> f64 {
        let sign = if self.outcomes[n] { 0.5 } else { -0.5 };
        sign * self.weights[n]
    }
}
