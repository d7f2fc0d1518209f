//! `pingmap replay`: what each vehicle knows alone, what the team knows after sharing, what it could know at best.

mod replayed;
mod tables;
pub mod json;
mod scores;
mod pictures;
mod report;
pub mod online;

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_trial::{
    Agreed, DivideBy, Division, EventLog, Learners, Plan, Riding, Split, Water, read_splits, splits_to_csv,
};

use crate::log::{Logs, WholeLog, thinned};
use crate::model::{HAS_SEEN_LOG, agreed_model, log_digests, open_model};
use crate::names::{DivideByName, LearnName, ShareName};
use crate::options::{ModelSource, RESULT, Work};
use crate::output::{BadInput, Results, note, print, print_json, warn};
use crate::outputs::{Kind, Target};
use crate::reference::ReferenceOptions;
use crate::team::{open_key, open_team};
use crate::values::{frame_bytes, open_share, packets, piggyback_bytes, repeats, share};
use online::OnlineMission;
pub use replayed::Replayed;

/// What options are listed under.
const HELD_OUT: &str = "Held-out events";
const ON_THE_WATER: &str = "What is sent, and what becomes of it";
const IN_TIME: &str = "In the order of time";

/// Replay a mission: what each vehicle knows alone, what the team knows after sharing packets, what it could know at
/// best
#[derive(Args)]
#[command(
    after_help = "Examples:\n  pingmap replay log.csv --frames 1,5,10 --report report\n  pingmap replay log.csv --model model.toml --online"
)]
pub struct Options {
    #[command(flatten)]
    pub logs: Logs,
    /// CSV of fixed splits: one column a split, one row an event, 1 = held out
    #[arg(help_heading = HELD_OUT, long, value_name = "FILE", conflicts_with = "Dividing")]
    pub splits: Option<PathBuf>,
    #[command(flatten)]
    pub dividing: Dividing,
    /// Also write the splits to this file, as --splits takes them
    #[arg(help_heading = HELD_OUT, long, value_name = "FILE", conflicts_with = "splits")]
    pub write_splits: Option<PathBuf>,
    /// Numbers of packets that every vehicle sends
    #[arg(help_heading = ON_THE_WATER, long, default_value = "1,2,5,10,20,40", value_delimiter = ',', value_parser = packets)]
    pub frames: Vec<usize>,
    #[command(flatten)]
    pub sharing: Sharing,
    /// Compare with other ways to use the same bytes
    #[arg(long)]
    pub compare: bool,
    /// Show how far probabilities mean what they say: reliability, and how often intervals hold the truth where it is known
    #[arg(long)]
    pub calibration: bool,
    /// Run the mission in the order of time instead: every event is predicted by its receiver before it is learned
    /// from, and packets ride on the transmissions of the log. Without --model or --team nothing is learned beforehand
    #[arg(help_heading = IN_TIME, long, conflicts_with_all = ["splits", "Dividing", "write_splits", "frames", "compare", "calibration", "learn", "reorder"])]
    pub online: bool,
    /// With --online: every so many of its transmissions a vehicle may send a packet; 10 if not given, none with
    /// --piggyback-bytes alone
    #[arg(help_heading = IN_TIME, long, value_name = "TRANSMISSIONS", value_parser = packets, requires = "online")]
    pub slot_every: Option<usize>,
    /// With --online: bytes of every transmission with the newest outcomes of its sender; two hold ten outcomes
    #[arg(help_heading = IN_TIME, long, value_name = "BYTES", value_parser = piggyback_bytes, requires = "online")]
    pub piggyback_bytes: Option<usize>,
    /// Also write a report with maps to this folder
    #[arg(help_heading = RESULT, long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Who learns the model
    #[arg(long, value_enum, default_value_t = LearnName::Pooled)]
    pub learn: LearnName,
    #[command(flatten)]
    pub reference: ReferenceOptions,
    #[command(flatten)]
    pub source: ModelSource,
    #[command(flatten)]
    pub work: Work,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

/// How held-out events are chosen.
#[derive(Args)]
#[group(id = "Dividing", multiple = true)]
pub struct Dividing {
    /// What decides which events are held out: chance, blocks of time, the range (the farthest), or the receiver (each
    /// vehicle in turn)
    #[arg(help_heading = HELD_OUT, long, value_enum)]
    pub split_by: Option<DivideByName>,
    /// Number of splits, where chance decides; 3 if not given
    #[arg(help_heading = HELD_OUT, long, value_parser = repeats)]
    pub repeats: Option<usize>,
    /// Share that is held out: of every vehicle's events, of blocks of time, of all ranges; 0.35 (of ranges 0.4) if not
    /// given
    #[arg(help_heading = HELD_OUT, long, value_parser = open_share, allow_negative_numbers = true)]
    pub test_share: Option<f64>,
    /// Hold out all receivers of a transmission together, with random splits (blocks of time do so anyway)
    #[arg(help_heading = HELD_OUT, long)]
    pub whole_transmissions: bool,
}

impl Dividing {
    fn splits(&self, log: &EventLog, seed: u64) -> Result<Vec<Split>, BadInput> {
        self.division()?.splits(log, seed).map_err(|error| BadInput(error.to_string()))
    }

    /// Refuses what would change nothing.
    fn division(&self) -> Result<Division, BadInput> {
        let by = self.split_by.map_or(DivideBy::Random, DivideByName::divide_by);
        let refuse =
            |option: &str, what: &str| BadInput(format!("{option} changes nothing where {what}; expected without"));
        if self.repeats.is_some() && matches!(by, DivideBy::Range | DivideBy::Vehicle) {
            return Err(refuse("--repeats", "the range or the receiver decides what is held out"));
        }
        if self.test_share.is_some() && by == DivideBy::Vehicle {
            return Err(refuse("--test-share", "the receiver decides what is held out"));
        }
        let share = if by == DivideBy::Range { 0.4 } else { 0.35 };
        Ok(Division {
            by,
            repeats: self.repeats.unwrap_or(3),
            test_share: self.test_share.unwrap_or(share),
            whole_transmissions: self.whole_transmissions,
        })
    }
}

/// What is sent, and what happens to it on its way.
#[derive(Args)]
pub struct Sharing {
    /// Team file: members, model, grid, frames and key
    #[arg(help_heading = ON_THE_WATER, long, value_name = "FILE", conflicts_with_all = ["Kernel", "model", "frame_bytes", "key_file", "dense_events_max", "inducing_points_max"])]
    pub team: Option<PathBuf>,
    /// Bytes of a frame
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 32, value_parser = frame_bytes)]
    pub frame_bytes: usize,
    /// File with the team's key, 64 hexadecimal digits: packets are authenticated with it, which takes 8 bytes of each
    #[arg(help_heading = ON_THE_WATER, long, value_name = "FILE")]
    pub key_file: Option<PathBuf>,
    /// Share of packets that are lost on their way to a receiver
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub loss: f64,
    /// Share of packets that arrive twice
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub duplicate: f64,
    /// Share of packets that later ones overtake
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub reorder: f64,
    /// What vehicles send: summaries of all their events, reports of single outcomes, or reports with summaries of events that no
    /// report can carry
    #[arg(help_heading = ON_THE_WATER, long, value_enum, default_value_t = ShareName::Both)]
    pub share: ShareName,
}

impl Sharing {
    /// What happens to packets.
    pub fn water(&self) -> Water {
        let Self { loss, duplicate, reorder, .. } = *self;
        Water { loss, duplicate, reorder }
    }
}

impl Options {
    pub fn threads(&self) -> usize {
        self.work.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        run(self, results)
    }
}

fn run(options: &Options, results: Results) -> anyhow::Result<()> {
    if let Some(folder) = &options.report {
        Target::page(folder, options.logs.overwrite)?;
    }
    let written_splits = options.write_splits.as_deref().map(|path| {
        let mut inputs = options.logs.paths();
        let read = [&options.splits, &options.source.model, &options.sharing.team, &options.sharing.key_file];
        inputs.extend(read.into_iter().flatten().map(PathBuf::as_path));
        Target::new(path, Kind::SPLITS, &inputs, options.logs.overwrite)
    });
    let written_splits = written_splits.transpose()?;
    let mut log = options.logs.open()?;
    options.reference.tell(&mut log)?;
    let whole = WholeLog::of(&log, options.logs.name());
    let (agreed, has_seen_log) = agreed(options, &log)?;
    if let (Some(model), false) = (agreed_model(&agreed), log.reference.is_known()) {
        log.reference = model.chart.reference;
    }
    if options.sharing.team.is_some() {
        note("the [slots] of the team file are not used: a replay numbers the transmissions of the log");
    }
    let plan = plan(options, agreed)?;
    if has_seen_log {
        warn(HAS_SEEN_LOG);
    }
    if options.online {
        let (log, _) = thinned(log, Vec::new(), options.work.events_max, options.work.seed);
        let mission = OnlineMission { plan, has_seen_log, riding: riding(options), seed: options.work.seed, whole };
        return mission.run(&log, results, options.json, options.report.as_deref());
    }
    let splits = match &options.splits {
        Some(path) => read_splits(path, &log)?,
        None => options.dividing.splits(&log, options.work.seed)?,
    };
    if let Some(target) = written_splits {
        target.write(splits_to_csv(&splits).as_bytes(), results)?;
    }
    let (log, splits) = thinned(log, splits, options.work.events_max, options.work.seed);
    let shows_calibration = options.calibration;
    let mut mission =
        Replayed { has_seen_log, shows_calibration, ..Replayed::new((log, whole), splits, &options.frames, plan)? };
    if options.learn == LearnName::Both {
        mission.learn_own(&options.frames)?;
    }
    mission.show(results, options.json, options.report.as_deref())
}

/// What is agreed on already, and whether its model was learned from this very log.
fn agreed(options: &Options, log: &EventLog) -> anyhow::Result<(Agreed, bool)> {
    let (agreed, digests) = match (&options.source.model, &options.sharing.team) {
        (_, Some(path)) => {
            let (team, digests) = open_team(path, log)?;
            (Agreed::Team(Box::new(team)), digests)
        }
        (Some(path), None) => {
            let file = open_model(path, log)?;
            let digests = log_digests(&file).map(str::to_owned).collect();
            (Agreed::Model(file.model), digests)
        }
        (None, None) => (Agreed::Nothing, Vec::new()),
    };
    Ok((agreed, digests.contains(&log.digest())))
}

/// What goes with the transmissions of a log.
fn riding(options: &Options) -> Riding {
    let slot_every = match (options.slot_every, options.piggyback_bytes) {
        (None, None) => Some(online::SLOT_EVERY),
        (slot_every, _) => slot_every,
    };
    Riding { slot_every, piggyback_bytes: options.piggyback_bytes.unwrap_or(0) }
}

/// What the options say of the team and of what it sends.
fn plan(options: &Options, agreed: Agreed) -> anyhow::Result<Plan> {
    let kernel = &options.source.kernel;
    let sharing = &options.sharing;
    Ok(Plan {
        agreed,
        learners: if options.learn == LearnName::Own { Learners::Own } else { Learners::Pooled },
        frame_bytes: sharing.frame_bytes,
        key: sharing.key_file.as_ref().map(|path| open_key(path)).transpose()?,
        sharing: sharing.share.sharing(),
        water: sharing.water(),
        compare: options.compare,
        // A report without it would leave open whether its maps can be believed.
        calibration: options.calibration || options.report.is_some() && !options.online,
        ..Plan::new(kernel.learning(kernel.given().default_candidates(), options.work.limits()), options.work.seed)
    })
}

impl Replayed {
    /// Warns, prints, and writes the report if one is wanted.
    pub fn show(&self, results: Results, as_json: bool, report: Option<&Path>) -> anyhow::Result<()> {
        self.warn();
        let command = results.command().to_vec();
        match as_json {
            true => print_json(results, &json::ReplayJson::of(self))?,
            false => print(results, &tables::text(self))?,
        }
        if let Some(folder) = report {
            note(format_args!("report: {}", report::write(self, &command, folder)?.display()));
        }
        Ok(())
    }
}
