//! Experiments behind the figures of `docs/evaluation.md` and its pages, one subcommand each.
//!
//! `cargo run --release -p pingmap-trial --example experiments -- help`

mod agents;
mod arguments;
mod statistics;

mod adverse_conditions;
mod faulty_member;
mod hard_missions;
mod intervals;
mod long_mission;
mod online_sharing;
mod optional_terms;
mod sharing_features;

use std::io::{Write, stdout};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Runs one of the experiments behind the figures of the documentation.
#[derive(Parser)]
#[command(name = "experiments")]
struct Arguments {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(Subcommand)]
enum Experiment {
    AdverseConditions(adverse_conditions::Arguments),
    FaultyMember(faulty_member::Arguments),
    HardMissions(hard_missions::Arguments),
    Intervals(intervals::Arguments),
    LongMission(long_mission::Arguments),
    OnlineSharing(online_sharing::Arguments),
    OptionalTerms(optional_terms::Arguments),
    SharingFeatures(sharing_features::Arguments),
}

impl Experiment {
    /// Runs the experiment, and writes its table to `out`.
    fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        match self {
            Self::AdverseConditions(arguments) => arguments.run(out),
            Self::FaultyMember(arguments) => arguments.run(out),
            Self::HardMissions(arguments) => arguments.run(out),
            Self::Intervals(arguments) => arguments.run(out),
            Self::LongMission(arguments) => arguments.run(out),
            Self::OnlineSharing(arguments) => arguments.run(out),
            Self::OptionalTerms(arguments) => arguments.run(out),
            Self::SharingFeatures(arguments) => arguments.run(out),
        }
    }
}

fn main() -> ExitCode {
    match Arguments::parse().experiment.run(&mut stdout().lock()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;
    use pingmap_trial::simulate::{Simulation, Sound};
    use pingmap_trial::{Division, splits_to_csv};

    #[test]
    fn every_experiment_has_a_one_sentence_help() {
        let command = Arguments::command();
        command.clone().debug_assert();
        for experiment in command.get_subcommands() {
            let help = experiment.get_about().expect("a help").to_string();
            assert!(help.starts_with("Measures ") || help.starts_with("Simulates "), "{help}");
            assert!(!help.contains(". "), "{help}");
        }
    }

    #[test]
    fn usage_errors_exit_with_2() {
        for arguments in [&["unknown"][..], &["optional-terms", "events.csv"], &["intervals", "events.csv"]] {
            let error = Arguments::try_parse_from([&["experiments"], arguments].concat()).err().expect("an error");
            assert_eq!(error.exit_code(), 2, "{arguments:?}");
        }
    }

    /// Runs an experiment on a simulated log with two splits.
    #[test]
    fn optional_terms_of_a_simulated_log_have_a_row_per_split() -> anyhow::Result<()> {
        let log = Simulation { vehicles: 2, slots: 60, seed: 1, ..Simulation::default() }.run(&Sound::default())?.log;
        let folder = tempfile::tempdir()?;
        let [events, splits] = ["events.csv", "splits.csv"].map(|name| folder.path().join(name));
        std::fs::write(&events, log.to_csv())?;
        std::fs::write(&splits, splits_to_csv(&Division::random(2, 0.35).splits(&log, 1)?))?;
        let files = [events.as_os_str(), splits.as_os_str()];
        let options = ["experiments", "optional-terms", "--packets", "2"].map(std::ffi::OsStr::new);
        let mut out = Vec::new();
        Arguments::try_parse_from([&options[..], &files].concat())?.experiment.run(&mut out)?;
        let out = String::from_utf8(out)?;
        let first: Vec<&str> = out.lines().filter_map(|line| line.split_whitespace().next()).collect();
        assert_eq!(first, ["split", "r0", "r1", "mean"]);
        let numbers =
            out.lines().last().unwrap_or_default().split_whitespace().filter_map(|cell| cell.parse::<f64>().ok());
        // Predictions are better than even odds.
        assert_eq!(numbers.filter(|nll| (0.0..std::f64::consts::LN_2).contains(nll)).count(), 3, "{out}");
        Ok(())
    }
}
