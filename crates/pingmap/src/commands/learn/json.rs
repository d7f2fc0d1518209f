//! Learned models in JSON.

use std::path::Path;

use pingmap_agent::{Fading, LearnedModel};
use schemars::JsonSchema;
use serde::Serialize;

use crate::model::{InputDigests, KernelJson, PriorMeanJson, counted};

/// Events added to a site prior.
#[derive(Serialize, JsonSchema)]
pub struct AddedJson<'a> {
    /// Version of this object.
    pub schema: u32,
    #[serde(flatten)]
    pub digests: InputDigests,
    /// The model file with the site prior.
    pub file: &'a Path,
    /// Events of the log.
    pub events: usize,
    /// Number of inducing points of the site prior.
    pub site_points: usize,
}

/// Result of learning a model in JSON.
#[derive(Serialize, JsonSchema)]
pub struct LearnJson<'a> {
    /// Version of this object.
    pub schema: u32,
    #[serde(flatten)]
    pub digests: InputDigests,
    /// The model file that was written.
    pub file: &'a Path,
    /// Number of events of the log.
    pub events: usize,
    /// Number of events from which the model was learned.
    pub training_events: usize,
    /// Number of events that were held out.
    pub held_out_events: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// All candidates, that of the highest `comparable_leave_one_out` first.
    pub candidates: Vec<CandidateJson>,
    /// Rule by which a candidate was chosen, in words.
    pub rule: &'static str,
    /// The model that was written.
    pub model: ModelJson,
}

#[derive(Serialize, JsonSchema)]
pub struct CandidateJson {
    /// Whether this candidate was chosen.
    pub chosen: bool,
    #[serde(flatten)]
    pub model: ModelJson,
    /// Whether the term was rejected after a search on some of the events. All values of the model are then those of
    /// this search.
    pub screened: bool,
    /// Evidence in nats per event. For a screened candidate: the value before the term was tried, plus the change on
    /// the events of the search. These values are comparable.
    pub evidence_per_event: f64,
    /// Mean log probability of an event given all others, in nats. For a screened candidate as
    /// `evidence_per_event`.
    pub comparable_leave_one_out: f64,
    /// Duration of learning in seconds.
    pub seconds: f64,
    /// Mean negative log-likelihood of the held-out events, in nats.
    pub held_out_nll: Option<f64>,
    /// Number of evaluations of evidence and gradient.
    pub evaluations: usize,
    /// Reason for the end of the search.
    pub stop: String,
    /// Factor by which all variances were multiplied after the evidence was maximised. The factor calibrates the
    /// probabilities.
    pub variance_factor: f64,
}

/// Correlation of successive outcomes at one position.
#[derive(Serialize, JsonSchema)]
pub struct FadingJson {
    /// Correlation of two outcomes at equal positions and times.
    correlation: f64,
    /// Time in seconds after which the correlation falls to 1/e.
    memory_s: f64,
    /// Speed of both ends together at which the correlation falls to 1/e, in metres per second.
    drift_m_per_s: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct ModelJson {
    /// Terms and prior mean as text.
    structure: String,
    /// Lower bound on the log probability of all outcomes at the optimum, in nats.
    evidence: f64,
    /// Mean log probability of an event given all others, in nats.
    leave_one_out: f64,
    /// Number of events from which the model was learned.
    events_used: usize,
    /// The learned kernel.
    kernel: KernelJson,
    /// The learned prior mean.
    prior_mean: PriorMeanJson,
    /// Effective number of independent events.
    events_counted: f64,
    /// Correlation of successive outcomes at one position.
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
