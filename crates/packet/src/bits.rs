//! A stream of bits. Bit i of the stream is bit i mod 8, counted from the least significant, of byte i div 8.

use alloc::vec::Vec;

/// Writes numbers, least significant bit first.
#[derive(Debug, Default)]
pub(crate) struct BitWriter {
    bytes: Vec<u8>,
    bits: usize,
}

impl BitWriter {
    /// Appends the lowest `width` bits of `value` (width at most 64).
    pub(crate) fn write(&mut self, value: u64, width: u32) {
        for place in 0..width {
            if self.bits.is_multiple_of(8) {
                self.bytes.push(0);
            }
            if let Some(byte) = self.bytes.last_mut() {
                *byte |= (((value >> place) & 1) as u8) << (self.bits % 8);
            }
            self.bits += 1;
        }
    }

    /// Returns the bytes written so far. The last byte is padded with zeros.
    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// Reads the bits that [`BitWriter`] wrote.
#[derive(Debug)]
pub(crate) struct BitReader<'a> {
    bytes: &'a [u8],
    position: usize,
}

impl<'a> BitReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Returns the next `width` bits (at most 64), or `None` if fewer are left.
    pub(crate) fn read(&mut self, width: u32) -> Option<u64> {
        let end = self.position.checked_add(width as usize)?;
        if end > 8 * self.bytes.len() {
            return None;
        }
        let bit = |position: usize| u64::from(self.bytes[position / 8] >> (position % 8) & 1);
        let value = (0..width).fold(0, |value, place| value | bit(self.position + place as usize) << place);
        self.position = end;
        Some(value)
    }

    /// Skips to the next whole byte. Returns false if a skipped bit is set.
    pub(crate) fn align(&mut self) -> bool {
        let padding = (8 - self.position % 8) % 8;
        self.read(padding as u32) == Some(0)
    }

    /// Returns the number of whole bytes that were not read.
    pub(crate) fn bytes_left(&self) -> usize {
        self.bytes.len() - self.position.div_ceil(8)
    }
}

/// Overwrites `width` bits (at most 64) from bit `start` on. Bits behind the end of `bytes` are ignored.
pub(crate) fn overwrite(bytes: &mut [u8], start: usize, width: u32, value: u64) {
    for place in 0..width {
        let bit = start.saturating_add(place as usize);
        if let Some(byte) = bytes.get_mut(bit / 8) {
            *byte = *byte & !(1 << (bit % 8)) | (((value >> place) & 1) as u8) << (bit % 8);
        }
    }
}
