//! What rides along in a few spare bits of messages that hosts send anyway.

use pingmap_packet::Recent;

use crate::agent::Agent;
use crate::event::VehicleId;
use crate::memory::Arrived;
use crate::receipt::{Receipt, Refusal};

/// How old the newest outcome may be, in slots: what is told has as long to go before its number means another slot.
const AGE_SLOTS_MAX: u32 = Recent::NUMBERS / 2;

impl Agent {
    /// What to put into 7 to 64 spare bits of the next message of the host: the number of a slot, and what became of the latest
    /// transmissions of others up to it, one bit each ([`Recent`]); in two bytes, ten of them. Where the vehicle did not listen to
    /// one of these, as many that came before it, of the last 32 slots; `None` where there are not so many. Who reads it places
    /// these events where it knows itself that the others were: spare bits tell no positions. O(64 log N).
    ///
    /// `None`, too, for who is no member, and in a team that takes no spare bits ([`Team::spare_bits`](crate::Team::spare_bits)).
    pub fn recent(&self, time_s: f64, n_bits: usize) -> Option<u64> {
        let sender = self.memory.own.filter(|_| self.team().has_spare_bits())?;
        let count = Recent::outcomes_in(n_bits).ok()?;
        let now = self.team().slots.number(time_s)?;
        let first = now.saturating_sub(2 * Recent::NUMBERS + count as u32);
        let known = self.memory.outcomes_since(sender, self.team().slots.begin_s(first)?);
        let slots: Vec<u32> = self.memory.frames.slots_back(sender, now).take(AGE_SLOTS_MAX as usize + count).collect();
        let newest = (0..slots.len()).take_while(|&place| now - slots[place] < AGE_SLOTS_MAX);
        // Before the first slot of all there is nothing to tell.
        let run = |place: usize| &slots[place..slots.len().min(place + count)];
        let told = |place: usize| run(place).iter().map(|slot| known.get(slot).copied()).collect::<Option<Vec<bool>>>();
        let (newest, outcomes) = newest.filter_map(|place| Some((slots[place], told(place)?))).next()?;
        Some(Recent { newest: (newest % Recent::NUMBERS) as u8, outcomes }.encode())
    }

    /// Takes in what a member said in so many spare bits of a message that came at this time: of the slots with its number
    /// the latest that had begun by then. The bits may have waited for 32 slots. They are not sealed and may be wrong: where a report
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
        let now = self.team().slots.number(time_s).ok_or(Refusal::NoSlot { time_s })?;
        let age = (now % Recent::NUMBERS + Recent::NUMBERS - u32::from(newest)) % Recent::NUMBERS;
        Ok((now.checked_sub(age).ok_or(Refusal::NoSlot { time_s })?, outcomes))
    }
}
