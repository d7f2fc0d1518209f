//! Decides whether the outcome of a slot counts: the member transmitted in it, and conforms to the schedule.

use std::collections::BTreeSet;

use crate::codec::team_codec::TeamCodec;
use crate::store::claim_check::ClaimCheck;
use crate::store::events::{Events, RecordedEvent};
use crate::store::own_outcomes::OwnOutcomes;
use crate::store::reports::Reports;
use crate::store::slot_conformance::SlotConformance;
use crate::types::event::VehicleId;

#[derive(Clone, Copy)]
pub(crate) struct SlotEvidence<'a> {
    pub(crate) codec: &'a TeamCodec,
    /// Number of the vehicle itself, if it is a member.
    pub(crate) own: Option<u8>,
    pub(crate) events: &'a Events,
    pub(crate) outcomes: &'a OwnOutcomes,
    pub(crate) reports: &'a Reports,
    pub(crate) conformance: &'a SlotConformance,
    pub(crate) claims: &'a ClaimCheck,
    /// Members without any effect.
    pub(crate) muted: &'a BTreeSet<u8>,
}

impl SlotEvidence<'_> {
    /// Returns whether a member transmitted in its slot: it does not deny it, its claims do not count, or another
    /// vehicle heard it. The answer is the same for every receiver, whatever it recorded. O(members log N).
    pub(crate) fn is_transmission(&self, transmitter: u8, slot: u32) -> bool {
        let is_denied = self.reports.is_unused(transmitter, slot)
            && !self.muted.contains(&transmitter)
            && self.claims.is_reliable(transmitter);
        !is_denied || self.is_heard(slot)
    }

    /// Returns all other members with stored data, except for muted ones.
    pub(crate) fn others(&self) -> impl Iterator<Item = u8> {
        self.reports.senders().filter(|sender| Some(*sender) != self.own && !self.muted.contains(sender))
    }

    fn is_heard(&self, slot: u32) -> bool {
        let members = self.codec.team.members.keys();
        let is_heard_by_me = self.own.is_some() && self.outcomes.has_heard(slot);
        is_heard_by_me
            || members.into_iter().any(|&member| {
                let is_reported = || !self.muted.contains(&member) && self.reports.has_heard(member, slot);
                self.events.in_slot((member, slot)).any(|(_, success)| success) || is_reported()
            })
    }

    /// Returns whether a member conformed to the schedule in a slot, as far as the vehicle received it. O(members log
    /// N).
    pub(crate) fn keeps_slots(&self, member: u8, slot: u32) -> bool {
        let team = &self.codec.team;
        let Some((id, time_s)) = team.members.get(&member).zip(team.slots.begin_s(slot)) else { return true };
        !self.conformance.is_only_member_out(id, time_s)
    }

    /// Returns whether the messages of a member arrive at the vehicle itself in the member's slots. O(log N).
    pub(crate) fn arrives_in_slots(&self, member: u8, slot: u32) -> bool {
        let team = &self.codec.team;
        let Some((id, time_s)) = team.members.get(&member).zip(team.slots.begin_s(slot)) else { return true };
        !self.conformance.is_out_of_slot(id, time_s)
    }

    /// Returns whether an event that the vehicle recorded counts. Outcomes of a member outside its slots do not count.
    /// Its misses cannot count, so its receptions do not count either. O(members log N).
    pub(crate) fn counts(&self, RecordedEvent { key, event, .. }: &RecordedEvent) -> bool {
        let is_own = self.own_id() == Some(&event.receiver_id);
        if is_own && self.conformance.is_out_of_slot(&event.transmitter_id, event.time_s) {
            return false;
        }
        let transmitter = self.codec.team.number(&event.transmitter_id);
        transmitter.zip(*key).is_none_or(|(transmitter, key)| self.is_transmission(transmitter, key.1))
    }

    fn own_id(&self) -> Option<&VehicleId> {
        self.own.and_then(|own| self.codec.team.members.get(&own))
    }
}
