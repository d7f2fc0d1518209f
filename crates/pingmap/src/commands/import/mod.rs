//! `pingmap import`: what vehicles recorded becomes an event log.

mod archives;
mod files;
pub mod json;
mod records;
mod shown;

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::VehicleId;
use pingmap_import::{ImportResult, Rules, SlotUse, join};

use self::files::Files;
use self::json::ImportedJson;
use self::shown::{left_alone, summary, warnings};
use crate::output::{BadInput, Results, print_json, warn};
use crate::outputs::{Kind, Target};
use crate::values::{not_negative, positive};

/// Make an event log from what the vehicles recorded: where each was, what it heard, what it sent or when it was its turn
///
/// A transmission counts if its sender recorded it, if anybody received it, or if it was the sender's turn and --always-sends says that
/// turns are used; and for receivers whose modem was at work. Whatever is neither heard nor missed for certain is left out and counted.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  pingmap import mission/*.alog --ids ids.csv -o events.csv\n  pingmap import --nav auv1=nav1.csv auv2=nav2.csv --heard auv1=rx1.csv auv2=rx2.csv --sent auv1=tx1.csv auv2=tx2.csv"
)]
pub struct Options {
    #[command(flatten)]
    pub files: Files,
    #[command(flatten)]
    pub decisions: Decisions,
    /// File for the event log
    #[arg(long, short, value_name = "FILE", default_value = "events.csv")]
    pub output: PathBuf,
    /// Replace a file that pingmap did not write
    #[arg(long)]
    pub overwrite: bool,
    /// Print one JSON object instead of a summary
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
#[command(next_help_heading = "Decisions")]
pub struct Decisions {
    /// Turns of the schedule are all used: everybody's, or those of some. Else a turn that nobody heard is not known to be used
    #[arg(long, value_name = "NAME,…", num_args = 0..=1, require_equals = true, default_missing_value = "*", value_delimiter = ',')]
    pub always_sends: Option<Vec<String>>,
    /// Correct times and places to this vehicle's clock
    #[arg(long, value_name = "NAME")]
    pub correct_clocks: Option<String>,
    /// Clocks differ by no more than this, an hour at most; 0: not at all
    #[arg(long, default_value_t = Rules::default().clock_off_s_max, value_parser = clock_off_s_max, allow_negative_numbers = true)]
    pub clock_off_s_max: f64,
    /// A reception belongs to a transmission if it came within so many seconds of when it should
    #[arg(long, default_value_t = Rules::default().match_s, value_parser = positive, allow_negative_numbers = true)]
    pub match_s: f64,
    /// How long a message lasts: for so long before and after its own a vehicle hears nothing
    #[arg(long, default_value_t = Rules::default().message_s, value_parser = positive, allow_negative_numbers = true)]
    pub message_s: f64,
    /// Where a vehicle was between fixes that are farther apart is not known
    #[arg(long, default_value_t = Rules::default().nav_gap_s_max, value_parser = positive, allow_negative_numbers = true)]
    pub nav_gap_s_max: f64,
    /// Speed of sound
    #[arg(long, default_value_t = Rules::default().sound_m_per_s, value_parser = positive, allow_negative_numbers = true)]
    pub sound_m_per_s: f64,
    /// Messages to one vehicle count for the others, too
    #[arg(long)]
    pub overhear: bool,
    /// A message of several frames counts as heard with any of them; else with all
    #[arg(long)]
    pub any_frame: bool,
    /// Vehicles above this depth are at the surface and left out
    #[arg(long, value_name = "METRES", value_parser = positive, allow_negative_numbers = true)]
    pub surfaced_above_m: Option<f64>,
}

/// Each message is compared with all that was sent so long before and after it.
fn clock_off_s_max(text: &str) -> Result<f64, String> {
    let expected = || "expected an hour (3600) at most: shift the times of that vehicle's files first".to_owned();
    not_negative(text).and_then(|off_s| (off_s <= 3600.0).then_some(off_s).ok_or_else(expected))
}

impl Decisions {
    fn rules(&self) -> Rules {
        let Self { clock_off_s_max, match_s, message_s, nav_gap_s_max, sound_m_per_s, .. } = *self;
        let slot_use = match &self.always_sends {
            None => SlotUse::NoSender,
            Some(names) if names.iter().any(|name| name == "*") => SlotUse::AllSenders,
            Some(names) => SlotUse::Listed(names.iter().map(VehicleId::new).collect()),
        };
        Rules {
            sound_m_per_s,
            clock_off_s_max,
            match_s,
            reference_clock: self.correct_clocks.as_ref().map(VehicleId::new),
            nav_gap_s_max,
            message_s,
            slot_use,
            overhear: self.overhear,
            any_frame: self.any_frame,
            surfaced_above_m: self.surfaced_above_m,
            ..Rules::default()
        }
    }
}

impl Options {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        run(self, results)
    }
}

fn run(options: &Options, results: Results) -> anyhow::Result<()> {
    let rules = options.decisions.rules();
    let inputs = options.files.paths()?;
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    let target =
        Target::new(&options.output, Kind::EVENT_LOG, &inputs, options.overwrite)?.beside_json(options.json)?;
    let taken = options.files.take()?;
    let joined = join(&taken.recordings, taken.schedule.as_ref(), &taken.reference, &rules);
    if let (Err(_), Some(left_alone)) = (&joined, left_alone(&taken)) {
        warn(format_args!("left alone: {left_alone}"));
    }
    let imported: ImportResult = joined?;
    for warning in warnings(&imported, &taken, &rules) {
        warn(warning);
    }
    for finding in imported.log.findings().into_iter().filter(|_| !imported.log.events.is_empty()) {
        warn(finding.text);
    }
    if imported.log.events.is_empty() {
        let reasons: Vec<String> =
            imported.excluded().iter().map(|(why, count)| format!("{count} {}", why.description())).collect();
        let why = match reasons.join(", ") {
            none if none.is_empty() => "nothing was sent by anybody known to a receiver that kept a record".to_owned(),
            reasons => reasons,
        };
        let message = format!("no event is left ({why}); expected some that were heard or missed for certain");
        return Err(BadInput(message).into());
    }
    let written = target.write(imported.log.to_csv().as_bytes(), results);
    if options.json {
        print_json(results, &ImportedJson::of(&imported, &taken))?;
    } else {
        target.tell(&format!("{}: {}", options.output.display(), summary(&imported, &taken, &rules)), results)?;
    }
    written
}
