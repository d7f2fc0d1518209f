//! The newest outcomes of a vehicle in a few unused bits of a message that its host sends anyway.

use alloc::vec::Vec;

use crate::error::Error;

/// The newest outcomes that a vehicle recorded, in 7 to 64 bits.
///
/// The lowest six bits are the number of the newest slot, modulo [`OutcomeBitmap::SLOT_MODULUS`]. Each following bit is
/// the outcome of one slot, from the newest slot back: 1 for heard, 0 for missed. Slots in which the vehicle could not
/// receive are left out. The slot number identifies the slots even if the host message waited in a queue.
///
/// ```
/// use pingmap_packet::OutcomeBitmap;
///
/// let bitmap = OutcomeBitmap { slot_mod: 9, outcomes: [true, false, true].to_vec() };
/// assert_eq!(bitmap.encode(), 0b101_001001);
/// assert_eq!(OutcomeBitmap::decode(0b101_001001, 9)?, bitmap);
/// # Ok::<(), pingmap_packet::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutcomeBitmap {
    /// Number of the newest slot, modulo [`OutcomeBitmap::SLOT_MODULUS`].
    pub slot_mod: u8,
    /// Whether the vehicle heard the message of each slot, the newest first. At most 58.
    pub outcomes: Vec<bool>,
}

/// Bits of the slot number.
const SLOT_BITS: usize = 6;

impl OutcomeBitmap {
    /// Number of distinct slot numbers.
    pub const SLOT_MODULUS: u32 = 1 << SLOT_BITS;

    /// Returns the number of outcomes that fit into `n_bits` bits.
    ///
    /// # Errors
    /// [`Error::OutOfBounds`] for fewer than 7 bits or more than 64.
    pub fn outcomes_in(n_bits: usize) -> Result<usize, Error> {
        if (SLOT_BITS + 1..=64).contains(&n_bits) {
            return Ok(n_bits - SLOT_BITS);
        }
        let value = n_bits as f64;
        Err(Error::OutOfBounds { field: "piggyback bits".into(), min: SLOT_BITS as f64 + 1.0, max: 64.0, value })
    }

    /// Returns the bits, with the slot number in the lowest six.
    pub fn encode(&self) -> u64 {
        let outcomes = self.outcomes.iter().rev().fold(0, |bits, &heard| bits << 1 | u64::from(heard));
        outcomes << SLOT_BITS | u64::from(u32::from(self.slot_mod) % Self::SLOT_MODULUS)
    }

    /// Decodes `n_bits` bits.
    ///
    /// # Errors
    /// [`Error::OutOfBounds`] for fewer than 7 bits or more than 64, and for a value with more than `n_bits` bits.
    pub fn decode(bits: u64, n_bits: usize) -> Result<Self, Error> {
        let outcomes = Self::outcomes_in(n_bits)?;
        let max = u64::MAX >> (64 - n_bits);
        if bits > max {
            return Err(Error::OutOfBounds {
                field: "piggyback".into(),
                min: 0.0,
                max: max as f64,
                value: bits as f64,
            });
        }
        Ok(Self {
            slot_mod: (bits % u64::from(Self::SLOT_MODULUS)) as u8,
            outcomes: (0..outcomes).map(|place| bits >> (SLOT_BITS + place) & 1 == 1).collect(),
        })
    }
}
