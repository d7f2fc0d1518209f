//! Learn, while under way, the probability that a message from here reaches there.
//!
//! The command line, as a library: arguments in, calls to the crates below, words and pictures out. [`main`] is the
//! program; [`run`] runs one command in the process, with its results written wherever one likes.
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
mod outputs;
mod contour;
mod figure;
mod values;
mod log;
mod options;
mod model;
mod team;
mod tracks;
mod survey;
mod success_map;
mod commands;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;

use clap::Parser;

use crate::commands::Command;
use crate::output::BadInput;

/// Learn, while under way, the probability that a message from here reaches there.
///
/// Event logs are CSV files with the columns time_s, tx_id, rx_id, tx_easting_m, tx_northing_m, rx_easting_m,
/// rx_northing_m and success (1 heard, 0 missed), one line per attempted transmission. Results go to standard output,
/// everything else to standard error. Exit status: 0 success, 1 failure, 2 bad input.
#[derive(Parser)]
#[command(name = "pingmap", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// Why a command did not succeed.
#[derive(Debug)]
pub struct Failure {
    /// What was wrong, where, and what was expected.
    pub message: String,
    /// Exit status: 1 failure, 2 bad input; 0 where a person asked for help or the version.
    pub status: u8,
}

impl std::fmt::Display for Failure {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

/// The program: arguments from the command line, results to standard output.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match execute(&arguments.command, &mut std::io::stdout()) {
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
    let arguments = Arguments::try_parse_from(arguments)
        .map_err(|error| Failure { status: error.exit_code().try_into().unwrap_or(2), message: error.to_string() })?;
    execute(&arguments.command, results)
}

fn execute(command: &Command, results: &mut (dyn Write + Send)) -> Result<(), Failure> {
    match output::with_threads(command.threads(), || command.run(results)) {
        Ok(()) => Ok(()),
        // A reader that has seen enough, such as `head`, is not a failure.
        Err(error) if output::is_broken_pipe(&error) => Ok(()),
        Err(error) => {
            let status = if BadInput::is_behind(&error) { 2 } else { 1 };
            Err(Failure { message: format!("{error:#}"), status })
        }
    }
}
