//! Arguments of several experiments.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use pingmap_agent::{Model, ModelFile, Sharing};
use pingmap_trial::{EventLog, Split, read_splits};

/// A log and its splits, as two arguments or as one of the form `events.csv:splits.csv`.
#[derive(Debug, Clone, PartialEq, Args)]
pub(crate) struct LogFiles {
    /// Event log
    pub(crate) events: PathBuf,
    /// Splits of the log: one column per split, one row per event, 1 = held out
    pub(crate) splits: PathBuf,
}

impl LogFiles {
    /// Reads both files.
    pub(crate) fn read(&self) -> anyhow::Result<(EventLog, Vec<Split>)> {
        let log = EventLog::open(&self.events)?;
        let splits = read_splits(&self.splits, &log)?;
        Ok((log, splits))
    }
}

impl FromStr for LogFiles {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (events, splits) = text.split_once(':').ok_or("expected events.csv:splits.csv")?;
        Ok(Self { events: events.into(), splits: splits.into() })
    }
}

/// A log, its splits, and the number of packets.
#[derive(Debug, Args)]
pub(crate) struct Exchange {
    #[command(flatten)]
    pub(crate) log: LogFiles,
    /// Number of packets of each vehicle
    #[arg(long, default_value_t = 10)]
    pub(crate) packets: usize,
}

/// A log as one mission, or with splits.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum TrialFiles {
    Mission(PathBuf),
    Splits(LogFiles),
}

impl FromStr for TrialFiles {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Mission(text.into()), Self::Splits))
    }
}

/// Reads a model file.
pub(crate) fn read_model(path: &Path) -> anyhow::Result<Model> {
    let text = std::fs::read_to_string(path).map_err(|error| anyhow::anyhow!("{}: {error}", path.display()))?;
    Ok(ModelFile::parse(&text)?.model)
}

/// Returns the sharing options with these features turned off: fields of [`Sharing`], separated by commas.
pub(crate) fn sharing_without(features: &str) -> Result<Sharing, String> {
    let mut sharing = Sharing::default();
    for feature in features.split(',').filter(|feature| !feature.is_empty()) {
        // A new field without a switch does not compile.
        let Sharing { summaries, reports, acknowledgements, report_candidates, summary_candidates } = &mut sharing;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trial_with_a_colon_has_splits() {
        let files = LogFiles { events: "a.csv".into(), splits: "b.csv".into() };
        assert_eq!("a.csv:b.csv".parse(), Ok(TrialFiles::Splits(files.clone())));
        assert_eq!("a.csv:b.csv".parse(), Ok(files));
        assert_eq!("a.csv".parse(), Ok(TrialFiles::Mission("a.csv".into())));
        assert!("a.csv".parse::<LogFiles>().is_err());
    }

    #[test]
    fn named_features_are_turned_off() {
        let default = Sharing::default();
        assert_eq!(sharing_without(""), Ok(default));
        let expected = Sharing { reports: false, summary_candidates: false, ..default };
        assert_eq!(sharing_without("reports,summary_candidates"), Ok(expected));
        assert_ne!(expected, default);
        assert!(sharing_without("reports,frames").is_err_and(|error| error.contains("frames")));
    }
}
