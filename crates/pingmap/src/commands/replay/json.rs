//! A replay in JSON.

use pingmap_agent::{LearnedModel, VehicleId};
use pingmap_packet::Layout;
use pingmap_trial::{ChannelImpairments, Ignored, ModelSource, Replay, SplitNll, SplitSummary};
use schemars::JsonSchema;
use serde::Serialize;

use super::replayed::Replayed;
use super::scores::{CalibratedJson, OwnLearningJson, ScoresJson, SharingJson};
use crate::model::{InputDigests, KernelJson, PriorMeanJson, path_variance, stop_words};

/// Result of a replay in JSON.
#[derive(Serialize, JsonSchema)]
pub struct ReplayJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Reference system of the metres; `unknown` if the log does not name it.
    reference_system: String,
    /// Number of events of all logs together.
    events: usize,
    /// Number of these events that were replayed.
    events_used: usize,
    /// Number of vehicles.
    vehicles: usize,
    /// Names of the vehicles.
    vehicle_ids: Vec<String>,
    /// Number of divisions of the log into training and held-out events.
    splits: usize,
    /// Seed of all random numbers.
    seed: u64,
    /// Methods of inference.
    inference: InferenceJson,
    /// Layout of the packets, and the impairments of the channel.
    packets: PacketsJson,
    /// `own` if every vehicle learned its own model, `pooled` if one model was learned from all training events.
    learn: &'static str,
    /// Whether the model was learned from these events. The scores are then too good.
    model_has_seen_log: bool,
    /// The kernel of the first split, with median length-scale and variance over the splits.
    kernel: Option<KernelJson>,
    /// The prior mean of the first split.
    prior_mean: Option<PriorMeanJson>,
    /// Scores if every vehicle learns its own model.
    own_learning: Option<OwnLearningJson>,
    /// Scores without sharing, and with all events in one place.
    scores: ScoresJson,
    /// Scores after each number of frames per vehicle.
    sharing: Vec<SharingJson>,
    /// Calibration of the probabilities.
    calibration: Option<CalibratedJson>,
    /// Results of each split.
    per_split: Vec<SplitJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct InferenceJson {
    /// Method for a vehicle's own events.
    own: &'static str,
    /// Method for all events together.
    centralised: &'static str,
    /// Largest number of events of a dense fit.
    dense_events_max: usize,
    /// Largest number of inducing points of a sparse fit.
    inducing_points_max: usize,
    /// Content of the summaries: the change from the prior.
    summary: &'static str,
    /// Method of fusing summaries.
    fusion: &'static str,
}

/// A member whose data a vehicle excludes, at least in part.
#[derive(Serialize, JsonSchema)]
pub struct IgnoredJson {
    /// The vehicle that excludes the data.
    listener: String,
    /// The member whose data are excluded.
    member: String,
    /// `contradicts`: its outcomes or summaries contradict those of all others. `out-of-slot`: its messages arrive
    /// outside its slots. `false-claims`: it was received in slots that it reported as unused. `wrong-track`: its
    /// reported track contradicts receptions. `ahead`: some of its frames are ahead of the vehicle's clock.
    reason: &'static str,
    /// Time of the vehicle's clock since when, in seconds.
    since_s: f64,
    /// Discrepancy of the member in standard deviations.
    discrepancy: Option<f64>,
}

impl IgnoredJson {
    fn of(ignored: &Ignored) -> Self {
        Self {
            listener: ignored.listener.to_string(),
            member: ignored.member.to_string(),
            reason: ignored.reason.name(),
            since_s: ignored.since_s,
            discrepancy: ignored.discrepancy,
        }
    }
}

/// Layout of the packets, and the impairments of the channel.
#[derive(Serialize, JsonSchema)]
pub struct PacketsJson {
    /// Name of the message in the `.proto`.
    message: Option<&'static str>,
    /// Length of the message in bytes.
    bytes: Option<usize>,
    /// Whether the message ends with an authentication tag.
    authenticated: Option<bool>,
    /// Side of a cell of the team's grid in metres.
    cell_m: Option<f64>,
    /// Share of packets that are lost.
    loss: f64,
    /// Share of packets that arrive twice.
    duplicate: f64,
    /// Share of packets that arrive after a later one.
    reorder: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct SplitJson {
    /// Name of the split.
    name: String,
    /// Number of training events.
    training_events: usize,
    /// Number of held-out events.
    held_out_events: usize,
    /// Typical length-scale of the path term in metres.
    length_scale_m: f64,
    /// Variance of the path term.
    variance: f64,
    /// Terms and prior mean as text.
    structure: Option<String>,
    /// Kernel of the model.
    kernel: KernelJson,
    /// Prior mean of the model.
    prior_mean: PriorMeanJson,
    /// Lower bound on the log probability of all outcomes at the optimum, in nats.
    evidence: Option<f64>,
    /// Mean log probability of an event given all others, in nats.
    leave_one_out: Option<f64>,
    /// Number of events from which the kernel was learned.
    learning_events: Option<usize>,
    /// Reason for the end of the search.
    stop: Option<String>,
    /// Members whose data vehicles exclude after the last number of frames.
    ignored: Vec<IgnoredJson>,
    /// Whether every fit converged.
    converged: bool,
    /// Largest number that was added to the diagonal of a kernel matrix.
    jitter_max: f64,
    /// Mean negative log-likelihoods of the held-out events, in nats.
    nll: SplitNllJson,
}

#[derive(Serialize, JsonSchema)]
pub struct SplitNllJson {
    /// Logistic regression on the distance.
    distance_only: f64,
    /// Each vehicle with its own events only.
    own: f64,
    /// The team, for each number of frames.
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
            digests: InputDigests::given(whole, &plan.preshared),
            reference_system: log.reference.to_string(),
            events: whole.events,
            events_used: log.events.len(),
            vehicles: replay.vehicles.len(),
            vehicle_ids: replay.vehicles.iter().map(VehicleId::to_string).collect(),
            splits: splits.len(),
            seed: plan.seed,
            inference: InferenceJson::of(replayed),
            packets: PacketsJson::of(replayed),
            learn: if plan.model_source == ModelSource::Own { "own" } else { "pooled" },
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

/// Returns the kernel of the first split, with median length-scale and variance.
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
        let ChannelImpairments { loss, duplicate, reorder } = replayed.plan.impairments;
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
