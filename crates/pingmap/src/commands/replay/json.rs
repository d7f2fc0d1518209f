//! A replay for programs.

use pingmap_agent::{LearnedModel, VehicleId};
use pingmap_packet::Layout;
use pingmap_trial::{
    Bin, Calibrated, Calibration, Estimate, Learners, MeanScore, Replay, Sharing, SplitNll, SplitSummary, Water,
};
use schemars::JsonSchema;
use serde::Serialize;

use super::replayed::Replayed;
use crate::model::{KernelJson, MadeOf, PriorMeanJson, path_variance, stop_words};

/// Everything that was computed.
#[derive(Serialize, JsonSchema)]
pub struct ReplayJson {
    schema: u32,
    #[serde(flatten)]
    made_of: MadeOf,
    events: usize,
    events_used: usize,
    vehicles: usize,
    vehicle_ids: Vec<String>,
    splits: usize,
    seed: u64,
    inference: InferenceJson,
    packets: PacketsJson,
    learn: &'static str,
    model_has_seen_log: bool,
    kernel: Option<KernelJson>,
    prior_mean: Option<PriorMeanJson>,
    own_learning: Option<OwnLearningJson>,
    scores: ScoresJson,
    sharing: Vec<SharingJson>,
    calibration: Option<CalibratedJson>,
    per_split: Vec<SplitJson>,
}

/// How far probabilities mean what they say.
#[derive(Serialize, JsonSchema)]
pub struct CalibratedJson {
    own: CalibrationJson,
    team: CalibrationJson,
    centralised: CalibrationJson,
    team_surer_than_centralised: Option<f64>,
    median_variance_ratio: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct CalibrationJson {
    expected_error: f64,
    coverage_50: Option<f64>,
    coverage_90: Option<f64>,
    bins: Vec<BinJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct BinJson {
    events: usize,
    predicted: Option<f64>,
    heard: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct InferenceJson {
    own: &'static str,
    centralised: &'static str,
    dense_events_max: usize,
    inducing_points_max: usize,
    summary: &'static str,
    fusion: &'static str,
}

/// What is sent, and what happens to it.
#[derive(Serialize, JsonSchema)]
pub struct PacketsJson {
    message: Option<&'static str>,
    bytes: Option<usize>,
    sealed: Option<bool>,
    cell_m: Option<f64>,
    loss: f64,
    duplicate: f64,
    reorder: f64,
    repeats_max: Option<u8>,
}

/// Scores of every vehicle learning by itself.
#[derive(Serialize, JsonSchema)]
pub struct OwnLearningJson {
    scores: OwnScoresJson,
    sharing: Vec<OwnSharingJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct OwnScoresJson {
    own: ScoreJson,
    centralised: ScoreJson,
}

#[derive(Serialize, JsonSchema)]
pub struct OwnSharingJson {
    frames: usize,
    team: ScoreJson,
    better_than_own: DifferenceJson,
    worse_than_centralised: DifferenceJson,
    worst_vehicle_nll: f64,
    gap_closed: Option<f64>,
    gap_closed_se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoresJson {
    base_rate: ScoreJson,
    distance_only: ScoreJson,
    own: ScoreJson,
    centralised: ScoreJson,
    /// Own less centralised.
    gap: DifferenceJson,
    true_probability: Option<ScoreJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoreJson {
    acc: f64,
    nll: f64,
    nll_se: Option<f64>,
    brier: f64,
    brier_se: Option<f64>,
    regret: Option<f64>,
    regret_se: Option<f64>,
}

/// A paired difference of NLL over splits.
#[derive(Serialize, JsonSchema)]
pub struct DifferenceJson {
    nll: f64,
    nll_se: Option<f64>,
    indistinguishable: bool,
}

#[derive(Serialize, JsonSchema)]
pub struct SharingJson {
    #[serde(flatten)]
    team: OwnSharingJson,
    points_per_frame: Option<usize>,
    packets_per_vehicle: f64,
    reports_per_vehicle: f64,
    bytes_per_vehicle: f64,
    /// How many of all events of others a vehicle knows one by one.
    told_share: f64,
    alternatives: Vec<AlternativeJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct AlternativeJson {
    name: &'static str,
    nll: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct SplitJson {
    name: String,
    training_events: usize,
    held_out_events: usize,
    length_scale_m: f64,
    variance: f64,
    structure: Option<String>,
    kernel: KernelJson,
    prior_mean: PriorMeanJson,
    evidence: Option<f64>,
    leave_one_out: Option<f64>,
    learning_events: Option<usize>,
    stop: Option<String>,
    converged: bool,
    jitter_max: f64,
    nll: SplitNllJson,
}

#[derive(Serialize, JsonSchema)]
pub struct SplitNllJson {
    distance_only: f64,
    own: f64,
    /// For each number of frames.
    team: Vec<f64>,
    centralised: f64,
}

impl ReplayJson {
    pub fn of(replayed: &Replayed) -> Self {
        let Replayed { log, splits, plan, replay, own_learning, events, has_seen_log, .. } = replayed;
        let points = replayed.layout().map(Layout::points_in_all);
        Self {
            schema: 1,
            made_of: MadeOf::given(log, &plan.agreed),
            events: *events,
            events_used: log.events.len(),
            vehicles: replay.vehicles.len(),
            vehicle_ids: replay.vehicles.iter().map(VehicleId::to_string).collect(),
            splits: splits.len(),
            seed: plan.seed,
            inference: InferenceJson::of(replayed),
            packets: PacketsJson::of(replayed),
            learn: if plan.learners == Learners::Own { "own" } else { "pooled" },
            model_has_seen_log: *has_seen_log,
            kernel: kernel(replay),
            prior_mean: replay.splits.first().map(|split| PriorMeanJson::of(split.model().prior.mean())),
            own_learning: own_learning.as_ref().map(OwnLearningJson::of),
            scores: ScoresJson::of(replay),
            sharing: replay.sharing.iter().map(|sharing| SharingJson::of(sharing, points)).collect(),
            calibration: replay.calibration.as_ref().map(CalibratedJson::of),
            per_split: replay.splits.iter().map(SplitJson::of).collect(),
        }
    }
}

/// The kernel of the first split, with typical numbers.
fn kernel(replay: &Replay) -> Option<KernelJson> {
    let model = replay.splits.first()?.model();
    let inputs = if model.inputs.has_depths() { "positions and depths" } else { "positions" };
    let mut kernel = KernelJson::of(model);
    kernel.inputs = Some(inputs);
    kernel.length_scale_m = replay.median(|split| split.model().length_scale_m());
    kernel.variance = Some(replay.median(|split| path_variance(split.model())));
    Some(kernel)
}

impl InferenceJson {
    fn of(replayed: &Replayed) -> Self {
        let (own, centralised) = replayed.replay.dense();
        let method = |dense: bool| if dense { "dense mean field" } else { "sparse mean field" };
        let limits = &replayed.plan.limits;
        Self {
            own: method(own),
            centralised: method(centralised),
            dense_events_max: limits.dense_events_max,
            inducing_points_max: limits.inducing_points_max,
            summary: "residual",
            fusion: "sites",
        }
    }
}

impl PacketsJson {
    fn of(replayed: &Replayed) -> Self {
        let Water { loss, duplicate, reorder } = replayed.plan.water;
        let team = replayed.replay.splits.first().map(|split| &split.team);
        let layout = replayed.layout();
        Self {
            message: layout.map(|layout| layout.name),
            bytes: layout.map(|layout| layout.schema().length()),
            sealed: layout.map(|layout| layout.is_sealed),
            cell_m: team.map(|team| team.grid.cell_m),
            loss,
            duplicate,
            reorder,
            repeats_max: team.map(|team| team.repeats_max),
        }
    }
}

impl OwnLearningJson {
    fn of(own: &Replay) -> Self {
        Self {
            scores: OwnScoresJson { own: ScoreJson::of(&own.own), centralised: ScoreJson::of(&own.centralised) },
            sharing: own.sharing.iter().map(OwnSharingJson::of).collect(),
        }
    }
}

impl OwnSharingJson {
    fn of(sharing: &Sharing) -> Self {
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
    fn of(replay: &Replay) -> Self {
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
    fn of(score: &MeanScore) -> Self {
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
    fn of(difference: Estimate) -> Self {
        Self { nll: difference.mean, nll_se: difference.se, indistinguishable: !difference.is_clear() }
    }
}

impl SharingJson {
    fn of(sharing: &Sharing, points_per_frame: Option<usize>) -> Self {
        let alternative = |&(way, nll): &(pingmap_trial::Alternative, f64)| AlternativeJson { name: way.name(), nll };
        Self {
            team: OwnSharingJson::of(sharing),
            points_per_frame,
            packets_per_vehicle: sharing.traffic.packets,
            reports_per_vehicle: sharing.traffic.reports,
            bytes_per_vehicle: sharing.traffic.bytes,
            told_share: sharing.traffic.told_share,
            alternatives: sharing.alternatives.iter().map(alternative).collect(),
        }
    }
}

impl CalibratedJson {
    fn of(calibrated: &Calibrated) -> Self {
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
    fn of(calibration: &Calibration) -> Self {
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

impl SplitJson {
    fn of(split: &SplitSummary) -> Self {
        let fit = split.fit.as_ref();
        Self {
            name: split.name.clone(),
            training_events: split.training_events,
            held_out_events: split.held_out_events,
            length_scale_m: split.model().length_scale_m(),
            variance: path_variance(split.model()),
            structure: fit.map(|fit| fit.structure.to_string()),
            kernel: KernelJson::of(split.model()),
            prior_mean: PriorMeanJson::of(split.model().prior.mean()),
            evidence: fit.map(LearnedModel::evidence),
            leave_one_out: fit.map(LearnedModel::leave_one_out),
            learning_events: fit.map(|fit| fit.events_used),
            stop: fit.map(|fit| stop_words(&fit.learned.stop)),
            converged: split.converged,
            jitter_max: split.jitter_max,
            nll: SplitNllJson::of(&split.nll),
        }
    }
}

impl SplitNllJson {
    fn of(nll: &SplitNll) -> Self {
        let SplitNll { distance_only, own, ref team, centralised } = *nll;
        Self { distance_only, own, team: team.clone(), centralised }
    }
}
