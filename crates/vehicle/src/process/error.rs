//! [`ProcessError`]: why a process does not start.

use std::io;
use std::path::PathBuf;

use pingmap_import::ReferenceError;

use crate::config::settings::ConfigError;
use crate::store::error::StoreError;
use crate::vehicle::restore::RestoreError;

/// The reason why the process of a vehicle does not start. Each text names what is wrong, where, and a remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessError {
    /// The configuration has a wrong value.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The vehicle is not a member of the team.
    #[error(
        "the vehicle {vehicle:?} is not a member of the team ({}). Correct the key vehicle, or choose another team file.",
        members.join(", ")
    )]
    NotAMember {
        /// The vehicle of the configuration.
        vehicle: String,
        /// The members of the team.
        members: Vec<String>,
    },
    /// A muted vehicle is not another member of the team.
    #[error("muted names {found:?}, expected other members of the team. Correct the key muted.")]
    WrongMuted {
        /// The name that was found.
        found: String,
    },
    /// The reference system of the model is not known.
    #[error("the model of the team: {0}")]
    Reference(#[from] ReferenceError),
    /// Writing the snapshot would replace the store.
    #[error("store.snapshot would replace the store {}. Choose another path for the snapshot.", path.display())]
    OneFile {
        /// The store.
        path: PathBuf,
    },
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The content of an intact store cannot be read.
    #[error(
        "the store {}: {source}. Use the version of pingmap that wrote the store, or move it away to begin with its \
         snapshot.", path.display()
    )]
    Restore {
        /// The store.
        path: PathBuf,
        /// The description of the problem.
        source: RestoreError,
    },
    /// The host cannot connect.
    #[error("host.listen {listen}: {source}. {remedy}")]
    Listen {
        /// The value of the key.
        listen: String,
        /// The error of the operating system.
        source: io::Error,
        /// The remedy.
        remedy: &'static str,
    },
    /// The operating system refused a thread or a signal.
    #[error("cannot start the process: {0}")]
    System(io::Error),
}

impl ProcessError {
    /// Returns whether a file or a value of the user is the reason.
    pub fn is_bad_input(&self) -> bool {
        !matches!(self, Self::System(_))
    }
}
