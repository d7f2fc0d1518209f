//! Options that several commands share.

use std::path::PathBuf;

use clap::Args;
use dgpc::Shape;
use pingmap_agent::{Given, Learning, Limits, MeanStructure, Structure};

use crate::values::*;

/// What a map is learned from, and how.
#[derive(Args)]
pub struct Source {
    /// Event log to learn from
    #[arg(long)]
    pub events: PathBuf,
    /// Learn from this vehicle's events only
    #[arg(long)]
    pub vehicle: Option<String>,
    #[command(flatten)]
    pub model: ModelSource,
    #[command(flatten)]
    pub work: Work,
}

/// What links are read with: a model file, or what is learned.
#[derive(Args)]
pub struct ModelSource {
    /// Model file, as `pingmap learn` writes it; learned from the events if not given
    #[arg(long, value_name = "FILE", conflicts_with = "Kernel")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub kernel: Kernel,
}

/// Kernel and prior mean, as far as they are given. What is not given is learned.
#[derive(Args)]
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
    /// What is expected before the first event
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
    /// What decides among kernels and prior means
    #[arg(long, value_enum, default_value_t = CriterionName::LeaveOneOut)]
    pub criterion: CriterionName,
    /// Learn kernel and prior mean from at most so many events, spread evenly over the log
    #[arg(long, default_value_t = Learning::default().events_max, value_parser = events)]
    pub learn_events_max: usize,
}

impl Kernel {
    /// The parts that are given.
    pub fn given(&self) -> Given {
        let conservative = self.conservative_range_m.map(|range_m| {
            MeanStructure::conservative(range_m, self.conservative_slope_per_km.map(|slope| slope / 1000.0))
        });
        Given {
            shape: self.shape,
            path_inputs: self.inputs.map(InputsName::inputs),
            reciprocal: self.reciprocal.map(|reciprocal| reciprocal == YesNo::Yes),
            terms: self.terms.map(TermsName::terms),
            mean: conservative.or(self.prior_mean.map(MeanName::mean)),
        }
    }

    /// Learning with these structures to choose from.
    pub fn learning(&self, structures: Vec<Structure>, limits: Limits) -> Learning {
        let Self { length_scale_m, variance, learn_events_max: events_max, .. } = *self;
        Learning { structures, criterion: self.criterion.criterion(), length_scale_m, variance, events_max, limits }
    }
}

/// Bounds on work, and the seed.
#[derive(Args)]
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
