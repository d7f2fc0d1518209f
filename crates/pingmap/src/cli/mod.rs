//! The command line.

mod simulate;
mod values;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use pingmap_agent::{Given, Learning, Limits, MeanStructure, Structure};
use pingmap_trial::Water;

pub use simulate::Simulate;
pub use values::*;

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
    /// Run the experiment of the paper that pingmap comes from: its tables and figures, beside the published ones
    Reproduce(Reproduce),
    /// Make up a field trial: vehicles on survey legs, a slot schedule, and an acoustic channel of published formulas
    Simulate(Simulate),
    /// Write what a team must agree on before the mission: members, grid, frames, and the model that packets are formed under
    Team(Team),
    /// Look at the bytes on the water: what a packet says, what fields it has, and the .proto of them all
    #[command(subcommand)]
    Packet(Packet),
}

#[derive(Args)]
pub struct Team {
    /// Event log: its receivers are the members, and the grid holds all of its positions
    pub events: PathBuf,
    /// Model file, as `pingmap learn` writes it
    #[arg(long, value_name = "FILE", default_value = "model.toml")]
    pub model: PathBuf,
    /// File with the team's key, 64 hexadecimal digits, if packets are to be sealed
    #[arg(long, value_name = "FILE")]
    pub key_file: Option<PathBuf>,
    /// Bytes of a frame
    #[arg(long, default_value_t = 32, value_parser = frame_bytes)]
    pub frame_bytes: usize,
    /// Number of the key epoch: to be raised whenever a key is used for another mission, or a vehicle lost its memory
    #[arg(long, default_value_t = 0)]
    pub epoch: u32,
    /// Side of a cell of the grid; the finest that holds the log if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub cell_m: Option<f64>,
    /// File for the team, in the folder of the model file or above it
    #[arg(long, short, value_name = "FILE", default_value = "team.toml")]
    pub output: PathBuf,
}

#[derive(Subcommand)]
pub enum Packet {
    /// Say what a packet holds
    Decode(PacketDecode),
    /// Turn what `decode --json` prints, or a person wrote, into a packet
    Encode(PacketEncode),
    /// Print the fields of the packets and their bits
    Schema(PacketSchema),
}

#[derive(Args)]
pub struct PacketDecode {
    /// The packet in hexadecimal
    pub hex: String,
    /// Team file: checks that the packet is one of the team, and says in metres what it is about
    #[arg(long, value_name = "FILE")]
    pub team: Option<PathBuf>,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct PacketEncode {
    /// JSON file
    pub file: PathBuf,
    /// Team file: seals the packet, or puts the digest of the team's model in
    #[arg(long, value_name = "FILE")]
    pub team: Option<PathBuf>,
    /// Print one JSON object instead of the bytes in hexadecimal
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
pub struct PacketSchema {
    /// Bytes of a frame
    #[arg(long, default_value_t = 32, value_parser = frame_bytes)]
    pub frame_bytes: usize,
    /// Sealed with a team's key
    #[arg(long)]
    pub sealed: bool,
    /// With depths
    #[arg(long)]
    pub depth: bool,
    /// Print the .proto of all packets instead, as Goby and other users of DCCL load it
    #[arg(long, conflicts_with_all = ["json", "sealed", "depth", "frame_bytes"])]
    pub proto: bool,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
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
pub struct Reproduce {
    /// What to compute
    #[arg(value_enum, default_value_t = Exhibit::All)]
    pub exhibit: Exhibit,
    /// An event log in the place of the paper's next data set (to be given once for each), or a folder whose CSV files are taken in alphabetical
    /// order; depths are left out. Three simulated trials that come with pingmap if not given
    #[arg(long, value_name = "DIR|FILE")]
    pub data: Vec<PathBuf>,
    /// How often every data set is divided anew into training and held-out events
    #[arg(long, default_value_t = 100, value_parser = permutations, allow_negative_numbers = true)]
    pub permutations: usize,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder for the figures and, with `all`, the page reproduction.md
    #[arg(long, default_value = "pingmap-reproduction", value_name = "DIR")]
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
    #[arg(long, default_value = "1,2,5,10,20,40", value_delimiter = ',', value_parser = at_least_one)]
    pub frames: Vec<usize>,
    #[command(flatten)]
    pub sharing: Sharing,
    /// Compare with other ways to use the same bytes
    #[arg(long)]
    pub compare: bool,
    /// Run the mission in the order of time instead: every event is predicted by its receiver before it is learned from, and
    /// packets ride on the transmissions of the log. Without --model or --team nothing is learned beforehand
    #[arg(long, conflicts_with_all = ["splits", "repeats", "test_share", "frames", "compare", "learn", "reorder"])]
    pub online: bool,
    /// With --online: every so many of its transmissions a vehicle may send a packet; 10 if not given
    #[arg(long, value_name = "TRANSMISSIONS", value_parser = at_least_one, requires = "online")]
    pub slot_every: Option<usize>,
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

/// What is sent, and what happens to it on its way.
#[derive(Args)]
pub struct Sharing {
    /// Team file: members, model, grid, frames and key
    #[arg(long, value_name = "FILE", conflicts_with_all = ["Kernel", "model", "frame_bytes", "key_file", "repeat", "dense_events_max", "inducing_points_max"])]
    pub team: Option<PathBuf>,
    /// Bytes of a frame
    #[arg(long, default_value_t = 32, value_parser = frame_bytes)]
    pub frame_bytes: usize,
    /// File with the team's key, 64 hexadecimal digits: packets are sealed with it, which takes 8 bytes of each
    #[arg(long, value_name = "FILE")]
    pub key_file: Option<PathBuf>,
    /// Share of packets that are lost on their way to a receiver
    #[arg(long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub loss: f64,
    /// Share of packets that arrive twice
    #[arg(long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub duplicate: f64,
    /// Share of packets that later ones overtake
    #[arg(long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub reorder: f64,
    /// Send every packet again up to so many times, once there is nothing new to tell
    #[arg(long, default_value_t = 0)]
    pub repeat: u8,
}

impl Sharing {
    /// What happens to packets.
    pub fn water(&self) -> Water {
        let Self { loss, duplicate, reorder, .. } = *self;
        Water { loss, duplicate, reorder }
    }
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
            MeanStructure::Conservative { range_m, slope_per_m: slope_per_m.unwrap_or(CONSERVATIVE_LOSS / range_m) }
        });
        Given {
            shape: self.shape.map(ShapeName::shape),
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
        let Self { events_max, dense_events_max, inducing_points_max, .. } = *self;
        Limits { events_max, dense_events_max, inducing_points_max, ..Limits::default() }
    }
}
