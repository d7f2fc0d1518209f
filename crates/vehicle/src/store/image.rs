//! [`Image`]: a copy of a storage in memory, which the engine may change freely.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use redb::StorageBackend;

use crate::store::error::StoreError;

/// A copy of a storage in memory.
pub(crate) struct Image {
    bytes: Mutex<Vec<u8>>,
    len_max: u64,
}

impl std::fmt::Debug for Image {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Image").field("len_max", &self.len_max).finish_non_exhaustive()
    }
}

impl Image {
    /// Copies a storage.
    pub(crate) fn new(path: &Path, storage: &impl StorageBackend) -> Result<Self, StoreError> {
        let from_io = |e| StoreError::from_io(path, e);
        let len = storage.len().map_err(from_io)?;
        let too_long = || StoreError::damaged(path, format!("its {len} bytes do not fit into memory"));
        let mut bytes = Vec::new();
        let len_bytes = usize::try_from(len).map_err(|_| too_long())?;
        bytes.try_reserve_exact(len_bytes).map_err(|_| too_long())?;
        bytes.resize(len_bytes, 0);
        storage.read(0, &mut bytes).map_err(from_io)?;
        // The engine adds a commit. More is a consequence of a wrong length in a damaged file.
        Ok(Self { bytes: Mutex::new(bytes), len_max: 2 * len + (16 << 20) })
    }

    /// Sets one byte.
    pub(crate) fn with_byte(self, offset: u64, byte: u8) -> Self {
        self.change(|bytes| {
            if let Some(place) = bytes.get_mut(offset as usize) {
                *place = byte;
            }
        });
        self
    }

    fn change<T>(&self, operation: impl FnOnce(&mut Vec<u8>) -> T) -> T {
        operation(&mut self.bytes.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Returns the places of `len` bytes at `offset`, if they lie in a storage of `end` bytes.
fn places(offset: u64, len: usize, end: usize) -> io::Result<std::ops::Range<usize>> {
    let first = usize::try_from(offset).map_err(|_| ErrorKind::UnexpectedEof)?;
    match first.checked_add(len) {
        Some(last) if last <= end => Ok(first..last),
        _ => Err(ErrorKind::UnexpectedEof.into()),
    }
}

impl StorageBackend for Image {
    fn len(&self) -> io::Result<u64> {
        Ok(self.change(|bytes| bytes.len() as u64))
    }

    fn read(&self, offset: u64, out: &mut [u8]) -> io::Result<()> {
        self.change(|bytes| {
            out.copy_from_slice(&bytes[places(offset, out.len(), bytes.len())?]);
            Ok(())
        })
    }

    fn set_len(&self, len: u64) -> io::Result<()> {
        if len > self.len_max {
            return Err(io::Error::new(ErrorKind::InvalidData, format!("the header asks for {len} bytes")));
        }
        self.change(|bytes| bytes.resize(len as usize, 0));
        Ok(())
    }

    fn sync_data(&self) -> io::Result<()> {
        Ok(())
    }

    fn write(&self, offset: u64, data: &[u8]) -> io::Result<()> {
        self.change(|bytes| {
            let places = places(offset, data.len(), bytes.len())?;
            bytes[places].copy_from_slice(data);
            Ok(())
        })
    }
}
