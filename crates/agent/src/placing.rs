//! Events of others: what they told of single transmissions, and where that was.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use pingmap_packet::Cell;

use crate::clock::Reckoning;
use crate::event::{Event, Link, Position};
use crate::events::Events;
use crate::frames::{Frames, ToldKey};
use crate::reports::{EVERY_SLOT, Reports, Said};
use crate::track::Track;
use crate::turns::{Known, Turns};

/// Events that were told and have a place.
pub(crate) type ToldEvents = BTreeMap<ToldKey, Arc<Event>>;

/// Whether an event was told, and just so.
pub(crate) fn is_among(told: &ToldEvents, (key, event): (&ToldKey, &Arc<Event>)) -> bool {
    told.get(key).is_some_and(|other| is_same(other, event))
}

/// The same, asked of events in the order of their keys, one after the other: O(told) for all of them.
pub(crate) fn among(told: &ToldEvents) -> impl FnMut((&ToldKey, &Arc<Event>)) -> bool {
    let mut told = told.iter().peekable();
    move |(key, event)| {
        while told.next_if(|(other, _)| *other < key).is_some() {}
        told.peek().is_some_and(|(other, same)| *other == key && is_same(same, event))
    }
}

fn is_same(a: &Arc<Event>, b: &Arc<Event>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

/// Events of others by what they told.
#[derive(Debug, Clone, Default)]
pub(crate) struct Placed {
    /// Those whose ends are known. What the vehicle has recorded itself is not among them.
    pub(crate) events: Arc<ToldEvents>,
    /// Length of the longest link that each member told of.
    pub(crate) longest_m: BTreeMap<u8, f64>,
    /// Those that wait until it is known where they took place.
    pub(crate) waiting: BTreeSet<ToldKey>,
    /// What the vehicle records of its own behind this changes nothing of all this; none where it may.
    settled: Option<Settled>,
}

impl Placed {
    /// Where all is as it was `before` it is the same in memory, too, so that it is soon known to be.
    fn new(events: ToldEvents, before: &Self, waiting: BTreeSet<ToldKey>, settled: Option<Settled>) -> Self {
        let mut longest_m = BTreeMap::<u8, f64>::new();
        for (key, event) in &events {
            let longest_m = longest_m.entry(key.0).or_default();
            *longest_m = longest_m.max(event.link.range_m());
        }
        let is_same = |(now, before): (&Arc<Event>, &Arc<Event>)| Arc::ptr_eq(now, before);
        let is_as_before =
            events.len() == before.events.len() && events.values().zip(before.events.values()).all(is_same);
        let events = if is_as_before { before.events.clone() } else { Arc::new(events) };
        Self { events, longest_m, waiting, settled }
    }

    /// What was placed, and what waited, in other slots than these.
    fn outside(&self, changed: &[Range<u32>]) -> (ToldEvents, BTreeSet<ToldKey>) {
        if changed.contains(&EVERY_SLOT) {
            return Default::default();
        }
        let is_outside = |key: &ToldKey| !changed.iter().any(|slots| slots.contains(&key.1));
        let (mut events, mut waiting) = (ToldEvents::clone(&self.events), self.waiting.clone());
        events.retain(|key, _| is_outside(key));
        waiting.retain(is_outside);
        (events, waiting)
    }

    /// An event, the same in memory as it was if it is the same.
    fn as_it_was(&self, key: &ToldKey, event: Event) -> Arc<Event> {
        let same = self.events.get(key).filter(|before| ***before == event);
        same.map_or_else(|| Arc::new(event), Arc::clone)
    }
}

/// What followed about the events of others the last time, and the slots in which something else may follow since.
#[derive(Debug, Clone, Default)]
pub(crate) struct Before {
    placed: Placed,
    /// Apart from each other.
    changed: Vec<Range<u32>>,
}

/// What follows about the events of others, found when it is asked for after something changed.
#[derive(Debug, Clone, Default)]
pub(crate) struct Placement {
    now: OnceLock<Placed>,
    before: Before,
}

impl Placement {
    pub(crate) fn get_or_place(&self, place: impl FnOnce(&Before) -> Placed) -> &Placed {
        self.now.get_or_init(|| place(&self.before))
    }

    /// Notes that of these slots something else may follow.
    pub(crate) fn change(&mut self, slots: Range<u32>) {
        if let Some(placed) = self.now.take() {
            self.before = Before { placed, changed: Vec::new() };
        }
        let is_apart = |other: &Range<u32>| other.end < slots.start || slots.end < other.start;
        let (mut changed, near): (Vec<_>, Vec<_>) = self.before.changed.drain(..).partition(is_apart);
        let all = near.into_iter().fold(slots, |all, near| all.start.min(near.start)..all.end.max(near.end));
        changed.push(all);
        self.before.changed = changed;
    }

    /// Whether something of its own of this time, in this slot if in any, changes nothing but what is to be looked at anyway.
    pub(crate) fn is_settled_before(&self, time_s: f64, slot: Option<u32>) -> bool {
        let settled = self.now.get().unwrap_or(&self.before.placed).settled;
        settled.is_some_and(|settled| settled.is_before(time_s, slot))
    }
}

/// The last slot that others told of, and when the vehicle knows for the first time after that began where it was itself.
#[derive(Debug, Clone, Copy)]
struct Settled {
    slot: Option<u32>,
    time_s: f64,
}

impl Settled {
    /// Whether something of its own of this time, in this slot if in any, is behind it.
    fn is_before(&self, time_s: f64, slot: Option<u32>) -> bool {
        time_s > self.time_s && slot.is_none_or(|slot| Some(slot) > self.slot)
    }
}

/// What is known of where everybody was.
struct Whereabouts<'a> {
    frames: &'a Frames,
    reports: &'a Reports,
    own: Option<u8>,
    /// The vehicle's own way.
    track: Track,
    /// Where others were when they sent, as the vehicle recorded it with its events, heard or missed alike.
    seen: BTreeMap<u8, Track>,
}

/// Places what others told, and what the vehicle itself heard and missed while its clock was wrong: whom it missed then it could not
/// say, and not where. What a report says lies where reports say that both ends were, on a leg or for a while behind one. What spare
/// bits say lies where the vehicle itself knows that others were. In neither case does it depend on what became of the transmission.
/// What was placed before stays where nothing changed, unless spare bits came, somebody may have been silent, or its clock was wrong.
/// O(own places + told), and with a logarithm what changed.
pub(crate) fn place(known: Known<'_>, track: Track, before: &Before) -> Placed {
    let Known { frames, own, events, reports, reckoning } = known;
    let turns = Turns::new(known);
    let has_recent = others(own, reports).any(|sender| reports.recent(sender).next().is_some());
    // By spare bits, where somebody may have been silent, or its clock was wrong, it depends on all of its own events who was where,
    // or who sent.
    let is_by_reports = !has_recent && !known.is_in_doubt();
    let settled = if is_by_reports { settled(frames, own, &track, reports) } else { None };
    let changed: &[Range<u32>] = if is_by_reports { &before.changed } else { &[EVERY_SLOT] };
    let (mut told, mut waiting) = before.placed.outside(changed);
    let seen = if has_recent { seen(frames, events, reckoning) } else { BTreeMap::new() };
    let whereabouts = Whereabouts { frames, reports, own, track, seen };
    let of_others = others(own, reports).flat_map(|receiver| {
        let outcomes = changed.iter().flat_map(move |slots| reports.outcomes(receiver, slots.clone()));
        outcomes.map(move |(slot, said, is_recent)| ((receiver, slot), said, is_recent))
    });
    let of_others = of_others.filter(|&(key, ..)| events.in_slot(key).next().is_none());
    let of_own = own.into_iter().flat_map(|own| {
        let outcomes = reckoning.outcomes.iter();
        outcomes.map(move |(&slot, &heard)| ((own, slot), Said::from(heard), false))
    });
    for (key, said, is_recent) in of_others.chain(of_own) {
        let Some((transmitter, success)) = opportunity(frames, &turns, key, said) else { continue };
        match whereabouts.event(transmitter, key, success, is_recent) {
            Some(event) => drop(told.insert(key, before.placed.as_it_was(&key, event))),
            None => drop(waiting.insert(key)),
        }
    }
    Placed::new(told, &before.placed, waiting, settled)
}

/// Everybody else who said something.
fn others(own: Option<u8>, reports: &Reports) -> impl Iterator<Item = u8> {
    reports.senders().filter(move |&sender| Some(sender) != own)
}

/// What members say that they sent and this one did not record, as missed, where both ends are known.
pub(crate) fn unheard(known: Known<'_>, own: u8, track: Track) -> Vec<Event> {
    let Known { frames, events, reports, reckoning, .. } = known;
    let apart = frames.team.slots.at_once() as u32;
    let recorded = events.recorded().iter().filter(|known| reckoning.counts(&known.event));
    let recorded = recorded.filter_map(|known| Some((known.key?, &known.event)));
    let recorded = recorded.filter(|((receiver, _), _)| *receiver == own);
    // What was heard is of a slot in which its sender says that it sent, wherever it seemed to be.
    let known: BTreeSet<u32> = recorded
        .map(|((_, slot), event)| {
            let sender = frames.team.number(&event.transmitter_id).filter(|_| event.success);
            sender.and_then(|sender| reports.sent_about(sender, slot, apart)).unwrap_or(slot)
        })
        .chain(reckoning.outcomes.keys().copied())
        .collect();
    let whereabouts = Whereabouts { frames, reports, own: Some(own), track, seen: BTreeMap::new() };
    let sent = others(Some(own), reports).flat_map(|sender| {
        let sent = reports.turns(sender, EVERY_SLOT).filter(|&(slot, sent)| sent && !known.contains(&slot));
        sent.map(move |(slot, _)| (sender, slot))
    });
    sent.filter_map(|(sender, slot)| whereabouts.event(sender, (own, slot), false, false)).collect()
}

/// From when on the vehicle's own events change nothing, where places follow from reports and its own track.
fn settled(frames: &Frames, own: Option<u8>, track: &Track, reports: &Reports) -> Option<Settled> {
    let last = |sender| reports.told_by(sender)?.outcomes.last_key_value().map(|(&slot, _)| slot);
    let slot = others(own, reports).filter_map(last).max();
    let begin_s = slot.map_or(Some(f64::NEG_INFINITY), |slot| frames.team.slots.begin_s(slot))?;
    // Where it was then follows from where it was next.
    let time_s = if slot.is_none() || own.is_none() { begin_s } else { track.next_s(begin_s)? };
    Some(Settled { slot, time_s })
}

/// Who sent in a slot, and whether it was heard; nobody where it was not sent, or a receiver says both.
fn opportunity(frames: &Frames, turns: &Turns<'_>, key: ToldKey, said: Said) -> Option<(u8, bool)> {
    let transmitter = frames.team.number(frames.team.slots.sender(key.1)?)?;
    let success = match said {
        Said::Heard => true,
        Said::Missed => false,
        Said::Contradicted => return None,
    };
    turns.was_sent(transmitter, key, success).then_some((transmitter, success))
}

fn seen(frames: &Frames, events: &Events, reckoning: &Reckoning) -> BTreeMap<u8, Track> {
    let mut seen = BTreeMap::<u8, Vec<(f64, Position)>>::new();
    for event in events.iter() {
        if let Some(member) = frames.team.number(&event.transmitter_id) {
            seen.entry(member).or_default().push((reckoning.team_s(event.time_s), event.link.transmitter));
        }
    }
    seen.into_iter().map(|(member, fixes)| (member, Track::new(fixes))).collect()
}

impl Whereabouts<'_> {
    fn event(&self, transmitter: u8, (receiver, slot): ToldKey, success: bool, is_recent: bool) -> Option<Event> {
        let team = &self.frames.team;
        let time_s = team.slots.begin_s(slot)?;
        let at = |member: u8| {
            let position = match Some(member) == self.own {
                true => self.track.at(time_s)?,
                false if is_recent => self.seen_at(member, time_s).or_else(|| self.by_knots(member, slot))?,
                false => self.by_knots(member, slot)?,
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

    fn by_knots(&self, member: u8, slot: u32) -> Option<Position> {
        let team = &self.frames.team;
        let place = |cell: Cell| team.grid.knot_position(&team.model.chart, cell, team.model.inputs.has_depths());
        self.reports.told_by(member)?.track.at(slot, &team.slots, &place, team.onward_s_max)
    }

    /// Nothing says that others went straight between two places where they were seen, but that they were there soon before or
    /// after.
    fn seen_at(&self, member: u8, time_s: f64) -> Option<Position> {
        self.seen.get(&member)?.at_within(time_s, 2.0 * self.frames.team.onward_s_max)
    }
}
