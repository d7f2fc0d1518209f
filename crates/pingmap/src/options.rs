//! Options that several commands share.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Args;
use dgpc::Shape;
use pingmap_agent::{
    Fading, Kind, Learning, Limits, Link, LinkQuery, MeanStructure, MessageKind, OptionalTerm, Structure,
    StructureConstraints, Time, Vehicle, VehicleId,
};
use pingmap_trial::EventLog;

use crate::log::{LOG_AND_MODEL, Logs};
use crate::names::*;
use crate::output::BadInput;
use crate::reference::ReferenceOptions;
use crate::values::*;

/// What options are listed under that say where results go, whatever stands around them.
pub const RESULT: &str = "Result";

/// What a map is learned from, and how.
#[derive(Args)]
pub struct Source {
    #[command(flatten)]
    pub logs: Logs,
    /// Learn from this vehicle's events only
    #[arg(help_heading = LOG_AND_MODEL, long)]
    pub vehicle: Option<String>,
    #[command(flatten)]
    pub reference: ReferenceOptions,
    #[command(flatten)]
    pub model: ModelSource,
    #[command(flatten)]
    pub work: Work,
}

impl Source {
    /// All files that are read.
    pub fn inputs(&self) -> Vec<&Path> {
        self.logs.paths().into_iter().chain(self.model.model.as_deref()).collect()
    }
}

/// What links are read with: a model file, or what is learned.
#[derive(Args)]
pub struct ModelSource {
    /// Model file, as `pingmap learn` writes it; learned from the events if not given
    #[arg(help_heading = LOG_AND_MODEL, long, value_name = "FILE", conflicts_with = "Kernel")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub kernel: Kernel,
}

/// Kernel and prior mean, as far as they are given. What is not given is learned.
#[derive(Args)]
#[command(next_help_heading = "Model, where no file is given")]
#[group(id = "Kernel", multiple = true)]
pub struct Kernel {
    /// How covariance falls with distance
    #[arg(long = "kernel", value_parser = ShapeParser)]
    pub shape: Option<Shape>,
    /// What the path term measures distance over
    #[arg(long, value_enum)]
    pub inputs: Option<InputsName>,
    /// Whether the two directions of a path behave alike
    #[arg(long, value_enum, value_name = "YES|NO")]
    pub reciprocal: Option<YesNo>,
    /// What the log-odds are a sum of
    #[arg(long, value_enum)]
    pub terms: Option<TermsName>,
    /// What may be added to that if the events ask for it, in the order in which it is tried; all if not given
    #[arg(long, value_enum, value_delimiter = ',', num_args = 1..)]
    pub additions: Option<Vec<AdditionName>>,
    /// What is expected before the first event; odds that fall with range if not given
    #[arg(long, value_enum, conflicts_with = "conservative_range_m")]
    pub prior_mean: Option<MeanName>,
    /// The range that is trusted before the first event: even odds there, falling with range; learning starts from it
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub conservative_range_m: Option<f64>,
    /// Log-odds that such a prior loses per kilometre; four over the conservative range if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true, requires = "conservative_range_m")]
    pub conservative_slope_per_km: Option<f64>,
    /// Fix every length-scale
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub length_scale_m: Option<f64>,
    /// Fix the variance of every term
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub variance: Option<f64>,
    /// Fix how alike outcomes at one place are that follow one another: correlation, seconds over which it fades,
    /// metres a second below which vehicles lie still; or `none`. Learned where vehicles lay still, if not given
    #[arg(long, value_parser = fading, value_name = "C,S,M_PER_S")]
    pub fading: Option<Fading>,
    /// What decides among kernels and prior means
    #[arg(long, value_enum, default_value_t = CriterionName::LeaveOneOut)]
    pub criterion: CriterionName,
    /// Learn kernel and prior mean from at most so many events, spread evenly over the log
    #[arg(long, default_value_t = Learning::default().events_max, value_parser = events)]
    pub learn_events_max: usize,
}

impl Kernel {
    /// The parts that are given.
    pub fn given(&self) -> StructureConstraints {
        let conservative = self.conservative_range_m.map(|range_m| {
            MeanStructure::conservative(range_m, self.conservative_slope_per_km.map(|slope| slope / 1000.0))
        });
        StructureConstraints {
            shape: self.shape,
            path_inputs: self.inputs.map(InputsName::inputs),
            reciprocal: self.reciprocal.map(|reciprocal| reciprocal == YesNo::Yes),
            terms: self.terms.map(TermsName::terms),
            mean: conservative.or(self.prior_mean.map(MeanName::mean)),
        }
    }

    /// What may be added. Who says what the terms over places are has said so of all of them.
    fn additions(&self) -> Vec<OptionalTerm> {
        match &self.additions {
            Some(names) => names.iter().filter_map(|name| name.addition()).collect(),
            None => {
                let all = OptionalTerm::ALL.into_iter();
                all.filter(|addition| self.terms.is_none() || !addition.is_common()).collect()
            }
        }
    }

    /// Learning with these structures to choose from.
    pub fn learning(&self, structures: Vec<Structure>, limits: Limits) -> Learning {
        let Self { length_scale_m, variance, fading, learn_events_max: events_max, .. } = *self;
        let additions = self.additions();
        let criterion = self.criterion.criterion();
        Learning { structures, additions, criterion, length_scale_m, variance, fading, events_max, limits }
    }
}

/// Bounds on work, and the seed.
#[derive(Args)]
#[command(next_help_heading = "Work")]
pub struct Work {
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Use at most so many events, drawn at random; vehicles with few keep theirs
    #[arg(long, default_value_t = 100_000, value_parser = events)]
    pub events_max: usize,
    /// Fit exactly up to so many events, and with inducing points beyond
    #[arg(long, default_value_t = Limits::default().dense_events_max, value_parser = dense_events)]
    pub dense_events_max: usize,
    /// Inducing points of a fit that is not exact
    #[arg(long, default_value_t = Limits::default().inducing_points_max, value_parser = inducing_points)]
    pub inducing_points_max: usize,
    /// Worker threads; 0 takes one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
}

impl Work {
    /// The bounds of one vehicle.
    pub fn limits(&self) -> Limits {
        let Self { events_max, dense_events_max, inducing_points_max, .. } = *self;
        Limits { events_max, dense_events_max, inducing_points_max, ..Limits::default() }
    }
}

/// Who and when is asked about, where the model tells vehicles or times apart.
#[derive(Args)]
#[command(next_help_heading = "Who and when")]
pub struct Asked {
    /// Who transmits: a vehicle of the log, a typical one, or a new one that may be any
    #[arg(long, value_name = "NAME|typical|new", default_value = TYPICAL)]
    pub transmitter: String,
    /// Who receives, likewise
    #[arg(long, value_name = "NAME|typical|new", default_value = TYPICAL)]
    pub receiver: String,
    /// When: the end of the log, a typical time, another day that may be any, or a time of the log in seconds
    #[arg(long, value_name = "end|typical|another-day|SECONDS", default_value = "end", value_parser = Moment::parse, allow_negative_numbers = true)]
    pub time: Moment,
    /// What kind of message: one of the log, or a typical one
    #[arg(long, value_name = "NAME|typical", default_value = TYPICAL)]
    pub kind: String,
    /// Do not cap predictions beyond the longest observed range (by default they never exceed the prediction at that range)
    #[arg(long)]
    pub no_range_cap: bool,
}

/// The name of nobody in particular.
const TYPICAL: &str = "typical";

impl Asked {
    /// The attempt over this link that is asked about.
    pub fn attempt(&self, log: &EventLog) -> Result<impl Fn(Link) -> LinkQuery + use<>, BadInput> {
        let (transmitter, receiver) =
            (party("--transmitter", &self.transmitter, log)?, party("--receiver", &self.receiver, log)?);
        let end_s = log.events.iter().map(|event| event.time_s).fold(f64::NEG_INFINITY, f64::max);
        let when = match self.time {
            Moment::End => Time::At(end_s),
            Moment::Typical => Time::Typical,
            Moment::AnotherDay => Time::AnotherDay,
            Moment::At(time_s) => Time::At(time_s),
        };
        let kind = kind(&self.kind, log)?;
        Ok(move |link| LinkQuery { link, transmitter, receiver, when, kind })
    }
}

/// The kind of message that the option names.
fn kind(name: &str, log: &EventLog) -> Result<Kind, BadInput> {
    let known: BTreeSet<&str> =
        log.events.iter().filter_map(|event| event.kind.as_ref()).map(|kind| kind.as_str()).collect();
    match name {
        name if known.contains(name) => Ok((&MessageKind::new(name)).into()),
        TYPICAL => Ok(Kind::Typical),
        _ if known.is_empty() => Err(BadInput(format!("--kind {name}: the log has no column kind; expected typical"))),
        _ => {
            let known: Vec<&str> = known.into_iter().collect();
            Err(BadInput(format!("--kind {name}: expected {} or typical", known.join(", "))))
        }
    }
}

/// The party that an option names.
fn party(option: &str, name: &str, log: &EventLog) -> Result<Vehicle, BadInput> {
    let mut known: Vec<&VehicleId> =
        log.events.iter().flat_map(|event| [&event.transmitter_id, &event.receiver_id]).collect();
    known.sort();
    known.dedup();
    match known.iter().find(|known| known.as_str() == name) {
        Some(known) => Ok((*known).into()),
        None if name == TYPICAL => Ok(Vehicle::Typical),
        None if name == "new" => Ok(Vehicle::New),
        None => {
            let known: Vec<&str> = known.iter().map(|known| known.as_str()).collect();
            Err(BadInput(format!("{option} {name}: expected {}, typical or new", known.join(", "))))
        }
    }
}
