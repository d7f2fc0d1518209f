//! The events that a vehicle remembers.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::sync::Arc;

use crate::event::Event;
use crate::frames::ToldKey;
use crate::shifts::Shifts;

/// An event as the vehicle remembers it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Recorded {
    /// How many it had observed before.
    pub(crate) number: u64,
    /// Whose event it is in which slot, if it is between members and in one: known once and for all, because a team's slots stay.
    pub(crate) key: Option<ToldKey>,
    /// By which shifts of the vehicle's clock it would be in turn, if it is the vehicle's own, of a member, in a slot.
    pub(crate) shifts: Option<Shifts>,
    pub(crate) event: Event,
}

impl Recorded {
    /// That of the events, and of their numbers where these are the same.
    pub(crate) fn order(&self, other: &Self) -> Ordering {
        self.event.canonical_order(&other.event).then(self.number.cmp(&other.number))
    }

    fn numbered_key(&self) -> Option<(ToldKey, u64)> {
        Some((self.key?, self.number))
    }
}

/// What became of the events that were put in.
#[derive(Debug, Default)]
pub(crate) struct Change {
    /// Those that were not there.
    pub(crate) new: Vec<Recorded>,
    /// How many others went for them.
    pub(crate) forgotten: usize,
}

/// Events by their numbers, the latest of them: which are there depends on the set of those put in alone. They are
/// forgotten by number and not by the clock, which may be set back, and a sixteenth at a time, because whoever forgets
/// must fit again. Shared by copies.
#[derive(Debug, Clone)]
pub(crate) struct Events {
    events_max: usize,
    /// In canonical order, so that fits do not depend on the order of arrival.
    in_order: Arc<Vec<Recorded>>,
    numbers: Arc<BTreeSet<u64>>,
    /// Numbers of the events that have a key, behind their keys.
    keys: Arc<BTreeSet<(ToldKey, u64)>>,
    /// Length of the longest link.
    longest_m: f64,
    /// How many messages were heard in no slot of their sender's.
    pub(crate) strange: usize,
}

impl Events {
    pub(crate) fn new(events_max: usize) -> Self {
        Self {
            events_max: events_max.max(1),
            in_order: Arc::default(),
            numbers: Arc::default(),
            keys: Arc::default(),
            longest_m: 0.0,
            strange: 0,
        }
    }

    /// Puts in events that have these numbers. Of two events under one number, which no vehicle makes, the first in
    /// canonical order stays. O(log N) for one, but for the others' moving aside; O(N log N) for many.
    pub(crate) fn insert(&mut self, new: Vec<Recorded>) -> Change {
        let mut change = Change::default();
        let mut added = Vec::new();
        for entry in new {
            let is_old = entry.number < self.first_kept();
            if is_old || self.in_order.binary_search_by(|known| known.order(&entry)).is_ok() {
                continue;
            }
            if Arc::make_mut(&mut self.numbers).insert(entry.number) {
                change.new.push(entry.clone());
                added.push(entry);
            } else {
                // Rare, and so it may be slow.
                self.merge(std::mem::take(&mut added));
                if self.settle(&entry) {
                    change.new.push(entry);
                    change.forgotten += 1;
                }
            }
        }
        self.merge(added);
        change.forgotten += self.forget();
        let new_m = change.new.iter().map(|known| known.event.link.range_m());
        self.longest_m = match change.forgotten {
            0 => new_m.fold(self.longest_m, f64::max),
            _ => self.iter().map(|event| event.link.range_m()).fold(0.0, f64::max),
        };
        let is_strange = |known: &&Recorded| known.event.success && known.shifts.is_some_and(|shifts| !shifts.has(0));
        self.strange = match change.forgotten {
            0 => self.strange + change.new.iter().filter(is_strange).count(),
            _ => self.in_order.iter().filter(is_strange).count(),
        };
        change
    }

    fn merge(&mut self, mut added: Vec<Recorded>) {
        let keys: Vec<(ToldKey, u64)> = added.iter().filter_map(Recorded::numbered_key).collect();
        if !keys.is_empty() {
            Arc::make_mut(&mut self.keys).extend(keys);
        }
        let in_order = Arc::make_mut(&mut self.in_order);
        if added.len() == 1 {
            let entry = added.remove(0);
            let place = in_order.partition_point(|known| known.order(&entry).is_lt());
            in_order.insert(place, entry);
        } else if !added.is_empty() {
            in_order.extend(added);
            in_order.sort_by(Recorded::order);
        }
    }

    /// Puts an event in the place of the other one of its number, if it comes before that; whether it did.
    fn settle(&mut self, entry: &Recorded) -> bool {
        let in_order = Arc::make_mut(&mut self.in_order);
        let place = in_order.iter().position(|known| known.number == entry.number);
        let Some(place) = place.filter(|&place| in_order[place].order(entry).is_gt()) else { return false };
        if let Some(gone) = in_order.remove(place).numbered_key() {
            Arc::make_mut(&mut self.keys).remove(&gone);
        }
        self.merge(vec![entry.clone()]);
        true
    }

    /// Lets the oldest go, and says how many.
    fn forget(&mut self) -> usize {
        let first_kept = self.first_kept();
        if self.numbers.first().is_none_or(|&number| number >= first_kept) {
            return 0;
        }
        let before = self.in_order.len();
        Arc::make_mut(&mut self.in_order).retain(|known| known.number >= first_kept);
        let kept = Arc::make_mut(&mut self.numbers).split_off(&first_kept);
        self.numbers = Arc::new(kept);
        Arc::make_mut(&mut self.keys).retain(|&(_, number)| number >= first_kept);
        before - self.in_order.len()
    }

    /// The smallest number that is not too old beside the largest.
    fn first_kept(&self) -> u64 {
        let (max, step) = (self.events_max as u64, (self.events_max as u64 / 16).max(1));
        self.count().saturating_sub(max).div_ceil(step) * step
    }

    /// The number of the next event.
    pub(crate) fn count(&self) -> u64 {
        self.numbers.last().map_or(0, |&last| last.saturating_add(1))
    }

    /// Length of the longest link; 0 without events.
    pub(crate) fn longest_m(&self) -> f64 {
        self.longest_m
    }

    pub(crate) fn len(&self) -> usize {
        self.in_order.len()
    }

    /// In canonical order.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &Event> + DoubleEndedIterator + Clone {
        self.in_order.iter().map(|known| &known.event)
    }

    /// Those before an event in canonical order, the latest first.
    pub(crate) fn before(&self, event: &Event) -> impl Iterator<Item = &Event> {
        let place = self.in_order.partition_point(|known| known.event.canonical_order(event).is_lt());
        self.in_order[..place].iter().rev().map(|known| &known.event)
    }

    /// In canonical order, with what else is known of them.
    pub(crate) fn recorded(&self) -> &[Recorded] {
        &self.in_order
    }

    /// Numbers of a vehicle's events in a slot. O(log N).
    pub(crate) fn in_slot(&self, key: ToldKey) -> impl Iterator<Item = u64> {
        self.keys.range((key, 0)..=(key, u64::MAX)).map(|&(_, number)| number)
    }

    /// Slots of a vehicle's events, with their numbers.
    pub(crate) fn slots_of(&self, receiver: u8) -> impl Iterator<Item = (u32, u64)> {
        let all = ((receiver, 0), 0)..=((receiver, u32::MAX), u64::MAX);
        self.keys.range(all).map(|&((_, slot), number)| (slot, number))
    }

    /// Those from a time on.
    pub(crate) fn since(&self, time_s: f64) -> &[Recorded] {
        &self.in_order[self.in_order.partition_point(|known| known.event.time_s < time_s)..]
    }
}
