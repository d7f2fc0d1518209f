//! Learn, while under way, the probability that a message from here reaches there. Glue: arguments in, calls to the other
//! crates, words and pictures out.

mod cli;
mod contour;
mod demo;
mod figure;
mod learn;
mod map;
mod online;
mod output;
mod packet;
mod predict;
mod region;
mod replay;
mod report;
mod reproduce;
mod simulate;
mod survey;
mod team;

use std::process::ExitCode;

use clap::Parser;

use crate::output::BadInput;

fn main() -> ExitCode {
    let arguments = cli::Arguments::parse();
    let done = match arguments.command {
        cli::Command::Demo(options) => demo::run(&options),
        cli::Command::Replay(options) => replay::run(&options),
        cli::Command::Learn(options) => learn::run(&options),
        cli::Command::Predict(options) => predict::run(&options),
        cli::Command::Map(options) => map::run(&options),
        cli::Command::Select(options) => region::run(&options),
        cli::Command::Team(options) => team::run(&options),
        cli::Command::Reproduce(options) => reproduce::run(&options),
        cli::Command::Simulate(options) => simulate::run(&options),
        cli::Command::Packet(command) => packet::run(&command),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        // A reader that has seen enough, such as `head`, is not a failure.
        Err(error) if output::is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("pingmap: {error:#}");
            ExitCode::from(if BadInput::is_behind(&error) { 2 } else { 1 })
        }
    }
}
