//! `pingmap import`: makes an event log from the vehicles' recordings.

mod archives;
mod columns;
mod files;
mod input_checks;
mod origin;
pub mod json;
mod records;
mod summary;
mod unpacked;
mod warnings;

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::VehicleId;
use pingmap_import::{ImportResult, Rules, SlotUse, join, join_events};

use self::files::Files;
use self::json::ImportJson;
use self::summary::{summary, unknown_files};
use self::warnings::warnings;
use crate::cli_parsers::{not_negative, positive};
use crate::output::{BadInput, Results, print_json, warn};
use crate::output_target::{Overwrite, RESULT};

/// Make an event log from the recordings of the vehicles
///
/// Recordings are positions, receptions, and transmissions or a schedule. A transmission counts if its sender or any
/// receiver recorded it. With --always-transmits every slot of the sender's schedule counts, too. A receiver counts if
/// its modem was working. Messages that are neither heard nor missed for certain are left out and counted.
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap import mission/*.alog --ids mission/ids.csv -o events.csv\n  pingmap import --nav auv1=nav1.csv auv2=nav2.csv --heard auv1=rx1.csv auv2=rx2.csv --sent auv1=tx1.csv auv2=tx2.csv --ids ids.csv -o pair.csv"
)]
pub struct Options {
    #[command(flatten)]
    pub files: Files,
    #[command(flatten)]
    pub decisions: Decisions,
    /// File for the event log
    #[arg(help_heading = RESULT, long, short, value_name = "FILE", default_value = "events.csv")]
    pub output: PathBuf,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print one JSON object instead of a summary
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

#[derive(Args)]
#[command(next_help_heading = "Decisions")]
pub struct Decisions {
    /// Assume that all slots of the schedule are used
    ///
    /// The option applies to all vehicles, or to the named ones. By default the use of a slot is unknown if no vehicle
    /// received a message in it.
    #[arg(long, value_name = "NAME,…", num_args = 0..=1, require_equals = true, default_missing_value = "*", value_delimiter = ',')]
    pub always_transmits: Option<Vec<String>>,
    /// Correct times and positions to this vehicle's clock
    #[arg(long, value_name = "NAME")]
    pub correct_clocks: Option<String>,
    /// Largest offset between clocks in seconds, at most 3600; 0 if the clocks agree
    ///
    /// Offsets up to 60 s are found in any case if they fit clearly better.
    #[arg(long, default_value_t = Rules::default().clock_offset_s_max, value_parser = clock_offset_s_max, allow_negative_numbers = true)]
    pub clock_offset_s_max: f64,
    /// Upper limit of the difference between the expected and recorded time of a reception in seconds
    ///
    /// Where the sender's transmissions are close to each other, the limit is .45 of the time between them.
    #[arg(long, default_value_t = Rules::default().match_s, value_parser = positive, allow_negative_numbers = true)]
    pub match_s: f64,
    /// Duration of a message in seconds; a vehicle receives nothing during its own transmissions
    #[arg(long, default_value_t = Rules::default().message_s, value_parser = positive, allow_negative_numbers = true)]
    pub message_s: f64,
    /// Largest gap between position fixes in seconds; positions within larger gaps are unknown
    #[arg(long, default_value_t = Rules::default().nav_gap_s_max, value_parser = positive, allow_negative_numbers = true)]
    pub nav_gap_s_max: f64,
    /// Speed of sound
    #[arg(long, default_value_t = Rules::default().sound_m_per_s, value_parser = positive, allow_negative_numbers = true)]
    pub sound_m_per_s: f64,
    /// Count messages to one vehicle for the others, too
    #[arg(long)]
    pub overhear: bool,
    /// Count a message of several frames as heard if any frame was received; by default all frames must be
    #[arg(long)]
    pub any_frame: bool,
    /// Write the log even if its records contradict each other
    #[arg(long)]
    pub accept_bad_log: bool,
    /// Leave out vehicles above this depth, because they are at the surface
    #[arg(long, value_name = "METRES", value_parser = positive, allow_negative_numbers = true)]
    pub surfaced_above_m: Option<f64>,
}

/// Parses a clock offset. The limit bounds the work, because each message is compared with all transmissions within it.
fn clock_offset_s_max(text: &str) -> Result<f64, String> {
    let expected = || "expected an hour (3600) at most: shift the times of that vehicle's files first".to_owned();
    not_negative(text).and_then(|offset_s| (offset_s <= 3600.0).then_some(offset_s).ok_or_else(expected))
}

impl Decisions {
    fn rules(&self) -> Rules {
        let Self { clock_offset_s_max, match_s, message_s, nav_gap_s_max, sound_m_per_s, .. } = *self;
        let slot_use = match &self.always_transmits {
            None => SlotUse::NoSender,
            Some(names) if names.iter().any(|name| name == "*") => SlotUse::AllSenders,
            Some(names) => SlotUse::SomeSenders(names.iter().map(VehicleId::new).collect()),
        };
        Rules {
            sound_m_per_s,
            clock_offset_s_max,
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
    let target = options.overwrite.target(&options.output, &inputs)?.with_json(options.json)?;
    let inputs = options.files.read()?;
    let joined = match &inputs.events {
        Some(events) => Ok(join_events(events, &inputs.reference)),
        None => join(&inputs.recordings, inputs.schedule.as_ref(), &inputs.reference, &rules),
    };
    if let (Err(_), Some(unknown_files)) = (&joined, unknown_files(&inputs)) {
        warn(format_args!("left out: {unknown_files}"));
    }
    let mut imported: ImportResult = joined?;
    if !imported.log.events.is_empty() {
        let findings = imported.log.findings();
        imported.warnings.extend(findings.into_iter().map(|finding| finding.text));
    }
    for warning in warnings(&imported, &inputs, &rules) {
        warn(warning);
    }
    if imported.log.events.is_empty() {
        let reasons: Vec<String> =
            imported.excluded().iter().map(|(why, count)| format!("{count} {}", why.description())).collect();
        let why = match reasons.join(", ") {
            none if none.is_empty() => "no known vehicle sent a message to a receiver with records".to_owned(),
            reasons => reasons,
        };
        let message = format!("no event is left ({why}); expected some that were heard or missed for certain");
        return Err(BadInput(message).into());
    }
    check_contradictions(&imported, options)?;
    let written = target.write(imported.log.to_csv().as_bytes(), results);
    if options.json {
        print_json(results, &ImportJson::new(&imported, &inputs))?;
    } else {
        target.print_message(
            &format!("{}: {}", options.output.display(), summary(&imported, &inputs, &rules)),
            results,
        )?;
    }
    written
}

/// Refuses a log whose records contradict each other, unless the user accepts it.
fn check_contradictions(imported: &ImportResult, options: &Options) -> anyhow::Result<()> {
    for contradiction in imported.contradictions.iter().filter(|_| options.decisions.accept_bad_log) {
        warn(contradiction);
    }
    if options.decisions.accept_bad_log || imported.contradictions.is_empty() {
        return Ok(());
    }
    let reasons: Vec<String> = imported.contradictions.iter().map(ToString::to_string).collect();
    let message = format!("{}\nno log is written; --accept-bad-log writes it anyway", reasons.join("\n"));
    Err(BadInput(message).into())
}
