//! Opens event logs: warnings about suspicious content, thinning, and the events of one vehicle.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Link, VehicleId};
use pingmap_trial::{EventLog, FileError, Problem, Split, open, thin};

use crate::interruptible::Interruptible;
use crate::output::{BadInput, warn};

/// Name, size and digest of a log before any event was removed.
pub struct WholeLog {
    pub name: String,
    pub events: usize,
    pub digest: String,
}

impl WholeLog {
    pub fn of(log: &EventLog, name: String) -> Self {
        Self { name, events: log.events.len(), digest: log.digest() }
    }
}

/// The file name that stands for standard input.
pub const STANDARD_INPUT: &str = "-";

/// Help heading of the options that select the input.
pub const LOG_AND_MODEL: &str = "Log and model";

/// The logs that a command reads.
#[derive(Args)]
pub struct Logs {
    /// Event logs, read as one log; - is standard input
    #[arg(help_heading = None::<&str>, value_name = "LOG", required_unless_present = "events")]
    logs: Vec<PathBuf>,
    /// Old spelling of the log argument
    #[arg(help_heading = None::<&str>, long, hide = true, value_name = "LOG", conflicts_with = "logs")]
    events: Vec<PathBuf>,
    /// Continue even if the log contains only one outcome, or coordinates that look like degrees
    #[arg(help_heading = LOG_AND_MODEL, long)]
    pub accept_bad_log: bool,
}

impl Logs {
    /// Reads all files as one log, warns about suspicious content and refuses unusable content.
    pub fn open(&self) -> anyhow::Result<EventLog> {
        let log = self.read()?;
        for finding in log.findings() {
            match finding.is_nonsense && !self.accept_bad_log {
                true => {
                    return Err(BadInput(format!(
                        "{}: {}; --accept-bad-log uses the log anyway",
                        self.name(),
                        finding.text
                    ))
                    .into());
                }
                false => warn(format_args!("{}: {}", self.name(), finding.text)),
            }
        }
        Ok(log)
    }

    /// Reads all files as one log without checking its content.
    pub fn read(&self) -> anyhow::Result<EventLog> {
        let paths = self.paths();
        let mut logs = paths.iter().map(|path| read_log(path)).collect::<anyhow::Result<Vec<_>>>()?.into_iter();
        let Some(mut all) = logs.next() else { return Err(BadInput("expected an event log".into()).into()) };
        for (log, path) in logs.zip(&paths[1..]) {
            if log.has_depths != all.has_depths {
                let message = "one log has depths and another has none; expected all or none of them to";
                return Err(BadInput(format!("{}: {message}", path.display())).into());
            }
            if !log.reference.agrees_with(&all.reference) {
                let (one, other) = (all.reference, log.reference);
                let message =
                    format!("the log uses {other}, but the logs before it use {one}; expected one reference system");
                return Err(BadInput(format!("{}: {message}", path.display())).into());
            }
            if log.reference.is_known() != all.reference.is_known() {
                warn("some logs name their reference system and others do not; one system is assumed for all");
            }
            all.append(log);
        }
        Ok(all)
    }

    /// Returns the paths of the files.
    pub fn paths(&self) -> Vec<&Path> {
        self.logs.iter().chain(&self.events).map(PathBuf::as_path).collect()
    }

    /// Returns the paths of all files, separated by commas.
    pub fn name(&self) -> String {
        self.paths().iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    }

    /// Returns the names of the files without their folders.
    pub fn file_names(&self) -> String {
        let names =
            self.paths().into_iter().filter_map(Path::file_name).map(|name| name.to_string_lossy().into_owned());
        names.collect::<Vec<_>>().join(", ")
    }
}

fn read_log(path: &Path) -> anyhow::Result<EventLog> {
    let (reader, name) = opened(path)?;
    EventLog::read(reader, name).map_err(|error| match error.problem {
        Problem::MissingColumns { .. } | Problem::BadValue { .. } => BadInput(format!(
            "{error}\npingmap import --events reads tables with other columns, dates, degrees and words for the outcome."
        ))
        .into(),
        _ => error.into(),
    })
}

/// Opens a file, or standard input for `-`. Also returns the name for messages.
pub fn opened(path: &Path) -> Result<(Box<dyn Read + Send>, &Path), FileError> {
    if path == Path::new(STANDARD_INPUT) {
        return Ok((Box::new(Interruptible(std::io::stdin())), Path::new("standard input")));
    }
    Ok((Box::new(Interruptible(open(path)?)), path))
}

/// Reads one log, as [`Logs::open`] does.
pub fn open_log(path: &Path, accept_bad_log: bool) -> anyhow::Result<EventLog> {
    Logs { logs: vec![path.to_owned()], events: Vec::new(), accept_bad_log }.open()
}

/// Keeps at most `events_max` events, and warns if events were removed.
pub fn thinned(log: EventLog, splits: Vec<Split>, events_max: usize, seed: u64) -> (EventLog, Vec<Split>) {
    let kept = thin(&log, events_max, seed);
    if kept.len() == log.events.len() {
        return (log, splits);
    }
    warn(format_args!(
        "using {} of {} events, drawn with seed {seed}; vehicles with few keep theirs (--events-max, --seed)",
        kept.len(),
        log.events.len()
    ));
    (log.select(&kept), splits.iter().map(|split| split.select(&kept)).collect())
}

/// Gives positions without a depth the mean depth of the log, and warns about it. Does nothing for logs without depths.
pub fn fill_depths<'a>(links: impl Iterator<Item = &'a mut Link>, log: &EventLog) {
    let Some(depth_m) = log.mean_depth_m() else { return };
    let unknown = links.flat_map(|link| [&mut link.transmitter.depth_m, &mut link.receiver.depth_m]);
    let mut filled = false;
    for depth in unknown.filter(|depth| depth.is_none()) {
        *depth = Some(depth_m);
        filled = true;
    }
    if filled {
        warn(format_args!("positions without a depth are assumed to lie at {depth_m:.1} m, the mean depth of the log"));
    }
}

/// Returns the part of a log with one receiver.
pub fn only(log: &EventLog, vehicle: &str) -> anyhow::Result<EventLog> {
    let own = log.owned_by(&VehicleId::new(vehicle));
    if own.events.is_empty() {
        let known: Vec<String> = log.vehicles().iter().map(ToString::to_string).collect();
        let message = format!("no events received by vehicle {vehicle:?}; expected one of {}", some_of(&known));
        return Err(BadInput(message).into());
    }
    Ok(own)
}

/// Lists the first 20 names, and the number of the others.
fn some_of(names: &[String]) -> String {
    const NAMED_MAX: usize = 20;
    match names.len().saturating_sub(NAMED_MAX) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..NAMED_MAX].join(", ")),
    }
}
