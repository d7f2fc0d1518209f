//! [`Store`]: the open store of one vehicle.

use std::path::{Path, PathBuf};

use redb::{Database, StorageBackend, WriteTransaction};

use crate::store::creation::{FreshStore, initialize};
use crate::store::engine::{catch_panics, commit, open_database, read_database};
use crate::store::error::StoreError;
use crate::store::identity::Identity;
use crate::store::locked_file::LockedFile;
use crate::store::tables::{Contents, write_base, write_entries};
use crate::store::verification::Verified;

/// A file is compacted when it is opened with more than this number of bytes in addition to twice its content.
const SLACK_BYTES: u64 = 1 << 20;

/// The open store of one vehicle. No other process can open it meanwhile.
///
/// After an error the store is closed: every later operation returns [`StoreError::Closed`].
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    /// `None` after an error.
    database: Option<Database>,
    /// Number of the next entry.
    next: u64,
}

impl Store {
    /// Opens the store at `path` and returns its content. A missing file becomes an empty store.
    ///
    /// Every checksum is verified. A file that holds much free space is compacted. Use
    /// [`open_or_recover`](crate::open_or_recover) to continue in spite of a damaged file.
    ///
    /// # Errors
    /// [`StoreError::Damaged`] if the content is not what was written; the file is unchanged then. Other variants name
    /// a wrong path, identity or version, a lock, or an error of the file system.
    pub fn open(path: &Path, identity: &Identity) -> Result<(Self, Contents), StoreError> {
        let file = match LockedFile::open(path) {
            Err(StoreError::Missing { .. }) => {
                FreshStore::new(path, identity, None)?.place(path)?;
                LockedFile::open(path)?
            }
            file => file?,
        };
        let verified = Verified::new(path, file.storage())?;
        Self::open_verified_file(path, file, &verified, identity)
    }

    /// Opens a store on a storage that is not a file, for example on a simulated disk. An empty storage becomes an
    /// empty store.
    ///
    /// # Errors
    /// As [`Store::open`]. A storage that lost power while it became a store is refused: begin with an empty one.
    pub fn open_on(storage: impl StorageBackend, identity: &Identity) -> Result<(Self, Contents), StoreError> {
        let path = Path::new("(storage)");
        if storage.len().map_err(|e| StoreError::from_io(path, e))? == 0 {
            let database = catch_panics(path, || initialize(path, storage, identity, None))?;
            return Ok((Self { path: path.into(), database: Some(database), next: 0 }, Contents::default()));
        }
        let verified = Verified::new(path, &storage)?;
        verified.identity.check(path, identity)?;
        verified.correct(path, &storage)?;
        Self::open_verified(path, storage)
    }

    /// Opens a file that the caller has locked and verified.
    pub(crate) fn open_verified_file(
        path: &Path,
        file: LockedFile,
        verified: &Verified,
        identity: &Identity,
    ) -> Result<(Self, Contents), StoreError> {
        verified.identity.check(path, identity)?;
        verified.correct(path, file.storage())?;
        Self::open_verified(path, file.unlock(path)?)
    }

    fn open_verified(path: &Path, storage: impl StorageBackend) -> Result<(Self, Contents), StoreError> {
        let len = storage.len().map_err(|e| StoreError::from_io(path, e))?;
        catch_panics(path, || {
            let mut database = open_database(path, storage)?;
            let (_, contents) = read_database(path, &database)?;
            if len > 2 * contents.len_bytes() as u64 + SLACK_BYTES {
                database.compact().map_err(|e| StoreError::from_engine(path, e))?;
            }
            let next = contents.entries.len() as u64;
            Ok((Self { path: path.into(), database: Some(database), next }, contents))
        })
    }

    /// Appends entries in one transaction. They survive a crash once this method has returned without an error.
    ///
    /// # Errors
    /// None of the entries is promised, and the store is closed. They may be there when it is opened again.
    pub fn append(&mut self, entries: &[Vec<u8>]) -> Result<(), StoreError> {
        let first = self.next;
        self.commit(|transaction| write_entries(transaction, first, entries))?;
        self.next += entries.len() as u64;
        Ok(())
    }

    /// Replaces the base and removes all entries, in one transaction. A crash leaves the old base with its entries, or
    /// the new base without any.
    ///
    /// Later entries use the free space. The next [`Store::open`] returns it to the file system.
    ///
    /// # Errors
    /// The store is closed. It has the old or the new content when it is opened again.
    pub fn replace_base(&mut self, base: &[u8]) -> Result<(), StoreError> {
        self.commit(|transaction| write_base(transaction, Some(base)))?;
        self.next = 0;
        Ok(())
    }

    /// Closes the store. A store that is dropped is closed as well, without the errors.
    ///
    /// # Errors
    /// Errors of the last writes. Entries and bases that were acknowledged are on the medium in any case.
    pub fn close(mut self) -> Result<(), StoreError> {
        let Some(database) = self.database.take() else { return Ok(()) };
        let path = &self.path;
        catch_panics(path, || database.close().map_err(|e| StoreError::from_engine(path, e)))
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn commit(&mut self, change: impl FnOnce(&WriteTransaction) -> Result<(), redb::Error>) -> Result<(), StoreError> {
        let path = &self.path;
        let database = self.database.take().ok_or_else(|| StoreError::Closed { path: path.clone() })?;
        self.database = Some(catch_panics(path, || commit(path, &database, change).map(|()| database))?);
        Ok(())
    }
}

impl Drop for Store {
    fn drop(&mut self) {
        if let Some(database) = self.database.take() {
            let _ = catch_panics(&self.path, || {
                drop(database);
                Ok(())
            });
        }
    }
}
