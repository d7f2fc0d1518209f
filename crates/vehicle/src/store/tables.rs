//! The tables of a store, and their content as values.

use std::path::Path;

use redb::{ReadTransaction, ReadableTable, TableDefinition, WriteTransaction};

use crate::store::error::StoreError;
use crate::store::identity::Identity;

/// Version of the layout that this program writes, and the latest that it reads.
pub(crate) const FORMAT: u32 = 1;

pub(crate) const META: TableDefinition<&str, &[u8]> = TableDefinition::new("meta");
pub(crate) const BASE: TableDefinition<u64, &[u8]> = TableDefinition::new("base");
pub(crate) const ENTRIES: TableDefinition<u64, &[u8]> = TableDefinition::new("entries");

const META_FORMAT: &str = "format";
const META_VEHICLE: &str = "vehicle";
const META_TEAM: &str = "team";

/// The content of a store.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Contents {
    /// The snapshot, if one was recorded.
    pub base: Option<Vec<u8>>,
    /// The entries that were appended after the snapshot, in order.
    pub entries: Vec<Vec<u8>>,
}

impl Contents {
    /// Returns the number of bytes of base and entries.
    pub(crate) fn len_bytes(&self) -> usize {
        self.base.as_ref().map_or(0, Vec::len) + self.entries.iter().map(Vec::len).sum::<usize>()
    }
}

/// Writes the identity and the version of the layout.
pub(crate) fn write_identity(transaction: &WriteTransaction, identity: &Identity) -> Result<(), redb::Error> {
    let mut meta = transaction.open_table(META)?;
    meta.insert(META_FORMAT, FORMAT.to_le_bytes().as_slice())?;
    meta.insert(META_VEHICLE, identity.vehicle.as_bytes())?;
    meta.insert(META_TEAM, identity.team_digest.as_slice())?;
    Ok(())
}

/// Appends entries. The first has the number `first`.
pub(crate) fn write_entries(
    transaction: &WriteTransaction,
    first: u64,
    entries: &[Vec<u8>],
) -> Result<(), redb::Error> {
    let mut table = transaction.open_table(ENTRIES)?;
    for (number, entry) in (first..).zip(entries) {
        table.insert(number, entry.as_slice())?;
    }
    Ok(())
}

/// Replaces the base and removes all entries.
pub(crate) fn write_base(transaction: &WriteTransaction, base: Option<&[u8]>) -> Result<(), redb::Error> {
    transaction.delete_table(ENTRIES)?;
    transaction.open_table(ENTRIES)?;
    let mut table = transaction.open_table(BASE)?;
    if let Some(base) = base {
        table.insert(0, base)?;
    }
    Ok(())
}

/// Reads the identity.
pub(crate) fn read_identity(path: &Path, transaction: &ReadTransaction) -> Result<Identity, StoreError> {
    let no_store = |problem: &str| StoreError::NotAStore { path: path.into(), problem: problem.into() };
    let meta = match transaction.open_table(META) {
        Ok(meta) => meta,
        Err(redb::TableError::Storage(error)) => return Err(StoreError::from_engine(path, error)),
        Err(_) => return Err(no_store("it is a database of another program")),
    };
    let field = |name: &str| -> Result<Vec<u8>, StoreError> {
        let value = meta.get(name).map_err(|e| StoreError::from_engine(path, e))?;
        value.map(|bytes| bytes.value().to_vec()).ok_or_else(|| no_store(&format!("it lacks the field {name:?}")))
    };
    let format = field(META_FORMAT)?.try_into().map(u32::from_le_bytes);
    let found = format.map_err(|_| no_store("its version is not a number of four bytes"))?;
    if found > FORMAT {
        return Err(StoreError::NewerFormat { path: path.into(), what: "format version", found, expected: FORMAT });
    }
    let vehicle = String::from_utf8(field(META_VEHICLE)?).map_err(|_| no_store("the vehicle's name is no text"))?;
    let team_digest = field(META_TEAM)?.try_into().map_err(|_| no_store("the digest of the team has not 32 bytes"))?;
    Ok(Identity { vehicle, team_digest })
}

/// Reads base and entries.
pub(crate) fn read_contents(path: &Path, transaction: &ReadTransaction) -> Result<Contents, StoreError> {
    let read = || -> Result<_, redb::Error> {
        let base = transaction.open_table(BASE)?.get(0)?.map(|bytes| bytes.value().to_vec());
        let mut entries = Vec::new();
        for row in transaction.open_table(ENTRIES)?.iter()? {
            let (number, entry) = row?;
            entries.push((number.value(), entry.value().to_vec()));
        }
        Ok((base, entries))
    };
    let (base, numbered) = read().map_err(|e| StoreError::from_engine(path, e))?;
    if let Some((expected, (found, _))) = (0_u64..).zip(&numbered).find(|(expected, (found, _))| expected != found) {
        return Err(StoreError::damaged(path, format!("entry {expected} is missing, the next one is {found}")));
    }
    Ok(Contents { base, entries: numbered.into_iter().map(|(_, entry)| entry).collect() })
}
