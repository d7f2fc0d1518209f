//! Opens the store of a vehicle, and replaces a damaged store.

use std::path::{Path, PathBuf};

use crate::store::creation::FreshStore;
use crate::store::error::StoreError;
use crate::store::folder::{copy_damaged, keep_damaged};
use crate::store::identity::Identity;
use crate::store::locked_file::LockedFile;
use crate::store::snapshot::{read_snapshot, write_snapshot};
use crate::store::tables::Contents;
use crate::store::vehicle_store::Store;
use crate::store::verification::Verified;

/// How a store was opened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Opened {
    /// The store had its content, every entry that was acknowledged.
    Intact(Contents),
    /// There was neither a store nor a snapshot. The store is empty.
    New,
    /// The store was damaged or missing. A fresh one has taken its place, with a base that continues the snapshot.
    Recovered {
        /// The name under which the damaged file was kept. `None` if the store was missing.
        kept_as: Option<PathBuf>,
        /// The snapshot, if there was one.
        snapshot: Option<Vec<u8>>,
        /// Description of the damage.
        problem: String,
    },
}

/// Opens the store at `path`. A store that is damaged or missing is replaced by a fresh one, which begins with the
/// snapshot at `snapshot_path`.
///
/// A damaged file is never deleted or changed. A damaged store is renamed to `NAME.damaged-1`, or to the next number
/// that is free. A damaged snapshot is copied to a name of this form. After a crash within this function, the next call
/// recovers again.
///
/// # Errors
/// Every state that is not damage: a lock, another vehicle or team, a newer version, a file that is not a store, a
/// folder, a missing folder, missing permissions, a full medium. The store is unchanged then.
pub fn open_or_recover(path: &Path, snapshot_path: &Path, identity: &Identity) -> Result<(Store, Opened), StoreError> {
    open_or_recover_with(path, snapshot_path, identity, |snapshot, _| Recovery {
        base: snapshot.map(<[u8]>::to_vec),
        uses_snapshot: snapshot.is_some(),
    })
}

/// The begin of a fresh store.
pub(crate) struct Recovery {
    /// Its base, if it has one.
    pub(crate) base: Option<Vec<u8>>,
    /// Whether the base continues the snapshot. A snapshot that is not used is kept under another name.
    pub(crate) uses_snapshot: bool,
}

/// Opens the store as [`open_or_recover`] does, with another base for a fresh store. `recover` gets the snapshot and a
/// description of the damage. The base replaces the snapshot, and is in the fresh store before the store has its name:
/// what the recovery changes survives a crash, and a second damage.
pub(crate) fn open_or_recover_with(
    path: &Path,
    snapshot_path: &Path,
    identity: &Identity,
    recover: impl FnOnce(Option<&[u8]>, &str) -> Recovery,
) -> Result<(Store, Opened), StoreError> {
    let (damaged, problem) = match LockedFile::open(path) {
        Ok(file) => match open_verified(path, file, identity)? {
            Outcome::Intact(store, contents) => return Ok((store, Opened::Intact(contents))),
            Outcome::Damaged(file, problem) => (Some(file), problem),
        },
        Err(StoreError::Missing { .. }) => (None, "the store is missing, although it has a snapshot".to_string()),
        Err(error) => return Err(error),
    };
    let (snapshot, has_snapshot, problem) = match read_snapshot(snapshot_path) {
        Ok(snapshot) => (Some(snapshot), true, problem),
        Err(StoreError::Missing { .. } | StoreError::NoFolder { .. }) if damaged.is_none() => {
            return Ok((replace(path, identity, None, None)?.0, Opened::New));
        }
        Err(StoreError::Missing { .. } | StoreError::NoFolder { .. }) => (None, false, problem),
        Err(StoreError::Damaged { problem: of_snapshot, .. }) => {
            (None, true, format!("{problem}; its snapshot is damaged: {of_snapshot}"))
        }
        Err(error) => return Err(error),
    };
    let Recovery { base, uses_snapshot } = recover(snapshot.as_deref(), &problem);
    if has_snapshot && !uses_snapshot {
        copy_damaged(snapshot_path)?;
    }
    if let Some(base) = &base {
        write_snapshot(snapshot_path, base)?;
    }
    let (store, kept_as) = replace(path, identity, base.as_deref(), damaged)?;
    Ok((store, Opened::Recovered { kept_as, snapshot, problem }))
}

enum Outcome {
    Intact(Store, Contents),
    Damaged(LockedFile, String),
}

fn open_verified(path: &Path, file: LockedFile, identity: &Identity) -> Result<Outcome, StoreError> {
    match Verified::new(path, file.storage()) {
        Ok(verified) => match Store::open_verified_file(path, file, &verified, identity) {
            Ok((store, contents)) => Ok(Outcome::Intact(store, contents)),
            // The copy in memory was right, and reading the file again gave something else.
            Err(StoreError::Damaged { problem, .. }) => Ok(Outcome::Damaged(LockedFile::open(path)?, problem)),
            Err(error) => Err(error),
        },
        Err(StoreError::Damaged { problem, .. }) => Ok(Outcome::Damaged(file, problem)),
        Err(error) => Err(error),
    }
}

/// Renames the damaged store, if there is one, and puts a fresh one in its place. The fresh one is complete before the
/// damaged one loses its name. Returns the open store and the new name of the damaged one.
///
/// The damaged file stays locked until the fresh one is in place. Two processes thus cannot recover one store.
fn replace(
    path: &Path,
    identity: &Identity,
    base: Option<&[u8]>,
    damaged: Option<LockedFile>,
) -> Result<(Store, Option<PathBuf>), StoreError> {
    let fresh = FreshStore::new(path, identity, base)?;
    let kept_as = damaged.as_ref().map(|_| keep_damaged(path)).transpose()?;
    if !fresh.place(path)? {
        // Another process created the store in the same moment.
        return Err(StoreError::Locked { path: path.into() });
    }
    let (store, _) = Store::open(path, identity)?;
    Ok((store, kept_as))
}
