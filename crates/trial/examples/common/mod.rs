//! What examples are given.

use std::error::Error;
use std::path::Path;

use pingmap_trial::{EventLog, Split, read_splits};

/// What goes from one thread to another when it fails.
pub(crate) type Failure = Box<dyn Error + Send + Sync>;

/// `events.csv splits.csv [packets]` on the command line; ten packets if not given.
pub(crate) fn log_splits_and_packets() -> Result<(EventLog, Vec<Split>, usize), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [events, splits, rest @ ..] = arguments.as_slice() else {
        return Err("expected: events.csv splits.csv [packets]".into());
    };
    let packets = rest.first().map_or(Ok(10), |packets| packets.parse())?;
    let log = EventLog::open(Path::new(events))?;
    let splits = read_splits(Path::new(splits), &log)?;
    Ok((log, splits, packets))
}
