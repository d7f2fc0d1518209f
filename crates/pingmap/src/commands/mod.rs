//! The list of commands. Each is a module with its options, `Options`, which know how many threads they take and how to
//! run.

pub mod check;
pub mod demo;
pub mod import;
pub mod learn;
pub mod map;
pub mod packet;
pub mod predict;
pub mod replay;
pub mod reproduce;
pub mod select;
pub mod simulate;
pub mod team;

use clap::Subcommand;

use crate::output::Results;

macro_rules! commands {
    ($($name:ident($module:ident)),* $(,)?) => {
        #[derive(Subcommand)]
        pub enum Command {
            $($name($module::Options)),*
        }

        impl Command {
            /// Worker threads, 0 = one per core.
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
    Demo(demo),
    Import(import),
    Check(check),
    Replay(replay),
    Learn(learn),
    Predict(predict),
    Map(map),
    Select(select),
    Reproduce(reproduce),
    Simulate(simulate),
    Team(team),
    Packet(packet),
}
