//! Snapshots: a copy of the vehicle's memory in a file next to the store.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::store::error::StoreError;
use crate::store::folder::replace_file;

/// Writes a snapshot in one step: `path` holds the old snapshot or all of the new one, even after a power loss.
///
/// The content is first written to `path` with the suffix `.new`. A file that an interrupted call left there is
/// overwritten.
///
/// # Errors
/// [`StoreError::Full`], [`StoreError::NoPermission`] and others of the file system. The old snapshot remains.
pub fn write_snapshot(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    replace_file(path, |file| file.write_all(bytes))
}

/// Returns the snapshot at `path`.
///
/// # Errors
/// [`StoreError::Missing`] or [`StoreError::NoFolder`] if there is none, and errors of the file system.
pub fn read_snapshot(path: &Path) -> Result<Vec<u8>, StoreError> {
    fs::read(path).map_err(|e| StoreError::from_io(path, e))
}
