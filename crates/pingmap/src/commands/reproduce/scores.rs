//! The scores of a reproduction for programs.

use std::collections::BTreeMap;

use pingmap_trial::paper::statistics::mean_bound;
use pingmap_trial::paper::{Choice, LocalOutcome, Omega};
use pingmap_trial::{Estimate, MeanScore};
use schemars::JsonSchema;
use serde::Serialize;

use super::published::PublishedScore;
use super::results::BOUNDS;

#[derive(Serialize, JsonSchema)]
pub struct DifferencesJson {
    /// In mean negative log-likelihood.
    pub nll_difference: Option<f64>,
    /// In accuracy.
    pub acc_difference: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct DrawsJson {
    /// Mean over permutations.
    pub mean: f64,
    /// The least of all.
    pub least: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct LocalScoreJson {
    /// How points were chosen.
    policy: &'static str,
    /// How many.
    points: usize,
    /// Which ω weighted them.
    omega: &'static str,
    /// What was found.
    score: Option<ScoreJson>,
    /// What the paper says.
    published: Option<PublishedJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct OmegaScoreJson {
    /// Which ω weighted the events.
    omega: &'static str,
    /// What was found.
    score: Option<ScoreJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct CertificateJson {
    /// How points were chosen.
    policy: &'static str,
    /// How many.
    points: usize,
    /// Each bound, in nats.
    bounds: BTreeMap<&'static str, Option<EstimateJson>>,
}

#[derive(Serialize, JsonSchema)]
pub struct TeamScoreJson {
    /// How summaries were fused.
    pub fusion: &'static str,
    #[serde(flatten)]
    pub score: LocalScoreJson,
}

#[derive(Serialize, JsonSchema)]
pub struct PointsJson {
    /// How many.
    pub points: usize,
    /// Mean negative log-likelihood, in nats.
    pub nll: EstimateJson,
}

#[derive(Serialize, JsonSchema)]
pub struct EstimateJson {
    /// The mean.
    mean: f64,
    /// Its standard error.
    se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoreJson {
    /// Accuracy.
    acc: f64,
    /// Its standard error.
    acc_se: Option<f64>,
    /// Mean negative log-likelihood, in nats.
    nll: f64,
    /// Its standard error.
    nll_se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct PublishedJson {
    /// Accuracy.
    pub acc: f64,
    /// Mean negative log-likelihood, in nats.
    pub nll: f64,
}

impl CertificateJson {
    pub fn of(choice: Choice, outcomes: &[&LocalOutcome]) -> Self {
        let bound = |(key, _, of): &(&'static str, &str, _)| (*key, mean_bound(outcomes, choice, *of));
        Self { policy: choice.policy.name(), points: choice.points, bounds: estimates(BOUNDS.iter().map(bound)) }
    }
}

impl LocalScoreJson {
    pub fn of(choice: Choice, omega: Omega, score: Option<MeanScore>, published: Option<PublishedScore>) -> Self {
        Self {
            policy: choice.policy.name(),
            points: choice.points,
            omega: omega.name(),
            score: score.map(ScoreJson::of),
            published: published.map(|PublishedScore { accuracy, nll }| PublishedJson { acc: accuracy, nll }),
        }
    }
}

impl EstimateJson {
    pub fn of(Estimate { mean, se, .. }: Estimate) -> Self {
        Self { mean, se }
    }
}

impl ScoreJson {
    pub fn of(MeanScore { accuracy, nll, .. }: MeanScore) -> Self {
        Self { acc: accuracy.mean, acc_se: accuracy.se, nll: nll.mean, nll_se: nll.se }
    }
}

pub fn by_omega(score: impl Fn(Omega) -> Option<MeanScore>) -> Vec<OmegaScoreJson> {
    let of = |omega: Omega| OmegaScoreJson { omega: omega.name(), score: score(omega).map(ScoreJson::of) };
    Omega::ALL.into_iter().map(of).collect()
}

pub fn estimates(
    all: impl Iterator<Item = (&'static str, Option<Estimate>)>,
) -> BTreeMap<&'static str, Option<EstimateJson>> {
    all.map(|(key, value)| (key, value.map(EstimateJson::of))).collect()
}
