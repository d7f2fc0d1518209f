//! A replay for programs.

use pingmap_agent::{LearnedModel, VehicleId};
use pingmap_packet::Layout;
use pingmap_trial::{Ignored, Learners, Replay, SplitNll, SplitSummary, Water};
use schemars::JsonSchema;
use serde::Serialize;

use super::replayed::Replayed;
use super::scores::{CalibratedJson, OwnLearningJson, ScoresJson, SharingJson};
use crate::model::{KernelJson, MadeOf, PriorMeanJson, path_variance, stop_words};

/// Everything that was computed.
#[derive(Serialize, JsonSchema)]
pub struct ReplayJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    made_of: MadeOf,
    /// What metres mean; `unknown` where nobody said so.
    reference_system: String,
    /// Events of all logs together.
    events: usize,
    /// Those of them that were replayed.
    events_used: usize,
    /// How many vehicles there are.
    vehicles: usize,
    /// Their names.
    vehicle_ids: Vec<String>,
    /// How often the log was divided into training and held-out events.
    splits: usize,
    /// Seed of everything random.
    seed: u64,
    /// How posteriors were computed.
    inference: InferenceJson,
    /// What is sent, and what happens to it.
    packets: PacketsJson,
    /// Whether vehicles learned their kernels each for itself (`own`) or from all events (`pooled`).
    learn: &'static str,
    /// Whether the model was learned from these events: scores are too good then.
    model_has_seen_log: bool,
    /// The kernel of the first split, with numbers typical of all.
    kernel: Option<KernelJson>,
    /// The prior mean of the first split.
    prior_mean: Option<PriorMeanJson>,
    /// The same where every vehicle learned for itself.
    own_learning: Option<OwnLearningJson>,
    /// Without sharing, and with all events in one place.
    scores: ScoresJson,
    /// With so many frames from each vehicle.
    sharing: Vec<SharingJson>,
    /// How far probabilities mean what they say.
    calibration: Option<CalibratedJson>,
    /// Every division of the log.
    per_split: Vec<SplitJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct InferenceJson {
    /// Method for a vehicle's events.
    own: &'static str,
    /// Method for all events.
    centralised: &'static str,
    /// So many events are taken one by one.
    dense_events_max: usize,
    /// More are summed up by so many points at most.
    inducing_points_max: usize,
    /// What packets say: the change from what was known.
    summary: &'static str,
    /// How packets are fused.
    fusion: &'static str,
}

/// A member whose data, or a part of them, a vehicle does not use.
#[derive(Serialize, JsonSchema)]
pub struct IgnoredJson {
    /// The vehicle that decided.
    listener: String,
    /// The member.
    member: String,
    /// `contradicts`: its outcomes or summaries contradict those of all others. `out-of-slot`: its messages arrive outside its slots.
    /// `false-claims`: it was received in slots that it reported as unused. `wrong-track`: its reported track contradicts receptions.
    /// `ahead`: some of its frames are ahead of the vehicle's clock.
    reason: &'static str,
    /// Discrepancy of the member in standard deviations.
    discrepancy: Option<f64>,
}

impl IgnoredJson {
    fn of(ignored: &Ignored) -> Self {
        Self {
            listener: ignored.listener.to_string(),
            member: ignored.member.to_string(),
            reason: ignored.reason.name(),
            discrepancy: ignored.discrepancy,
        }
    }
}

/// What is sent, and what happens to it.
#[derive(Serialize, JsonSchema)]
pub struct PacketsJson {
    /// Name of the message in the `.proto`.
    message: Option<&'static str>,
    /// How long it is.
    bytes: Option<usize>,
    /// Whether it ends in a proof of who wrote it.
    authenticated: Option<bool>,
    /// Side of a cell of the team's chart.
    cell_m: Option<f64>,
    /// Share of packets that are lost.
    loss: f64,
    /// Share that arrive twice.
    duplicate: f64,
    /// Share that are overtaken.
    reorder: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct SplitJson {
    /// What divides it.
    name: String,
    /// Events that vehicles learned from.
    training_events: usize,
    /// Events that they were tried on.
    held_out_events: usize,
    /// Typical length-scale of the path term.
    length_scale_m: f64,
    /// Its variance.
    variance: f64,
    /// Terms and prior mean, in words.
    structure: Option<String>,
    /// The kernel that all was computed with.
    kernel: KernelJson,
    /// What is expected where nothing was heard.
    prior_mean: PriorMeanJson,
    /// Lower bound on the log probability of all outcomes, at the optimum, in nats.
    evidence: Option<f64>,
    /// Mean log probability of an event given all others, in nats.
    leave_one_out: Option<f64>,
    /// How many events the kernel was learned from.
    learning_events: Option<usize>,
    /// Why the search ended.
    stop: Option<String>,
    /// Members whose data vehicles do not use after the last number of frames.
    ignored: Vec<IgnoredJson>,
    /// Whether every posterior did.
    converged: bool,
    /// The most that was added to a kernel matrix's diagonal.
    jitter_max: f64,
    /// Mean negative log-likelihoods, in nats.
    nll: SplitNllJson,
}

#[derive(Serialize, JsonSchema)]
pub struct SplitNllJson {
    /// By the distance alone.
    distance_only: f64,
    /// Every vehicle by itself.
    own: f64,
    /// For each number of frames.
    team: Vec<f64>,
    /// All events in one place.
    centralised: f64,
}

impl ReplayJson {
    pub fn of(replayed: &Replayed) -> Self {
        let Replayed { log, splits, plan, replay, own_learning, whole, has_seen_log, .. } = replayed;
        let points = replayed.layout().map(Layout::points_in_all);
        Self {
            schema: 1,
            made_of: MadeOf::given(whole, &plan.agreed),
            reference_system: log.reference.to_string(),
            events: whole.events,
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
            authenticated: layout.map(|layout| layout.is_authenticated),
            cell_m: team.map(|team| team.grid.cell_m),
            loss,
            duplicate,
            reorder,
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
            ignored: split.ignored.iter().map(IgnoredJson::of).collect(),
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
