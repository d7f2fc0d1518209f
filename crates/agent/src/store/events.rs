//! The events that a vehicle stores.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::codec::decoded::EventKey;
use crate::types::event::Event;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RecordedEvent {
    /// Number of events recorded before it.
    pub(crate) number: u64,
    /// Receiver and slot, if the event is between members and in a slot. They do not change, because a team's schedule
    /// is fixed.
    pub(crate) key: Option<EventKey>,
    pub(crate) event: Event,
}

impl RecordedEvent {
    /// Compares two events in canonical order, then by number.
    pub(crate) fn order(&self, other: &Self) -> Ordering {
        self.event.canonical_order(&other.event).then(self.number.cmp(&other.number))
    }

    fn numbered_key(&self) -> Option<(EventKey, u64)> {
        Some((self.key?, self.number))
    }
}

/// Change of the events that count.
#[derive(Debug, Default)]
pub(crate) struct EventChange {
    /// Events that were added.
    pub(crate) new: Vec<RecordedEvent>,
    /// Events that count again. They may still be in the last fit.
    pub(crate) restored: Vec<RecordedEvent>,
    /// Number of other events that were removed, or that no longer count.
    pub(crate) forgotten: usize,
}

/// The stored events: those with the largest numbers.
///
/// Events are forgotten by number, because clocks may be set back. They are forgotten a sixteenth at a time, because
/// each time needs a refit. Clones share their memory.
#[derive(Debug, Clone)]
pub(crate) struct Events {
    events_max: usize,
    /// Events in canonical order, so that fits do not depend on the order of arrival.
    in_order: Arc<Vec<RecordedEvent>>,
    numbers: Arc<BTreeSet<u64>>,
    /// Outcomes of the events that have a key, by key and number.
    outcomes: Arc<BTreeMap<(EventKey, u64), bool>>,
}

impl Events {
    pub(crate) fn new(events_max: usize) -> Self {
        Self {
            events_max: events_max.max(1),
            in_order: Arc::default(),
            numbers: Arc::default(),
            outcomes: Arc::default(),
        }
    }

    /// Inserts events with these numbers. Two events with one number cannot come from one vehicle; then the first one
    /// in canonical order is kept. Searches in O(log N) for one event, and moves up to N events in memory. O(N log N)
    /// for many events.
    pub(crate) fn insert(&mut self, new: Vec<RecordedEvent>) -> EventChange {
        let mut change = EventChange::default();
        let mut added = Vec::new();
        for recorded in new {
            let is_old = recorded.number < self.first_kept_number();
            if is_old || self.in_order.binary_search_by(|stored| stored.order(&recorded)).is_ok() {
                continue;
            }
            if Arc::make_mut(&mut self.numbers).insert(recorded.number) {
                change.new.push(recorded.clone());
                added.push(recorded);
            } else {
                // This case is rare, so it may be slow.
                self.merge(std::mem::take(&mut added));
                if self.replace_if_earlier(&recorded) {
                    change.new.push(recorded);
                    change.forgotten += 1;
                }
            }
        }
        self.merge(added);
        change.forgotten += self.forget_oldest();
        change
    }

    fn merge(&mut self, mut added: Vec<RecordedEvent>) {
        let outcome = |added: &RecordedEvent| Some((added.numbered_key()?, added.event.success));
        let outcomes: Vec<((EventKey, u64), bool)> = added.iter().filter_map(outcome).collect();
        if !outcomes.is_empty() {
            Arc::make_mut(&mut self.outcomes).extend(outcomes);
        }
        let in_order = Arc::make_mut(&mut self.in_order);
        if added.len() == 1 {
            let recorded = added.remove(0);
            let index = in_order.partition_point(|stored| stored.order(&recorded).is_lt());
            in_order.insert(index, recorded);
        } else if !added.is_empty() {
            in_order.extend(added);
            in_order.sort_by(RecordedEvent::order);
        }
    }

    /// Replaces the stored event of the same number if `recorded` precedes it in canonical order. Returns whether it
    /// did.
    fn replace_if_earlier(&mut self, recorded: &RecordedEvent) -> bool {
        let in_order = Arc::make_mut(&mut self.in_order);
        let index = in_order.iter().position(|stored| stored.number == recorded.number);
        let Some(index) = index.filter(|&index| in_order[index].order(recorded).is_gt()) else { return false };
        if let Some(removed) = in_order.remove(index).numbered_key() {
            Arc::make_mut(&mut self.outcomes).remove(&removed);
        }
        self.merge(vec![recorded.clone()]);
        true
    }

    /// Removes the events below [`Events::first_kept_number`]. Returns their number.
    fn forget_oldest(&mut self) -> usize {
        let first_kept = self.first_kept_number();
        if self.numbers.first().is_none_or(|&number| number >= first_kept) {
            return 0;
        }
        let before = self.in_order.len();
        Arc::make_mut(&mut self.in_order).retain(|stored| stored.number >= first_kept);
        let kept = Arc::make_mut(&mut self.numbers).split_off(&first_kept);
        self.numbers = Arc::new(kept);
        Arc::make_mut(&mut self.outcomes).retain(|&(_, number), _| number >= first_kept);
        before - self.in_order.len()
    }

    /// Returns the smallest number that is kept, given the largest number.
    fn first_kept_number(&self) -> u64 {
        let (max, step) = (self.events_max as u64, (self.events_max as u64 / 16).max(1));
        self.next_number().saturating_sub(max).div_ceil(step) * step
    }

    pub(crate) fn next_number(&self) -> u64 {
        self.numbers.last().map_or(0, |&last| last.saturating_add(1))
    }

    pub(crate) fn len(&self) -> usize {
        self.in_order.len()
    }

    /// Returns the events in canonical order.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &Event> + DoubleEndedIterator + Clone {
        self.in_order.iter().map(|recorded| &recorded.event)
    }

    /// Returns the events that precede an event in canonical order, the latest first.
    pub(crate) fn before(&self, event: &Event) -> impl Iterator<Item = &Event> {
        let index = self.in_order.partition_point(|recorded| recorded.event.canonical_order(event).is_lt());
        self.in_order[..index].iter().rev().map(|recorded| &recorded.event)
    }

    /// Returns the events with numbers and keys, in canonical order.
    pub(crate) fn recorded(&self) -> &[RecordedEvent] {
        &self.in_order
    }

    /// Returns the numbers and outcomes of a receiver's events in a slot. O(log N).
    pub(crate) fn in_slot(&self, key: EventKey) -> impl Iterator<Item = (u64, bool)> {
        self.outcomes.range((key, 0)..=(key, u64::MAX)).map(|(&(_, number), &success)| (number, success))
    }

    /// Returns the slots and numbers of a receiver's events.
    pub(crate) fn slots_of(&self, receiver: u8) -> impl Iterator<Item = (u32, u64)> {
        let all = ((receiver, 0), 0)..=((receiver, u32::MAX), u64::MAX);
        self.outcomes.range(all).map(|(&((_, slot), number), _)| (slot, number))
    }

    /// Returns the events between two times, both inclusive.
    pub(crate) fn between(&self, (from_s, to_s): (f64, f64)) -> &[RecordedEvent] {
        let from = self.since(from_s);
        &from[..from.partition_point(|recorded| recorded.event.time_s <= to_s)]
    }

    /// Returns the smallest number of a stored event; 0 without events.
    pub(crate) fn first_number(&self) -> u64 {
        self.numbers.first().copied().unwrap_or_default()
    }

    pub(crate) fn since(&self, time_s: f64) -> &[RecordedEvent] {
        &self.in_order[self.in_order.partition_point(|recorded| recorded.event.time_s < time_s)..]
    }
}
