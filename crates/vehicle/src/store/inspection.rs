//! Reading a store without opening it for a vehicle.

use std::path::Path;

use redb::StorageBackend;

use crate::store::error::StoreError;
use crate::store::identity::Identity;
use crate::store::locked_file::LockedFile;
use crate::store::tables::{Contents, FORMAT};
use crate::store::verification::Verified;

/// Summary of a store whose checksums are right.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// The vehicle and team of the store.
    pub identity: Identity,
    /// Version of the layout.
    pub format: u32,
    /// Number of entries after the base.
    pub entry_count: usize,
    /// Bytes of these entries.
    pub entry_bytes: usize,
    /// Bytes of the base, if there is one.
    pub base_bytes: Option<usize>,
    /// Bytes of the file.
    pub file_bytes: u64,
}

/// Verifies a store and returns a summary. The file is neither changed nor opened for writing.
///
/// # Errors
/// [`StoreError::Damaged`], [`StoreError::NotAStore`], [`StoreError::NewerFormat`], [`StoreError::Locked`] if a vehicle
/// has the store open, and errors of the file system.
pub fn inspect(path: &Path) -> Result<Report, StoreError> {
    let file = LockedFile::open_read_only(path)?;
    let Verified { identity, contents, .. } = Verified::new(path, file.storage())?;
    Ok(Report {
        identity,
        format: FORMAT,
        entry_count: contents.entries.len(),
        entry_bytes: contents.entries.iter().map(Vec::len).sum(),
        base_bytes: contents.base.as_ref().map(Vec::len),
        file_bytes: file.storage().len().map_err(|e| StoreError::from_io(path, e))?,
    })
}

/// Verifies a store, and returns its identity and content. The file is neither changed nor opened for writing.
///
/// # Errors
/// As [`inspect`].
pub fn read_store(path: &Path) -> Result<(Identity, Contents), StoreError> {
    let file = LockedFile::open_read_only(path)?;
    let Verified { identity, contents, .. } = Verified::new(path, file.storage())?;
    Ok((identity, contents))
}
