//! Arguments of the examples.

use std::error::Error;
use std::path::Path;

use pingmap_trial::{EventLog, Split, read_splits};

/// An error that can move between threads.
pub(crate) type Failure = Box<dyn Error + Send + Sync>;

/// Reads `events.csv splits.csv [packets]` from the command line. The default is ten packets.
#[allow(dead_code, reason = "not every program takes splits")]
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

/// Returns the sharing options with these features turned off: fields of [`Sharing`](pingmap_agent::Sharing), separated
/// by commas.
#[allow(dead_code, reason = "not every program has switches")]
pub fn sharing_without(features: &str) -> Result<pingmap_agent::Sharing, String> {
    let mut sharing = pingmap_agent::Sharing::default();
    for feature in features.split(',').filter(|feature| !feature.is_empty()) {
        // A new field without a switch does not compile.
        let pingmap_agent::Sharing { summaries, reports, acknowledgements, report_candidates, summary_candidates } =
            &mut sharing;
        *match feature {
            "summaries" => summaries,
            "reports" => reports,
            "acknowledgements" => acknowledgements,
            "report_candidates" => report_candidates,
            "summary_candidates" => summary_candidates,
            other => return Err(format!("found {other}; expected a field of Sharing")),
        } = false;
    }
    Ok(sharing)
}
