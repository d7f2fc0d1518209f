//! Snapshots: a copy of the vehicle's memory in a file next to the store.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::store::error::StoreError;
use crate::store::folder::replace_file;

/// Bytes of the checksum at the end of a snapshot.
const CHECK_BYTES: usize = 8;

/// Writes a snapshot and its checksum in one step: `path` holds the old snapshot or all of the new one, even after a
/// power loss.
///
/// The content is first written to `path` with the suffix `.new`. A file that an interrupted call left there is
/// overwritten.
///
/// # Errors
/// [`StoreError::Full`], [`StoreError::NoPermission`] and others of the file system. The old snapshot remains.
pub fn write_snapshot(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    replace_file(path, |file| file.write_all(bytes).and_then(|()| file.write_all(&checksum(bytes))))
}

/// Returns the snapshot at `path`.
///
/// # Errors
/// [`StoreError::Missing`] or [`StoreError::NoFolder`] if there is none, [`StoreError::Damaged`] if its checksum does
/// not fit, and errors of the file system.
pub fn read_snapshot(path: &Path) -> Result<Vec<u8>, StoreError> {
    let mut bytes = fs::read(path).map_err(|e| StoreError::from_io(path, e))?;
    let check = bytes.split_off(bytes.len().saturating_sub(CHECK_BYTES));
    if check != checksum(&bytes) {
        return Err(StoreError::damaged(path, "its checksum does not fit"));
    }
    Ok(bytes)
}

fn checksum(bytes: &[u8]) -> Vec<u8> {
    blake3::hash(bytes).as_bytes()[..CHECK_BYTES].to_vec()
}
