//! `pingmap check`: finds problems in event logs.

use std::path::PathBuf;

use clap::Args;
use pingmap_import::{Contradiction, ModemIds, Schedule, compare_with_schedule};
use pingmap_trial::{EventLog, Finding, PairCount, RangeBin, open};
use schemars::JsonSchema;
use serde::Serialize;

use crate::log::Logs;
use crate::output::{BadInput, Results, count, print_json, print_text, table};

/// Number of range bins in the table.
const BINS: usize = 8;

/// Check event logs for suspicious content, and count events by pair and by range
#[derive(Args)]
#[command(after_help = "Example:\n  pingmap check log.csv --strict")]
pub struct Options {
    #[command(flatten)]
    pub logs: Logs,
    /// Compare the transmissions with this schedule, as `pingmap import` reads it
    #[arg(long, value_name = "FILE")]
    pub schedule: Option<PathBuf>,
    /// Names of modem ids in the schedule: a table of id and name
    #[arg(long, value_name = "FILE", requires = "schedule")]
    pub ids: Option<PathBuf>,
    /// Exit with status 2 if anything is suspicious
    #[arg(long)]
    pub strict: bool,
    /// Print one JSON object instead of tables
    #[arg(long)]
    pub json: bool,
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
    let log = options.logs.read()?;
    let mut findings = log.findings();
    if let Some(path) = &options.schedule {
        let ids = options.ids.as_ref().map(|path| ModemIds::read(open(path)?, path)).transpose()?.unwrap_or_default();
        let schedule = Schedule::read(open(path)?, path, &ids)?;
        if !schedule.senders().any(|name| log.events.iter().any(|event| event.transmitter_id == *name)) {
            let message = format!("{}: no slot belongs to a transmitter of the log; expected --ids", path.display());
            return Err(BadInput(message).into());
        }
        let contradictions = compare_with_schedule(&log, &schedule);
        let finding = |contradiction: &Contradiction| Finding {
            check: "schedule",
            is_nonsense: true,
            text: contradiction.to_string(),
        };
        findings.extend(contradictions.iter().map(finding));
    }
    if options.json {
        print_json(results, &CheckedJson::of(&log, &findings))?;
    } else {
        print_text(results, &text(&log, &findings))?;
    }
    if options.strict && !findings.is_empty() {
        return Err(BadInput(format!("{}: {}", options.logs.name(), count(findings.len(), "finding"))).into());
    }
    Ok(())
}

fn text(log: &EventLog, findings: &[Finding]) -> String {
    let share = |heard: usize, events: usize| format!("{:.3}", heard as f64 / events as f64);
    let pair = |((from, to), PairCount { heard, missed }): (&(_, _), &PairCount)| {
        let (events, share) = (heard + missed, share(*heard, heard + missed));
        vec![format!("{from} → {to}"), events.to_string(), heard.to_string(), missed.to_string(), share]
    };
    let pairs: Vec<Vec<String>> = log.pairs().iter().map(pair).collect();
    let bin = |bin: &RangeBin| {
        let range = format!("{:.0} to {:.0}", bin.from_m, bin.to_m);
        vec![range, bin.events.to_string(), share(bin.heard, bin.events)]
    };
    let bins: Vec<Vec<String>> = log.over_range(BINS).iter().map(bin).collect();
    let line = |finding: &Finding| format!("{} {}\n", if finding.is_nonsense { "!!" } else { "! " }, finding.text);
    let found = match findings {
        [] => "Nothing suspicious.".to_owned(),
        _ => findings.iter().map(line).collect(),
    };
    format!(
        "{}\n\n{}\n\n{}",
        table(&["from → to", "sent", "heard", "missed", "share heard"], &pairs),
        table(&["range (m)", "events", "share heard"], &bins),
        found
    )
}

/// Result of the checks in JSON.
#[derive(Serialize, JsonSchema)]
pub struct CheckedJson {
    /// Version of this object.
    schema: u32,
    /// Number of events of all logs.
    events: usize,
    /// Digest of the events. It does not depend on the file or the order of lines.
    log_digest: String,
    /// Counts for each transmitter and receiver, ordered by name.
    pairs: Vec<PairJson>,
    /// Counts over range, from near to far, in bins of about equal numbers of events.
    over_range: Vec<BinJson>,
    /// Suspicious content.
    findings: Vec<FindingJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct PairJson {
    /// Name of the transmitter.
    transmitter: String,
    /// Name of the receiver.
    receiver: String,
    /// Number of events that were heard.
    heard: usize,
    /// Number of events that were missed.
    missed: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct BinJson {
    /// Smallest range of the bin in metres.
    from_m: f64,
    /// Largest range of the bin in metres.
    to_m: f64,
    /// Number of events in the bin.
    events: usize,
    /// Number of these events that were heard.
    heard: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct FindingJson {
    /// Name of the check, as in the documentation.
    check: &'static str,
    /// Whether a map of this log would be meaningless. Such logs are refused.
    is_nonsense: bool,
    /// The finding as a sentence.
    text: String,
}

impl CheckedJson {
    fn of(log: &EventLog, findings: &[Finding]) -> Self {
        let pair = |((from, to), PairCount { heard, missed }): (&(_, _), &PairCount)| PairJson {
            transmitter: format!("{from}"),
            receiver: format!("{to}"),
            heard: *heard,
            missed: *missed,
        };
        let bin = |&RangeBin { from_m, to_m, events, heard }: &RangeBin| BinJson { from_m, to_m, events, heard };
        let finding = |Finding { check, is_nonsense, text }: &Finding| FindingJson {
            check,
            is_nonsense: *is_nonsense,
            text: text.clone(),
        };
        Self {
            schema: 1,
            events: log.events.len(),
            log_digest: log.digest(),
            pairs: log.pairs().iter().map(pair).collect(),
            over_range: log.over_range(BINS).iter().map(bin).collect(),
            findings: findings.iter().map(finding).collect(),
        }
    }
}
