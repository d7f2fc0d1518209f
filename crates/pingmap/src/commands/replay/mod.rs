//! `pingmap replay`: scores predictions by each vehicle alone, by the team after sharing, and with all events in one
//! place.

mod replayed;
mod tables;
pub mod json;
mod scores;
mod pictures;
pub mod report;
mod film;
pub mod online;

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_trial::{
    Alternative, ChannelImpairments, DivideBy, Division, EventLog, ModelSource, Plan, Preshared, Split, TrafficPlan,
    read_splits, splits_to_csv,
};

use crate::cli_enums::{DivideByName, LearnName, ShareName};
use crate::cli_parsers::{frame_bytes, open_share, packets, piggyback_bytes, repeats, share};
use crate::log::{LOG_AND_MODEL, Logs, WholeLog, thinned};
use crate::model::{HAS_SEEN_LOG, log_digests, open_model, preshared_model};
use crate::options::{ModelOptions, RESULT, Work};
use crate::output::{BadInput, Results, note, print_json, print_text, warn};
use crate::output_target::{Overwrite, STANDARD_OUTPUT};
use crate::reference::ReferenceOptions;
use crate::team::{open_key, open_team};
use online::{OnlineFiles, OnlineMission};
pub use replayed::Replayed;

/// Help headings of groups of options.
const HELD_OUT: &str = "Held-out events";
const ON_THE_WATER: &str = "Communication";
const IN_TIME: &str = "In the order of time";

/// Replay a mission, and score the predictions of each vehicle alone and of the team
///
/// The scores are those of each vehicle alone, of the team after sharing packets, and of a model with all events in one
/// place.
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap replay log.csv --frames 1,5,10 --report replay\n  pingmap replay log.csv --model model.toml --online"
)]
pub struct Options {
    #[command(flatten)]
    pub logs: Logs,
    /// CSV of fixed splits: one column per split, one row per event, 1 = held out
    #[arg(help_heading = HELD_OUT, long, value_name = "FILE", conflicts_with = "Dividing")]
    pub splits: Option<PathBuf>,
    #[command(flatten)]
    pub dividing: Dividing,
    /// Also write the splits to this file, in the format of --splits
    #[arg(help_heading = HELD_OUT, long, value_name = "FILE", conflicts_with = "splits")]
    pub write_splits: Option<PathBuf>,
    /// Numbers of packets that every vehicle sends
    #[arg(help_heading = ON_THE_WATER, long, default_value = "1,2,5,10,20,40", value_delimiter = ',', value_parser = packets)]
    pub frames: Vec<usize>,
    #[command(flatten)]
    pub sharing: Sharing,
    /// Compare with other uses of the same number of bytes
    #[arg(long)]
    pub compare: bool,
    /// Show the calibration of the probabilities: reliability, and the coverage of intervals if the log has true
    /// probabilities
    #[arg(long)]
    pub calibration: bool,
    /// Run the mission in the order of time instead
    ///
    /// Receivers predict every event before they learn from it, and packets are sent with the transmissions of the log.
    /// Without --model or --team no model is learned beforehand.
    #[arg(help_heading = IN_TIME, long, conflicts_with_all = ["splits", "Dividing", "write_splits", "frames", "compare", "calibration", "learn", "reorder"])]
    pub online: bool,
    /// With --online: a vehicle may send a packet with every N-th of its transmissions; 10 if not given, no packets if
    /// only --piggyback-bytes is given
    #[arg(help_heading = IN_TIME, long, value_name = "TRANSMISSIONS", value_parser = packets, requires = "online")]
    pub slot_every: Option<usize>,
    /// With --online: bytes in every transmission for the newest outcomes of its sender; two bytes hold ten outcomes
    #[arg(help_heading = IN_TIME, long, value_name = "BYTES", value_parser = piggyback_bytes, requires = "online")]
    pub piggyback_bytes: Option<usize>,
    /// Also write a report with maps to this folder
    #[arg(help_heading = RESULT, long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// With --online: also write a film of the mission, a page for browsers that needs no other file
    ///
    /// The page shows the tracks, the messages, and the map of each vehicle at 24 times of the mission.
    #[arg(help_heading = RESULT, long, value_name = "FILE", requires = "online")]
    pub animate: Option<PathBuf>,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// The data from which models are learned
    #[arg(long, value_enum, default_value_t = LearnName::Pooled)]
    pub learn: LearnName,
    #[command(flatten)]
    pub reference: ReferenceOptions,
    /// Model file of `pingmap learn`; if not given, models are learned from the log
    #[arg(help_heading = LOG_AND_MODEL, long, value_name = "FILE", conflicts_with = "ModelOptions")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub model_options: ModelOptions,
    #[command(flatten)]
    pub work: Work,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

/// Choice of the held-out events.
#[derive(Args)]
#[group(id = "Dividing", multiple = true)]
pub struct Dividing {
    /// Rule for held-out events
    #[arg(help_heading = HELD_OUT, long, value_enum)]
    pub split_by: Option<DivideByName>,
    /// Number of random splits; 3 if not given
    #[arg(help_heading = HELD_OUT, long, value_parser = repeats)]
    pub repeats: Option<usize>,
    /// Share that is held out: of every vehicle's events, of the blocks of time, or of the ranges; 0.35, or 0.4 of the
    /// ranges, if not given
    #[arg(help_heading = HELD_OUT, long, value_parser = open_share, allow_negative_numbers = true)]
    pub test_share: Option<f64>,
    /// With random splits: hold out all receivers of a transmission together, as blocks of time always do
    #[arg(help_heading = HELD_OUT, long)]
    pub whole_transmissions: bool,
}

impl Dividing {
    fn splits(&self, log: &EventLog, seed: u64) -> Result<Vec<Split>, BadInput> {
        self.division()?.splits(log, seed).map_err(|error| BadInput(error.to_string()))
    }

    /// Refuses options without effect.
    fn division(&self) -> Result<Division, BadInput> {
        let by = self.split_by.map_or(DivideBy::Random, DivideByName::divide_by);
        let refuse =
            |option: &str, what: &str| BadInput(format!("{option} has no effect if {what}; expected no {option}"));
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

/// Options of sharing, and impairments of the channel.
#[derive(Args)]
pub struct Sharing {
    /// Team file: members, model, grid, frames and key
    #[arg(help_heading = ON_THE_WATER, long, value_name = "FILE", conflicts_with_all = ["ModelOptions", "model", "frame_bytes", "key_file", "dense_events_max", "inducing_points_max"])]
    pub team: Option<PathBuf>,
    /// Bytes of a frame
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 32, value_parser = frame_bytes)]
    pub frame_bytes: usize,
    /// File with the team's key of 64 hexadecimal digits; packets are authenticated with it, which takes 8 bytes of
    /// each
    #[arg(help_heading = ON_THE_WATER, long, value_name = "FILE")]
    pub key_file: Option<PathBuf>,
    /// Share of packets that each receiver loses
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub loss: f64,
    /// Share of packets that arrive twice
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub duplicate: f64,
    /// Share of packets that arrive after a later one
    #[arg(help_heading = ON_THE_WATER, long, default_value_t = 0.0, value_parser = share, allow_negative_numbers = true)]
    pub reorder: f64,
    /// Content of the packets
    #[arg(help_heading = ON_THE_WATER, long, value_enum, default_value_t = ShareName::Both)]
    pub share: ShareName,
}

impl Sharing {
    /// Returns the impairments of the channel.
    pub fn impairments(&self) -> ChannelImpairments {
        let Self { loss, duplicate, reorder, .. } = *self;
        ChannelImpairments { loss, duplicate, reorder }
    }
}

impl Options {
    pub fn threads(&self) -> usize {
        self.work.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        run(self, results)
    }

    /// Checks that the film can be written next to the other results.
    fn check_animation(&self, path: &Path, inputs: &[&Path]) -> anyhow::Result<()> {
        let problem = match () {
            () if path == Path::new(STANDARD_OUTPUT) => "the scores go to standard output",
            () if self.is_report_page(path) => "that is the page of the report",
            () => return self.overwrite.target(path, inputs).map(drop),
        };
        let name = path.display();
        Err(BadInput(format!("--animate {name}: {problem}; expected another file, such as mission.html")).into())
    }

    fn is_report_page(&self, path: &Path) -> bool {
        let resolved = |folder: &Path| Path::new(".").join(folder).canonicalize().ok();
        let Some(report) = self.report.as_deref().and_then(resolved) else { return false };
        path.file_name() == Some("index.html".as_ref()) && path.parent().and_then(resolved) == Some(report)
    }

    /// Returns the paths of the files of a replay in the order of time.
    fn files(&self) -> OnlineFiles<'_> {
        OnlineFiles { report: self.report.as_deref(), film: self.animate.as_deref() }
    }

    /// Returns the paths of all input files.
    fn inputs(&self) -> Vec<&Path> {
        let others = [&self.splits, &self.model, &self.sharing.team, &self.sharing.key_file];
        self.logs.paths().into_iter().chain(others.into_iter().flatten().map(PathBuf::as_path)).collect()
    }
}

fn run(options: &Options, results: Results) -> anyhow::Result<()> {
    let inputs = options.inputs();
    if let Some(folder) = &options.report {
        options.overwrite.report_folder(folder, &inputs)?;
    }
    if let Some(path) = &options.animate {
        options.check_animation(path, &inputs)?;
    }
    let splits_target =
        options.write_splits.as_deref().map(|path| options.overwrite.target(path, &inputs)).transpose()?;
    let mut log = options.logs.open()?;
    options.reference.apply(&mut log)?;
    let whole = WholeLog::of(&log, options.logs.name());
    let (preshared, has_seen_log) = preshared(options, &log)?;
    if let (Some(model), false) = (preshared_model(&preshared), log.reference.is_known()) {
        log.reference = model.chart.reference;
    }
    if options.sharing.team.is_some() {
        note("the [slots] of the team file are not used: a replay numbers the transmissions of the log");
    }
    let plan = plan(options, preshared)?;
    if has_seen_log {
        warn(HAS_SEEN_LOG);
    }
    if options.online {
        let (log, _) = thinned(log, Vec::new(), options.work.events_max, options.work.seed);
        let mission = OnlineMission { plan, has_seen_log, traffic: traffic(options), seed: options.work.seed, whole };
        return mission.run(&log, results, options.json, options.files());
    }
    let splits = match &options.splits {
        Some(path) => read_splits(path, &log)?,
        None => options.dividing.splits(&log, options.work.seed)?,
    };
    if let Some(target) = splits_target {
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

/// Returns the shared model or team, and whether the model was learned from this log.
fn preshared(options: &Options, log: &EventLog) -> anyhow::Result<(Preshared, bool)> {
    let (preshared, digests) = match (&options.model, &options.sharing.team) {
        (_, Some(path)) => {
            let (team, digests) = open_team(path, log)?;
            (Preshared::Team(Box::new(team)), digests)
        }
        (Some(path), None) => {
            let file = open_model(path, log)?;
            let digests = log_digests(&file).map(str::to_owned).collect();
            (Preshared::Model(file.model), digests)
        }
        (None, None) => (Preshared::Nothing, Vec::new()),
    };
    Ok((preshared, digests.contains(&log.digest())))
}

/// Returns the options of sending packets with the transmissions of the log.
fn traffic(options: &Options) -> TrafficPlan {
    let slot_every = match (options.slot_every, options.piggyback_bytes) {
        (None, None) => Some(online::SLOT_EVERY),
        (slot_every, _) => slot_every,
    };
    TrafficPlan { slot_every, piggyback_bytes: options.piggyback_bytes.unwrap_or(0) }
}

/// Returns the plan of the replay: team, sharing and learning.
fn plan(options: &Options, preshared: Preshared) -> anyhow::Result<Plan> {
    let model = &options.model_options;
    let sharing = &options.sharing;
    Ok(Plan {
        preshared,
        model_source: if options.learn == LearnName::Own { ModelSource::Own } else { ModelSource::Pooled },
        frame_bytes: sharing.frame_bytes,
        key: sharing.key_file.as_ref().map(|path| open_key(path)).transpose()?,
        sharing: sharing.share.sharing(),
        impairments: sharing.impairments(),
        alternatives: if options.compare { Alternative::ALL.to_vec() } else { Vec::new() },
        // A report always shows the calibration, so that its reader can judge the maps.
        calibration: options.calibration || options.report.is_some() && !options.online,
        ..Plan::new(model.learning(options.work.limits()), options.work.seed)
    })
}

impl Replayed {
    /// Prints warnings and results, and writes the report if requested.
    pub fn show(&self, results: Results, as_json: bool, report: Option<&Path>) -> anyhow::Result<()> {
        self.warn();
        let command = results.command().to_vec();
        match as_json {
            true => print_json(results, &json::ReplayJson::of(self))?,
            false => print_text(results, &tables::text(self))?,
        }
        if let Some(folder) = report {
            note(format_args!("report: {}", report::write(self, &command, folder, &|_| ())?.display()));
        }
        Ok(())
    }
}
