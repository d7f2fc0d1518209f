//! Learn, while under way, the probability that a message from here reaches there.
//!
//! The command-line interface as a library. The library parses arguments and calls the crates below. It writes text
//! and figures. [`main`] is the program. [`run`] runs one command in the process and writes its results to any writer.
//! [`run_until`] does the same until another thread stops it. A host can collect [`Warnings`].
//!
//! ```
//! let mut results = Vec::new();
//! pingmap::run(["pingmap", "packet", "schema"], &mut results)?;
//! assert!(String::from_utf8_lossy(&results).starts_with("Map32"));
//! # Ok::<(), pingmap::Failure>(())
//! ```

#![forbid(unsafe_code)]

// In the order of the flow: each module uses only those above it.
mod warnings;
mod output;
mod interruptible;
mod files;
mod output_target;
mod grid;
mod figure;
mod cli_enums;
mod cli_parsers;
mod log;
mod reference;
mod options;
mod model;
mod team;
mod tracks;
mod answer;
mod data_extent;
mod learned_map;
mod area;
mod success_map;
mod route;
mod outage;
mod standoff;
mod map_figure;
mod page;
mod exports;
mod commands;
mod short_help;

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use clap::{ArgAction, CommandFactory, FromArgMatches, Parser};

pub use crate::warnings::Warnings;
pub use pingmap_agent::Interrupt;
use pingmap_agent::Team;

use crate::commands::Command;
use crate::output::{BadInput, Out};
use crate::short_help::with_short_help;

/// Learn, while under way, the probability that a message from here reaches there.
///
/// Event logs are CSV files with the columns time_s, tx_id, rx_id, tx_easting_m, tx_northing_m, rx_easting_m,
/// rx_northing_m and success (1 heard, 0 missed), one line per attempted transmission. Optional columns are tx_depth_m
/// and rx_depth_m, tx_heading_deg and rx_heading_deg, and kind. Results go to standard output,
/// everything else to standard error. Exit status: 0 success, 1 failure, 2 bad input.
#[derive(Parser)]
#[command(
    name = "pingmap",
    version,
    disable_version_flag = true,
    max_term_width = 100,
    disable_help_subcommand = true,
    after_long_help = "Example:\n  pingmap demo --out report\n\n`pingmap completions` and `pingmap man` print completions of a shell and manual pages."
)]
struct Arguments {
    /// Print only results, warnings and errors
    #[arg(long, short, global = true, hide_short_help = true)]
    quiet: bool,
    /// Print the version
    #[arg(long, short = 'V', action = ArgAction::Version, hide_short_help = true)]
    version: Option<bool>,
    #[command(subcommand)]
    command: Command,
}

/// The writer of the results, and the command line that was given.
struct Answers<'a> {
    out: &'a mut (dyn Write + Send),
    command: Vec<String>,
}

impl Write for Answers<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

impl Out for Answers<'_> {
    fn command(&self) -> &[String] {
        &self.command
    }

    fn definition(&self) -> clap::Command {
        definition()
    }
}

/// Returns all commands and options.
fn definition() -> clap::Command {
    with_short_help(Arguments::command())
}

/// The reason why a command failed.
#[derive(Debug)]
pub struct Failure {
    /// Names the file or option, the problem and the expected input.
    pub message: String,
    /// Exit status: 1 failure, 2 bad input, 0 if the user asked for help or the version.
    pub status: u8,
}

impl Failure {
    fn of(error: &anyhow::Error) -> Self {
        let status = if BadInput::is_behind(error) { 2 } else { 1 };
        Self { message: format!("{error:#}"), status }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

/// Runs the program: arguments from the command line, results to standard output.
pub fn main() -> ExitCode {
    ExitCode::from(main_with(std::env::args_os()))
}

/// Runs the program with other arguments than those of the process, and returns the exit status. The first argument is
/// the program's name.
pub fn main_with(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> u8 {
    let given: Vec<OsString> = arguments.into_iter().map(Into::into).collect();
    let arguments = match parsed(&given) {
        Ok(arguments) => arguments,
        Err(error) => {
            // A closed standard error is no failure.
            let _ = error.print();
            return status(&error);
        }
    };
    match execute(&arguments, words(given), &mut std::io::stdout(), &Interrupt::default()) {
        Ok(()) => 0,
        Err(failure) => {
            eprintln!("pingmap: {failure}");
            failure.status
        }
    }
}

/// Runs one command; the first argument is the program's name. Notes go to standard error, and so do warnings unless
/// [`Warnings`] are attached to this thread.
///
/// # Errors
/// [`Failure`] with a message for people and the exit status that the program would have.
pub fn run(
    arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
    results: &mut (dyn Write + Send),
) -> Result<(), Failure> {
    run_until(arguments, results, &Interrupt::default())
}

/// Runs one command as [`run`] does, until it ends or another thread requests it to stop.
///
/// Reading, learning, fits and predictions then end within a fraction of a second, with a failure of status 1. An
/// interrupted command leaves no incomplete file.
///
/// # Errors
/// As [`run`].
pub fn run_until(
    arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
    results: &mut (dyn Write + Send),
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let given: Vec<OsString> = arguments.into_iter().map(Into::into).collect();
    let arguments = parsed(&given).map_err(|error| Failure { status: status(&error), message: error.to_string() })?;
    execute(&arguments, words(given), results, interrupt)
}

/// Parses the arguments, of which the first is the program's name.
fn parsed(given: &[OsString]) -> Result<Arguments, clap::Error> {
    Arguments::from_arg_matches(&definition().try_get_matches_from(given)?)
}

/// Returns the exit status of refused arguments.
fn status(error: &clap::Error) -> u8 {
    error.exit_code().try_into().unwrap_or(2)
}

/// Returns the command line as text, without the program's name.
fn words(arguments: impl IntoIterator<Item = OsString>) -> Vec<String> {
    arguments.into_iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect()
}

fn execute(
    arguments: &Arguments,
    words: Vec<String>,
    out: &mut (dyn Write + Send),
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let command = &arguments.command;
    output::be_quiet(arguments.quiet);
    let mut answers = Answers { out, command: words };
    match output::with_threads(command.threads(), interrupt, || command.run(&mut answers)) {
        Ok(()) => Ok(()),
        // A reader that closes the pipe early, such as `head`, is not a failure.
        Err(error) if output::is_broken_pipe(&error) => Ok(()),
        // A reader that was stopped looks like a bad file.
        Err(error) if interrupt.is_requested() => Err(Failure { status: 1, ..Failure::of(&error) }),
        Err(error) => Err(Failure::of(&error)),
    }
}

/// Reads a team file, and the model and key files that it names.
///
/// # Errors
/// [`Failure`] with file, key, value and the expected value.
pub fn read_team(path: &Path) -> Result<Team, Failure> {
    team::read_team(path).map_err(|error| Failure::of(&error))
}
