//! What can be wrong with what vehicles recorded.

use pingmap_trial::FileError;

use crate::reference::ReferenceError;

/// Why no log could be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// A file is not what it should be.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file says something that cannot be.
    #[error("{file}: {problem}")]
    Content {
        /// The file.
        file: String,
        /// What is wrong, and what was expected.
        problem: String,
    },
    /// There is no such reference system.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// A column was named that means nothing here.
    #[error("{given:?} is no column to be named; expected {expected}")]
    Role {
        /// What was given.
        given: String,
        /// All that can be named.
        expected: String,
    },
    /// What the files say does not go together.
    #[error("{0}")]
    Together(String),
}
