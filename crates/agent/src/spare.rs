//! What rides along in a few spare bits of messages that hosts send anyway.

use std::ops::Range;

use pingmap_packet::Recent;

use crate::agent::Agent;
use crate::event::VehicleId;
use crate::memory::Arrived;
use crate::receipt::{Receipt, Refusal};
use crate::tellings::{Aside, Of, Tellings};

/// How many numbers back the newest may be: those that are left say how long a message may wait until its number means other slots,
/// with a slot for clocks that differ.
const NUMBERS_BACK: u32 = Recent::NUMBERS * 3 / 4 - 1;

/// Slots in a row in all of which a vehicle could hear somebody and listened, and whether it heard: the newest first. There is one.
#[derive(Debug)]
struct Run {
    outcomes: Vec<(u32, bool)>,
}

impl Run {
    fn slots(&self) -> Range<u32> {
        let slot = |end: Option<&(u32, bool)>| end.map_or(0, |&(slot, _)| slot);
        slot(self.outcomes.last())..slot(self.outcomes.first()) + 1
    }

    fn number(&self) -> u32 {
        (self.slots().end - 1) / Recent::SLOTS_PER_NUMBER
    }
}

impl Agent {
    /// What to put into 7 to 64 spare bits of the next message of the host, which leaves at `time_s`: what became of some of the
    /// latest transmissions of others, one bit each, and which these are ([`Recent`]); in two bytes, ten of them. They are ten in a
    /// row to all of which the vehicle listened, the newest of them in the last 94 slots: those of which others may be expected to
    /// learn most, by what it told in spare bits and reports before, and by what they say that they heard; of several, the
    /// latest. `None` where there are not so many in a row. Whoever asks twice in one slot is told the same if nothing came in between. Who reads it places these events
    /// where it knows itself that the others were: spare bits tell no positions. O(64 log N), and O(slots) that were reported, for each other member.
    ///
    /// `None`, too, for who is no member, and in a team that takes no spare bits ([`Team::spare_bits`](crate::Team::spare_bits)).
    pub fn recent(&mut self, time_s: f64, n_bits: usize) -> Option<u64> {
        let sender = self.memory.own.filter(|_| self.team().has_spare_bits())?;
        let count = Recent::outcomes_in(n_bits).ok()?;
        let runs = self.runs(sender, self.team().slots.number(self.memory.reckoning.team_s(time_s))?, count);
        let first = runs.iter().map(|run| run.slots().start).min()?;
        let sent_in = self.memory.reckoning.departs_in(&self.team().slots, &self.id, time_s);
        // Nobody knows in which slot it sends where its clock is wrong.
        self.asides.retain(|aside| (sent_in.is_none() || aside.sent_in != sent_in) && aside.slots.end > first);
        let tellings = Tellings::with_asides(&self.memory, sender, sent_in, &self.doubted(), &self.asides);
        let value =
            |run: &Run| run.outcomes.iter().map(|&(slot, _)| tellings.get(Of::Other, slot).learning).sum::<f64>();
        let best = runs.into_iter().max_by(|one, other| value(one).total_cmp(&value(other)))?;
        self.asides.retain(|aside| aside.sent_in.is_some() || aside.slots != best.slots());
        self.asides.push(Aside { sent_in, slots: best.slots() });
        let newest = (best.number() % Recent::NUMBERS) as u8;
        let outcomes = best.outcomes.into_iter().map(|(_, heard)| heard).collect();
        Some(Recent { newest, outcomes }.encode())
    }

    /// The runs that it can speak of in this slot, the latest last. Those that begin before the first slot of all are shorter. The
    /// newest slot of each is of its number: none is told before its own time, by whatever clock.
    fn runs(&self, sender: u8, now: u32, count: usize) -> Vec<Run> {
        let number = |slot: u32| slot / Recent::SLOTS_PER_NUMBER;
        let oldest = number(now).saturating_sub(NUMBERS_BACK);
        let slots = self.memory.frames.slots_back(sender, Recent::last_slot(number(now)));
        let slots: Vec<u32> = slots.take(((NUMBERS_BACK + 1) * Recent::SLOTS_PER_NUMBER) as usize + count).collect();
        let begin_s = slots.last().and_then(|&first| self.team().slots.begin_s(first));
        let known = self.memory.outcomes_since(sender, begin_s.unwrap_or(f64::NEG_INFINITY));
        let is_newest = |place: usize| place == 0 || number(slots[place - 1]) != number(slots[place]);
        let run = |place: usize| {
            let slots = &slots[place..slots.len().min(place + count)];
            let outcomes = slots.iter().map(|&slot| Some((slot, *known.get(&slot)?)));
            Some(Run { outcomes: outcomes.collect::<Option<_>>()? })
        };
        let places = (0..slots.len()).rev().filter(|&place| number(slots[place]) >= oldest && is_newest(place));
        places.filter_map(run).collect()
    }

    /// Takes in what a member said in so many spare bits of a message that came at this time: of the slots with its number
    /// the latest that had begun by then. The bits may have waited for 30 slots. They are not sealed and may be wrong: where a report
    /// of the same member speaks of a slot, that counts.
    pub fn receive_recent(&mut self, sender: &VehicleId, time_s: f64, bits: u64, n_bits: usize) -> Receipt {
        let arrived = match self.read_recent(time_s, bits, n_bits) {
            Ok((newest, outcomes)) => self.memory.put_in_recent(sender, newest, &outcomes),
            Err(refusal) => Arrived::refused(None, refusal),
        };
        self.arrived(arrived)
    }

    fn read_recent(&self, time_s: f64, bits: u64, n_bits: usize) -> Result<(u32, Vec<bool>), Refusal> {
        let Recent { newest, outcomes } = Recent::decode(bits, n_bits).map_err(Refusal::Malformed)?;
        let now = self.team().slots.number(self.memory.reckoning.team_s(time_s));
        let now = now.ok_or(Refusal::NoSlot { time_s })? / Recent::SLOTS_PER_NUMBER;
        let age = (now % Recent::NUMBERS + Recent::NUMBERS - u32::from(newest)) % Recent::NUMBERS;
        let number = now.checked_sub(age).ok_or(Refusal::NoSlot { time_s })?;
        Ok((Recent::last_slot(number), outcomes))
    }
}
