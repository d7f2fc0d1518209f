//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use dgpc::Shape;
use pingmap_agent::{
    Criterion, Expectation, Fusion, Given, Learning, Limits, PathInputs, Structure, SummaryKind, Terms,
};
use pingmap_trial::COORDINATE_MAX_M;

/// Learn, while under way, the probability that a message from here reaches there.
///
/// Event logs are CSV files with the columns time_s, tx_id, rx_id, tx_easting_m, tx_northing_m, rx_easting_m, rx_northing_m and
/// success (1 heard, 0 missed), one line per attempted transmission. Results go to standard output, everything else to standard
/// error. Exit status: 0 success, 1 failure, 2 bad input.
#[derive(Parser)]
#[command(version)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Subcommand)]
pub enum Command {
    /// Replay a field trial that comes with pingmap, print the scores and write a report with maps
    Demo(Demo),
    /// Replay a mission: what each vehicle knows alone, what the team knows after sharing packets, what it could know at best
    Replay(Replay),
    /// Learn from an event log how links behave, and write it to a model file that all other commands take
    Learn(Learn),
    /// Predict the probability of success over links
    Predict(Predict),
    /// Draw the probability of success seen from one place
    Map(Map),
    /// Choose the inducing points that sum up a locality region, with the certificate of the choice
    Select(Select),
}

#[derive(Args)]
pub struct Demo {
    /// Folder for the report
    #[arg(long, default_value = "pingmap-report", value_name = "DIR")]
    pub out: PathBuf,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
    /// Worker threads; 0 takes one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
}

#[derive(Args)]
pub struct Replay {
    /// Event log
    pub events: PathBuf,
    /// CSV of fixed splits: one column a split, one row an event, 1 = held out
    #[arg(long, value_name = "FILE", conflicts_with_all = ["repeats", "test_share"])]
    pub splits: Option<PathBuf>,
    /// Number of random splits
    #[arg(long, default_value_t = 3, value_parser = at_least_one)]
    pub repeats: usize,
    /// Share of every vehicle's events that is held out
    #[arg(long, default_value_t = 0.35, value_parser = open_share, allow_negative_numbers = true)]
    pub test_share: f64,
    /// Numbers of packets that every vehicle sends
    #[arg(long, default_value = "1,2,5,10,20", value_delimiter = ',', value_parser = at_least_one)]
    pub frames: Vec<usize>,
    /// Inducing points in a packet
    #[arg(long, default_value_t = 4, value_parser = at_least_one)]
    pub points_per_frame: usize,
    /// How packets are put together
    #[arg(long, value_enum, default_value_t = FusionName::Sites)]
    pub fusion: FusionName,
    /// Which message a packet carries about its region
    #[arg(long, value_enum, default_value_t = SummaryName::Marginal)]
    pub summary: SummaryName,
    /// Also write a report with maps to this folder
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Who learns the model
    #[arg(long, value_enum, default_value_t = LearnName::Pooled)]
    pub learn: LearnName,
    #[command(flatten)]
    pub source: ModelSource,
    #[command(flatten)]
    pub work: Work,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct Learn {
    /// Event log
    pub events: PathBuf,
    /// File for the model
    #[arg(long, short, value_name = "FILE", default_value = "model.toml")]
    pub output: PathBuf,
    /// Also hold out this share of every vehicle's events, and print how well the rest predicts them
    #[arg(long, value_parser = open_share, allow_negative_numbers = true)]
    pub test_share: Option<f64>,
    #[command(flatten)]
    pub kernel: Kernel,
    #[command(flatten)]
    pub work: Work,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct Predict {
    #[command(flatten)]
    pub source: Source,
    /// CSV of links: tx_easting_m, tx_northing_m, rx_easting_m, rx_northing_m
    #[arg(long)]
    pub links: PathBuf,
    /// File for the result; standard output if not given
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write one JSON object instead of CSV
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct Map {
    #[command(flatten)]
    pub source: Source,
    /// The place the map is seen from, in metres of the log
    #[arg(long, value_name = "EAST,NORTH", value_parser = pair, allow_hyphen_values = true)]
    pub at: (f64, f64),
    /// Whether that place transmits or receives
    #[arg(long = "as", value_enum, default_value_t = End::Tx)]
    pub end: End,
    /// File for the map; its ending says what it is: .png, .svg, .csv (the grid) or .geojson (the contours; needs --origin)
    #[arg(long, short, value_name = "FILE", default_value = "map.png")]
    pub output: PathBuf,
    /// Latitude and longitude of (0, 0) of the log, in degrees
    #[arg(long, value_name = "LAT,LON", value_parser = pair, allow_hyphen_values = true)]
    pub origin: Option<(f64, f64)>,
    /// Width of a grid cell; the longer side has 120 cells if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub cell_m: Option<f64>,
    /// Print what was drawn as one JSON object
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct Select {
    /// Event log
    pub events: PathBuf,
    /// The vehicle whose events are summed up
    #[arg(long)]
    pub vehicle: String,
    /// Centre of the locality region, in metres; the vehicle's event with most of its own events around it if not given
    #[arg(long, value_name = "TX_EAST,TX_NORTH,RX_EAST,RX_NORTH", value_parser = quadruple, allow_hyphen_values = true)]
    pub centre: Option<[f64; 4]>,
    /// Radius of the locality region over all coordinates of both ends; 1.384 length-scales if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub radius_m: Option<f64>,
    /// How many inducing points
    #[arg(long, default_value_t = 2, value_parser = at_least_one)]
    pub points: usize,
    /// Which points to choose
    #[arg(long, value_enum, default_value_t = PolicyName::Good)]
    pub policy: PolicyName,
    #[command(flatten)]
    pub model: ModelSource,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Sum up at most so many events of the region, those nearest to its centre
    #[arg(long, default_value_t = 1000, value_parser = at_least_one)]
    pub events_max: usize,
    /// Worker threads; 0 takes one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
}

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
    #[arg(long = "kernel", value_enum)]
    pub shape: Option<ShapeName>,
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
    #[arg(long, default_value_t = Learning::default().events_max, value_parser = at_least_one)]
    pub learn_events_max: usize,
}

/// Log-odds that a conservative prior loses from range zero to its range.
const CONSERVATIVE_LOSS: f64 = 4.0;

impl Kernel {
    /// The parts that are given.
    pub fn given(&self) -> Given {
        let conservative = self.conservative_range_m.map(|range_m| {
            let slope_per_m = self.conservative_slope_per_km.map(|slope| slope / 1000.0);
            Expectation::Conservative { range_m, slope_per_m: slope_per_m.unwrap_or(CONSERVATIVE_LOSS / range_m) }
        });
        Given {
            shape: self.shape.map(ShapeName::shape),
            path_inputs: self.inputs.map(InputsName::inputs),
            reciprocal: self.reciprocal.map(|reciprocal| reciprocal == YesNo::Yes),
            terms: self.terms.map(TermsName::terms),
            expectation: conservative.or(self.prior_mean.map(MeanName::expectation)),
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
    #[arg(long, default_value_t = 100_000, value_parser = at_least_one)]
    pub events_max: usize,
    /// Fit exactly up to so many events, and with inducing points beyond
    #[arg(long, default_value_t = Limits::default().dense_events_max, value_parser = at_least_one)]
    pub dense_events_max: usize,
    /// Inducing points of a fit that is not exact
    #[arg(long, default_value_t = Limits::default().inducing_points_max, value_parser = at_least_one)]
    pub inducing_points_max: usize,
    /// Worker threads; 0 takes one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
}

impl Work {
    /// The bounds of one vehicle.
    pub fn limits(&self) -> Limits {
        let Self { dense_events_max, inducing_points_max, .. } = *self;
        Limits { dense_events_max, inducing_points_max, ..Limits::default() }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ShapeName {
    SquaredExponential,
    Matern32,
    Matern52,
}

impl ShapeName {
    fn shape(self) -> Shape {
        match self {
            ShapeName::SquaredExponential => Shape::SquaredExponential,
            ShapeName::Matern32 => Shape::Matern32,
            ShapeName::Matern52 => Shape::Matern52,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputsName {
    /// The positions of both ends, one length-scale for all
    Raw,
    /// Where the link lies, and which way and how far it reaches; a length-scale for each coordinate
    Link,
}

impl InputsName {
    fn inputs(self) -> PathInputs {
        match self {
            InputsName::Raw => PathInputs::Raw,
            InputsName::Link => PathInputs::Link,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum YesNo {
    Yes,
    No,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TermsName {
    /// The path between the ends
    Path,
    /// The path, noise at the receiver, and loss over the range
    PathReceiverRange,
}

impl TermsName {
    fn terms(self) -> Terms {
        match self {
            TermsName::Path => Terms::Path,
            TermsName::PathReceiverRange => Terms::PathReceiverRange,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MeanName {
    /// Even odds
    Zero,
    /// The same odds everywhere
    Constant,
    /// Odds that fall with range
    Range,
}

impl MeanName {
    fn expectation(self) -> Expectation {
        match self {
            MeanName::Zero => Expectation::Zero,
            MeanName::Constant => Expectation::Constant,
            MeanName::Range => Expectation::Range,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CriterionName {
    /// The leave-one-out log predictive probability
    LeaveOneOut,
    /// The evidence bound
    Evidence,
}

impl CriterionName {
    fn criterion(self) -> Criterion {
        match self {
            CriterionName::LeaveOneOut => Criterion::LeaveOneOut,
            CriterionName::Evidence => Criterion::Evidence,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LearnName {
    /// Somebody who saw the training events of all, beforehand
    Pooled,
    /// Every vehicle by itself, from its own events and what it received
    Own,
    /// Both, side by side
    Both,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FusionName {
    /// Packets join the vehicle's own raw events; the prior counts once
    Sites,
    /// The paper's: packets alone, stacked block by block
    Concatenation,
}

impl FusionName {
    pub fn fusion(self) -> Fusion {
        match self {
            FusionName::Sites => Fusion::Sites,
            FusionName::Concatenation => Fusion::Concatenation,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SummaryName {
    /// The exact message about the inducing points
    Marginal,
    /// The paper's: additive, overconfident in large regions
    Variational,
}

impl SummaryName {
    pub fn kind(self) -> SummaryKind {
        match self {
            SummaryName::Marginal => SummaryKind::Marginal,
            SummaryName::Variational => SummaryKind::Variational,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PolicyName {
    /// Leave as little prior variance unexplained as possible
    Good,
    /// Leave as much as possible
    Bad,
    /// Draw the points uniformly
    Random,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum End {
    /// Transmits
    Tx,
    /// Receives
    Rx,
}

/// What the user calls a value of one of the enumerations above.
pub fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

fn at_least_one(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&number| number >= 1).ok_or_else(|| "expected a whole number of at least 1".to_owned())
}

/// Lengths and variances beyond these bounds mean a slip of the pen, and would overflow when squared.
fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (1e-6..=1e9).contains(number));
    number.ok_or_else(|| "expected a number above 0, from 1e-6 to 1e9".to_owned())
}

fn threads(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&number| number <= 256).ok_or_else(|| "expected a whole number from 0 to 256".to_owned())
}

fn open_share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && *number < 1.0);
    number.ok_or_else(|| "expected a number above 0 and below 1".to_owned())
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse::<f64>().ok().filter(|x| x.abs() <= COORDINATE_MAX_M)).collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.ok_or_else(|| format!("expected {N} numbers, at most 1e9 from zero, with commas between them"))
}

fn pair(text: &str) -> Result<(f64, f64), String> {
    numbers::<2>(text).map(|[a, b]| (a, b))
}

fn quadruple(text: &str) -> Result<[f64; 4], String> {
    numbers(text)
}
