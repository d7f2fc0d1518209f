//! [`Verified`]: the content of a storage, read from a copy in memory so that a damaged file stays as it was found.

use std::path::Path;

use redb::StorageBackend;

use crate::store::engine::{catch_panics, open_database, read_database};
use crate::store::error::StoreError;
use crate::store::header::{FLAGS, Header};
use crate::store::identity::Identity;
use crate::store::image::Image;
use crate::store::tables::Contents;

/// The content of a storage in which every checksum is right.
#[derive(Debug)]
pub(crate) struct Verified {
    pub(crate) identity: Identity,
    pub(crate) contents: Contents,
    /// The header's flags that select the latest complete commit, if others are in the storage.
    correct_flags: Option<u8>,
}

impl Verified {
    /// Checks a storage without changing it. The caller holds its lock.
    ///
    /// # Errors
    /// [`StoreError::Damaged`], [`StoreError::NotAStore`], [`StoreError::NewerFormat`], and errors of reading.
    pub(crate) fn new(path: &Path, storage: &impl StorageBackend) -> Result<Self, StoreError> {
        let header = Header::read(path, storage)?;
        let (identity, contents) = examine(path, Image::new(path, storage)?)?;
        let selected = Self { identity, contents, correct_flags: None };
        let Some(flags) = header.newer_commit() else { return Ok(selected) };
        match examine(path, Image::new(path, storage)?.with_byte(FLAGS, flags)) {
            Ok((identity, contents)) => Ok(Self { identity, contents, correct_flags: Some(flags) }),
            Err(_) => Ok(selected),
        }
    }

    /// Selects the latest complete commit in the storage.
    pub(crate) fn correct(&self, path: &Path, storage: &impl StorageBackend) -> Result<(), StoreError> {
        if let Some(flags) = self.correct_flags {
            storage
                .write(FLAGS, &[flags])
                .and_then(|()| storage.sync_data())
                .map_err(|e| StoreError::from_io(path, e))?;
        }
        Ok(())
    }
}

/// Reads a copy. Memory does not fail, so that every error of the engine is damage.
fn examine(path: &Path, image: Image) -> Result<(Identity, Contents), StoreError> {
    let read = || read_database(path, &open_database(path, image)?);
    catch_panics(path, read).map_err(|error| match error {
        StoreError::Damaged { .. } | StoreError::NotAStore { .. } | StoreError::NewerFormat { .. } => error,
        StoreError::Io { source, .. } => StoreError::damaged(path, source.to_string()),
        StoreError::Refused { problem, .. } => StoreError::damaged(path, problem),
        other => StoreError::damaged(path, other.to_string()),
    })
}
