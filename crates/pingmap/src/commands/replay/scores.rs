//! The scores of a replay for programs.

use pingmap_trial::{Alternative, Bin, Calibrated, Calibration, Estimate, MeanScore, Replay, Sharing};
use schemars::JsonSchema;
use serde::Serialize;

/// How far probabilities mean what they say.
#[derive(Serialize, JsonSchema)]
pub struct CalibratedJson {
    /// Of every vehicle by itself.
    own: CalibrationJson,
    /// With what others sent.
    team: CalibrationJson,
    /// With all events in one place.
    centralised: CalibrationJson,
    /// Share of events at which the team is surer than all events would make it.
    team_surer_than_centralised: Option<f64>,
    /// The team's variance as a multiple of that with all events: the median.
    median_variance_ratio: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct CalibrationJson {
    /// Mean distance of a bin's mean probability from its share of heard events.
    expected_error: f64,
    /// How often the interval that is to hold half of the true log-odds does; where these are known.
    coverage_50: Option<f64>,
    /// The same of the interval for nine in ten.
    coverage_90: Option<f64>,
    /// Events by their probability, a tenth each.
    bins: Vec<BinJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct BinJson {
    /// Events whose probability lay within the tenth.
    events: usize,
    /// Their mean probability.
    predicted: Option<f64>,
    /// The share that was heard.
    heard: Option<f64>,
}

/// Scores of every vehicle learning by itself.
#[derive(Serialize, JsonSchema)]
pub struct OwnLearningJson {
    /// Without sharing, and with all events in one place.
    pub scores: OwnScoresJson,
    /// With so many frames from each vehicle.
    pub sharing: Vec<OwnSharingJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct OwnScoresJson {
    /// Every vehicle by itself.
    own: ScoreJson,
    /// All events in one place, under each vehicle's kernel.
    centralised: ScoreJson,
}

#[derive(Serialize, JsonSchema)]
pub struct OwnSharingJson {
    /// Frames of each vehicle.
    frames: usize,
    /// Mean over vehicles.
    team: ScoreJson,
    /// By how much every vehicle by itself is worse.
    better_than_own: DifferenceJson,
    /// By how much all events in one place are better.
    worse_than_centralised: DifferenceJson,
    /// The vehicle that does worst.
    worst_vehicle_nll: f64,
    /// (own − team) / (own − centralised); where that gap is not within its error.
    gap_closed: Option<f64>,
    /// Standard error of that.
    gap_closed_se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoresJson {
    /// The share of all that was heard, for every event.
    base_rate: ScoreJson,
    /// By the distance alone.
    distance_only: ScoreJson,
    /// Every vehicle by itself.
    own: ScoreJson,
    /// All events in one place.
    centralised: ScoreJson,
    /// Own less centralised.
    gap: DifferenceJson,
    /// The probabilities that a simulation drew from.
    true_probability: Option<ScoreJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoreJson {
    /// Share of events whose more probable outcome was right.
    acc: f64,
    /// Mean negative log-likelihood, in nats.
    nll: f64,
    /// Standard error of that over splits.
    nll_se: Option<f64>,
    /// Mean squared distance of probability and outcome.
    brier: f64,
    /// Standard error of that over splits.
    brier_se: Option<f64>,
    /// How much less probable it is to be heard from places chosen by these probabilities than from the best ones; where that is known.
    regret: Option<f64>,
    /// Standard error of that over splits.
    regret_se: Option<f64>,
}

/// A paired difference of NLL over splits.
#[derive(Serialize, JsonSchema)]
pub struct DifferenceJson {
    /// The mean, in nats.
    nll: f64,
    /// Standard error, corrected for splits that overlap.
    nll_se: Option<f64>,
    /// Whether it may as well be 0.
    indistinguishable: bool,
}

#[derive(Serialize, JsonSchema)]
pub struct SharingJson {
    #[serde(flatten)]
    team: OwnSharingJson,
    /// Inducing points in each frame.
    points_per_frame: Option<usize>,
    /// Map messages that a vehicle sent.
    packets_per_vehicle: f64,
    /// Reports that it sent.
    reports_per_vehicle: f64,
    /// Bytes of both.
    bytes_per_vehicle: f64,
    /// How many of all events of others a vehicle knows one by one.
    remote_event_share: f64,
    /// Other ways of filling as many bytes.
    alternatives: Vec<AlternativeJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct AlternativeJson {
    /// Which way.
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
        let alternative = |&(way, nll): &(Alternative, f64)| AlternativeJson { name: way.name(), nll };
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
