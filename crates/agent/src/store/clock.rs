//! The clock of a vehicle, which bounds the slots and counters of frames that it accepts.

use std::collections::BTreeMap;

use crate::codec::receipt::Refusal;
use crate::store::entry::Entry;
use crate::team::config::Team;
use crate::team::slots::Slots;

/// Smallest lead of a slot over the vehicle's clock that is accepted, in seconds. Clocks differ, and hosts record
/// events late.
const SLOT_LEAD_S: f64 = 600.0;

/// Smallest accepted lead in cycles of the schedule. It exceeds [`SLOT_LEAD_S`] where cycles are long.
const SLOT_LEAD_CYCLES: f64 = 2.0;

/// Counters that are accepted in addition to those that the schedule allows a sender.
///
/// A sender that lost its memory skips one window of counters, which is at most this number
/// ([`crate::bounds::WINDOW`]).
pub const COUNTER_LEAD: u16 = 1024;

/// Frames that a sender may transmit in each of its slots. The longest packet of the WHOI Micro-Modem holds eight.
const FRAMES_PER_SLOT: u32 = 8;

/// Maximum number of frames of one sender that wait for the clock.
const WAITING_MAX: usize = 64;

/// The number of a frame that grows with time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum FrameNumber {
    /// Latest slot in a report or in piggybacked outcomes.
    Slot(u32),
    /// Counter of a summary packet.
    Counter(u16),
}

/// The latest time that the vehicle knows, and the frames that are ahead of it.
///
/// The windows of a sender follow its latest slot and its latest counter. A frame from a wrong clock or with a wrong
/// counter would end these windows for all correct frames. A vehicle therefore accepts a number only if its own clock
/// allows it. Other frames wait. Each sender has at most [`WAITING_MAX`] waiting frames, those with the smallest
/// numbers. The clock begins with the first slot.
#[derive(Debug, Clone)]
pub(crate) struct Clock {
    latest_s: f64,
    waiting: BTreeMap<u8, BTreeMap<(FrameNumber, Vec<u8>), Entry>>,
}

impl Clock {
    pub(crate) fn new(slots: &Slots) -> Self {
        Self { latest_s: slots.begin_s(0).unwrap_or(slots.start_s), waiting: BTreeMap::new() }
    }

    /// Returns the latest time of an own event, own position, reception or transmission, in seconds.
    pub(crate) fn latest_s(&self) -> f64 {
        self.latest_s
    }

    /// Advances the clock to a time. An earlier time changes nothing. Returns the waiting frames that the clock allows
    /// now.
    pub(crate) fn advance_to(&mut self, time_s: f64, team: &Team) -> Vec<Entry> {
        if time_s.is_nan() || time_s <= self.latest_s {
            return Vec::new();
        }
        self.latest_s = time_s;
        let mut allowed = Vec::new();
        for (&sender, waiting) in &mut self.waiting {
            let is_ahead =
                |((number, _), _): &((FrameNumber, Vec<u8>), Entry)| check(time_s, team, sender, *number).is_err();
            let (ahead, due): (BTreeMap<_, _>, BTreeMap<_, _>) =
                std::mem::take(waiting).into_iter().partition(is_ahead);
            *waiting = ahead;
            allowed.extend(due.into_values());
        }
        allowed
    }

    /// Admits a frame of this sender if the clock allows its number. Otherwise the frame, as `entry` returns it, waits.
    /// O(members of a cycle).
    pub(crate) fn admit(
        &mut self,
        team: &Team,
        sender: u8,
        number: FrameNumber,
        entry: impl FnOnce() -> Entry,
    ) -> Result<(), Refusal> {
        check(self.latest_s, team, sender, number).inspect_err(|_| self.wait(sender, number, entry()))
    }

    fn wait(&mut self, sender: u8, number: FrameNumber, entry: Entry) {
        // The bytes distinguish frames with one number.
        let bytes = match &entry {
            Entry::Piggyback { outcomes, .. } => outcomes.iter().map(|&heard| heard.into()).collect(),
            Entry::Received { bytes, .. } => bytes.clone(),
            _ => Vec::new(),
        };
        let waiting = self.waiting.entry(sender).or_default();
        waiting.insert((number, bytes), entry);
        if waiting.len() > WAITING_MAX {
            waiting.pop_last();
        }
    }

    pub(crate) fn waiting_of(&self, sender: u8) -> usize {
        self.waiting.get(&sender).map_or(0, |waiting| waiting.len())
    }

    pub(crate) fn waiting(&self) -> impl Iterator<Item = &Entry> {
        self.waiting.values().flat_map(|waiting| waiting.values())
    }
}

/// Checks a number of a frame against a time.
fn check(time_s: f64, team: &Team, sender: u8, number: FrameNumber) -> Result<(), Refusal> {
    let slots = &team.slots;
    let lead_s = SLOT_LEAD_S.max(SLOT_LEAD_CYCLES * slots.cycle_slots() as f64 * slots.duration_s);
    let latest = slots.latest(time_s + lead_s).unwrap_or(0);
    match number {
        FrameNumber::Slot(slot) if slot > latest => Err(Refusal::SlotAhead { slot, latest }),
        FrameNumber::Slot(_) => Ok(()),
        FrameNumber::Counter(counter) => {
            let transmissions = slots.transmissions(latest, team.members.get(&sender));
            let largest = transmissions.saturating_mul(FRAMES_PER_SLOT).saturating_add(COUNTER_LEAD.into());
            let largest = u16::try_from(largest).unwrap_or(u16::MAX);
            if counter <= largest { Ok(()) } else { Err(Refusal::CounterAhead { counter, largest }) }
        }
    }
}
