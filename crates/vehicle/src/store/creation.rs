//! Creation of a store under a temporary name, so that a file at its path is complete.

use std::path::Path;

use redb::backends::FileBackend;
use redb::{Database, StorageBackend};
use tempfile::NamedTempFile;

use crate::store::engine::{catch_panics, commit, open_database};
use crate::store::error::StoreError;
use crate::store::folder::{folder_of, sync_folder};
use crate::store::identity::Identity;
use crate::store::tables::{write_base, write_identity};

/// A complete store that does not have its name yet.
pub(crate) struct FreshStore(NamedTempFile);

impl FreshStore {
    /// Creates a store in the folder of `path`, with this base and no entries.
    pub(crate) fn new(path: &Path, identity: &Identity, base: Option<&[u8]>) -> Result<Self, StoreError> {
        let from_io = |e| StoreError::from_io(path, e);
        let file = temporary_file(path)?;
        let storage = FileBackend::new(file.reopen().map_err(from_io)?);
        let storage = storage.map_err(|e| StoreError::from_engine(path, e))?;
        catch_panics(path, || {
            let database = initialize(path, storage, identity, base)?;
            database.close().map_err(|e| StoreError::from_engine(path, e))
        })?;
        file.as_file().sync_all().map_err(from_io)?;
        Ok(Self(file))
    }

    /// Gives the store its name, if that is free. Returns whether it was.
    pub(crate) fn place(self, path: &Path) -> Result<bool, StoreError> {
        match self.0.persist_noclobber(path) {
            Ok(_) => sync_folder(path).map(|()| true),
            Err(error) if error.error.kind() == std::io::ErrorKind::AlreadyExists => Ok(false),
            Err(error) => Err(StoreError::from_io(path, error.error)),
        }
    }
}

/// Turns an empty storage into a store.
pub(crate) fn initialize(
    path: &Path,
    storage: impl StorageBackend,
    identity: &Identity,
    base: Option<&[u8]>,
) -> Result<Database, StoreError> {
    let database = open_database(path, storage)?;
    commit(path, &database, |transaction| {
        write_identity(transaction, identity)?;
        write_base(transaction, base)
    })?;
    Ok(database)
}

/// Creates an empty file next to `path`, with the permissions of an ordinary file.
fn temporary_file(path: &Path) -> Result<NamedTempFile, StoreError> {
    let mut prefix = path.file_name().unwrap_or_default().to_os_string();
    prefix.push(".new-");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The umask applies, as it does to other files.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let folder = folder_of(path);
    builder.tempfile_in(folder).map_err(|e| StoreError::from_io(path, e))
}
