//! The memory of a vehicle: a set of entries. Everything else that the vehicle computes follows from it.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use dgpc::Observations;
use pingmap_packet::ReportLayout;

use crate::codec::decoded::PacketKey;
use crate::codec::receipt::{Receipt, Refusal};
use crate::codec::team_codec::TeamCodec;
use crate::error::AgentError;
use crate::store::claim_check::ClaimCheck;
use crate::store::clock::{Clock, FrameNumber};
use crate::store::entry::{Entry, check_event, check_number, check_position, check_time};
use crate::store::event_location::{LocatedEventCache, LocatedEvents, locate_events};
use crate::store::events::{EventChange, Events, RecordedEvent};
use crate::store::own_outcomes::{OutcomeEffect, OwnOutcomes};
use crate::store::packets::{Packets, Transmission, Transmissions, Version};
use crate::store::peer_positions::PeerPositions;
use crate::store::reports::{EVERY_SLOT, ReportedOutcome, Reports};
use crate::store::slot_conformance::{SlotConformance, WITHOUT_EVENT};
use crate::store::slot_evidence::SlotEvidence;
use crate::track::position_track::Track;
use crate::types::event::{Event, Position, VehicleId};

/// Events, positions, packets and reports. They depend on the entries, clock, latest counters and muted members.
#[derive(Debug, Clone)]
pub(crate) struct Memory {
    pub(crate) codec: TeamCodec,
    /// The vehicle's number in the team, if it is a member.
    pub(crate) own: Option<u8>,
    pub(crate) events: Events,
    /// Numbers of own events that do not count: see [`SlotEvidence::counts`].
    excluded: Arc<BTreeSet<u64>>,
    pub(crate) conformance: SlotConformance,
    pub(crate) claims: ClaimCheck,
    /// Numbers of members that the vehicle ignores.
    pub(crate) muted: BTreeSet<u8>,
    pub(crate) clock: Clock,
    /// Positions from navigation, in the order of time.
    pub(crate) fixes: Vec<(f64, Position)>,
    pub(crate) packets: Packets,
    pub(crate) reports: Reports,
    /// Own outcomes without positions.
    pub(crate) outcomes: OwnOutcomes,
    pub(crate) peers: PeerPositions,
    /// Located events of other members and own outcomes, derived from all other fields.
    located: LocatedEventCache,
}

#[derive(Debug)]
pub(crate) struct Effect {
    /// The sender of a frame, if the frame names one.
    pub(crate) sender: Option<u8>,
    pub(crate) receipt: Receipt,
    /// Own events that count from now on, or no longer.
    pub(crate) change: EventChange,
}

impl Effect {
    /// Effect of own data, which are never refused.
    fn of_own_data(change: EventChange) -> Self {
        Self { sender: None, receipt: Receipt::Accepted, change }
    }

    pub(crate) fn refused(refusal: Refusal) -> Self {
        Self { sender: None, receipt: Receipt::Refused(refusal), change: EventChange::default() }
    }
}

impl Memory {
    pub(crate) fn new(codec: TeamCodec, own: Option<u8>) -> Self {
        let team = &codec.team;
        Self {
            events: Events::new(team.limits.events_max),
            packets: Packets::new(team.packets_per_sender_max),
            reports: Reports::new(team.reports_per_sender_max, team.limits.report_window_slots),
            outcomes: OwnOutcomes::new(team.limits.events_max),
            peers: PeerPositions::new(team.limits.events_max),
            clock: Clock::new(&team.slots),
            codec,
            own,
            excluded: Arc::default(),
            conformance: SlotConformance::default(),
            claims: ClaimCheck::default(),
            muted: BTreeSet::new(),
            fixes: Vec::new(),
            located: LocatedEventCache::default(),
        }
    }

    /// Applies an entry. A second application of the same entry changes nothing.
    ///
    /// # Errors
    /// [`AgentError`] for an event or position out of bounds, or a number out of range. The memory is then unchanged.
    pub(crate) fn apply(&mut self, entry: Entry) -> Result<Effect, AgentError> {
        let applied = match entry {
            Entry::Observed { number, event } => Ok(Effect::of_own_data(self.record(vec![(number, event)])?)),
            Entry::Navigated { time_s, position } => {
                self.record_positions(&[(time_s, position)])?;
                Ok(Effect::of_own_data(EventChange::default()))
            }
            Entry::Outcome { time_s, transmitter_id, success } => {
                check_time(time_s)?;
                self.insert_outcome(&transmitter_id, time_s, success)
            }
            Entry::PeerPosition { member, time_s, position, is_independent } => {
                check_time(time_s)?;
                check_position(&position)?;
                self.insert_peer_position(&member, time_s, position, is_independent)
            }
            Entry::UnusedSlot { sender, slot } => self.insert_unused_slots(&sender, &[slot]),
            Entry::Piggyback { sender, newest, outcomes } => self.insert_piggyback(&sender, newest, &outcomes),
            Entry::Received { bytes, .. } => self.insert_frame(&bytes, None),
            Entry::Sent { number, state, slot, bytes } => {
                check_number(number)?;
                let slot = slot.filter(|&slot| self.codec.is_slot_of(slot, self.own_id()));
                self.insert_frame(&bytes, Some(Transmission { number, state, slot }))
            }
        };
        Ok(applied.unwrap_or_else(Effect::refused))
    }

    /// Returns the observation of an own event. Its weight follows from the events before it, because repeated outcomes
    /// are correlated.
    pub(crate) fn observation(&self, event: &Event) -> dgpc::Result<Observations> {
        self.codec.team.model.observation_given_earlier(event, self.events.before(event))
    }

    /// Records events with these numbers: all of them, or none after an error.
    pub(crate) fn record(&mut self, new: Vec<(u64, Event)>) -> Result<EventChange, AgentError> {
        for (number, event) in &new {
            check_number(*number)?;
            check_event(event)?;
        }
        let recorded = |(number, event)| RecordedEvent { number, key: self.codec.slot_of(&event), event };
        let change = self.events.insert(new.into_iter().map(recorded).collect());
        let mut spans = Vec::new();
        if change.forgotten > 0 {
            let first = self.events.first_number();
            Arc::make_mut(&mut self.excluded).retain(|&number| number >= first);
            spans.extend(self.compare_all_with_schedule());
        } else {
            spans.extend(change.new.iter().filter_map(|recorded| self.compare_with_schedule(recorded)));
        }
        let is_before_horizon = |recorded: &RecordedEvent| {
            self.located.is_before_horizon(recorded.event.time_s, recorded.key.map(|key| key.1))
        };
        if change.forgotten > 0 || !spans.is_empty() || !change.new.iter().all(is_before_horizon) {
            self.located.invalidate(EVERY_SLOT);
        }
        let keys = change
            .new
            .iter()
            .filter_map(|recorded| Some((self.codec.team.number(&recorded.event.transmitter_id)?, recorded.key?.1)));
        let denied: Vec<(u8, u32)> =
            keys.filter(|&(transmitter, slot)| self.reports.is_unused(transmitter, slot)).collect();
        spans.extend(denied.iter().filter_map(|&(_, slot)| self.codec.team.slots.span_s(slot)));
        let mut has_changed = change.forgotten > 0 && self.forget_all_claims();
        for (transmitter, slot) in denied {
            has_changed |= self.check_claims(transmitter, &[slot]);
        }
        if has_changed {
            self.located.invalidate(EVERY_SLOT);
            spans.push(ALL_TIMES);
        }
        Ok(self.reassess(change, &spans))
    }

    /// Compares all own outcomes with the schedule again. Returns the times between which own events may change.
    fn compare_all_with_schedule(&mut self) -> Option<(f64, f64)> {
        self.conformance = SlotConformance::default();
        for recorded in self.events.clone().recorded() {
            self.compare_with_schedule(recorded);
        }
        for outcome in self.outcomes.iter() {
            let at = (outcome.time_s.0, WITHOUT_EVENT);
            self.conformance.insert(&self.codec.team.slots, &outcome.transmitter_id, at, outcome.success);
        }
        (!self.conformance.is_clean() || !self.excluded.is_empty()).then_some(ALL_TIMES)
    }

    /// Compares an event of the vehicle with the schedule. Returns the times between which own events may change.
    fn compare_with_schedule(&mut self, RecordedEvent { number, event, .. }: &RecordedEvent) -> Option<(f64, f64)> {
        let team = &self.codec.team;
        let is_compared = self.own_id() == Some(&event.receiver_id) && team.is_member(&event.transmitter_id);
        let at = (event.time_s, *number);
        is_compared.then(|| self.conformance.insert(&team.slots, &event.transmitter_id, at, event.success)).flatten()
    }

    /// Compares the claims of a member about these slots with the vehicle's own receptions. Returns whether its claims
    /// no longer count from now on. O(members log N) for each slot.
    fn check_claims(&mut self, member: u8, slots: &[u32]) -> bool {
        let was_reliable = self.claims.is_reliable(member);
        for &slot in slots {
            if self.is_contradicted_claim(member, slot) {
                self.claims.insert(member, slot);
            }
        }
        was_reliable != self.claims.is_reliable(member)
    }

    /// Forgets contradictions as [`Self::forget_claims`] does, for all members.
    fn forget_all_claims(&mut self) -> bool {
        let senders: Vec<u8> = self.reports.senders().collect();
        senders.into_iter().fold(false, |has_changed, sender| self.forget_claims(sender) | has_changed)
    }

    /// Forgets contradictions by claims or receptions that are no longer stored. Returns whether the claims of the
    /// member count again.
    fn forget_claims(&mut self, member: u8) -> bool {
        let mut claims = std::mem::take(&mut self.claims);
        let counts_again = claims.retain(member, |slot| self.is_contradicted_claim(member, slot));
        self.claims = claims;
        counts_again
    }

    fn is_contradicted_claim(&self, member: u8, slot: u32) -> bool {
        let mut receivers = self.codec.team.members.keys();
        let is_heard = || self.outcomes.has_heard(slot);
        self.reports.is_unused(member, slot)
            && (is_heard()
                || receivers.any(|&receiver| self.events.in_slot((receiver, slot)).any(|(_, success)| success)))
    }

    /// Ignores a member, or uses its data again.
    pub(crate) fn set_muted(&mut self, member: u8, is_muted: bool) -> EventChange {
        let has_changed = if is_muted { self.muted.insert(member) } else { self.muted.remove(&member) };
        if !has_changed {
            return EventChange::default();
        }
        self.effect(member, Receipt::Accepted, vec![EVERY_SLOT]).change
    }

    /// Decides again which own events between these times count, and which of the new ones do. Events that begin to
    /// count are new; events that no longer count are forgotten. O(log N) for each event in these spans.
    fn reassess(&mut self, mut change: EventChange, spans: &[(f64, f64)]) -> EventChange {
        let numbers: BTreeSet<u64> = change.new.iter().map(|recorded| recorded.number).collect();
        let evidence = self.evidence();
        let mut excluded = Vec::new();
        change.new.retain(|recorded| {
            let counts = evidence.counts(recorded);
            excluded.extend((!counts).then_some(recorded.number));
            counts
        });
        let mut included = Vec::new();
        for recorded in spans.iter().flat_map(|&span| self.events.between(span)) {
            match (evidence.counts(recorded), self.excluded.contains(&recorded.number)) {
                _ if numbers.contains(&recorded.number) => {}
                (true, true) => included.push(recorded.clone()),
                (false, false) => excluded.push(recorded.number),
                _ => {}
            }
        }
        if !excluded.is_empty() || !included.is_empty() {
            let all = Arc::make_mut(&mut self.excluded);
            let added = excluded.into_iter().filter(|&number| all.insert(number)).collect::<Vec<_>>();
            change.forgotten += added.iter().filter(|number| !numbers.contains(number)).count();
            included.retain(|recorded| all.remove(&recorded.number));
            change.restored = included;
        }
        change
    }

    /// Returns the outcomes of the vehicle by slot, from a time on. Outcomes of members outside their slots are
    /// omitted, heard and missed alike. If a slot has several outcomes, the last one in canonical order counts.
    pub(crate) fn outcomes_since(&self, own: u8, time_s: f64) -> BTreeMap<u32, bool> {
        let keeps_slots = |event: &Event| !self.conformance.is_out_of_slot(&event.transmitter_id, event.time_s);
        let conforming = self.events.since(time_s).iter().filter(|recorded| keeps_slots(&recorded.event));
        let outcome = |recorded: &RecordedEvent| {
            let (receiver, slot) = recorded.key?;
            (receiver == own).then_some((slot, recorded.event.success))
        };
        // An event of a slot replaces an outcome without positions.
        self.outcomes_without_events(own, time_s).chain(conforming.filter_map(outcome)).collect()
    }

    /// Returns the own outcomes without positions, in slots from a time on of members that conform to the schedule.
    fn outcomes_without_events(&self, own: u8, time_s: f64) -> impl Iterator<Item = (u32, bool)> {
        let slots = &self.codec.team.slots;
        let first = slots.number(time_s).unwrap_or(0);
        let range = if Some(own) == self.own { first..u32::MAX } else { 0..0 };
        self.outcomes.in_slots(range).filter_map(move |(slot, outcome)| {
            let begin_s = slots.begin_s(slot).filter(|&begin_s| begin_s >= time_s)?;
            let keeps_slots = !self.conformance.is_out_of_slot(slots.sender(slot)?, begin_s);
            let is_known = outcome != ReportedOutcome::Contradictory;
            (keeps_slots && is_known).then_some((slot, outcome == ReportedOutcome::Heard))
        })
    }

    /// Returns the own events that count, in canonical order.
    pub(crate) fn counting_events(&self) -> impl Iterator<Item = &RecordedEvent> {
        self.events.recorded().iter().filter(|recorded| !self.excluded.contains(&recorded.number))
    }

    fn number(&self, id: &VehicleId) -> Result<u8, Refusal> {
        self.codec.team.number(id).ok_or_else(|| Refusal::NoMember(id.clone()))
    }

    /// Returns the number of another member.
    fn peer_number(&self, id: &VehicleId) -> Result<u8, Refusal> {
        self.number(id).and_then(|number| if Some(number) == self.own { Err(Refusal::OwnReport) } else { Ok(number) })
    }

    /// Stores whether the vehicle heard a message of another member.
    fn insert_outcome(&mut self, transmitter: &VehicleId, time_s: f64, success: bool) -> Result<Effect, Refusal> {
        let member = self.peer_number(transmitter)?;
        let team = self.codec.team.clone();
        let span_s = match self.outcomes.insert(&team.slots, transmitter, time_s, success) {
            None => return Err(Refusal::NoSlot { time_s }),
            Some(OutcomeEffect::Unchanged) => return Err(Refusal::Duplicate),
            Some(OutcomeEffect::Added) => {
                self.conformance.insert(&team.slots, transmitter, (time_s, WITHOUT_EVENT), success)
            }
            Some(OutcomeEffect::ForgotOldest) => {
                self.forget_all_claims();
                self.compare_all_with_schedule().or(Some(ALL_TIMES))
            }
        };
        let slot = team.slots.sent_in(time_s, transmitter);
        let is_denied = |slot: &u32| self.reports.is_unused(member, *slot);
        let denied: Vec<u32> = slot.filter(is_denied).into_iter().collect();
        let changes_all = self.check_claims(member, &denied) || span_s.is_some();
        let slots = if changes_all { Some(EVERY_SLOT) } else { slot.map(|slot| slot..slot + 1) };
        let mut effect = self.effect(member, Receipt::Accepted, slots.into_iter().collect());
        effect.change = self.reassess(effect.change, span_s.as_slice());
        Ok(effect)
    }

    /// Stores a position of another member that the host knows.
    fn insert_peer_position(
        &mut self,
        member: &VehicleId,
        time_s: f64,
        position: Position,
        is_independent: bool,
    ) -> Result<Effect, Refusal> {
        let number = self.peer_number(member)?;
        if !self.peers.insert(number, time_s, position, is_independent) {
            return Err(Refusal::Duplicate);
        }
        Ok(self.effect(number, Receipt::Accepted, vec![EVERY_SLOT]))
    }

    /// Stores that a member did not transmit in slots of its own.
    pub(crate) fn insert_unused_slots(&mut self, sender: &VehicleId, slots: &[u32]) -> Result<Effect, Refusal> {
        let number = self.number(sender)?;
        let slots: Vec<u32> = slots.iter().copied().filter(|&slot| self.codec.is_slot_of(slot, Some(sender))).collect();
        slots.iter().for_each(|&slot| self.reports.insert_unused(number, slot));
        let changed = self.slots_of_claims(number, &slots);
        Ok(self.effect(number, Receipt::Accepted, changed))
    }

    /// Checks new claims of a member. Returns the slots in which they may change which events count.
    fn slots_of_claims(&mut self, member: u8, claimed: &[u32]) -> Vec<Range<u32>> {
        if claimed.is_empty() {
            return Vec::new();
        }
        // A new claim may end the window of old ones.
        let counts_again = self.forget_claims(member);
        if self.check_claims(member, claimed) || counts_again {
            return vec![EVERY_SLOT];
        }
        claimed.iter().map(|&slot| slot..slot + 1).collect()
    }

    /// Returns the effect of new evidence about these slots, and decides again which own events in them count.
    fn effect(&mut self, sender: u8, receipt: Receipt, slots: Vec<Range<u32>>) -> Effect {
        let mut unused = BTreeSet::new();
        for slots in slots {
            for sender in self.reports.senders() {
                unused.extend(self.reports.unused(sender, slots.clone()));
            }
            self.located.invalidate(slots);
        }
        let spans: Vec<(f64, f64)> = unused.into_iter().filter_map(|slot| self.codec.team.slots.span_s(slot)).collect();
        let change = self.reassess(EventChange::default(), &spans);
        Effect { sender: Some(sender), receipt, change }
    }

    /// Records positions of the vehicle by time: all of them, or none after an error. The latest
    /// [`Limits::events_max`](crate::Limits::events_max) positions are kept.
    pub(crate) fn record_positions(&mut self, new: &[(f64, Position)]) -> Result<(), AgentError> {
        for (time_s, position) in new {
            check_time(*time_s)?;
            check_position(position)?;
        }
        self.fixes.extend(new);
        let sorted = Track::new(std::mem::take(&mut self.fixes)).into_fixes();
        self.fixes = sorted;
        let max = self.codec.team.limits.events_max;
        let excess = self.fixes.len().saturating_sub(max);
        self.fixes.drain(..excess);
        if excess > 0 || !new.iter().all(|&(time_s, _)| self.located.is_before_horizon(time_s, None)) {
            self.located.invalidate(EVERY_SLOT);
        }
        Ok(())
    }

    /// Returns the vehicle's own track, from its navigation and from the receiver positions in its own events.
    pub(crate) fn track(&self) -> Track {
        let own = self.own_id();
        let received = self.events.iter().filter(|event| Some(&event.receiver_id) == own);
        let positions = received.map(|event| (event.time_s, event.link.receiver));
        Track::new(self.fixes.iter().copied().chain(positions).collect())
    }

    pub(crate) fn own_id(&self) -> Option<&VehicleId> {
        self.own.and_then(|own| self.codec.team.members.get(&own))
    }

    /// Returns the numbers of the own events that count in wanted slots. O(own events).
    pub(crate) fn numbers_of(&self, is_wanted: &dyn Fn(u32) -> bool) -> BTreeSet<u64> {
        let slots = self.own.into_iter().flat_map(|own| self.events.slots_of(own));
        let wanted = slots.filter(|&(slot, _)| is_wanted(slot)).map(|(_, number)| number);
        wanted.filter(|number| !self.excluded.contains(number)).collect()
    }

    /// Returns the events of other members, located as far as possible.
    pub(crate) fn located(&self) -> &LocatedEvents {
        self.located.get_or_locate(|previous| locate_events(self.evidence(), self.track(), &self.peers, previous))
    }

    /// Advances the vehicle's clock to a time: of an own event, an own position, a reception or a transmission. Returns
    /// the effects of the frames that waited for it.
    pub(crate) fn advance_clock(&mut self, time_s: f64) -> Vec<Effect> {
        let allowed = self.clock.advance_to(time_s, &self.codec.team);
        allowed.into_iter().filter_map(|entry| self.apply(entry).ok()).collect()
    }

    /// Admits a frame if the vehicle's clock allows its number. Otherwise the frame waits. Frames that the vehicle
    /// transmitted pass, if they have its own number.
    fn admit(
        &mut self,
        sender: u8,
        number: FrameNumber,
        bytes: &[u8],
        sent: Option<Transmission>,
    ) -> Result<(), Refusal> {
        if sent.is_some() {
            let is_own = Some(sender) == self.own;
            return if is_own { Ok(()) } else { Err(Refusal::NotSentByMe(sender)) };
        }
        let entry = || Entry::Received { time_s: None, bytes: bytes.to_vec() };
        self.clock.admit(&self.codec.team, sender, number, entry)
    }

    pub(crate) fn is_transmission(&self, transmitter: u8, slot: u32) -> bool {
        self.evidence().is_transmission(transmitter, slot)
    }

    /// Returns everything that shows how slots were used.
    fn evidence(&self) -> SlotEvidence<'_> {
        let Self { codec, own, events, outcomes, reports, conformance, claims, muted, .. } = self;
        SlotEvidence { codec, own: *own, events, outcomes, reports, conformance, claims, muted }
    }

    /// Stores a frame that was received, or transmitted by the vehicle itself. A frame of another team changes nothing,
    /// nor does a transmitted frame of another sender.
    pub(crate) fn insert_frame(&mut self, bytes: &[u8], sent: Option<Transmission>) -> Result<Effect, Refusal> {
        if ReportLayout::of(bytes).is_some() {
            return self.insert_report(bytes, sent);
        }
        let (key, packet) = self.codec.decode_packet(bytes)?;
        let (sender, counter) = key;
        self.admit(sender, FrameNumber::Counter(counter), &packet.bytes, sent)?;
        self.packets.insert(key, packet, sent)?;
        if Some(sender) == self.own && sent.is_none() {
            return Err(Refusal::OwnNumber(counter));
        }
        Ok(Effect { sender: Some(sender), receipt: Receipt::Accepted, change: EventChange::default() })
    }

    fn insert_report(&mut self, bytes: &[u8], sent: Option<Transmission>) -> Result<Effect, Refusal> {
        let (sender, report) = self.codec.decode_report(bytes)?;
        let latest = report.latest_slot().min(self.codec.team.slots.end().saturating_sub(1));
        self.admit(sender, FrameNumber::Slot(latest), &report.bytes, sent)?;
        // Unused slots of an old report count too.
        let unused = report.unused.clone();
        let (receipt, slots) = match self.reports.insert(sender, report, sent) {
            Ok(slots) if Some(sender) == self.own && sent.is_none() => (Receipt::Refused(Refusal::OwnReport), slots),
            Ok(slots) => (Receipt::Accepted, slots),
            Err(refusal) => (Receipt::Refused(refusal), Vec::new()),
        };
        let of_claims = self.slots_of_claims(sender, &unused);
        Ok(self.effect(sender, receipt, [slots, of_claims].concat()))
    }

    /// Stores outcomes that a member piggybacked. They belong to the slots, from `newest` backwards, in which it could
    /// receive another member.
    pub(crate) fn insert_piggyback(
        &mut self,
        sender: &VehicleId,
        newest: u32,
        outcomes: &[bool],
    ) -> Result<Effect, Refusal> {
        if !self.codec.team.has_piggyback() {
            return Err(Refusal::PiggybackDisabled);
        }
        let number = self.number(sender)?;
        if Some(number) == self.own {
            return Err(Refusal::OwnReport);
        }
        let entry = || Entry::Piggyback { sender: sender.clone(), newest, outcomes: outcomes.to_vec() };
        self.clock.admit(&self.codec.team, number, FrameNumber::Slot(newest), entry)?;
        let slots: Vec<(u32, bool)> = self.codec.slots_back(number, newest).zip(outcomes.iter().copied()).collect();
        let is_new = self.reports.insert_piggybacked(number, slots.iter().copied());
        let receipt = if is_new { Receipt::Accepted } else { Receipt::Refused(Refusal::Duplicate) };
        Ok(self.effect(number, receipt, slots.into_iter().map(|(slot, _)| slot..slot + 1).collect()))
    }

    pub(crate) fn next_transmission_number(&self) -> u64 {
        self.own_frames().filter_map(|(_, sent)| sent.last_number()).max().map_or(0, |last| last + 1)
    }

    /// Returns the frames under the vehicle's own number, with their transmissions.
    pub(crate) fn own_frames(&self) -> impl Iterator<Item = (&Vec<u8>, &Transmissions)> {
        self.own.into_iter().flat_map(|own| {
            let packets = self.packets.all(own).map(|version| (&version.packet.bytes, &version.sent));
            packets.chain(self.reports.all(own).map(|stored| (&stored.report.bytes, &stored.sent)))
        })
    }

    /// Returns the keys of the summary packets of the vehicle that other members may store.
    pub(crate) fn own_packets(&self) -> impl Iterator<Item = PacketKey> {
        let foreign = self.own.and_then(|own| self.packets.foreign_counter(own));
        let own = self.own.into_iter().flat_map(|own| self.packets.accepted(own).map(move |packet| (own, packet)));
        let may_have_left = |version: &Version| version.sent.undropped().next().is_some();
        let is_stored = move |counter: u16, version: &Version| may_have_left(version) && Some(counter) > foreign;
        own.filter_map(move |(own, (counter, version))| is_stored(counter, version).then_some((own, counter)))
    }

    /// Returns the keys of the summary packets of other members that count, by sender and counter.
    pub(crate) fn packets_of_others(&self) -> impl Iterator<Item = PacketKey> {
        let others = self.packets.senders().filter(|&sender| Some(sender) != self.own);
        others.flat_map(|sender| self.packets.accepted(sender).map(move |(counter, _)| (sender, counter)))
    }
}

const ALL_TIMES: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
