//! The latest outcomes in a few spare bits of a message that a host sends anyway.

use alloc::vec::Vec;

use crate::error::Error;

/// What a vehicle heard and missed of late, in 7 to 64 bits: from the lowest on, six for the number of the newest two slots that
/// are spoken of, modulo [`Recent::NUMBERS`], then one for every slot back from the later one in which the vehicle could hear
/// somebody: 1 for heard, 0 for missed. The number is what keeps bits in step that had to wait in a queue, and says which are told
/// again. Two slots share one, which reaches twice as far back: where members take turns, one of them is often the vehicle's own.
///
/// ```
/// use pingmap_packet::Recent;
///
/// let recent = Recent { newest: 9, outcomes: [true, false, true].to_vec() };
/// assert_eq!(recent.encode(), 0b101_001001);
/// assert_eq!(Recent::decode(0b101_001001, 9)?, recent);
/// # Ok::<(), pingmap_packet::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recent {
    /// Number of the newest slots, modulo [`Recent::NUMBERS`]: that of a slot over [`Recent::SLOTS_PER_NUMBER`], rounded down.
    pub newest: u8,
    /// Whether the vehicle heard what was sent in these, and in those before: the newest first. 58 at most.
    pub outcomes: Vec<bool>,
}

/// Bits of the number.
const NUMBER_BITS: usize = 6;

impl Recent {
    /// Numbers that can be told apart.
    pub const NUMBERS: u32 = 1 << NUMBER_BITS;

    /// Slots in a row that have one number.
    pub const SLOTS_PER_NUMBER: u32 = 2;

    /// The later of the slots that have this number: the first of which a vehicle speaks, if it could hear somebody in it.
    pub fn last_slot(number: u32) -> u32 {
        number.saturating_mul(Self::SLOTS_PER_NUMBER).saturating_add(Self::SLOTS_PER_NUMBER - 1)
    }

    /// How many outcomes there are in so many bits.
    ///
    /// # Errors
    /// [`Error::OutOfBounds`] for fewer than 7 bits or more than 64.
    pub fn outcomes_in(n_bits: usize) -> Result<usize, Error> {
        if (NUMBER_BITS + 1..=64).contains(&n_bits) {
            return Ok(n_bits - NUMBER_BITS);
        }
        let value = n_bits as f64;
        Err(Error::OutOfBounds { field: "spare bits".into(), min: NUMBER_BITS as f64 + 1.0, max: 64.0, value })
    }

    /// The bits, the first the lowest.
    pub fn encode(&self) -> u64 {
        let outcomes = self.outcomes.iter().rev().fold(0, |bits, &heard| bits << 1 | u64::from(heard));
        outcomes << NUMBER_BITS | u64::from(u32::from(self.newest) % Self::NUMBERS)
    }

    /// What so many bits say.
    ///
    /// # Errors
    /// [`Error::OutOfBounds`] for fewer than 7 bits or more than 64, and for a value that has more bits than these.
    pub fn decode(bits: u64, n_bits: usize) -> Result<Self, Error> {
        let outcomes = Self::outcomes_in(n_bits)?;
        let max = u64::MAX >> (64 - n_bits);
        if bits > max {
            return Err(Error::OutOfBounds { field: "recent".into(), min: 0.0, max: max as f64, value: bits as f64 });
        }
        Ok(Self {
            newest: (bits % u64::from(Self::NUMBERS)) as u8,
            outcomes: (0..outcomes).map(|place| bits >> (NUMBER_BITS + place) & 1 == 1).collect(),
        })
    }
}
