//! Unpacked content in one temporary file without a name. The system removes the file when the process ends, however
//! it ends.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::Arc;

use crate::interruptible::Interruptible;

/// Number of bytes that are copied at once.
const BLOCK_BYTES: usize = 1 << 16;

/// Largest number of files that are unpacked.
const FILES_MAX: usize = 100_000;

/// The unnamed file, up to a limit of bytes.
pub struct Unpacked {
    file: Option<Arc<File>>,
    length: u64,
    limit_bytes: u64,
    files: usize,
}

/// The content of one unpacked file.
#[derive(Clone)]
pub struct Section {
    file: Arc<File>,
    start: u64,
    pub length: u64,
    position: u64,
}

impl Unpacked {
    pub fn new(limit_bytes: u64) -> Self {
        Self { file: None, length: 0, limit_bytes, files: 0 }
    }

    /// Copies content to the end of the unnamed file.
    ///
    /// # Errors
    /// If the content cannot be read, or exceeds what the limit leaves.
    pub fn add(&mut self, content: impl Read) -> io::Result<Section> {
        self.files += 1;
        if self.files > FILES_MAX {
            return Err(io::Error::other(format!("more than {FILES_MAX} files to unpack; expected fewer")));
        }
        let file = match &self.file {
            Some(file) => file.clone(),
            None => self.file.insert(Arc::new(tempfile::tempfile()?)).clone(),
        };
        let (start, mut block, mut content) = (self.length, vec![0; BLOCK_BYTES], Interruptible(content));
        loop {
            let read = match content.read(&mut block) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                read => read?,
            };
            if read == 0 {
                return Ok(Section { file, start, length: self.length - start, position: 0 });
            }
            if read as u64 > self.limit_bytes - self.length {
                let problem = format!(
                    "archives and standard input hold more than {} GB; expected less, or a larger --unpacked-max",
                    self.limit_bytes as f64 * 1e-9
                );
                return Err(io::Error::other(problem));
            }
            // Reading a section of the same file moves its position.
            (&*file).seek(SeekFrom::Start(self.length))?;
            (&*file).write_all(&block[..read])?;
            self.length += read as u64;
        }
    }
}

impl Read for Section {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.length.saturating_sub(self.position);
        let count = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        self.file.as_ref().seek(SeekFrom::Start(self.start + self.position))?;
        let read = self.file.as_ref().read(&mut buffer[..count])?;
        self.position += read as u64;
        Ok(read)
    }
}

impl Seek for Section {
    fn seek(&mut self, target: SeekFrom) -> io::Result<u64> {
        let position = match target {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(offset) => self.length.checked_add_signed(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
        };
        self.position = position.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.position)
    }
}
