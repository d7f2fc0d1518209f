//! Piggybacked outcomes: the newest outcomes in unused bits of messages that hosts send anyway.

use pingmap_packet::OutcomeBitmap;

use crate::agent::receive::Reception;
use crate::agent::state::Agent;
use crate::codec::receipt::Refusal;
use crate::store::entry::Entry;
use crate::store::memory::Effect;
use crate::types::event::VehicleId;

/// Largest age of the newest slot, in slots. The rest of the modulus is the time that a message may wait in a queue.
const AGE_MAX: u32 = OutcomeBitmap::SLOT_MODULUS * 3 / 4 - 1;

impl Agent {
    /// Returns 7 to 64 bits with the vehicle's newest outcomes, for the next message of its host at `time_s`. Two bytes
    /// hold ten outcomes. They are the newest consecutive slots in which the vehicle could receive and recorded an
    /// outcome; the newest of them is at most 47 slots old. A receiver locates these events by the transmitter
    /// positions in its own events. O(log N).
    ///
    /// `None` without such slots, for a vehicle that is no member or does not send reports, and in a team without
    /// piggybacking; see [`Team::piggyback`](crate::Team::piggyback).
    pub fn piggyback(&self, time_s: f64, n_bits: usize) -> Option<u64> {
        let sender = self.memory.own.filter(|_| self.team().has_piggyback() && self.options.sharing.reports)?;
        let count = OutcomeBitmap::outcomes_in(n_bits).ok()?;
        let now = self.team().slots.number(time_s)?;
        let slots = self.memory.codec.slots_back(sender, now);
        let slots: Vec<u32> = slots.take(AGE_MAX as usize + 1 + count).collect();
        let begin_s = slots.last().and_then(|&first| self.team().slots.begin_s(first))?;
        let known = self.memory.outcomes_since(sender, begin_s);
        let outcomes: Vec<Option<bool>> = slots.iter().map(|slot| known.get(slot).copied()).collect();
        // Near the first slot of the mission there are fewer.
        let run = |place: usize| -> Option<Vec<bool>> {
            outcomes[place..outcomes.len().min(place + count)].iter().copied().collect()
        };
        let is_fresh = |place: &usize| now - slots[*place] <= AGE_MAX;
        let (newest, outcomes) =
            (0..slots.len()).take_while(is_fresh).find_map(|place| Some((slots[place], run(place)?)))?;
        Some(OutcomeBitmap { slot_mod: (newest % OutcomeBitmap::SLOT_MODULUS) as u8, outcomes }.encode())
    }

    /// Stores the outcomes that a member piggybacked on a message, which was received at `time_s`. Slot numbers mean
    /// the latest slots with these numbers that had begun by then. The bits are not authenticated: a report about the
    /// same slot replaces them.
    pub fn receive_piggyback(&mut self, sender: &VehicleId, time_s: f64, bits: u64, n_bits: usize) -> Reception {
        self.advance_clock(Some(time_s));
        let read = self.read_piggyback(time_s, bits, n_bits);
        let effect = match &read {
            Ok((newest, outcomes)) => self.memory.insert_piggyback(sender, *newest, outcomes),
            Err(refusal) => Err(refusal.clone()),
        };
        let effect = effect.unwrap_or_else(Effect::refused);
        *self.counts.entry(effect.receipt.class()).or_default() += 1;
        let receipt = self.note_effect(effect);
        let read = read.ok().filter(|_| receipt.is_stored());
        let entry = read.map(|(newest, outcomes)| Entry::Piggyback { sender: sender.clone(), newest, outcomes });
        Reception { receipt, entry }
    }

    fn read_piggyback(&self, time_s: f64, bits: u64, n_bits: usize) -> Result<(u32, Vec<bool>), Refusal> {
        let OutcomeBitmap { slot_mod, outcomes } = OutcomeBitmap::decode(bits, n_bits).map_err(Refusal::Malformed)?;
        let now = self.team().slots.number(time_s).ok_or(Refusal::NoSlot { time_s })?;
        let modulus = OutcomeBitmap::SLOT_MODULUS;
        let age = (now % modulus + modulus - u32::from(slot_mod)) % modulus;
        let newest = now.checked_sub(age).ok_or(Refusal::NoSlot { time_s })?;
        Ok((newest, outcomes))
    }
}
