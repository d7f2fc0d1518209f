//! Which transmissions there were: what was not sent was not missed.

use std::collections::{BTreeMap, BTreeSet};

use crate::clock::Reckoning;
use crate::event::VehicleId;
use crate::events::{Events, Recorded};
use crate::frames::{Frames, ToldKey};
use crate::reports::{EVERY_SLOT, Reports, Said};

/// What is known of who sent in which slot.
pub(crate) struct Turns<'a> {
    frames: &'a Frames,
    reports: &'a Reports,
    /// Who heard something in which slot.
    heard: BTreeMap<u32, BTreeSet<u8>>,
    /// What of the vehicle's own events counts as it stands, and who it is.
    reckoning: &'a Reckoning,
    own: Option<&'a VehicleId>,
}

impl<'a> Turns<'a> {
    /// Of what everybody said. O(events + told), each with a logarithm; O(1) where all send in all their slots.
    pub(crate) fn new(
        frames: &'a Frames,
        own: Option<u8>,
        events: &Events,
        reports: &'a Reports,
        reckoning: &'a Reckoning,
    ) -> Self {
        let mut heard = BTreeMap::<u32, BTreeSet<u8>>::new();
        if may_be_silent(frames, reports) {
            let recorded = events.recorded().iter().filter(|known| known.event.success).filter_map(|known| known.key);
            let ahead = reckoning.outcomes.iter().filter(|(_, heard)| **heard).map(|(&slot, _)| slot);
            let ahead = own.into_iter().flat_map(|own| ahead.clone().map(move |slot| (own, slot)));
            let told = reports.senders().flat_map(|sender| {
                let heard = reports.outcomes(sender, EVERY_SLOT).filter(|(_, said, _)| *said == Said::Heard);
                heard.map(move |(slot, ..)| (sender, slot))
            });
            for (receiver, slot) in recorded.chain(ahead).chain(told) {
                heard.entry(slot).or_default().insert(receiver);
            }
        }
        let own = own.and_then(|own| frames.team.members.get(&own));
        Self { frames, reports, heard, reckoning, own }
    }

    /// Whether any event may be none.
    pub(crate) fn are_in_doubt(frames: &Frames, reports: &Reports, reckoning: &Reckoning) -> bool {
        may_be_silent(frames, reports) || !reckoning.is_right()
    }

    /// Whether what became of this transmission at somebody is an event: its sender says that it sent, or always does, or yet another
    /// one heard it. It is asked of what was heard as of what was missed: if hearing alone were proof enough for itself, what is
    /// heard would count and what is missed would wait.
    ///
    /// Of those who send at will it is the word of the sender alone: what somebody missed of them is known by it only. Where clocks
    /// differ, what was heard may seem to be of the slot before or after.
    pub(crate) fn was_sent(&self, transmitter: u8, (receiver, slot): ToldKey, success: bool) -> bool {
        if self.frames.team.slots.at_will {
            return match success {
                true => self.reports.sent_about(transmitter, slot, self.frames.team.slots.at_once() as u32).is_some(),
                false => self.reports.turn(transmitter, slot) == Some(true),
            };
        }
        let heard = |is_asked: &dyn Fn(u8) -> bool| {
            self.heard.get(&slot).is_some_and(|members| members.iter().any(|&member| is_asked(member)))
        };
        match self.reports.turn(transmitter, slot) {
            Some(true) => true,
            // Whoever says so has lost its memory.
            Some(false) => heard(&|_| true),
            None => {
                let id = self.frames.team.members.get(&transmitter);
                let always = id.is_none_or(|id| self.frames.team.slots.always_sends(id));
                always || heard(&|member| member != receiver)
            }
        }
    }

    /// The same of something that the vehicle recorded itself. Of those who do not keep to its schedule it does not know what it
    /// missed, and so what it heard does not count either. What it recorded while its clock was wrong counts as of the slots that it
    /// was in ([`Reckoning::outcomes`]), and not as it stands.
    pub(crate) fn is_event(&self, Recorded { key, event, .. }: &Recorded) -> bool {
        let sender = self.frames.team.number(&event.transmitter_id);
        // Of what members send at will nobody says anything once slots have no numbers left.
        let is_at_will = self.frames.team.slots.at_will && sender.is_some();
        (Some(&event.receiver_id) != self.own || self.reckoning.counts(event))
            && sender.zip(*key).map_or(!is_at_will, |(sender, key)| self.was_sent(sender, key, event.success))
    }
}

/// Whether anybody was, or may have been, silent in a slot of its own.
pub(crate) fn may_be_silent(frames: &Frames, reports: &Reports) -> bool {
    frames.team.slots.at_will || !frames.team.slots.may_be_silent.is_empty() || reports.has_turns()
}
