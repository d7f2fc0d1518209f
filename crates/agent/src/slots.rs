//! Who may send when, and so what the number of a slot means.

use std::collections::BTreeSet;
use std::sync::Arc;

use pingmap_packet::SLOTS;

use crate::event::VehicleId;

/// Whose turn it is. Slots are numbered by time, from [`Slots::start_s`] on, and never by counting what was heard: whoever
/// misses a few stays in step.
///
/// Where members send at will, every stretch of [`Slots::duration_s`] has a slot for each of them, in their order, and what somebody
/// sends then is sent in its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Slots {
    /// When slot 0 begins, in seconds.
    pub start_s: f64,
    /// Length of a slot in seconds. Where members send at will it should be several times what their clocks differ and a message
    /// travels, and less than half of the time between two transmissions of one of them.
    pub duration_s: f64,
    /// Senders in turn, from slot 0 on. An empty name is nobody: the slot before it goes on.
    pub order: Vec<VehicleId>,
    /// Other orders, from later slots on.
    pub changes: Vec<SlotChange>,
    /// Members that do not send in all of their slots: what somebody heard or missed of them is an event only when they say that
    /// they sent, or yet another one heard it. (Others say when they did not.) No part of what a team must agree on.
    pub may_be_silent: BTreeSet<VehicleId>,
    /// Nobody has turns: all send when they like, and what they sent is known from their word alone ([`Agent::sent`](crate::Agent::sent)).
    /// There are numbers for 262 144 slots: with stretches of 2 s for 36 hours of four members, 14 of ten. Nothing counts behind these.
    pub at_will: bool,
    /// Transmissions one by one, in the order of time, in place of all these: what a log has where no schedule is known. The
    /// number of a slot is then its place here.
    pub listed: Option<Arc<[Opportunity]>>,
}

/// An order of senders that holds from some slot on. Members that do not know of it share what was before it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SlotChange {
    /// The first slot of it, and of its first sender.
    pub from: u32,
    /// Senders in turn, as in [`Slots::order`].
    pub order: Vec<VehicleId>,
}

/// A transmission that took place, and who could have heard it.
#[derive(Debug, Clone, PartialEq)]
pub struct Opportunity {
    /// When it was sent.
    pub time_s: f64,
    /// Who sent.
    pub sender: VehicleId,
    /// Who could have heard it.
    pub listeners: Vec<VehicleId>,
}

/// Times that are told apart less are the same.
const SAME_S: f64 = 1e-6;

impl Slots {
    /// Senders in turn, from time 0 on.
    pub fn in_turn(duration_s: f64, order: Vec<VehicleId>) -> Self {
        Self {
            start_s: 0.0,
            duration_s,
            order,
            changes: Vec::new(),
            may_be_silent: BTreeSet::new(),
            at_will: false,
            listed: None,
        }
    }

    /// Members who send when they like, from time 0 on, told apart if they do so in different stretches of this length.
    pub fn at_will(duration_s: f64, members: Vec<VehicleId>) -> Self {
        Self { at_will: true, ..Self::in_turn(duration_s, members) }
    }

    /// The same slots, numbered from the last turn of the first sender on that begins no later than this: numbers are for one
    /// mission.
    #[must_use]
    pub fn beginning_by(self, time_s: f64) -> Self {
        let round_s = self.duration_s * (self.order.len() / self.at_once()).max(1) as f64;
        let start_s = self.start_s + ((time_s - self.start_s) / round_s).floor() * round_s;
        if start_s.is_finite() { Self { start_s, ..self } } else { self }
    }

    /// The slot of this time, of several at one time the first; `None` before the first, behind the last that has a number, and at a time that is not finite.
    pub fn number(&self, time_s: f64) -> Option<u32> {
        let number = self.place(time_s);
        (time_s.is_finite() && (0.0..f64::from(SLOTS)).contains(&number)).then_some(number as u32)
    }

    /// The slot of any time, numbered or not.
    fn place(&self, time_s: f64) -> f64 {
        match &self.listed {
            Some(listed) => listed.partition_point(|listed| listed.time_s <= time_s + SAME_S) as f64 - 1.0,
            None => ((time_s - self.start_s + SAME_S) / self.duration_s).floor() * self.at_once() as f64,
        }
    }

    /// How many slots begin at one time.
    pub(crate) fn at_once(&self) -> usize {
        if self.at_will { self.order.len().max(1) } else { 1 }
    }

    /// When a slot begins.
    pub fn begin_s(&self, number: u32) -> Option<f64> {
        match &self.listed {
            Some(listed) => listed.get(number as usize).map(|listed| listed.time_s),
            None => {
                (number < SLOTS).then(|| self.start_s + f64::from(number / self.at_once() as u32) * self.duration_s)
            }
        }
    }

    /// Who may send in a slot; nobody in one that goes on, or of an order without members.
    pub fn sender(&self, number: u32) -> Option<&VehicleId> {
        self.sender_at(number.into())
    }

    /// Who may send at this time, in a slot with a number or not; nobody more than others where all do at will.
    pub fn owner(&self, time_s: f64) -> Option<&VehicleId> {
        if self.at_will { None } else { self.sender_at(self.place(time_s)) }
    }

    fn sender_at(&self, place: f64) -> Option<&VehicleId> {
        if !place.is_finite() {
            return None;
        }
        if let Some(listed) = &self.listed {
            let number = (place >= 0.0).then_some(place as usize)?;
            return listed.get(number).map(|listed| &listed.sender);
        }
        let change =
            self.changes.iter().filter(|change| f64::from(change.from) <= place).max_by_key(|change| change.from);
        let (from, order) = change.map_or((0, &self.order), |change| (change.from, &change.order));
        let turn = (place - f64::from(from)).rem_euclid(order.len() as f64);
        let turn = turn.is_finite().then_some(turn as usize)?;
        order.get(turn).filter(|name| !name.as_str().is_empty())
    }

    /// Whether a slot is one in which this vehicle could hear another one.
    pub fn is_heard_by(&self, number: u32, id: &VehicleId) -> bool {
        match &self.listed {
            Some(listed) => listed.get(number as usize).is_some_and(|listed| listed.listeners.contains(id)),
            None => self.sender(number).is_some_and(|sender| sender != id),
        }
    }

    /// Whether somebody sends in all slots of its own, unless it says that it did not.
    pub(crate) fn always_sends(&self, id: &VehicleId) -> bool {
        !self.at_will && !self.may_be_silent.contains(id)
    }

    /// The slot of what this vehicle sent at this time, if it was its turn.
    pub fn sent_in(&self, time_s: f64, id: &VehicleId) -> Option<u32> {
        let number = self.number(time_s)?;
        if let Some(listed) = &self.listed {
            let at_once = (0..=number).rev().take_while(|&slot| listed[slot as usize].time_s >= time_s - 2.0 * SAME_S);
            let slots = std::iter::once(number).chain(at_once);
            return slots.into_iter().find(|&slot| listed[slot as usize].sender == *id);
        }
        if self.at_will {
            let place = self.order.iter().position(|member| member == id)? as u32;
            return Some(number + place).filter(|&number| number < SLOTS);
        }
        self.turn_at(time_s).filter(|&begin| self.sender(begin) == Some(id))
    }

    /// The slot of what is sent at this time, by whomever, of several at one time the last; `None` where all send at will.
    pub(crate) fn turn_at(&self, time_s: f64) -> Option<u32> {
        let number = self.number(time_s).filter(|_| !self.at_will)?;
        // A turn may go on over several slots.
        (0..=number).rev().take(self.order_max()).find(|&number| self.sender(number).is_some())
    }

    /// The slot of what this vehicle sends at this time or, where it is not its turn, in its next one; `None` before the first slot,
    /// and for who has no turn any more.
    pub fn next_turn(&self, time_s: f64, id: &VehicleId) -> Option<u32> {
        let next = || {
            // Behind a change of order all of the new one may come before its turn.
            let near = if self.listed.is_some() { usize::MAX } else { 2 * self.order_max() };
            let mut ahead = (self.number(time_s)?..self.end()).skip(1).take(near);
            ahead.find(|&slot| self.sender(slot) == Some(id))
        };
        self.sent_in(time_s, id).or_else(next)
    }

    /// How many slots an order has at most, and so how many a turn may go on.
    pub(crate) fn order_max(&self) -> usize {
        self.changes.iter().map(|change| change.order.len()).fold(self.order.len(), usize::max).max(1)
    }

    /// One more than the last slot.
    pub fn end(&self) -> u32 {
        self.listed.as_ref().map_or(SLOTS, |listed| (listed.len() as u32).min(SLOTS))
    }
}
