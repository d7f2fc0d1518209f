//! The header of a redb file, as far as a store reads it before the engine does.
//!
//! The header has a magic number, one byte of flags, and two commit slots. A flag selects the slot that counts. No
//! checksum covers the flags. One altered bit could thus select the previous commit, in which the last entries are
//! missing. [`Header::newer_commit`] detects this case. The layout is described in redb's design document.

use std::path::Path;

use redb::StorageBackend;

use crate::store::error::StoreError;

const MAGIC: [u8; 9] = *b"redb\x1a\x0a\xa9\x0d\x0a";
/// A file that agrees with the magic number in this number of bytes was written by the engine.
const MAGIC_BYTES_MIN: usize = 5;

/// Offset of the byte of flags.
pub(crate) const FLAGS: u64 = MAGIC.len() as u64;
const FLAG_SECOND_SLOT: u8 = 1;
const FLAG_TWO_PHASE: u8 = 4;

const SLOTS: [usize; 2] = [64, 192];
const SLOT_TRANSACTION: usize = 104;
const HEADER_BYTES: usize = 320;
/// The length of a file is a multiple of a page.
const PAGE_BYTES: u64 = 4096;

/// Version of redb's file format. It is the first byte of a slot.
const ENGINE_FORMAT: u8 = 3;

/// The header of a file.
pub(crate) struct Header([u8; HEADER_BYTES]);

impl Header {
    /// Reads the header, and refuses a file that is not a store.
    pub(crate) fn read(path: &Path, storage: &impl StorageBackend) -> Result<Self, StoreError> {
        let from_io = |e| StoreError::from_io(path, e);
        let len = storage.len().map_err(from_io)?;
        let mut bytes = [0; HEADER_BYTES];
        let present = usize::try_from(len).map_or(HEADER_BYTES, |len| len.min(HEADER_BYTES));
        storage.read(0, &mut bytes[..present]).map_err(from_io)?;
        if is_foreign(&bytes[..present], len) {
            let problem = "it does not begin like one".into();
            return Err(StoreError::NotAStore { path: path.into(), problem });
        }
        if present < HEADER_BYTES {
            let problem = format!("the file has {present} bytes, but its header alone has {HEADER_BYTES}");
            return Err(StoreError::damaged(path, problem));
        }
        // Damage to one bit alters the version in one slot only.
        let [found, other] = SLOTS.map(|slot| bytes[slot]);
        if found == other && found > ENGINE_FORMAT {
            let (found, expected) = (found.into(), ENGINE_FORMAT.into());
            return Err(StoreError::NewerFormat { path: path.into(), what: "redb file format", found, expected });
        }
        Ok(Self(bytes))
    }

    /// Returns the flags that select the other slot, if that slot has a later commit.
    ///
    /// A crash within a commit leaves this state as well. The later commit is then complete or not. If both commits
    /// verify, the later one is used. It was acknowledged and a flag was altered, or it was about to be acknowledged.
    pub(crate) fn newer_commit(&self) -> Option<u8> {
        let flags = self.0[FLAGS as usize];
        let [first, second] = SLOTS.map(|slot| {
            let field = &self.0[slot + SLOT_TRANSACTION..][..8];
            field.iter().rev().fold(0_u64, |number, &byte| number << 8 | u64::from(byte))
        });
        let (selected, other) = if flags & FLAG_SECOND_SLOT == 0 { (first, second) } else { (second, first) };
        (flags & FLAG_TWO_PHASE != 0 && other > selected).then_some(flags ^ FLAG_SECOND_SLOT)
    }
}

/// Whether the file was not written by the engine.
///
/// A damaged store can begin with a few wrong bytes, with zeros, or with a lost sector. Its length is then still a
/// whole number of pages, and it does not begin with text, as most files of other kinds do.
fn is_foreign(bytes: &[u8], len: u64) -> bool {
    let present = bytes.len().min(MAGIC.len());
    let equal = bytes.iter().zip(MAGIC).filter(|&(&byte, expected)| byte == expected).count();
    let is_magic = equal >= MAGIC_BYTES_MIN.min(present);
    let is_zero = bytes.iter().all(|&byte| byte == 0);
    let has_lost_sector =
        len.is_multiple_of(PAGE_BYTES) && !bytes.iter().take(4).all(|byte| matches!(byte, b' '..=b'~'));
    !(is_magic || is_zero || has_lost_sector)
}
