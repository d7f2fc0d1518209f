//! Reading logs for use: what is odd in them, thinning, and the part of one vehicle.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Link, VehicleId};
use pingmap_trial::{EventLog, FileError, Split, open, thin};

use crate::output::{BadInput, warn};

/// A log before any of its events were left out.
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

/// Standard input, where a file is named.
pub const STANDARD_INPUT: &str = "-";

/// What options are listed under that say what is read, whatever stands around them.
pub const LOG_AND_MODEL: &str = "Log and model";

/// The logs that a command reads.
#[derive(Args)]
pub struct Logs {
    /// Event logs, several as one; - is standard input
    #[arg(help_heading = None::<&str>, value_name = "LOG", required_unless_present = "events")]
    logs: Vec<PathBuf>,
    /// As logs were named before
    #[arg(help_heading = None::<&str>, long, hide = true, value_name = "LOG", conflicts_with = "logs")]
    events: Vec<PathBuf>,
    /// Continue even if the log contains only one outcome, or coordinates that look like degrees
    #[arg(help_heading = LOG_AND_MODEL, long)]
    pub accept_bad_log: bool,
    /// Replace files that pingmap did not write
    #[arg(help_heading = LOG_AND_MODEL, long)]
    pub overwrite: bool,
}

impl Logs {
    /// Reads them as one log, warns about what is odd and refuses what is nonsense.
    pub fn open(&self) -> anyhow::Result<EventLog> {
        let log = self.read()?;
        for finding in log.findings() {
            match finding.is_nonsense && !self.accept_bad_log {
                true => {
                    return Err(BadInput(format!(
                        "{}: {}; --accept-bad-log uses the log all the same",
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

    /// Reads them as one log, whatever it says.
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
                    format!("metres of {other}, but those of the logs before are of {one}; expected one system");
                return Err(BadInput(format!("{}: {message}", path.display())).into());
            }
            if log.reference.is_known() != all.reference.is_known() {
                warn("some logs say what their metres mean and others do not; they are taken for the same");
            }
            all.append(log);
        }
        Ok(all)
    }

    /// The files.
    pub fn paths(&self) -> Vec<&Path> {
        self.logs.iter().chain(&self.events).map(PathBuf::as_path).collect()
    }

    /// All of them by name.
    pub fn name(&self) -> String {
        self.paths().iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    }

    /// The files, without their folders.
    pub fn file_names(&self) -> String {
        let names =
            self.paths().into_iter().filter_map(Path::file_name).map(|name| name.to_string_lossy().into_owned());
        names.collect::<Vec<_>>().join(", ")
    }
}

fn read_log(path: &Path) -> anyhow::Result<EventLog> {
    let (reader, name) = opened(path)?;
    Ok(EventLog::read(reader, name)?)
}

/// A file, or standard input where that is named; and what people know it by.
pub fn opened(path: &Path) -> Result<(Box<dyn Read + Send>, &Path), FileError> {
    if path == Path::new(STANDARD_INPUT) {
        return Ok((Box::new(std::io::stdin()), Path::new("standard input")));
    }
    Ok((Box::new(open(path)?), path))
}

/// Reads one log, as [`Logs::open`] does.
pub fn open_log(path: &Path, accept_bad_log: bool) -> anyhow::Result<EventLog> {
    Logs { logs: vec![path.to_owned()], events: Vec::new(), accept_bad_log, overwrite: false }.open()
}

/// Keeps at most `events_max` events, and says so.
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

/// Gives ends without a depth the mean depth of a log that has depths, and says so.
pub fn fill_depths<'a>(links: impl Iterator<Item = &'a mut Link>, log: &EventLog) {
    let Some(depth_m) = log.mean_depth_m() else { return };
    let unknown = links.flat_map(|link| [&mut link.transmitter.depth_m, &mut link.receiver.depth_m]);
    let mut filled = false;
    for depth in unknown.filter(|depth| depth.is_none()) {
        *depth = Some(depth_m);
        filled = true;
    }
    if filled {
        warn(format_args!("places without a depth are taken to lie at {depth_m:.1} m, the mean depth of the log"));
    }
}

/// The part of a log that one vehicle owns.
pub fn only(log: &EventLog, vehicle: &str) -> anyhow::Result<EventLog> {
    let own = log.owned_by(&VehicleId::new(vehicle));
    if own.events.is_empty() {
        let known: Vec<String> = log.vehicles().iter().map(ToString::to_string).collect();
        let message = format!("no events received by vehicle {vehicle:?}; expected one of {}", some_of(&known));
        return Err(BadInput(message).into());
    }
    Ok(own)
}

/// The first of some names, and how many more there are.
fn some_of(names: &[String]) -> String {
    const NAMED_MAX: usize = 20;
    match names.len().saturating_sub(NAMED_MAX) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names[..NAMED_MAX].join(", ")),
    }
}
