//! What was learned, for programs.

use std::path::Path;

use pingmap_agent::{Fading, LearnedModel};
use schemars::JsonSchema;
use serde::Serialize;

use crate::model::{KernelJson, MadeOf, PriorMeanJson, counted};

/// Events added to a site prior.
#[derive(Serialize, JsonSchema)]
pub struct AddedJson<'a> {
    /// Version of this object.
    pub schema: u32,
    #[serde(flatten)]
    pub made_of: MadeOf,
    /// The model file with the site prior.
    pub file: &'a Path,
    /// Events of the log.
    pub events: usize,
    /// Number of inducing points of the site prior.
    pub site_points: usize,
}

/// What was learned, for programs.
#[derive(Serialize, JsonSchema)]
pub struct LearnJson<'a> {
    /// Version of this object.
    pub schema: u32,
    #[serde(flatten)]
    pub made_of: MadeOf,
    /// The model that was written.
    pub file: &'a Path,
    /// Events of the log.
    pub events: usize,
    /// Those that the model is learned from.
    pub training_events: usize,
    /// Those that it is only tried on.
    pub held_out_events: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// What decides between the candidates.
    pub criterion: String,
    /// All that were learned, the best first.
    pub candidates: Vec<CandidateJson>,
    /// The one that was written.
    pub model: ModelJson,
}

#[derive(Serialize, JsonSchema)]
pub struct CandidateJson {
    #[serde(flatten)]
    pub model: ModelJson,
    /// How long learning it took.
    pub seconds: f64,
    /// Mean negative log-likelihood of the events that were held out, in nats.
    pub held_out_nll: Option<f64>,
    /// How often evidence and gradient were computed.
    pub evaluations: usize,
    /// Why the search ended.
    pub stop: String,
    /// What all variances were multiplied by after the evidence was maximised, so that probabilities mean what they say.
    pub variance_factor: f64,
}

/// How alike outcomes at one place are that follow one another.
#[derive(Serialize, JsonSchema)]
pub struct FadingJson {
    /// Correlation of two outcomes at one place and time.
    correlation: f64,
    /// After how long it has fallen to 1/e.
    memory_s: f64,
    /// How fast what hides a place moves.
    drift_m_per_s: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct ModelJson {
    /// Its terms and prior mean, in words.
    structure: String,
    /// Lower bound on the log probability of all outcomes, at the optimum, in nats.
    evidence: f64,
    /// Mean log probability of an event given all others, in nats.
    leave_one_out: f64,
    /// How many events it was learned from.
    events_used: usize,
    /// What was learned about likeness.
    kernel: KernelJson,
    /// What is expected where nothing was heard.
    prior_mean: PriorMeanJson,
    /// As how many independent events those used count.
    events_counted: f64,
    /// How outcomes at one place are alike.
    fading: FadingJson,
}

impl ModelJson {
    pub fn of(fit: &LearnedModel) -> Self {
        let Fading { correlation, memory_s, drift_m_per_s } = fit.model.fading;
        Self {
            structure: fit.structure.to_string(),
            evidence: fit.evidence(),
            leave_one_out: fit.leave_one_out(),
            events_used: fit.events_used,
            kernel: KernelJson::of(&fit.model),
            prior_mean: PriorMeanJson::of(fit.model.prior.mean()),
            events_counted: counted(fit),
            fading: FadingJson { correlation, memory_s, drift_m_per_s },
        }
    }
}
