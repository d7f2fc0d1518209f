//! Fits as bytes.

use dgpc::{FitOptions, Inputs, Observations, Prior, Summary};
use serde::{Deserialize, Serialize};

/// The end of an iteration.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct End {
    pub iterations: usize,
    pub change: f64,
    pub stop: String,
}

impl End {
    pub fn of(fit: &dgpc::Fit) -> Self {
        Self { iterations: fit.iterations(), change: fit.change(), stop: stop_name(fit.stop()).to_owned() }
    }
}

/// Returns the name of a reason why a fit ended.
pub fn stop_name(stop: dgpc::FitStop) -> &'static str {
    match stop {
        dgpc::FitStop::Converged => "converged",
        dgpc::FitStop::Stagnated => "stagnated",
        _ => "iterations_max",
    }
}

/// The parts of a fit, from which one iteration computes the fit again.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredFit {
    prior: Prior,
    inputs: Inputs,
    outcomes: Vec<bool>,
    weights: Vec<f64>,
    tilts: Vec<f64>,
    /// Without the inducing points of the messages.
    inducing_points: Option<Inputs>,
    pub messages: Vec<Summary>,
    pub end: End,
}

impl StoredFit {
    pub fn new(fit: &dgpc::Fit, messages: &[Summary], end: &End) -> Self {
        let of_messages: usize = messages.iter().map(Summary::len).sum();
        let own = |points: &Inputs| points.select(&(0..points.len() - of_messages).collect::<Vec<_>>());
        Self {
            prior: fit.prior().clone(),
            inputs: fit.sites().inputs().clone(),
            outcomes: fit.sites().kappa().iter().map(|&kappa| kappa > 0.0).collect(),
            weights: fit.weights().to_vec(),
            tilts: fit.tilts().to_vec(),
            inducing_points: fit.inducing_points().map(own),
            messages: messages.to_vec(),
            end: end.clone(),
        }
    }

    /// Returns the number of events or inducing points, with those of the messages.
    pub fn rows(&self) -> usize {
        let own = self.inducing_points.as_ref().map_or(self.inputs.len(), Inputs::len);
        own + self.messages.iter().map(Summary::len).sum::<usize>()
    }

    /// Computes the fit with one iteration from its tilts.
    pub fn fit(&self) -> dgpc::Result<dgpc::Fit> {
        let events = Observations::weighted(self.inputs.clone(), self.outcomes.clone(), self.weights.clone())?;
        let messages: Vec<&Summary> = self.messages.iter().collect();
        let mut options = FitOptions::default().messages(&messages).start(&self.tilts).iterations_max(1);
        options.inducing_points = self.inducing_points.as_ref();
        dgpc::fit(&self.prior, &events, &options)
    }
}
