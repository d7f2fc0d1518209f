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
    /// [`PLAIN`] or [`WITH_GAPS`].
    pub(crate) coding: u8,
    /// Bits of the last byte that mean nothing.
    pub(crate) unused: u8,
    pub(crate) bytes: Vec<u8>,
}

/// Every outcome is told: one bit each, heard 1, from the lowest bit of the first byte on.
pub(crate) const PLAIN: u8 = 0;

/// Five outcomes a byte, digits to base 3 (missed 0, heard 1, untold 2), the first the lowest.
pub(crate) const WITH_GAPS: u8 = 1;

/// Outcomes of a byte with gaps.
const DIGITS: usize = 5;

/// Bytes of so many outcomes.
pub(crate) fn coded_bytes(outcomes: usize, has_gaps: bool) -> usize {
    outcomes.div_ceil(if has_gaps { DIGITS } else { 8 })
}

/// Outcomes in their only form. Those at the end that say nothing are left out.
pub(crate) fn code(outcomes: &[Outcome]) -> Coded {
    let told = outcomes.iter().rposition(|&outcome| outcome != Outcome::Untold).map_or(0, |last| last + 1);
    let outcomes = &outcomes[..told];
    if outcomes.contains(&Outcome::Untold) {
        let digits = |part: &[Outcome]| part.iter().rev().fold(0, |value, outcome| 3 * value + digit(*outcome));
        let mut bytes: Vec<u8> = outcomes.chunks(DIGITS).map(digits).collect();
        if let (Some(last), rest @ 1..) = (bytes.last_mut(), outcomes.len() % DIGITS) {
            *last += (rest..DIGITS).map(|place| digit(Outcome::Untold) * 3u8.pow(place as u32)).sum::<u8>();
        }
        return Coded { coding: WITH_GAPS, unused: 0, bytes };
    }
    let bits = |part: &[Outcome]| part.iter().rev().fold(0, |value, outcome| value << 1 | digit(*outcome));
    let bytes: Vec<u8> = outcomes.chunks(8).map(bits).collect();
    Coded { coding: PLAIN, unused: (8 * bytes.len() - outcomes.len()) as u8, bytes }
}

/// What [`code`] made bytes of.
pub(crate) fn decode(coded: &Coded) -> Result<Vec<Outcome>, Error> {
    let (base, each) = match coded.coding {
        PLAIN => (2, 8),
        WITH_GAPS => (3, DIGITS),
        other => {
            let max = f64::from(WITH_GAPS);
            return Err(Error::OutOfBounds { field: "coding".into(), min: 0.0, max, value: other.into() });
        }
    };
    let place = |byte: u8, place: usize| outcome(u16::from(byte) / u16::pow(base, place as u32) % base);
    let mut outcomes: Vec<Outcome> =
        coded.bytes.iter().flat_map(|&byte| (0..each).map(move |digit| place(byte, digit))).collect();
    outcomes.truncate(outcomes.len().saturating_sub(coded.unused.into()));
    let told = outcomes.iter().rposition(|&outcome| outcome != Outcome::Untold).map_or(0, |last| last + 1);
    outcomes.truncate(told);
    // What would not be written like this is not taken: a message has one form only.
    let again = code(&outcomes);
    let is_same = (again.coding, again.unused, &again.bytes) == (coded.coding, coded.unused, &coded.bytes);
    if is_same { Ok(outcomes) } else { Err(Error::Padding) }
}

fn digit(outcome: Outcome) -> u8 {
    match outcome {
        Outcome::Missed => 0,
        Outcome::Heard => 1,
        Outcome::Untold => 2,
    }
}

fn outcome(digit: u16) -> Outcome {
    match digit {
        0 => Outcome::Missed,
        1 => Outcome::Heard,
        _ => Outcome::Untold,
    }
}
