//! Access to the storage engine redb.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use redb::{Database, Durability, ReadableDatabase, StorageBackend, WriteTransaction};

use crate::store::error::StoreError;
use crate::store::identity::Identity;
use crate::store::tables::{Contents, read_contents, read_identity};

/// Bytes of the engine's page cache. The default of 1 GiB is too much for a vehicle.
const CACHE_BYTES: usize = 16 << 20;

/// Runs an operation of the engine and returns a panic as [`StoreError::Damaged`].
///
/// The engine asserts properties of its files. A file that was altered by a failing medium can violate them in places
/// that no checksum covers. A vehicle must start with a damaged file, too.
///
/// The operation owns the database, or the caller does not use it after an error. No broken invariant is observed.
pub(crate) fn catch_panics<T>(path: &Path, operation: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
    catch_unwind(AssertUnwindSafe(operation)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no text");
        Err(StoreError::damaged(path, format!("the storage engine failed: {text}")))
    })
}

/// Opens the database and checks every page. An empty storage becomes an empty database.
pub(crate) fn open_database(path: &Path, storage: impl StorageBackend) -> Result<Database, StoreError> {
    let mut builder = Database::builder();
    builder.set_cache_size(CACHE_BYTES).set_check_integrity_on_open(true);
    builder.create_with_backend(storage).map_err(|e| StoreError::from_engine(path, e))
}

/// Reads everything from an open database.
pub(crate) fn read_database(path: &Path, database: &Database) -> Result<(Identity, Contents), StoreError> {
    let transaction = database.begin_read().map_err(|e| StoreError::from_engine(path, e))?;
    Ok((read_identity(path, &transaction)?, read_contents(path, &transaction)?))
}

/// Commits one change. It is on the medium when this function returns without an error.
pub(crate) fn commit(
    path: &Path,
    database: &Database,
    change: impl FnOnce(&WriteTransaction) -> Result<(), redb::Error>,
) -> Result<(), StoreError> {
    let commit = || -> Result<(), redb::Error> {
        let mut transaction = database.begin_write()?;
        transaction.set_durability(Durability::Immediate)?;
        transaction.set_two_phase_commit(true);
        change(&transaction)?;
        Ok(transaction.commit()?)
    };
    commit().map_err(|e| StoreError::from_engine(path, e))
}
