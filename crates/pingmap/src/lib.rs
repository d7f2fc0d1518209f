//! Learn, while under way, the probability that a message from here reaches there.
//!
//! The command-line interface as a library. The library parses arguments, calls the crates below, and writes text and
//! figures. [`main`] is the program. [`run`] runs one command in the process and writes its results to any writer.
//!
//! ```
//! let mut results = Vec::new();
//! pingmap::run(["pingmap", "packet", "schema"], &mut results)?;
//! assert!(String::from_utf8_lossy(&results).starts_with("Map32"));
//! # Ok::<(), pingmap::Failure>(())
//! ```

#![forbid(unsafe_code)]

// In the order of the flow: each module uses only those above it.
mod output;
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
use std::process::ExitCode;

use clap::{ArgAction, CommandFactory, FromArgMatches, Parser};

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
    after_long_help = "Example:\n  pingmap demo --out report"
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

impl std::fmt::Display for Failure {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

/// Runs the program: arguments from the command line, results to standard output.
pub fn main() -> ExitCode {
    let arguments = definition().get_matches();
    let arguments = Arguments::from_arg_matches(&arguments).unwrap_or_else(|error| error.exit());
    match execute(&arguments, words(std::env::args_os()), &mut std::io::stdout()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("pingmap: {failure}");
            ExitCode::from(failure.status)
        }
    }
}

/// Runs one command; the first argument is the program's name. Warnings and notes go to standard error.
///
/// # Errors
/// [`Failure`] with a message for people and the exit status that the program would have.
pub fn run(
    arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
    results: &mut (dyn Write + Send),
) -> Result<(), Failure> {
    let given: Vec<OsString> = arguments.into_iter().map(Into::into).collect();
    let arguments = definition()
        .try_get_matches_from(&given)
        .and_then(|matches| Arguments::from_arg_matches(&matches))
        .map_err(|error| Failure { status: error.exit_code().try_into().unwrap_or(2), message: error.to_string() })?;
    execute(&arguments, words(given), results)
}

/// Returns the command line as text, without the program's name.
fn words(arguments: impl IntoIterator<Item = OsString>) -> Vec<String> {
    arguments.into_iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect()
}

fn execute(arguments: &Arguments, words: Vec<String>, out: &mut (dyn Write + Send)) -> Result<(), Failure> {
    let command = &arguments.command;
    output::be_quiet(arguments.quiet);
    let mut answers = Answers { out, command: words };
    match output::with_threads(command.threads(), || command.run(&mut answers)) {
        Ok(()) => Ok(()),
        // A reader that closes the pipe early, such as `head`, is not a failure.
        Err(error) if output::is_broken_pipe(&error) => Ok(()),
        Err(error) => {
            let status = if BadInput::is_behind(&error) { 2 } else { 1 };
            Err(Failure { message: format!("{error:#}"), status })
        }
    }
}
