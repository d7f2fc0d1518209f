//! Which transmissions there were: what was not sent was not missed.

use std::collections::{BTreeMap, BTreeSet};

use crate::clock::Reckoning;
use crate::event::VehicleId;
use crate::events::{Events, Recorded};
use crate::frames::{Frames, ToldKey};
use crate::reports::{EVERY_SLOT, Reports, Said};

/// What is known of single transmissions.
#[derive(Clone, Copy)]
pub(crate) struct Known<'a> {
    pub(crate) frames: &'a Frames,
    /// Who knows it.
    pub(crate) own: Option<u8>,
    pub(crate) events: &'a Events,
    pub(crate) reports: &'a Reports,
    pub(crate) reckoning: &'a Reckoning,
}

/// What is known of who sent in which slot.
pub(crate) struct Turns<'a> {
    known: Known<'a>,
    /// Who heard something in which slot.
    heard: BTreeMap<u32, BTreeSet<u8>>,
    own_id: Option<&'a VehicleId>,
}

impl Known<'_> {
    /// Whether any event may be none.
    pub(crate) fn is_in_doubt(&self) -> bool {
        self.may_be_silent() || !self.reckoning.is_right()
    }

    /// Whether anybody was, or may have been, silent in a slot of its own.
    pub(crate) fn may_be_silent(&self) -> bool {
        let slots = &self.frames.team.slots;
        slots.at_will || !slots.may_be_silent.is_empty() || self.reports.has_turns()
    }
}

impl<'a> Turns<'a> {
    /// Of what everybody said. O(events + told), each with a logarithm; O(1) where all send in all their slots.
    pub(crate) fn new(known: Known<'a>) -> Self {
        let Known { frames, own, events, reports, reckoning } = known;
        let mut heard = BTreeMap::<u32, BTreeSet<u8>>::new();
        if known.may_be_silent() {
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
        Self { known, heard, own_id: own.and_then(|own| frames.team.members.get(&own)) }
    }

    /// Whether what became of this transmission at somebody is an event: its sender says that it sent, or always does, or yet another
    /// one heard it. It is asked of what was heard as of what was missed: if hearing alone were proof enough for itself, what is
    /// heard would count and what is missed would wait.
    ///
    /// Of those who send at will it is the word of the sender alone: what somebody missed of them is known by it only. Where clocks
    /// differ, what was heard may seem to be of the slot before or after.
    pub(crate) fn was_sent(&self, transmitter: u8, (receiver, slot): ToldKey, success: bool) -> bool {
        if self.known.frames.team.slots.at_will {
            return match success {
                true => self
                    .known
                    .reports
                    .sent_about(transmitter, slot, self.known.frames.team.slots.at_once() as u32)
                    .is_some(),
                false => self.known.reports.turn(transmitter, slot) == Some(true),
            };
        }
        let heard = |is_asked: &dyn Fn(u8) -> bool| {
            self.heard.get(&slot).is_some_and(|members| members.iter().any(|&member| is_asked(member)))
        };
        match self.known.reports.turn(transmitter, slot) {
            Some(true) => true,
            // Whoever says so has lost its memory.
            Some(false) => heard(&|_| true),
            None => {
                let id = self.known.frames.team.members.get(&transmitter);
                let always = id.is_none_or(|id| self.known.frames.team.slots.always_sends(id));
                always || heard(&|member| member != receiver)
            }
        }
    }

    /// The same of something that the vehicle recorded itself. Of those who do not keep to its schedule it does not know what it
    /// missed, and so what it heard does not count either. What it recorded while its clock was wrong counts as of the slots that it
    /// was in ([`Reckoning::outcomes`]), and not as it stands.
    pub(crate) fn is_event(&self, Recorded { key, event, .. }: &Recorded) -> bool {
        let sender = self.known.frames.team.number(&event.transmitter_id);
        // Of what members send at will nobody says anything once slots have no numbers left.
        let is_at_will = self.known.frames.team.slots.at_will && sender.is_some();
        (Some(&event.receiver_id) != self.own_id || self.known.reckoning.counts(event))
            && sender.zip(*key).map_or(!is_at_will, |(sender, key)| self.was_sent(sender, key, event.success))
    }
}
