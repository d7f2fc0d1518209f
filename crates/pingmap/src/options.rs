//! Options that several commands share.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Args;
use dgpc::Shape;
use pingmap_agent::{
    Fading, Kind, Learning, Limits, Link, LinkQuery, MeanStructure, MessageKind, OptionalTerm, Structure, Time,
    Vehicle, VehicleId,
};
use pingmap_trial::EventLog;

use crate::cli_enums::*;
use crate::cli_parsers::*;
use crate::log::{LOG_AND_MODEL, Logs};
use crate::output::BadInput;
pub use crate::output_target::RESULT;
use crate::reference::ReferenceOptions;

/// Options that select the data and the model of a map.
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
    pub model: ModelFileOption,
    #[command(flatten)]
    pub work: Work,
}

impl Source {
    /// Returns the paths of all input files.
    pub fn inputs(&self) -> Vec<&Path> {
        self.logs.paths().into_iter().chain(self.model.path()).collect()
    }
}

/// A model file.
#[derive(Args)]
pub struct ModelFileOption {
    /// Model file of `pingmap learn`; if not given, a model is learned from the log
    #[arg(help_heading = LOG_AND_MODEL, long, value_name = "FILE")]
    model: Option<PathBuf>,
}

impl ModelFileOption {
    /// Returns the path of the model file, if given.
    pub fn path(&self) -> Option<&Path> {
        self.model.as_deref()
    }
}

/// Kernel and prior mean of a model that is learned. Options that are not given are learned.
#[derive(Args)]
#[command(next_help_heading = "Model options")]
#[group(id = "ModelOptions", multiple = true)]
pub struct ModelOptions {
    /// Shape of the covariance over distance
    #[arg(long = "kernel", value_parser = ShapeParser)]
    pub shape: Option<Shape>,
    /// Inputs of the path term
    #[arg(long, value_enum)]
    pub inputs: Option<InputsName>,
    /// Fix the two directions of a path as equal (yes) or independent (no); if not given, they are equal unless the
    /// events contradict that
    #[arg(long, value_enum, value_name = "YES|NO")]
    pub reciprocal: Option<YesNo>,
    /// Terms whose sum is the log-odds
    #[arg(long, value_enum)]
    pub terms: Option<TermsName>,
    /// Terms that may be added if the events support them, in the order in which they are tried; all if not given
    #[arg(long, value_enum, value_delimiter = ',', num_args = 1..)]
    pub additions: Option<Vec<AdditionName>>,
    /// Prior mean of the log-odds before the first event; it falls with range if not given
    #[arg(long, value_enum, conflicts_with = "conservative_range_m")]
    pub prior_mean: Option<MeanName>,
    /// Range with even odds before the first event; odds fall with range, and learning starts from this prior mean
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub conservative_range_m: Option<f64>,
    /// Decrease of that prior mean in log-odds per kilometre; four over the conservative range if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true, requires = "conservative_range_m")]
    pub conservative_slope_per_km: Option<f64>,
    /// Fix the horizontal length-scale of every term; those of depths, aspects and times then keep their values before
    /// learning
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub length_scale_m: Option<f64>,
    /// Fix the variance of every term
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub variance: Option<f64>,
    /// Fix the correlation of successive outcomes at one position: correlation, its time constant in seconds, and the
    /// speed in metres a second below which vehicles count as stationary; or `none`. Learned from stationary vehicles
    /// if not given
    #[arg(long, value_parser = fading, value_name = "C,S,M_PER_S")]
    pub fading: Option<Fading>,
    /// Largest number of events from which kernel and prior mean are learned, spread evenly over the log
    #[arg(long, default_value_t = Learning::default().events_max, value_parser = events)]
    pub learn_events_max: usize,
}

impl ModelOptions {
    /// Returns the structure with which learning starts. Options replace parts of the default.
    fn structure(&self) -> Structure {
        let conservative = self.conservative_range_m.map(|range_m| {
            MeanStructure::conservative(range_m, self.conservative_slope_per_km.map(|slope| slope / 1000.0))
        });
        let default = Structure::default();
        Structure {
            shape: self.shape.unwrap_or(default.shape),
            path_inputs: self.inputs.map_or(default.path_inputs, InputsName::inputs),
            reciprocal: self.reciprocal.map_or(default.reciprocal, |reciprocal| reciprocal == YesNo::Yes),
            terms: self.terms.map_or(default.terms, TermsName::terms),
            mean: conservative.or(self.prior_mean.map(MeanName::mean)).unwrap_or(default.mean),
            additions: default.additions,
        }
    }

    /// Returns the terms that may be added. If `--terms` is given, it decides about the common terms, so they are left
    /// out. If `--reciprocal` is given, it decides about the two directions of a path.
    fn additions(&self) -> Vec<OptionalTerm> {
        match &self.additions {
            Some(names) => names.iter().filter_map(|name| name.addition()).collect(),
            None => {
                let all = OptionalTerm::ALL.into_iter();
                let all = all.filter(|addition| self.terms.is_none() || !addition.is_common());
                all.filter(|addition| self.reciprocal.is_none() || *addition != OptionalTerm::OneWay).collect()
            }
        }
    }

    /// Returns the settings of learning.
    pub fn learning(&self, limits: Limits) -> Learning {
        let Self { length_scale_m, variance, fading, learn_events_max: events_max, .. } = *self;
        let (structure, additions) = (self.structure(), self.additions());
        Learning { structure, additions, length_scale_m, variance, fading, events_max, limits }
    }
}

/// Limits of the work, and the seed.
#[derive(Args)]
#[command(next_help_heading = "Computation")]
pub struct Work {
    /// Seed of all random numbers
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Largest number of events, drawn at random; vehicles with few events keep all of theirs
    #[arg(long, default_value_t = 100_000, value_parser = events)]
    pub events_max: usize,
    /// Largest number of events of an exact fit; larger logs use inducing points
    #[arg(long, default_value_t = Limits::default().dense_events_max, value_parser = dense_events)]
    pub dense_events_max: usize,
    /// Inducing points of a sparse fit
    #[arg(long, default_value_t = Limits::default().inducing_points_max, value_parser = inducing_points)]
    pub inducing_points_max: usize,
    /// Worker threads; 0 uses one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
}

impl Work {
    /// Returns the limits of one vehicle.
    pub fn limits(&self) -> Limits {
        let Self { events_max, dense_events_max, inducing_points_max, .. } = *self;
        Limits { events_max, dense_events_max, inducing_points_max, ..Limits::default() }
    }
}

/// Vehicles and time of the queried link, for models that distinguish vehicles or times.
#[derive(Args)]
#[command(next_help_heading = "Vehicles and time")]
pub struct QueryOptions {
    /// Transmitter: a vehicle of the log, a typical vehicle, or a new vehicle with an unknown offset
    #[arg(long, value_name = "NAME|typical|new", default_value = TYPICAL)]
    pub transmitter: String,
    /// Receiver: a vehicle of the log, a typical vehicle, or a new vehicle with an unknown offset
    #[arg(long, value_name = "NAME|typical|new", default_value = TYPICAL)]
    pub receiver: String,
    /// Time: the end of the log, a typical time, an unknown other day, or a time of the log in seconds
    #[arg(long, value_name = "end|typical|another-day|SECONDS", default_value = "end", value_parser = Moment::parse, allow_negative_numbers = true)]
    pub time: Moment,
    /// Kind of message: a kind of the log, or a typical one
    #[arg(long, value_name = "NAME|typical", default_value = TYPICAL)]
    pub kind: String,
    /// Do not cap predictions beyond the longest observed range; by default they never exceed the prediction at that
    /// range
    #[arg(long)]
    pub no_range_cap: bool,
}

/// Option value that selects a typical vehicle or message kind.
const TYPICAL: &str = "typical";

impl QueryOptions {
    /// Returns a function from a link to its query with these options.
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
        Ok(move |link| LinkQuery { transmitter, receiver, when, kind, ..LinkQuery::from(link) })
    }
}

/// Returns the message kind that the option names.
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

/// Returns the vehicle that the option names.
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
