//! Errors of the import.

use pingmap_trial::FileError;

use crate::model::reference::ReferenceError;

/// The reason for which no log can be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// A file cannot be read, or a table has a wrong format.
    #[error(transparent)]
    File(#[from] FileError),
    /// The content of a file is invalid.
    #[error("{file}: {problem}")]
    Content {
        /// Name of the file.
        file: String,
        /// The problem, and the expected content.
        problem: String,
    },
    /// The reference system is unknown.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// A column was assigned to an unknown role.
    #[error("{role:?} is no role of a column; expected {expected}")]
    Role {
        /// The unknown role.
        role: String,
        /// All roles.
        expected: String,
    },
    /// The files contradict each other.
    #[error("{0}")]
    Inconsistent(String),
}
