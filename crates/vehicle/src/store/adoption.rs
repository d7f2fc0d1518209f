//! Giving a store to another team configuration.

use std::path::Path;

use crate::store::engine::{catch_panics, commit, open_database};
use crate::store::error::StoreError;
use crate::store::identity::Identity;
use crate::store::locked_file::LockedFile;
use crate::store::tables::write_identity;
use crate::store::verification::Verified;

/// Keeps base and entries of a store under another team configuration, and returns its former identity.
///
/// The vehicle must be the same: the entries of one vehicle are wrong in the store of another.
///
/// # Errors
/// As [`Store::open`](crate::Store::open), except that the digest of the team may differ and that the file must exist.
pub fn adopt_store(path: &Path, identity: &Identity) -> Result<Identity, StoreError> {
    let file = LockedFile::open(path)?;
    let verified = Verified::new(path, file.storage())?;
    verified.identity.check_vehicle(path, identity)?;
    verified.correct(path, file.storage())?;
    let storage = file.unlock(path)?;
    catch_panics(path, || {
        let database = open_database(path, storage)?;
        commit(path, &database, |transaction| write_identity(transaction, identity))?;
        database.close().map_err(|e| StoreError::from_engine(path, e))
    })?;
    Ok(verified.identity)
}
