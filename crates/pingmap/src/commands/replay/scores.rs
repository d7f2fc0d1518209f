//! Scores of a replay in JSON.

use pingmap_trial::{Alternative, Bin, Calibrated, Calibration, Estimate, MeanScore, Replay, Sharing};
use schemars::JsonSchema;
use serde::Serialize;

/// Calibration of the probabilities.
#[derive(Serialize, JsonSchema)]
pub struct CalibratedJson {
    /// Each vehicle with its own events only.
    own: CalibrationJson,
    /// The team, with received packets.
    team: CalibrationJson,
    /// All events in one place.
    centralised: CalibrationJson,
    /// Share of held-out events at which the team has a smaller variance than a vehicle with all events.
    team_surer_than_centralised: Option<f64>,
    /// Median ratio of the team's variance to the variance with all events.
    median_variance_ratio: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct CalibrationJson {
    /// Mean difference between predicted probability and share of heard events, weighted over the bins.
    expected_error: f64,
    /// Coverage of the 50 % intervals of the log-odds, if the true probabilities are known.
    coverage_50: Option<f64>,
    /// Coverage of the 90 % intervals of the log-odds, if the true probabilities are known.
    coverage_90: Option<f64>,
    /// Held-out events in ten bins of their predicted probability.
    bins: Vec<BinJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct BinJson {
    /// Number of events in the bin.
    events: usize,
    /// Mean predicted probability.
    predicted: Option<f64>,
    /// Share of the events that were heard.
    heard: Option<f64>,
}

/// Scores if every vehicle learns its own model.
#[derive(Serialize, JsonSchema)]
pub struct OwnLearningJson {
    /// Scores without sharing, and with all events in one place.
    pub scores: OwnScoresJson,
    /// Scores after each number of frames per vehicle.
    pub sharing: Vec<OwnSharingJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct OwnScoresJson {
    /// Each vehicle with its own events only.
    own: ScoreJson,
    /// All events in one place, under each vehicle's model.
    centralised: ScoreJson,
}

#[derive(Serialize, JsonSchema)]
pub struct OwnSharingJson {
    /// Number of frames of each vehicle.
    frames: usize,
    /// Mean score over the vehicles.
    team: ScoreJson,
    /// NLL of each vehicle alone minus that of the team.
    better_than_own: DifferenceJson,
    /// NLL of the team minus that of all events in one place.
    worse_than_centralised: DifferenceJson,
    /// NLL of the vehicle with the worst score.
    worst_vehicle_nll: f64,
    /// (own − team) / (own − centralised), if that gap is significant.
    gap_closed: Option<f64>,
    /// Standard error of `gap_closed`.
    gap_closed_se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoresJson {
    /// The share of heard training events as the probability of every event.
    base_rate: ScoreJson,
    /// Logistic regression on the distance.
    distance_only: ScoreJson,
    /// Each vehicle with its own events only.
    own: ScoreJson,
    /// All events in one place.
    centralised: ScoreJson,
    /// NLL of own events minus that of all events in one place.
    gap: DifferenceJson,
    /// The true probabilities of a simulation.
    true_probability: Option<ScoreJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoreJson {
    /// Share of events whose more probable outcome occurred.
    acc: f64,
    /// Mean negative log-likelihood, in nats.
    nll: f64,
    /// Standard error of `nll` over splits.
    nll_se: Option<f64>,
    /// Mean squared difference between probability and outcome.
    brier: f64,
    /// Standard error of `brier` over splits.
    brier_se: Option<f64>,
    /// Difference in true probability between the best positions and those chosen by the predictions, if the true
    /// probabilities are known.
    regret: Option<f64>,
    /// Standard error of `regret` over splits.
    regret_se: Option<f64>,
}

/// A paired difference of NLL over splits.
#[derive(Serialize, JsonSchema)]
pub struct DifferenceJson {
    /// Mean difference in nats.
    nll: f64,
    /// Standard error, corrected for overlapping splits.
    nll_se: Option<f64>,
    /// Whether the difference is not significantly different from 0.
    indistinguishable: bool,
}

#[derive(Serialize, JsonSchema)]
pub struct SharingJson {
    #[serde(flatten)]
    team: OwnSharingJson,
    /// Number of inducing points in each frame.
    points_per_frame: Option<usize>,
    /// Mean number of map messages that a vehicle sent.
    packets_per_vehicle: f64,
    /// Mean number of reports that a vehicle sent.
    reports_per_vehicle: f64,
    /// Mean number of bytes of both.
    bytes_per_vehicle: f64,
    /// Share of the other vehicles' events that a vehicle received one by one.
    remote_event_share: f64,
    /// Other uses of the same number of bytes.
    alternatives: Vec<AlternativeJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct AlternativeJson {
    /// Name of the alternative.
    name: &'static str,
    /// Mean negative log-likelihood, in nats.
    nll: f64,
}

impl OwnLearningJson {
    pub fn of(own: &Replay) -> Self {
        Self {
            scores: OwnScoresJson { own: ScoreJson::of(&own.own), centralised: ScoreJson::of(&own.centralised) },
            sharing: own.sharing.iter().map(OwnSharingJson::of).collect(),
        }
    }
}

impl OwnSharingJson {
    pub fn of(sharing: &Sharing) -> Self {
        let Sharing { frames, worst_vehicle_nll, gap_closed, ref team, .. } = *sharing;
        Self {
            frames,
            team: ScoreJson::of(team),
            better_than_own: DifferenceJson::of(sharing.gain),
            worse_than_centralised: DifferenceJson::of(sharing.behind),
            worst_vehicle_nll,
            gap_closed: gap_closed.map(|gap| gap.mean),
            gap_closed_se: gap_closed.and_then(|gap| gap.se),
        }
    }
}

impl ScoresJson {
    pub fn of(replay: &Replay) -> Self {
        Self {
            base_rate: ScoreJson::of(&replay.base_rate),
            distance_only: ScoreJson::of(&replay.distance_only),
            own: ScoreJson::of(&replay.own),
            centralised: ScoreJson::of(&replay.centralised),
            gap: DifferenceJson::of(replay.gap),
            true_probability: replay.true_probability.as_ref().map(ScoreJson::of),
        }
    }
}

impl ScoreJson {
    pub fn of(score: &MeanScore) -> Self {
        Self {
            acc: score.accuracy.mean,
            nll: score.nll.mean,
            nll_se: score.nll.se,
            brier: score.brier.mean,
            brier_se: score.brier.se,
            regret: score.regret.map(|regret| regret.mean),
            regret_se: score.regret.and_then(|regret| regret.se),
        }
    }
}

impl DifferenceJson {
    pub fn of(difference: Estimate) -> Self {
        Self { nll: difference.mean, nll_se: difference.se, indistinguishable: !difference.is_clear() }
    }
}

impl SharingJson {
    pub fn of(sharing: &Sharing, points_per_frame: Option<usize>) -> Self {
        let alternative =
            |(way, score): &(Alternative, MeanScore)| AlternativeJson { name: way.name(), nll: score.nll.mean };
        Self {
            team: OwnSharingJson::of(sharing),
            points_per_frame,
            packets_per_vehicle: sharing.traffic.packets,
            reports_per_vehicle: sharing.traffic.reports,
            bytes_per_vehicle: sharing.traffic.bytes,
            remote_event_share: sharing.traffic.remote_event_share,
            alternatives: sharing.alternatives.iter().map(alternative).collect(),
        }
    }
}

impl CalibratedJson {
    pub fn of(calibrated: &Calibrated) -> Self {
        Self {
            own: CalibrationJson::of(&calibrated.own),
            team: CalibrationJson::of(&calibrated.team),
            centralised: CalibrationJson::of(&calibrated.centralised),
            team_surer_than_centralised: calibrated.surer(),
            median_variance_ratio: calibrated.median_variance_ratio(),
        }
    }
}

impl CalibrationJson {
    pub fn of(calibration: &Calibration) -> Self {
        let bin = |bin: &Bin| BinJson { events: bin.events, predicted: bin.predicted(), heard: bin.heard() };
        let [coverage_50, coverage_90] = calibration.coverage().map_or([None; 2], |shares| shares.map(Some));
        Self {
            expected_error: calibration.expected_error(),
            coverage_50,
            coverage_90,
            bins: calibration.bins.iter().map(bin).collect(),
        }
    }
}
