//! The built-in trials (`data/README.md` in the folder of this crate): simulated with a ray tracer, with two or three
//! vehicles each.

use std::path::Path;

use crate::event_log::EventLog;
use crate::table::FileError;

/// Name of every built-in trial, and its event log as CSV.
const TRIALS: [(&str, &[u8]); 3] = [
    ("bay2", include_bytes!("../data/bay2.csv")),
    ("lake2", include_bytes!("../data/lake2.csv")),
    ("bay3", include_bytes!("../data/bay3.csv")),
];

/// Names of the built-in trials, in the order of the paper's data sets 1, 2 and 3.
pub const BUILT_IN: [&str; 3] = [TRIALS[0].0, TRIALS[1].0, TRIALS[2].0];

/// Returns a built-in trial by its name; `None` for other names.
///
/// # Errors
/// None in practice, because the logs are valid.
pub fn built_in(name: &str) -> Option<Result<EventLog, FileError>> {
    let (_, csv) = TRIALS.iter().find(|(known, _)| *known == name)?;
    Some(EventLog::read(*csv, Path::new(&format!("{name}.csv (built in)"))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_trial_is_there() {
        for name in BUILT_IN {
            let log = built_in(name).expect("a trial").expect("a log");
            assert!(log.true_probability.is_some() && log.events.len() > 500, "{name}: {}", log.events.len());
        }
        assert!(built_in("bay4").is_none());
    }
}
