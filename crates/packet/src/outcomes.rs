//! Outcomes of transmissions, in the shortest of two simple codings.

use alloc::vec::Vec;

use crate::error::Error;

/// The outcome of a transmission at one receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The receiver listened and did not hear the transmission.
    Missed,
    /// The receiver heard the transmission.
    Heard,
    /// The report contains no outcome: the receiver did not listen, or does not know the outcome.
    Unreported,
}

/// Outcomes encoded as bytes.
pub(crate) struct Coded {
    /// [`PLAIN`] or [`WITH_GAPS`].
    pub(crate) coding: u8,
    /// Number of unused bits of the last byte.
    pub(crate) unused: u8,
    pub(crate) bytes: Vec<u8>,
}

/// Coding of outcomes that are all reported: one bit each, heard 1, from the lowest bit of the first byte on.
const PLAIN: u8 = 0;

/// Coding with five outcomes in each byte: digits to base 3 (missed 0, heard 1, unreported 2), the first outcome
/// lowest.
const WITH_GAPS: u8 = 1;

/// Number of outcomes in a byte with gaps.
const DIGITS: usize = 5;

/// Numbers of reported and unreported outcomes, from which the length in bytes follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutcomeCounts {
    /// Number of outcomes heard or missed.
    pub reported: usize,
    /// Number of unreported outcomes before the last reported outcome.
    pub unreported: usize,
}

impl OutcomeCounts {
    /// Returns the length of these outcomes in bytes.
    pub fn bytes(&self) -> usize {
        match self.unreported {
            0 => self.reported.div_ceil(8),
            _ => (self.reported + self.unreported).div_ceil(DIGITS),
        }
    }
}

/// Encodes outcomes in their shortest form. Unreported outcomes at the end are left out.
pub(crate) fn code(outcomes: &[Outcome]) -> Coded {
    let told = outcomes.iter().rposition(|&outcome| outcome != Outcome::Unreported).map_or(0, |last| last + 1);
    let outcomes = &outcomes[..told];
    if outcomes.contains(&Outcome::Unreported) {
        return Coded { coding: WITH_GAPS, unused: 0, bytes: digits(outcomes) };
    }
    let bits = |part: &[Outcome]| part.iter().rev().fold(0, |value, outcome| value << 1 | digit(*outcome));
    let bytes: Vec<u8> = outcomes.chunks(8).map(bits).collect();
    Coded { coding: PLAIN, unused: (8 * bytes.len() - outcomes.len()) as u8, bytes }
}

fn digits(outcomes: &[Outcome]) -> Vec<u8> {
    let value = |part: &[Outcome]| part.iter().rev().fold(0, |value, outcome| 3 * value + digit(*outcome));
    let mut bytes: Vec<u8> = outcomes.chunks(DIGITS).map(value).collect();
    if let (Some(last), rest @ 1..) = (bytes.last_mut(), outcomes.len() % DIGITS) {
        *last += (rest..DIGITS).map(|place| digit(Outcome::Unreported) * 3u8.pow(place as u32)).sum::<u8>();
    }
    bytes
}

/// Decodes the bytes that [`code`] made. Each list of outcomes has exactly one valid form.
pub(crate) fn decode(coded: &Coded) -> Result<Vec<Outcome>, Error> {
    let digits = |base: u8, count: u32| {
        let places = move |&byte: &u8| (0..count).map(move |place| outcome(byte / base.pow(place) % base));
        coded.bytes.iter().flat_map(places).collect()
    };
    let mut outcomes: Vec<Outcome> = match coded.coding {
        PLAIN => digits(2, 8),
        WITH_GAPS => digits(3, DIGITS as u32),
        other => {
            let max = f64::from(WITH_GAPS);
            return Err(Error::OutOfBounds { field: "coding".into(), min: 0.0, max, value: other.into() });
        }
    };
    outcomes.truncate(outcomes.len().saturating_sub(coded.unused.into()));
    let told = outcomes.iter().rposition(|&outcome| outcome != Outcome::Unreported).map_or(0, |last| last + 1);
    outcomes.truncate(told);
    // A form that the encoder would not write is refused, so each message has exactly one encoding.
    let again = code(&outcomes);
    let is_same = (again.coding, again.unused, &again.bytes) == (coded.coding, coded.unused, &coded.bytes);
    if is_same { Ok(outcomes) } else { Err(Error::Padding) }
}

fn digit(outcome: Outcome) -> u8 {
    match outcome {
        Outcome::Missed => 0,
        Outcome::Heard => 1,
        Outcome::Unreported => 2,
    }
}

fn outcome(digit: u8) -> Outcome {
    match digit {
        0 => Outcome::Missed,
        1 => Outcome::Heard,
        _ => Outcome::Unreported,
    }
}
