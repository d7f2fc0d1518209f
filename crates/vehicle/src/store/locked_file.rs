//! [`LockedFile`]: a file that no other process opens as a store meanwhile.

use std::fs::OpenOptions;
use std::ops::Bound::{self, Unbounded};
use std::path::Path;

use redb::StorageBackend;
use redb::backends::FileBackend;

use crate::store::error::StoreError;

const WHOLE: (Bound<u64>, Bound<u64>) = (Unbounded, Unbounded);

/// A file under the lock that the engine uses. The lock ends with this value.
#[derive(Debug)]
pub(crate) struct LockedFile(FileBackend);

impl LockedFile {
    /// Opens and locks a store for reading and writing.
    pub(crate) fn open(path: &Path) -> Result<Self, StoreError> {
        let file = open_file(path, true)?;
        Self::lock(path, &file, FileBackend::try_lock_range)?;
        Ok(Self(file))
    }

    /// Opens and locks a store for reading. Other readers may do so at once.
    pub(crate) fn open_read_only(path: &Path) -> Result<Self, StoreError> {
        let file = open_file(path, false)?;
        Self::lock(path, &file, FileBackend::try_lock_shared_range)?;
        Ok(Self(file))
    }

    fn lock(
        path: &Path,
        file: &FileBackend,
        lock: impl FnOnce(&FileBackend, Bound<u64>, Bound<u64>) -> Result<bool, redb::BackendError>,
    ) -> Result<(), StoreError> {
        match lock(file, WHOLE.0, WHOLE.1) {
            // A file system without locks cannot refuse a second process. The engine accepts this too.
            Ok(true) | Err(redb::BackendError::Unsupported) => Ok(()),
            Ok(false) => Err(StoreError::Locked { path: path.into() }),
            Err(error) => Err(StoreError::from_io(path, error.into())),
        }
    }

    /// Returns the storage.
    pub(crate) fn storage(&self) -> &FileBackend {
        &self.0
    }

    /// Gives up the lock, so that the engine can take it on the same open file.
    pub(crate) fn unlock(self, path: &Path) -> Result<FileBackend, StoreError> {
        match self.0.unlock_range(WHOLE.0, WHOLE.1) {
            Ok(()) | Err(redb::BackendError::Unsupported) => Ok(self.0),
            Err(error) => Err(StoreError::from_io(path, error.into())),
        }
    }
}

fn open_file(path: &Path, writable: bool) -> Result<FileBackend, StoreError> {
    if path.is_dir() {
        return Err(StoreError::IsFolder { path: path.into() });
    }
    let file = OpenOptions::new().read(true).write(writable).open(path).map_err(|e| StoreError::from_io(path, e))?;
    FileBackend::new(file).map_err(|e| StoreError::from_engine(path, e))
}
