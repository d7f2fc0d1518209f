//! What became of transmissions, in as few bits as DCCL users can read.

use alloc::vec::Vec;

use crate::error::Error;

/// What became of a transmission at somebody who may have heard it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// It was listened for and not heard.
    Missed,
    /// It was heard.
    Heard,
    /// Nothing is said: whoever speaks did not listen, or does not know.
    Untold,
}

/// How outcomes stand in bytes.
pub(crate) struct Coded {
    /// [`PLAIN`], [`WITH_GAPS`] or [`FEW`].
    pub(crate) coding: u8,
    /// Bits of the last byte that mean nothing.
    pub(crate) unused: u8,
    pub(crate) bytes: Vec<u8>,
}

/// Every outcome is told: one bit each, heard 1, from the lowest bit of the first byte on.
const PLAIN: u8 = 0;

/// Five outcomes a byte, digits to base 3 (missed 0, heard 1, untold 2), the first the lowest.
const WITH_GAPS: u8 = 1;

/// A byte for each outcome that is told: 2 · (how many before it are not) + 1 for heard, 0 for missed.
const FEW: u8 = 2;

/// Outcomes of a byte with gaps.
const DIGITS: usize = 5;

/// How many untold outcomes a byte can skip before one that is told; as many are skipped by [`SKIP`].
const GAP_MAX: usize = 127;

/// The byte that only skips.
const SKIP: u8 = 2 * GAP_MAX as u8;

/// How long outcomes are in bytes, of which so many are told and so many are untold before the last of these.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutcomeCounts {
    /// Outcomes heard or missed.
    pub told: usize,
    /// Outcomes untold.
    pub untold: usize,
    /// For each run of untold ones its whole multiples of 127.
    pub skips: usize,
}

impl OutcomeCounts {
    /// Bytes that they take at most: the shortest of three forms counts.
    pub fn bytes_max(&self) -> usize {
        match self.untold {
            0 => self.told.div_ceil(8),
            _ => (self.told + self.untold).div_ceil(DIGITS).min(self.told + self.skips),
        }
    }

    /// How many untold outcomes in a row are one of [`OutcomeCounts::skips`].
    pub const SKIP: usize = GAP_MAX;
}

/// Outcomes in their only form: the shortest, the first of equals. Those at the end that say nothing are left out.
pub(crate) fn code(outcomes: &[Outcome]) -> Coded {
    let told = outcomes.iter().rposition(|&outcome| outcome != Outcome::Untold).map_or(0, |last| last + 1);
    let outcomes = &outcomes[..told];
    if outcomes.contains(&Outcome::Untold) {
        let (with_gaps, few) = (digits(outcomes), few(outcomes));
        return match few.len() < with_gaps.len() {
            true => Coded { coding: FEW, unused: 0, bytes: few },
            false => Coded { coding: WITH_GAPS, unused: 0, bytes: with_gaps },
        };
    }
    let bits = |part: &[Outcome]| part.iter().rev().fold(0, |value, outcome| value << 1 | digit(*outcome));
    let bytes: Vec<u8> = outcomes.chunks(8).map(bits).collect();
    Coded { coding: PLAIN, unused: (8 * bytes.len() - outcomes.len()) as u8, bytes }
}

fn digits(outcomes: &[Outcome]) -> Vec<u8> {
    let value = |part: &[Outcome]| part.iter().rev().fold(0, |value, outcome| 3 * value + digit(*outcome));
    let mut bytes: Vec<u8> = outcomes.chunks(DIGITS).map(value).collect();
    if let (Some(last), rest @ 1..) = (bytes.last_mut(), outcomes.len() % DIGITS) {
        *last += (rest..DIGITS).map(|place| digit(Outcome::Untold) * 3u8.pow(place as u32)).sum::<u8>();
    }
    bytes
}

fn few(outcomes: &[Outcome]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut gap = 0;
    for &outcome in outcomes {
        match outcome {
            Outcome::Untold => gap += 1,
            told => bytes.push(2 * core::mem::take(&mut gap) + digit(told)),
        }
        if usize::from(gap) == GAP_MAX {
            bytes.push(SKIP);
            gap = 0;
        }
    }
    bytes
}

/// What [`code`] made bytes of.
pub(crate) fn decode(coded: &Coded) -> Result<Vec<Outcome>, Error> {
    let digits = |base: u8, count: u32| {
        let places = move |&byte: &u8| (0..count).map(move |place| outcome(byte / base.pow(place) % base));
        coded.bytes.iter().flat_map(places).collect()
    };
    let mut outcomes: Vec<Outcome> = match coded.coding {
        PLAIN => digits(2, 8),
        WITH_GAPS => digits(3, DIGITS as u32),
        FEW => coded.bytes.iter().flat_map(|&byte| one_of_few(byte)).collect(),
        other => {
            let max = f64::from(FEW);
            return Err(Error::OutOfBounds { field: "coding".into(), min: 0.0, max, value: other.into() });
        }
    };
    outcomes.truncate(outcomes.len().saturating_sub(coded.unused.into()));
    let told = outcomes.iter().rposition(|&outcome| outcome != Outcome::Untold).map_or(0, |last| last + 1);
    outcomes.truncate(told);
    // What would not be written like this is not taken: a message has one form only.
    let again = code(&outcomes);
    let is_same = (again.coding, again.unused, &again.bytes) == (coded.coding, coded.unused, &coded.bytes);
    if is_same { Ok(outcomes) } else { Err(Error::Padding) }
}

fn one_of_few(byte: u8) -> impl Iterator<Item = Outcome> {
    let told = (byte < SKIP).then_some(outcome(byte % 2));
    core::iter::repeat_n(Outcome::Untold, usize::from(byte / 2)).chain(told)
}

fn digit(outcome: Outcome) -> u8 {
    match outcome {
        Outcome::Missed => 0,
        Outcome::Heard => 1,
        Outcome::Untold => 2,
    }
}

fn outcome(digit: u8) -> Outcome {
    match digit {
        0 => Outcome::Missed,
        1 => Outcome::Heard,
        _ => Outcome::Untold,
    }
}
