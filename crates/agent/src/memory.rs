//! What a vehicle remembers. All else that it knows follows from this, and from what its team agreed on.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use dgpc::Observations;
use pingmap_packet::ReportLayout;

use crate::agent_error::AgentError;
use crate::clock::Reckoning;
use crate::entry::{Entry, check_event, check_number, check_position, check_time};
use crate::event::{Event, Position, VehicleId};
use crate::events::{Change, Events, Recorded};
use crate::frames::Frames;
use crate::packets::{Arrival, Departure, PacketKey, Packets, Sent, Version};
use crate::placing::{Placed, Placement, place};
use crate::receipt::{Receipt, Refusal};
use crate::reports::{EVERY_SLOT, Filed, Reports, Said};
use crate::shifts::Shifts;
use crate::track::Track;
use crate::turns::{Known, Turns};

/// Events, where it was, packets and reports. It changes only by [`Memory::apply`], and depends on nothing but the set of
/// entries.
#[derive(Debug, Clone)]
pub(crate) struct Memory {
    pub(crate) frames: Frames,
    /// The vehicle's number in the team, if it is a member.
    pub(crate) own: Option<u8>,
    pub(crate) events: Events,
    /// Numbers of those that are none: nobody says that it was sent.
    unsent: Arc<BTreeSet<u64>>,
    /// By how much its clock was wrong, as its events show.
    pub(crate) reckoning: Arc<Reckoning>,
    /// Where it was, in the order of time.
    fixes: Vec<(f64, Position)>,
    pub(crate) packets: Packets,
    pub(crate) reports: Reports,
    /// What of all this follows about the events of others.
    placement: Placement,
}

/// What an entry did.
#[derive(Debug)]
pub(crate) enum Applied {
    Event(Change),
    Fix,
    Frame(Arrived),
}

/// What became of a frame.
#[derive(Debug)]
pub(crate) struct Arrived {
    /// Who sent it, where that could be told.
    pub(crate) sender: Option<u8>,
    pub(crate) receipt: Receipt,
    /// Which of the vehicle's own events are none, or are some again, for it.
    pub(crate) change: Change,
}

impl Arrived {
    pub(crate) fn refused(sender: Option<u8>, refusal: Refusal) -> Self {
        Self { sender, receipt: Receipt::Refused(refusal), change: Change::default() }
    }
}

impl Memory {
    pub(crate) fn new(frames: Frames, own: Option<u8>) -> Self {
        let events = Events::new(frames.team.limits.events_max);
        let packets = Packets::new(frames.team.packets_per_sender_max);
        let reports = Reports::new(frames.team.reports_per_sender_max, frames.team.limits.slots_back_max);
        Self {
            frames,
            own,
            events,
            unsent: Arc::default(),
            reckoning: Arc::default(),
            fixes: Vec::new(),
            packets,
            reports,
            placement: Placement::default(),
        }
    }

    /// Remembers an entry: applying it again changes nothing. What became of it, if it is a frame.
    ///
    /// # Errors
    /// [`AgentError`] for an event that no vehicle records, and a number that none comes to; then nothing changed.
    pub(crate) fn apply(&mut self, entry: Entry) -> Result<Applied, AgentError> {
        match entry {
            Entry::Observed { number, event } => self.record(vec![(number, event)]).map(Applied::Event),
            Entry::Navigated { time_s, position } => {
                self.navigate(&[(time_s, position)])?;
                Ok(Applied::Fix)
            }
            Entry::Turn { sender, slot, sent } => Ok(Applied::Frame(self.put_in_turns(&sender, &[slot], sent))),
            Entry::Recent { sender, newest, outcomes } => {
                Ok(Applied::Frame(self.put_in_recent(&sender, newest, &outcomes)))
            }
            Entry::Heard { bytes } => Ok(Applied::Frame(self.put_in(&bytes, None))),
            Entry::Sent { number, slot, bytes } => {
                check_number(number)?;
                let slot = slot.filter(|&slot| self.frames.is_turn_of(slot, self.own_id()));
                Ok(Applied::Frame(self.put_in(&bytes, Some(Departure { number, slot }))))
            }
        }
    }

    /// One of its events as the method sees it, with the weight that it has beside those before it.
    pub(crate) fn observation(&self, event: &Event) -> dgpc::Result<Observations> {
        self.frames.team.model.observation_beside(event, self.events.before(event))
    }

    /// Remembers many events under their numbers, or none of them.
    ///
    /// # Errors
    /// As [`Memory::apply`].
    pub(crate) fn record(&mut self, new: Vec<(u64, Event)>) -> Result<Change, AgentError> {
        for (number, event) in &new {
            check_number(*number)?;
            check_event(event)?;
        }
        let numbers: BTreeSet<u64> = new.iter().map(|(number, _)| *number).collect();
        let new = new.into_iter().map(|(number, event)| {
            let (key, is_own) = (self.frames.slot_of(&event), self.own_id() == Some(&event.receiver_id));
            let shifts = if is_own { Shifts::of(&self.frames.team, &event) } else { None };
            Recorded { number, key, shifts, event }
        });
        let change = self.events.insert(new.collect());
        let is_behind =
            |known: &Recorded| self.placement.is_settled_before(known.event.time_s, known.key.map(|key| key.1));
        let reckoning = Reckoning::new(&self.frames, self.own, &self.events);
        let is_reckoned_anew = reckoning != *self.reckoning;
        if change.forgotten > 0 || !change.new.iter().all(is_behind) || is_reckoned_anew {
            self.placement.change(EVERY_SLOT);
        }
        if is_reckoned_anew {
            self.reckoning = Arc::new(reckoning);
        }
        Ok(self.settle(change, &numbers))
    }

    /// Decides anew which of its events are none, after some were put in: those that are, and those that are none any more, are new;
    /// those that are none now are gone. O(events + told) where anybody may have been silent.
    fn settle(&mut self, change: Change, numbers: &BTreeSet<u64>) -> Change {
        if self.unsent.is_empty() && !self.known().is_in_doubt() {
            return change;
        }
        let turns = Turns::new(self.known());
        let is_unsent = |known: &&Recorded| !turns.is_event(known);
        let unsent: BTreeSet<u64> = self.events.recorded().iter().filter(is_unsent).map(|known| known.number).collect();
        let back = |known: &&Recorded| self.unsent.contains(&known.number) && !unsent.contains(&known.number);
        let back = self.events.recorded().iter().filter(back).cloned();
        let new = change.new.into_iter().filter(|known| turns.is_event(known)).chain(back).collect();
        let gone = unsent.iter().filter(|number| !self.unsent.contains(number) && !numbers.contains(number)).count();
        self.unsent = Arc::new(unsent);
        Change { new, forgotten: change.forgotten + gone }
    }

    /// What became of transmissions that the vehicle listened to, by slot, from a time on. What it heard of those who do not
    /// keep to the schedule says as little as what it missed. What its clock was ahead of is of the slots that it was in.
    pub(crate) fn outcomes_since(&self, own: u8, time_s: f64) -> BTreeMap<u32, bool> {
        let known = self.events.since(time_s).iter().filter(|known| self.reckoning.counts(&known.event));
        let known = known.filter_map(|known| Some((known.key?, known.event.success)));
        let known = known.filter(|((receiver, _), _)| *receiver == own).map(|((_, slot), success)| (slot, success));
        let first = self.frames.team.slots.number(time_s).unwrap_or_default();
        let ahead = self.reckoning.outcomes.range(first..).map(|(&slot, &success)| (slot, success));
        known.chain(ahead).collect()
    }

    /// Its own events, with their numbers, but for those of which nobody says that they were sent.
    pub(crate) fn sent_events(&self) -> impl Iterator<Item = &Recorded> {
        self.sent_since(f64::NEG_INFINITY)
    }

    /// The same from a time on.
    pub(crate) fn sent_since(&self, time_s: f64) -> impl Iterator<Item = &Recorded> {
        self.events.since(time_s).iter().filter(|known| !self.unsent.contains(&known.number))
    }

    /// Length of the longest of its links; `None` without events. O(1) where none of them is in doubt.
    pub(crate) fn longest_m(&self) -> Option<f64> {
        if self.unsent.is_empty() {
            return (self.events.len() > 0).then(|| self.events.longest_m());
        }
        self.sent_events().map(|known| known.event.link.range_m()).reduce(f64::max)
    }

    /// Remembers whether a member sent in slots of its own.
    pub(crate) fn put_in_turns(&mut self, sender: &VehicleId, slots: &[u32], sent: bool) -> Arrived {
        let Some(number) = self.frames.team.number(sender) else {
            return Arrived::refused(None, Refusal::NoMember { id: sender.clone() });
        };
        for &slot in slots.iter().filter(|&&slot| self.frames.is_turn_of(slot, Some(sender))) {
            self.reports.insert_turn(number, slot, sent);
        }
        self.arrived(number, Receipt::Accepted, [EVERY_SLOT])
    }

    /// What became of something that says more of what was sent, of which something may follow in these slots.
    fn arrived(&mut self, sender: u8, receipt: Receipt, slots: impl IntoIterator<Item = Range<u32>>) -> Arrived {
        slots.into_iter().for_each(|slots| self.placement.change(slots));
        let change = self.settle(Change::default(), &BTreeSet::new());
        Arrived { sender: Some(sender), receipt, change }
    }

    /// Remembers where it was, or none of it; of as many places as events, the latest.
    ///
    /// # Errors
    /// As [`Memory::apply`].
    pub(crate) fn navigate(&mut self, new: &[(f64, Position)]) -> Result<(), AgentError> {
        for (time_s, position) in new {
            check_time(*time_s)?;
            check_position(position)?;
        }
        self.fixes.extend(new);
        let sorted = Track::new(std::mem::take(&mut self.fixes)).fixes();
        self.fixes = sorted;
        let max = self.frames.team.limits.events_max;
        let too_many = self.fixes.len().saturating_sub(max);
        self.fixes.drain(..too_many);
        if too_many > 0 || !new.iter().all(|&(time_s, _)| self.placement.is_settled_before(time_s, None)) {
            self.placement.change(EVERY_SLOT);
        }
        Ok(())
    }

    /// Where it was, by its navigation and by its events, at the times of the others.
    pub(crate) fn track(&self) -> Track {
        let own = self.own_id();
        let heard = self.events.iter().filter(|event| Some(&event.receiver_id) == own);
        let heard = heard.map(|event| (event.time_s, event.link.receiver));
        let fixes = self.fixes.iter().copied().chain(heard);
        Track::new(fixes.map(|(time_s, at)| (self.reckoning.team_s(time_s), at)).collect())
    }

    pub(crate) fn own_id(&self) -> Option<&VehicleId> {
        self.own.and_then(|own| self.frames.team.members.get(&own))
    }

    /// The vehicle's own events in slots that are wanted, by number. O(own events).
    pub(crate) fn numbers_of(&self, is_wanted: &dyn Fn(u32) -> bool) -> BTreeSet<u64> {
        let slots = self.own.into_iter().flat_map(|own| self.events.slots_of(own));
        self.sent(slots.filter(|&(slot, _)| is_wanted(slot)).map(|(_, number)| number)).collect()
    }

    /// The same of a few slots. O(log N) each.
    pub(crate) fn numbers_in(&self, slots: &BTreeSet<u32>) -> BTreeSet<u64> {
        let keys = self.own.into_iter().flat_map(|own| slots.iter().map(move |&slot| (own, slot)));
        self.sent(keys.flat_map(|key| self.events.in_slot(key))).collect()
    }

    /// Those numbers of events that are some: nobody doubts that these were sent.
    fn sent(&self, numbers: impl Iterator<Item = u64>) -> impl Iterator<Item = u64> {
        numbers.filter(|number| !self.unsent.contains(number))
    }

    /// What others told, where it took place.
    pub(crate) fn placed(&self) -> &Placed {
        self.placement.get_or_place(|before| place(self.known(), self.track(), before))
    }

    /// What is known of single transmissions.
    pub(crate) fn known(&self) -> Known<'_> {
        let Self { frames, own, events, reports, reckoning, .. } = self;
        Known { frames, own: *own, events, reports, reckoning }
    }

    /// Remembers a frame that was heard, or sent. One that is not the team's or, as a sent one, not
    /// this vehicle's changes nothing.
    pub(crate) fn put_in(&mut self, bytes: &[u8], sent: Option<Departure>) -> Arrived {
        if ReportLayout::of(bytes).is_some() {
            return self.put_in_report(bytes, sent);
        }
        let (key, packet) = match self.frames.packet(bytes) {
            Ok(read) => read,
            Err(refusal) => return Arrived::refused(None, refusal),
        };
        let sender = Some(key.0);
        if sent.is_some() && sender != self.own {
            return Arrived::refused(sender, Refusal::NotSentByMe { number: key.0 });
        }
        let arrival = self.packets.insert(key, packet, sent);
        Arrived { sender, receipt: self.receipt(key, arrival, sent.is_some()), change: Change::default() }
    }

    fn put_in_report(&mut self, bytes: &[u8], sent: Option<Departure>) -> Arrived {
        let (sender, report) = match self.frames.report(bytes) {
            Ok(read) => read,
            Err(refusal) => return Arrived::refused(None, refusal),
        };
        let refused = Receipt::Refused;
        if sent.is_some() && Some(sender) != self.own {
            return Arrived::refused(Some(sender), Refusal::NotSentByMe { number: sender });
        }
        // Whether it sent counts, however old the report is.
        let turns = (!report.turns.is_empty()).then_some(EVERY_SLOT);
        let (receipt, slots) = match self.reports.insert(sender, report, sent) {
            Filed::New(slots) if Some(sender) == self.own && sent.is_none() => (refused(Refusal::OwnReport), slots),
            Filed::New(slots) => (Receipt::Accepted, slots),
            Filed::Known => (refused(Refusal::Duplicate), Vec::new()),
            Filed::TooOld => (refused(Refusal::TooOld), Vec::new()),
        };
        self.arrived(sender, receipt, slots.into_iter().chain(turns))
    }

    /// Remembers what a member says of the slots from the newest back in which it could hear somebody.
    pub(crate) fn put_in_recent(&mut self, sender: &VehicleId, newest: u32, outcomes: &[bool]) -> Arrived {
        let number = self.frames.team.number(sender);
        let refused = |refusal| Arrived::refused(number, refusal);
        if !self.frames.team.has_spare_bits() {
            return refused(Refusal::SpareBits);
        }
        let Some(number) = number else { return refused(Refusal::NoMember { id: sender.clone() }) };
        if Some(number) == self.own {
            return refused(Refusal::OwnReport);
        }
        let slots = self.frames.slots_back(number, newest).zip(outcomes.iter().copied());
        let is_new = self.reports.insert_recent(number, slots);
        let receipt = if is_new { Receipt::Accepted } else { Receipt::Refused(Refusal::Duplicate) };
        self.arrived(number, receipt, [EVERY_SLOT])
    }

    /// What an arrival means to a receiver.
    fn receipt(&self, (sender, counter): PacketKey, arrival: Arrival, was_sent: bool) -> Receipt {
        Receipt::Refused(match arrival {
            Arrival::New if Some(sender) == self.own && !was_sent => Refusal::OwnNumber { counter },
            Arrival::New => return Receipt::Accepted,
            Arrival::Known => Refusal::Duplicate,
            Arrival::Conflict => Refusal::Conflict { counter },
            Arrival::Unconfirmed => Refusal::Unconfirmed { counter, latest: self.packets.latest(sender) },
            Arrival::TooOld => Refusal::TooOld,
        })
    }

    /// The number under which it sends its next frame.
    pub(crate) fn sent_next(&self) -> u64 {
        let versions = self.own.into_iter().flat_map(|own| self.packets.all(own));
        let reports = self.own.into_iter().flat_map(|own| self.reports.all(own));
        let last = versions.filter_map(|version| version.sent.last_number()).max();
        last.max(reports.filter_map(|kept| kept.sent.last_number()).max()).map_or(0, |last| last + 1)
    }

    /// The packets of the vehicle's own that others may hold, and will when it has sent another one.
    pub(crate) fn told(&self) -> impl Iterator<Item = (u16, &Version)> {
        let strange = self.own.and_then(|own| self.packets.strange(own));
        let sent = self.own.into_iter().flat_map(|own| self.packets.believed(own));
        sent.filter(move |(counter, version)| !version.sent.is_empty() && Some(*counter) > strange)
    }

    /// The packets of others that count, by sender and counter.
    pub(crate) fn heard(&self) -> impl Iterator<Item = PacketKey> {
        let others = self.packets.senders().filter(|&sender| Some(sender) != self.own);
        others.flat_map(|sender| self.packets.believed(sender).map(move |(counter, _)| (sender, counter)))
    }

    /// Everything in it, as entries: applied to an empty memory they make this one, but for how far senders have come
    /// ([`Packets::reach`]).
    pub(crate) fn entries(&self) -> impl Iterator<Item = Entry> {
        let events = self.events.recorded().iter();
        let observed = events.map(|known| Entry::Observed { number: known.number, event: known.event.clone() });
        let versions = self.packets.senders().flat_map(|sender| self.packets.all(sender));
        let frames = versions.flat_map(|version| frame_entries(&version.packet.bytes, &version.sent));
        let navigated = self.fixes.iter().map(|&(time_s, position)| Entry::Navigated { time_s, position });
        let reports = self.reports.everything().flat_map(|kept| frame_entries(&kept.report.bytes, &kept.sent));
        observed.chain(navigated).chain(frames).chain(reports).chain(self.recent_entries()).chain(self.turn_entries())
    }

    fn turn_entries(&self) -> impl Iterator<Item = Entry> {
        let turns = self
            .reports
            .senders()
            .flat_map(|number| self.reports.turns(number, EVERY_SLOT).map(move |turn| (number, turn)));
        turns.filter_map(|(number, (slot, sent))| {
            Some(Entry::Turn { sender: self.frames.team.members.get(&number)?.clone(), slot, sent })
        })
    }

    /// What spare bits said, one slot each.
    fn recent_entries(&self) -> impl Iterator<Item = Entry> {
        let recent =
            self.reports.senders().flat_map(|number| self.reports.recent(number).map(move |said| (number, said)));
        recent.flat_map(move |(number, (newest, said))| {
            let both = [(Said::Missed, false), (Said::Heard, true)].into_iter();
            let told = both.filter(move |(one, _)| said == *one || said == Said::Contradicted);
            told.filter_map(move |(_, heard)| {
                let sender = self.frames.team.members.get(&number)?.clone();
                Some(Entry::Recent { sender, newest, outcomes: vec![heard] })
            })
        })
    }
}

/// A frame that was heard, or sent so often.
fn frame_entries(bytes: &[u8], sent: &Sent) -> impl Iterator<Item = Entry> {
    let heard = sent.is_empty().then(|| Entry::Heard { bytes: bytes.to_vec() });
    let as_sent = |Departure { number, slot }| Entry::Sent { number, slot, bytes: bytes.to_vec() };
    heard.into_iter().chain(sent.iter().map(as_sent))
}
