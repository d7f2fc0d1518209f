//! What rides along in a few spare bits of messages that hosts send anyway.

use std::ops::Range;

use pingmap_packet::Recent;

use crate::agent::Agent;
use crate::event::VehicleId;
use crate::memory::Arrived;
use crate::receipt::{Receipt, Refusal};
use crate::tellings::{Aside, Of, Tellings};

/// Of how many numbers the newest may be: those that are left say how long a message may wait until its number means other slots.
const NUMBERS_BACK: u32 = Recent::NUMBERS * 3 / 4;

/// Slots in a row in all of which a vehicle could hear somebody and listened, and whether it heard: the newest first.
#[derive(Debug)]
struct Run {
    number: u32,
    outcomes: Vec<(u32, bool)>,
}

impl Run {
    fn slots(&self) -> Range<u32> {
        let slot = |end: Option<&(u32, bool)>| end.map_or(0, |&(slot, _)| slot);
        slot(self.outcomes.last())..slot(self.outcomes.first()) + 1
    }
}

impl Agent {
    /// What to put into 7 to 64 spare bits of the next message of the host, which leaves at `time_s`: what became of some of the
    /// latest transmissions of others, one bit each, and which these are ([`Recent`]); in two bytes, ten of them. They are ten in a
    /// row to all of which the vehicle listened, the newest of them in the last 96 slots: those of which others may be expected to
    /// learn most, by what it told in spare bits and reports before, and by what they say that they heard; of several, the
    /// latest. `None` where there are not so many in a row. Whoever asks twice in one slot is told the same. Who reads it places these events
    /// where it knows itself that the others were: spare bits tell no positions. O(64 log N), and O(slots) that were reported.
    ///
    /// `None`, too, for who is no member, and in a team that takes no spare bits ([`Team::spare_bits`](crate::Team::spare_bits)).
    pub fn recent(&mut self, time_s: f64, n_bits: usize) -> Option<u64> {
        let sender = self.memory.own.filter(|_| self.team().has_spare_bits())?;
        let count = Recent::outcomes_in(n_bits).ok()?;
        let runs = self.runs(sender, self.team().slots.number(time_s)?, count);
        let first = runs.iter().map(|run| run.slots().start).min()?;
        let sent_in = self.team().slots.next_turn(time_s, &self.id);
        self.asides.retain(|aside| aside.sent_in != sent_in && aside.slots.end > first);
        let tellings = Tellings::with_asides(&self.memory, sender, sent_in, &self.doubted(), &self.asides);
        let value =
            |run: &Run| run.outcomes.iter().map(|&(slot, _)| tellings.get(Of::Other, slot).learning).sum::<f64>();
        let best = runs.into_iter().max_by(|one, other| value(one).total_cmp(&value(other)))?;
        self.asides.push(Aside { sent_in, slots: best.slots() });
        let outcomes = best.outcomes.into_iter().map(|(_, heard)| heard).collect();
        Some(Recent { newest: (best.number % Recent::NUMBERS) as u8, outcomes }.encode())
    }

    /// The runs that it can speak of in this slot, the latest last. Those that begin before the first slot of all are shorter.
    fn runs(&self, sender: u8, now: u32, count: usize) -> Vec<Run> {
        let back = |number: u32| self.memory.frames.slots_back(sender, Recent::last_slot(number)).take(count);
        let newest = now / Recent::SLOTS_PER_NUMBER;
        let numbers = newest.saturating_sub(NUMBERS_BACK)..=newest;
        let begin_s = back(*numbers.start()).last().and_then(|first| self.team().slots.begin_s(first));
        let known = self.memory.outcomes_since(sender, begin_s.unwrap_or(f64::NEG_INFINITY));
        let run = |number: u32| {
            let outcomes = back(number).map(|slot| Some((slot, *known.get(&slot)?)));
            Some(Run { number, outcomes: outcomes.collect::<Option<_>>()? }).filter(|run| !run.outcomes.is_empty())
        };
        numbers.filter_map(run).collect()
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
        let now = self.team().slots.number(time_s).ok_or(Refusal::NoSlot { time_s })? / Recent::SLOTS_PER_NUMBER;
        let age = (now % Recent::NUMBERS + Recent::NUMBERS - u32::from(newest)) % Recent::NUMBERS;
        let number = now.checked_sub(age).ok_or(Refusal::NoSlot { time_s })?;
        Ok((Recent::last_slot(number), outcomes))
    }
}
