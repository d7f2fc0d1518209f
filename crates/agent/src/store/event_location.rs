//! Locates events of other members: their reports give the outcome and the slot, and tracks give the positions of both
//! ends.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use crate::codec::decoded::EventKey;
use crate::codec::team_codec::TeamCodec;
use crate::store::events::Events;
use crate::store::peer_positions::{PeerPositions, PeerTracks};
use crate::store::position_check::{members_with_wrong_tracks, reported_position};
use crate::store::reports::{EVERY_SLOT, ReportedOutcome};
use crate::store::slot_evidence::SlotEvidence;
use crate::track::position_track::Track;
use crate::types::event::{Event, Link, Position};

/// Events of other members whose positions are known.
pub(crate) type RemoteEvents = BTreeMap<EventKey, Arc<Event>>;

/// Returns whether `events` contain an equal event under the same key.
pub(crate) fn is_among(events: &RemoteEvents, (key, event): (&EventKey, &Arc<Event>)) -> bool {
    events.get(key).is_some_and(|other| is_same(other, event))
}

/// Returns a predicate equal to [`is_among`] for a series of events in the order of their keys. O(events) for the whole
/// series.
pub(crate) fn among(events: &RemoteEvents) -> impl FnMut((&EventKey, &Arc<Event>)) -> bool {
    let mut events = events.iter().peekable();
    move |(key, event)| {
        while events.next_if(|(other, _)| *other < key).is_some() {}
        events.peek().is_some_and(|(other, same)| *other == key && is_same(same, event))
    }
}

fn is_same(a: &Arc<Event>, b: &Arc<Event>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

#[derive(Debug, Clone, Default)]
pub(crate) struct LocatedEvents {
    /// Located events. Events that the vehicle recorded itself are not among them.
    pub(crate) events: Arc<RemoteEvents>,
    /// Events without a position of one end.
    pub(crate) unlocated: BTreeSet<EventKey>,
    /// Members whose reported tracks locate no events.
    pub(crate) wrong_tracks: BTreeSet<u8>,
    /// Own data after this horizon change nothing here; `None` where any may.
    horizon: Option<CacheHorizon>,
}

impl LocatedEvents {
    /// Creates the located events. If nothing changed, they share their memory with `before`, so that later comparisons
    /// are cheap.
    fn new(
        events: RemoteEvents,
        before: &Self,
        unlocated: BTreeSet<EventKey>,
        wrong_tracks: BTreeSet<u8>,
        horizon: Option<CacheHorizon>,
    ) -> Self {
        let is_same = |(now, before): (&Arc<Event>, &Arc<Event>)| Arc::ptr_eq(now, before);
        let is_unchanged =
            events.len() == before.events.len() && events.values().zip(before.events.values()).all(is_same);
        let events = if is_unchanged { before.events.clone() } else { Arc::new(events) };
        Self { events, unlocated, wrong_tracks, horizon }
    }

    /// Returns the located and unlocated events outside these slots.
    fn outside(&self, changed: &[Range<u32>]) -> (RemoteEvents, BTreeSet<EventKey>) {
        if changed.contains(&EVERY_SLOT) {
            return Default::default();
        }
        let is_outside = |key: &EventKey| !changed.iter().any(|slots| slots.contains(&key.1));
        let (mut events, mut unlocated) = (RemoteEvents::clone(&self.events), self.unlocated.clone());
        events.retain(|key, _| is_outside(key));
        unlocated.retain(is_outside);
        (events, unlocated)
    }

    /// Returns the event. It shares its memory with an equal event under the same key, if there is one.
    fn shared(&self, key: &EventKey, event: Event) -> Arc<Event> {
        let same = self.events.get(key).filter(|before| ***before == event);
        same.map_or_else(|| Arc::new(event), Arc::clone)
    }
}

/// The previous result, and the slots in which located events may have changed since.
#[derive(Debug, Clone, Default)]
pub(crate) struct Previous {
    located: LocatedEvents,
    /// Disjoint ranges.
    changed: Vec<Range<u32>>,
}

/// Located events, computed on demand after a change.
#[derive(Debug, Clone, Default)]
pub(crate) struct LocatedEventCache {
    now: OnceLock<LocatedEvents>,
    previous: Previous,
}

impl LocatedEventCache {
    pub(crate) fn get_or_locate(&self, locate: impl FnOnce(&Previous) -> LocatedEvents) -> &LocatedEvents {
        self.now.get_or_init(|| locate(&self.previous))
    }

    /// Notes that located events of these slots may have changed.
    pub(crate) fn invalidate(&mut self, slots: Range<u32>) {
        if let Some(located) = self.now.take() {
            self.previous = Previous { located, changed: Vec::new() };
        }
        let is_disjoint = |other: &Range<u32>| other.end < slots.start || slots.end < other.start;
        let (mut changed, near): (Vec<_>, Vec<_>) = self.previous.changed.drain(..).partition(is_disjoint);
        let union = near.into_iter().fold(slots, |all, near| all.start.min(near.start)..all.end.max(near.end));
        changed.push(union);
        self.previous.changed = changed;
    }

    /// Returns whether own data of this time, and of this slot if any, leave the located events unchanged.
    pub(crate) fn is_before_horizon(&self, time_s: f64, slot: Option<u32>) -> bool {
        let horizon = self.now.get().unwrap_or(&self.previous.located).horizon;
        horizon.is_some_and(|horizon| horizon.is_before(time_s, slot))
    }
}

/// The last reported slot, and the time of the first own position at or after its beginning.
#[derive(Debug, Clone, Copy)]
struct CacheHorizon {
    slot: Option<u32>,
    time_s: f64,
}

impl CacheHorizon {
    fn is_before(&self, time_s: f64, slot: Option<u32>) -> bool {
        time_s > self.time_s && slot.is_none_or(|slot| Some(slot) > self.slot)
    }
}

/// The source of an outcome, which decides how its ends are located.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OutcomeSource {
    /// A report of another member.
    Report,
    /// Bits that another member piggybacked.
    Piggyback,
    /// The vehicle itself, without the positions of the ends.
    Own,
}

/// Sources of the positions of all members.
struct PositionSources<'a> {
    evidence: SlotEvidence<'a>,
    /// Members whose reported tracks are wrong.
    wrong_tracks: &'a BTreeSet<u8>,
    /// The vehicle's own track.
    track: Track,
    /// Positions of other members when they transmitted, from the vehicle's own events, heard and missed alike.
    observed: BTreeMap<u8, Track>,
    /// Positions of other members that the host knows.
    peers: BTreeMap<u8, PeerTracks>,
}

/// Locates the events that other members reported, and own outcomes without positions. Positions of both ends come from
/// reported tracks and from the vehicle's own track. For piggybacked outcomes, and for members whose tracks are wrong,
/// they come from the transmitter positions in the vehicle's own events. For own outcomes they come first from the
/// positions that the host knows. None of these depends on the outcome. Events in slots without change
/// stay as they were, unless own events give positions. O(own positions + remote events), and a logarithm for each
/// change.
pub(crate) fn locate_events(
    evidence: SlotEvidence<'_>,
    track: Track,
    peers: &PeerPositions,
    previous: &Previous,
) -> LocatedEvents {
    let SlotEvidence { codec, own, events, outcomes, reports, muted, .. } = evidence;
    let peers = peers.tracks();
    let mut wrong_tracks = members_with_wrong_tracks(codec, events, reports);
    wrong_tracks.retain(|member| !muted.contains(member));
    let has_piggybacked = evidence.others().any(|sender| reports.piggybacked(sender).next().is_some());
    let own_outcomes = own.filter(|_| outcomes.iter().len() > 0);
    let uses_observed = has_piggybacked || !wrong_tracks.is_empty() || own_outcomes.is_some();
    let horizon = if uses_observed { None } else { horizon(&evidence, &track) };
    let is_same = !uses_observed && wrong_tracks == previous.located.wrong_tracks;
    let changed: &[Range<u32>] = if is_same { &previous.changed } else { &[EVERY_SLOT] };
    let (mut located, mut unlocated) = previous.located.outside(changed);
    let observed = if uses_observed { observed_positions(codec, events, &peers) } else { BTreeMap::new() };
    let sources = PositionSources { evidence, wrong_tracks: &wrong_tracks, track, observed, peers };
    let reported = evidence.others().flat_map(|receiver| {
        let reported = changed.iter().flat_map(move |slots| reports.outcomes(receiver, slots.clone()));
        reported.map(move |(slot, outcome, is_piggybacked)| {
            let source = if is_piggybacked { OutcomeSource::Piggyback } else { OutcomeSource::Report };
            ((receiver, slot), outcome, source)
        })
    });
    let recorded = own_outcomes.into_iter().flat_map(|own| {
        let recorded = changed.iter().flat_map(|slots| outcomes.in_slots(slots.clone()));
        recorded.map(move |(slot, outcome)| ((own, slot), outcome, OutcomeSource::Own))
    });
    let all = reported.chain(recorded);
    for (key, outcome, source) in all.filter(|&(key, ..)| events.in_slot(key).next().is_none()) {
        let Some((transmitter, success)) = opportunity(&evidence, key, outcome) else { continue };
        match sources.event(transmitter, key, success, source) {
            Some(event) => drop(located.insert(key, previous.located.shared(&key, event))),
            None => drop(unlocated.insert(key)),
        }
    }
    LocatedEvents::new(located, &previous.located, unlocated, wrong_tracks, horizon)
}

/// Returns the horizon: the last slot with a reported outcome or waypoint.
fn horizon(evidence: &SlotEvidence<'_>, track: &Track) -> Option<CacheHorizon> {
    let last = |sender| {
        let content = evidence.reports.reports_of(sender)?;
        let outcome = content.outcomes.last_key_value().map(|(&slot, _)| slot);
        outcome.max(content.track.waypoints().last_key_value().map(|(&slot, _)| slot))
    };
    let slot = evidence.others().filter_map(last).max();
    let begin_s = slot.map_or(Some(f64::NEG_INFINITY), |slot| evidence.codec.team.slots.begin_s(slot))?;
    // The position at the last slot is interpolated with the next one.
    let time_s = if slot.is_none() || evidence.own.is_none() { begin_s } else { track.next_time_s(begin_s)? };
    Some(CacheHorizon { slot, time_s })
}

/// Returns the transmitter of a slot, and whether the receiver heard it. `None` if the report does not count.
fn opportunity(evidence: &SlotEvidence<'_>, key: EventKey, outcome: ReportedOutcome) -> Option<(u8, bool)> {
    let team = &evidence.codec.team;
    let transmitter = team.number(team.slots.sender(key.1)?)?;
    let success = match outcome {
        ReportedOutcome::Heard => true,
        ReportedOutcome::Missed => false,
        ReportedOutcome::Contradictory => return None,
    };
    let counts = evidence.is_transmission(transmitter, key.1) && evidence.keeps_slots(key.0, key.1);
    let keeps_slots = match Some(key.0) == evidence.own {
        true => evidence.arrives_in_slots(transmitter, key.1),
        false => evidence.keeps_slots(transmitter, key.1),
    };
    (counts && keeps_slots).then_some((transmitter, success))
}

/// Returns the positions of other members when they transmitted, and those that the host knows.
fn observed_positions(codec: &TeamCodec, events: &Events, peers: &BTreeMap<u8, PeerTracks>) -> BTreeMap<u8, Track> {
    let known = |(&member, tracks): (&u8, &PeerTracks)| (member, tracks.all.clone().into_fixes());
    let mut observed: BTreeMap<u8, Vec<(f64, Position)>> = peers.iter().map(known).collect();
    for event in events.iter() {
        if let Some(member) = codec.team.number(&event.transmitter_id) {
            observed.entry(member).or_default().push((event.time_s, event.link.transmitter));
        }
    }
    observed.into_iter().map(|(member, fixes)| (member, Track::new(fixes))).collect()
}

impl PositionSources<'_> {
    fn event(
        &self,
        transmitter: u8,
        (receiver, slot): EventKey,
        success: bool,
        source: OutcomeSource,
    ) -> Option<Event> {
        let team = &self.evidence.codec.team;
        let time_s = team.slots.begin_s(slot)?;
        let at = |member: u8| {
            let position = match (source, self.wrong_tracks.contains(&member)) {
                _ if Some(member) == self.evidence.own => self.track.at(time_s)?,
                (OutcomeSource::Own, _) => {
                    self.known_at(member, slot, time_s).or_else(|| self.reported_within(member, slot))?
                }
                (OutcomeSource::Piggyback, _) | (OutcomeSource::Report, true) => {
                    self.observed_at(member, time_s).or_else(|| self.reported_at(member, slot))?
                }
                (OutcomeSource::Report, false) => self.reported_at(member, slot)?,
            };
            (position.depth_m.is_some() || !team.model.inputs.has_depths()).then_some(position)
        };
        Some(Event {
            time_s,
            transmitter_id: team.members.get(&transmitter)?.clone(),
            receiver_id: team.members.get(&receiver)?.clone(),
            link: Link { transmitter: at(transmitter)?, receiver: at(receiver)? },
            kind: None,
            success,
        })
    }

    fn reported_at(&self, member: u8, slot: u32) -> Option<Position> {
        let SlotEvidence { codec, reports, muted, .. } = self.evidence;
        let is_used = !muted.contains(&member) && !self.wrong_tracks.contains(&member);
        is_used.then(|| reported_position(codec, reports, member, slot)).flatten()
    }

    /// Returns the reported position if the track continues after the slot. A position beyond the track would be known
    /// more often in slots that the vehicle heard, because their messages extend the track.
    fn reported_within(&self, member: u8, slot: u32) -> Option<Position> {
        let continues = self.evidence.reports.reports_of(member)?.track.continues_after(slot);
        continues.then(|| self.reported_at(member, slot)).flatten()
    }

    /// Returns the position that the host knows, by a rule that does not depend on whether the vehicle heard the slot.
    fn known_at(&self, member: u8, slot: u32, time_s: f64) -> Option<Position> {
        let team = &self.evidence.codec.team;
        self.peers.get(&member)?.at(time_s, team.slots.next_begin_s(slot)?, 2.0 * team.extrapolation_s_max)
    }

    /// Returns the position between two observed positions, if these are close in time. The path between them need not
    /// be straight.
    fn observed_at(&self, member: u8, time_s: f64) -> Option<Position> {
        self.observed.get(&member)?.at_within(time_s, 2.0 * self.evidence.codec.team.extrapolation_s_max)
    }
}
