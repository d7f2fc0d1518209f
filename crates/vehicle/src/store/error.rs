//! [`StoreError`]: every reason for which a store or a snapshot cannot be used.

use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

use pingmap_packet::to_hex;

/// The reason why a store or a snapshot cannot be used. Each text names the file and a remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The content of the file is not what was written.
    #[error(
        "the store {} is damaged: {problem}. A vehicle that starts with this store keeps the file under another name and \
         continues from its last snapshot.", path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The result of the check that failed.
        problem: String,
    },
    /// The file was not written as a store.
    #[error(
        "{} is not a store: {problem}. Choose the path of a store, or a path at which no file exists.", path.display()
    )]
    NotAStore {
        /// The file.
        path: PathBuf,
        /// The difference from a store.
        problem: String,
    },
    /// A later version of this program wrote the file.
    #[error(
        "the store {} has {what} {found}, but this program reads versions up to {expected}. Use the version of pingmap \
         that wrote the store, or choose another path.", path.display()
    )]
    NewerFormat {
        /// The file.
        path: PathBuf,
        /// The format that is newer.
        what: &'static str,
        /// The version in the file.
        found: u32,
        /// The latest version that can be read.
        expected: u32,
    },
    /// The store belongs to another vehicle.
    #[error(
        "the store {} belongs to the vehicle {found:?}, but this vehicle is {expected:?}. Choose the store of this \
         vehicle, or correct the name of the vehicle.", path.display()
    )]
    OtherVehicle {
        /// The file.
        path: PathBuf,
        /// The vehicle in the store.
        found: String,
        /// The vehicle that opened it.
        expected: String,
    },
    /// The store was recorded under another team configuration.
    #[error(
        "the store {} was recorded with the team configuration {}, but this one is {}. Use the team file and epoch of \
         the store, choose another path, or adopt the store to keep its entries under this team.",
        path.display(), to_hex(found), to_hex(expected)
    )]
    OtherTeam {
        /// The file.
        path: PathBuf,
        /// Digest in the store.
        found: [u8; 32],
        /// Digest of the vehicle that opened it.
        expected: [u8; 32],
    },
    /// Another process has the store open.
    #[error(
        "the store {} is in use. Stop the other process that has it open, or choose another path.", path.display()
    )]
    Locked {
        /// The file.
        path: PathBuf,
    },
    /// A folder has the name of the file.
    #[error("{} is a folder, not a file. Choose the path of a file, for example one in this folder.", path.display())]
    IsFolder {
        /// The path.
        path: PathBuf,
    },
    /// The folder of the file is missing.
    #[error("there is no folder {} for the file {}. Create the folder, or correct the path.", folder.display(), path.display())]
    NoFolder {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
    },
    /// The file is missing.
    #[error("there is no file {}. Correct the path.", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The file or its folder cannot be written or read by this user.
    #[error(
        "no permission for {}: {source}. A store needs a file and a folder that this user can read and write, on a \
         medium that is not read-only.", path.display()
    )]
    NoPermission {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: Error,
    },
    /// The medium is full.
    #[error("no space for {}: {source}. Free space on this medium, or choose a path on another.", path.display())]
    Full {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: Error,
    },
    /// Another error of the operating system.
    #[error("cannot use {}: {source}. Check the medium and the path.", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: Error,
    },
    /// The storage engine refused an operation.
    #[error("the store {} refused the operation: {problem}. Open the store again.", path.display())]
    Refused {
        /// The file.
        path: PathBuf,
        /// The error of the storage engine.
        problem: String,
    },
    /// An earlier operation on the open store failed.
    #[error("the store {} is closed, because an earlier operation on it failed. Open it again.", path.display())]
    Closed {
        /// The file.
        path: PathBuf,
    },
}

impl StoreError {
    /// Returns the error for a file whose content is not what was written.
    pub(crate) fn damaged(path: &Path, problem: impl Into<String>) -> Self {
        Self::Damaged { path: path.into(), problem: problem.into() }
    }

    /// Returns the error of an operation of the operating system on this file.
    pub(crate) fn from_io(path: &Path, source: Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => Self::Full { path, source },
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => Self::NoPermission { path, source },
            ErrorKind::UnexpectedEof => Self::damaged(&path, "the file ends too early"),
            ErrorKind::InvalidData => Self::damaged(&path, source.to_string()),
            ErrorKind::IsADirectory => Self::IsFolder { path },
            ErrorKind::NotFound => match path.parent() {
                Some(folder) if folder != Path::new("") && !folder.exists() => {
                    Self::NoFolder { folder: folder.into(), path }
                }
                _ => Self::Missing { path },
            },
            _ => Self::Io { path, source },
        }
    }

    /// Returns the error of the storage engine on this file.
    pub(crate) fn from_engine(path: &Path, error: impl Into<redb::Error>) -> Self {
        let path = path.to_path_buf();
        match error.into() {
            redb::Error::Io(source) => Self::from_io(&path, source),
            redb::Error::DatabaseAlreadyOpen | redb::Error::LockProtocolMismatch => Self::Locked { path },
            redb::Error::Corrupted(problem) => Self::Damaged { path, problem },
            redb::Error::PreviousIo | redb::Error::DatabaseClosed => Self::Closed { path },
            error @ (redb::Error::UpgradeRequired(_)
            | redb::Error::TableTypeMismatch { .. }
            | redb::Error::TableIsMultimap(_)
            | redb::Error::TypeDefinitionChanged { .. }
            | redb::Error::TableDoesNotExist(_)) => Self::damaged(&path, error.to_string()),
            error => Self::Refused { path, problem: error.to_string() },
        }
    }
}
