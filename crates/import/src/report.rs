//! What was found besides events.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_trial::EventLog;

use crate::clock::{Piece, median};
use crate::clocks::Clocks;
use crate::fleet::Fleet;
use crate::recording::Unknown;
use crate::transmission::{Proof, Reception, Transmission};

/// A log, and how it came about.
#[derive(Debug, Clone)]
pub struct Imported {
    /// The events, in the order of time.
    pub log: EventLog,
    /// What is known of each sender and receiver.
    pub pairs: BTreeMap<(VehicleId, VehicleId), Pair>,
    /// How transmissions are known.
    pub proofs: Proofs,
    /// The clocks against the reference.
    pub clocks: Vec<ClockFound>,
    /// From the beginning of a message to the record of its reception, beside the time that sound takes, in seconds.
    pub delay_s: f64,
    /// Clocks that may differ otherwise, in words.
    pub doubts: Vec<String>,
    /// What was not used.
    pub left_out: LeftOut,
    /// Senders of which only what somebody received is known, with commas: what all missed is not in the log.
    pub by_reception_alone: String,
    /// Senders of which only receivers know to whom they sent, with commas: what nobody heard of them is left out.
    pub whom_by_reception: String,
    /// Senders with turns of which nobody knows whether they were used, with commas.
    pub unused_turns: String,
}

impl Imported {
    /// How often each reason was found why nobody knows whether something was missed.
    pub fn unknown(&self) -> BTreeMap<Unknown, usize> {
        let mut all = BTreeMap::new();
        for (&reason, &count) in self.pairs.values().flat_map(|pair| &pair.unknown) {
            *all.entry(reason).or_default() += count;
        }
        all
    }
}

/// What is known of the messages from one vehicle to another.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Pair {
    /// Events that were heard.
    pub heard: usize,
    /// Events that were missed.
    pub missed: usize,
    /// What is no event, by reason.
    pub unknown: BTreeMap<Unknown, usize>,
    /// Messages that were meant for others.
    pub overheard: usize,
    /// Arrivals that were recorded twice.
    pub twice: usize,
    /// Messages that fit nothing which their sender recorded.
    pub stray: usize,
}

/// How transmissions are known, how many of each.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Proofs {
    /// By their senders' records.
    pub recorded: usize,
    /// By the word that somebody uses every turn.
    pub always_sends: usize,
    /// By a reception alone.
    pub received: usize,
    /// Not at all: turns.
    pub nothing: usize,
}

impl Proofs {
    pub(crate) fn of(sent: &[Vec<Transmission>]) -> Self {
        let count = |proof| sent.iter().flatten().filter(|sent| sent.proof == proof).count();
        Self {
            recorded: count(Proof::Recorded),
            always_sends: count(Proof::AlwaysSends),
            received: count(Proof::Received),
            nothing: count(Proof::Nothing),
        }
    }
}

/// What was recorded and is in no event.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Messages from somebody of whom nothing was recorded.
    pub strangers: BTreeMap<VehicleId, usize>,
    /// Messages to somebody of whom nothing was recorded, as often as they were recorded.
    pub to_strangers: BTreeMap<VehicleId, usize>,
    /// Arrivals that were recorded twice.
    pub twice: usize,
    /// Messages that a vehicle heard of itself.
    pub own: usize,
    /// Messages that were meant for others.
    pub overheard: usize,
    /// Messages of senders that recorded no such transmission, which are no events, and of senders that had no turn then, which
    /// are.
    pub unexpected: BTreeMap<VehicleId, usize>,
    /// Fixes that are no place in the log.
    pub unplaced: usize,
}

/// A clock, by what was sent and heard.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockFound {
    /// Whose.
    pub vehicle: VehicleId,
    /// Whether the others are compared with it.
    pub is_reference: bool,
    /// How far ahead it is, between times when it was set; empty where nothing is known.
    pub pieces: Vec<Piece>,
    /// Messages that speak of it.
    pub comparisons: usize,
    /// Half of them are off by less than this.
    pub off_s: f64,
}

impl ClockFound {
    pub(crate) fn all(fleet: &Fleet, clocks: &Clocks, receptions: &[Reception]) -> Vec<Self> {
        let comparisons = clocks.comparisons(fleet, receptions);
        let of = |(number, clock): (usize, &crate::clock::Clock)| {
            let own = comparisons.iter().filter(|comparison| [comparison.early.0, comparison.late.0].contains(&number));
            let off_s: Vec<f64> = own.map(|comparison| comparison.residual_s(&clocks.clocks).abs()).collect();
            Self {
                vehicle: fleet.vehicles[number].name.clone(),
                is_reference: number == clocks.reference,
                pieces: if clock.known { clock.pieces().copied().collect() } else { Vec::new() },
                comparisons: off_s.len(),
                off_s: median(off_s),
            }
        };
        clocks.clocks.iter().enumerate().map(of).collect()
    }
}
