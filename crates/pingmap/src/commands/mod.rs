//! The commands. Each is a module with a type `Options`, which runs the command and returns its number of threads.

pub mod check;
pub mod demo;
pub mod fleet;
pub mod import;
pub mod learn;
pub mod map;
pub mod packet;
pub mod plan;
pub mod predict;
pub mod replay;
pub mod reproduce;
pub mod select;
pub mod shell;
pub mod schema;
pub mod simulate;
pub mod store;
pub mod team;
pub mod vehicle;

use clap::Subcommand;

use crate::output::Results;

macro_rules! commands {
    ($($name:ident($options:ty)),* $(,)?) => {
        #[derive(Subcommand)]
        pub enum Command {
            $($name($options)),*
        }

        impl Command {
            /// Returns the number of worker threads, 0 for one per core.
            pub fn threads(&self) -> usize {
                match self {
                    $(Command::$name(options) => options.threads()),*
                }
            }

            pub fn run(&self, results: Results) -> anyhow::Result<()> {
                match self {
                    $(Command::$name(options) => options.run(results)),*
                }
            }
        }
    };
}

commands! {
    Demo(demo::Options),
    Import(import::Options),
    Check(check::Options),
    Replay(replay::Options),
    Fleet(fleet::Options),
    Learn(learn::Options),
    Predict(predict::Options),
    Map(map::Options),
    Plan(plan::Options),
    Select(select::Options),
    Reproduce(reproduce::Options),
    Simulate(simulate::Options),
    Team(team::Options),
    Packet(packet::Options),
    Vehicle(vehicle::Options),
    Store(store::Options),
    Completions(shell::Completions),
    Man(shell::Man),
    Schema(schema::Options),
}
