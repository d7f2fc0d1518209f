//! Events of others: what they told of single transmissions, and where that was.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pingmap_packet::Cell;

use crate::event::{Event, Link, Position};
use crate::events::Events;
use crate::frames::{Frames, ToldKey};
use crate::reports::{Reports, Said};
use crate::track::Track;
use crate::turns::{Turns, may_be_silent};

/// Events that were told and have a place.
pub(crate) type ToldEvents = BTreeMap<ToldKey, Arc<Event>>;

/// Whether an event was told, and just so.
pub(crate) fn is_among(told: &ToldEvents, (key, event): (&ToldKey, &Arc<Event>)) -> bool {
    told.get(key).is_some_and(|other| Arc::ptr_eq(other, event) || other == event)
}

/// Events of others by what they told.
#[derive(Debug, Clone)]
pub(crate) struct Placed {
    /// Those whose ends are known. What the vehicle has recorded itself is not among them.
    pub(crate) events: Arc<ToldEvents>,
    /// Length of the longest link that each member told of.
    pub(crate) longest_m: BTreeMap<u8, f64>,
    /// How many wait until it is known where they took place.
    pub(crate) waiting: usize,
    /// What the vehicle records of its own behind this changes nothing of all this; none where it may.
    pub(crate) settled: Option<Settled>,
}

impl Placed {
    /// What is as it was `before` is the same in memory, too, so that it is soon known to be.
    fn new(mut events: ToldEvents, before: &Arc<ToldEvents>, waiting: usize, settled: Option<Settled>) -> Self {
        let mut longest_m = BTreeMap::<u8, f64>::new();
        for (key, event) in &mut events {
            let longest_m = longest_m.entry(key.0).or_default();
            *longest_m = longest_m.max(event.link.range_m());
            if let Some(same) = before.get(key).filter(|before| **before == *event) {
                *event = same.clone();
            }
        }
        let is_same = |(now, before): (&Arc<Event>, &Arc<Event>)| Arc::ptr_eq(now, before);
        let is_as_before = events.len() == before.len() && events.values().zip(before.values()).all(is_same);
        let events = if is_as_before { before.clone() } else { Arc::new(events) };
        Self { events, longest_m, waiting, settled }
    }
}

/// The last slot that others told of, and when the vehicle knows for the first time after that began where it was itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settled {
    slot: Option<u32>,
    time_s: f64,
}

impl Settled {
    /// Whether something of its own of this time, in this slot if in any, is behind it.
    pub(crate) fn is_before(&self, time_s: f64, slot: Option<u32>) -> bool {
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

/// Places what others told. What a report says lies where reports say that both ends were, on a leg or for a
/// while behind one. What spare bits say lies where the vehicle itself knows that others were. In neither case does it depend on
/// what became of the transmission. `before` is what was placed the last time. O(events + told), each with a logarithm.
pub(crate) fn place(
    frames: &Frames,
    own: Option<u8>,
    events: &Events,
    track: Track,
    reports: &Reports,
    before: &Arc<ToldEvents>,
) -> Placed {
    let (mut placed, mut waiting) = (ToldEvents::new(), 0);
    let turns = Turns::new(frames, events, reports);
    let settled = settled(frames, own, &track, reports);
    if reports.senders().any(|sender| Some(sender) != own) {
        // Of itself it asks nobody.
        let own_id = own.and_then(|own| frames.team.members.get(&own));
        let of_others = events.recorded().iter().filter(|known| Some(&known.event.receiver_id) != own_id);
        let recorded: BTreeSet<ToldKey> = of_others.filter_map(|known| known.key).collect();
        let has_recent = reports.senders().any(|sender| reports.recent(sender).next().is_some());
        let seen = if has_recent { seen(frames, events) } else { BTreeMap::new() };
        let whereabouts = Whereabouts { frames, reports, own, track, seen };
        for receiver in reports.senders().filter(|&sender| Some(sender) != own) {
            let outcomes = reports.outcomes(receiver);
            for (slot, said, is_recent) in outcomes.filter(|(slot, ..)| !recorded.contains(&(receiver, *slot))) {
                let Some((transmitter, success)) = opportunity(frames, &turns, (receiver, slot), said) else {
                    continue;
                };
                match whereabouts.event(transmitter, receiver, slot, success, is_recent) {
                    Some(event) => drop(placed.insert((receiver, slot), Arc::new(event))),
                    None => waiting += 1,
                }
            }
        }
    }
    Placed::new(placed, before, waiting, settled)
}

/// What members say that they sent and this one did not record, as missed, where both ends are known.
pub(crate) fn unheard(frames: &Frames, own: u8, events: &Events, track: Track, reports: &Reports) -> Vec<Event> {
    let apart = frames.team.slots.at_once() as u32;
    let recorded = events.recorded().iter().filter_map(|known| Some((known.key?, &known.event)));
    let recorded = recorded.filter(|((receiver, _), _)| *receiver == own);
    // What was heard is of a slot in which its sender says that it sent, wherever it seemed to be.
    let known: BTreeSet<u32> = recorded
        .map(|((_, slot), event)| {
            let sender = frames.team.number(&event.transmitter_id).filter(|_| event.success);
            sender.and_then(|sender| reports.sent_about(sender, slot, apart)).unwrap_or(slot)
        })
        .collect();
    let whereabouts = Whereabouts { frames, reports, own: Some(own), track, seen: BTreeMap::new() };
    let others = reports.senders().filter(|&sender| sender != own);
    let sent = others.flat_map(|sender| {
        let sent = reports.turns(sender).filter(|&(slot, sent)| sent && !known.contains(&slot));
        sent.map(move |(slot, _)| (sender, slot))
    });
    sent.filter_map(|(sender, slot)| whereabouts.event(sender, own, slot, false, false)).collect()
}

/// Nothing is settled where it depends on the vehicle's own events who was where, or who sent.
fn settled(frames: &Frames, own: Option<u8>, track: &Track, reports: &Reports) -> Option<Settled> {
    let others = || reports.senders().filter(|&sender| Some(sender) != own);
    if may_be_silent(frames, reports) || others().any(|sender| reports.recent(sender).next().is_some()) {
        return None;
    }
    let slot =
        others().filter_map(|sender| reports.told_by(sender)?.outcomes.last_key_value().map(|(&slot, _)| slot)).max();
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

fn seen(frames: &Frames, events: &Events) -> BTreeMap<u8, Track> {
    let mut seen = BTreeMap::<u8, Vec<(f64, Position)>>::new();
    for event in events.iter() {
        if let Some(member) = frames.team.number(&event.transmitter_id) {
            seen.entry(member).or_default().push((event.time_s, event.link.transmitter));
        }
    }
    seen.into_iter().map(|(member, fixes)| (member, Track::new(fixes))).collect()
}

impl Whereabouts<'_> {
    fn event(&self, transmitter: u8, receiver: u8, slot: u32, success: bool, is_recent: bool) -> Option<Event> {
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
