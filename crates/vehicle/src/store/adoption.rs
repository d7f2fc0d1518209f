//! Assigns a store to another team configuration.

use std::path::Path;

use crate::store::engine::{catch_panics, commit, open_database};
use crate::store::error::StoreError;
use crate::store::identity::Identity;
use crate::store::locked_file::LockedFile;
use crate::store::tables::{Contents, write_base, write_identity};
use crate::store::verification::Verified;

/// Assigns a store to another team configuration, and returns its former identity. The function `convert` makes the
/// base for the new configuration from the old identity and the content. Identity and base change in one
/// transaction. Nothing changes if the identity is the same.
///
/// The vehicle must be the same: the entries of one vehicle are wrong in the store of another.
///
/// # Errors
/// As [`Store::open`](crate::Store::open), except that the digest of the team may differ and that the file must exist.
/// Errors of `convert`.
pub fn adopt_store<E: From<StoreError>>(
    path: &Path,
    identity: &Identity,
    convert: impl FnOnce(&Identity, &Contents) -> Result<Vec<u8>, E>,
) -> Result<Identity, E> {
    let file = LockedFile::open(path)?;
    let verified = Verified::new(path, file.storage())?;
    verified.identity.check_vehicle(path, identity)?;
    if verified.identity == *identity {
        return Ok(verified.identity);
    }
    let base = convert(&verified.identity, &verified.contents)?;
    verified.correct(path, file.storage())?;
    let storage = file.unlock(path)?;
    catch_panics(path, || {
        let database = open_database(path, storage)?;
        commit(path, &database, |transaction| {
            write_identity(transaction, identity)?;
            write_base(transaction, Some(&base))
        })?;
        database.close().map_err(|e| StoreError::from_engine(path, e))
    })?;
    Ok(verified.identity)
}
