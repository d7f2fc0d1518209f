//! Scores of a reproduction in JSON.

use std::collections::BTreeMap;

use pingmap_trial::paper::statistics::mean_bound;
use pingmap_trial::paper::{Choice, LocalOutcome, Omega, SweepRow};
use pingmap_trial::{Estimate, MeanScore};
use schemars::JsonSchema;
use serde::Serialize;

use super::published::PublishedScore;
use super::results::BOUNDS;

#[derive(Serialize, JsonSchema)]
pub struct DifferencesJson {
    /// Difference of the mean negative log-likelihood.
    pub nll_difference: Option<f64>,
    /// Difference of the accuracy.
    pub acc_difference: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct DrawsJson {
    /// Mean over permutations.
    pub mean: f64,
    /// Smallest number over permutations.
    pub least: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct LocalScoreJson {
    /// Policy of the choice of points.
    policy: &'static str,
    /// Number of points.
    points: usize,
    /// Estimator of ω.
    omega: &'static str,
    /// Measured score.
    score: Option<ScoreJson>,
    /// Score in the paper.
    published: Option<PublishedJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct OmegaScoreJson {
    /// Estimator of ω.
    omega: &'static str,
    /// Measured score.
    score: Option<ScoreJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct CertificateJson {
    /// Policy of the choice of points.
    policy: &'static str,
    /// Number of points.
    points: usize,
    /// Mean of each bound, in nats.
    bounds: BTreeMap<&'static str, Option<EstimateJson>>,
}

#[derive(Serialize, JsonSchema)]
pub struct TeamScoreJson {
    /// Method of fusing the summaries.
    pub fusion: &'static str,
    #[serde(flatten)]
    pub score: LocalScoreJson,
}

#[derive(Serialize, JsonSchema)]
pub struct PointsJson {
    /// Number of points.
    pub points: usize,
    /// Mean negative log-likelihood, in nats.
    pub nll: EstimateJson,
}

#[derive(Serialize, JsonSchema)]
pub struct EstimateJson {
    /// Mean over permutations.
    mean: f64,
    /// Standard error of the mean.
    se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoreJson {
    /// Accuracy.
    acc: f64,
    /// Standard error of `acc`.
    acc_se: Option<f64>,
    /// Mean negative log-likelihood, in nats.
    nll: f64,
    /// Standard error of `nll`.
    nll_se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct PublishedJson {
    /// Accuracy.
    pub acc: f64,
    /// Mean negative log-likelihood, in nats.
    pub nll: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct SweepJson {
    /// Name of the data set.
    pub data_set: String,
    /// Results by radius.
    pub rows: Vec<SweepRowJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct SweepRowJson {
    /// Radius in length-scales.
    length_scales: f64,
    /// Training events in a region; the mean over agents and permutations.
    training_events: f64,
    /// Number of permutations that are not counted, because they leave a region empty.
    skipped: usize,
    /// NLL of all training events of the regions.
    all_events: Option<EstimateJson>,
    /// NLL of good points, by their number.
    good: Vec<PointsJson>,
    /// NLL of random points minus that of good points, by their number.
    random_minus_good: Vec<PointsJson>,
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

impl SweepRowJson {
    pub fn of(row: &SweepRow) -> Self {
        let by_points = |all: &BTreeMap<usize, Estimate>| {
            all.iter().map(|(&points, &nll)| PointsJson { points, nll: EstimateJson::of(nll) }).collect()
        };
        Self {
            length_scales: row.length_scales,
            training_events: row.events,
            skipped: row.skipped,
            all_events: row.all_events.map(EstimateJson::of),
            good: by_points(&row.good),
            random_minus_good: by_points(&row.gain),
        }
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
