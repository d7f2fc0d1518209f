//! Whether vehicles keep to the schedule: what was heard shows by when it came whose clock, or schedule, differs.

use std::collections::{BTreeMap, BTreeSet};

use crate::event::{Event, VehicleId};
use crate::events::Events;
use crate::frames::Frames;
use crate::slots::Slots;

/// So many messages in a row show something, where all of them do.
const IN_A_ROW: usize = 4;

/// So many members at least show that it is the own clock that is wrong.
const MEMBERS_MIN: usize = 2;

/// For so many that fit one at most may not: misses in turn, where a host goes by the schedule, and messages
const FITTING: usize = 8;

/// among so many before and behind: when others go by another order, a few in a row look like a clock that is off.
const ABOUT: usize = 32;

/// By how many slots the vehicle's own clock was ahead, and who was out of turn by it. What is heard comes when it is sent, and what is
/// missed stands where it was expected; where both are out of turn, nobody goes by this schedule at all.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Reckoning {
    /// From when on by its clock, and by how many slots. Before the first as by that.
    steps: Steps<i32>,
    /// Whether others were out of turn.
    strange: BTreeMap<VehicleId, Steps<bool>>,
    duration_s: f64,
    /// What became of transmissions while it was ahead, by the slot that they were sent in.
    pub(crate) outcomes: BTreeMap<u32, bool>,
}

/// What holds from some times on; before the first, what holds from that on.
type Steps<T> = Vec<(f64, T)>;

fn at<T: Copy + Default>(steps: &Steps<T>, time_s: f64) -> T {
    let place = steps.partition_point(|step| step.0 <= time_s).max(1);
    steps.get(place - 1).map_or(T::default(), |step| step.1)
}

/// A message that was heard, and by which shifts of the clock it would be in turn.
struct Arrival<'a> {
    time_s: f64,
    sender: &'a VehicleId,
    shifts: BTreeSet<i32>,
}

impl Reckoning {
    /// Of what a member recorded. O(events) where something was heard out of turn, else O(1).
    pub(crate) fn new(frames: &Frames, own: Option<u8>, events: &Events) -> Self {
        let slots = &frames.team.slots;
        let id = own.and_then(|own| frames.team.members.get(&own));
        let Some((own, id)) = own.zip(id).filter(|_| events.has_strange() && !slots.at_will && slots.listed.is_none())
        else {
            return Self::default();
        };
        let recorded = events.iter().filter(|event| event.receiver_id == *id);
        let (missed, heard): (Vec<&Event>, Vec<&Event>) = recorded.clone().partition(|event| !event.success);
        let within = missed.iter().filter(|event| is_in_turn(slots, event, 0)).count();
        if within < IN_A_ROW || FITTING * (missed.len() - within) > within {
            return Self::default();
        }
        let shift_max = (slots.order_max() as i32 - 1) / 2;
        let heard = heard.into_iter().filter(|event| frames.team.number(&event.transmitter_id).is_some());
        let arrivals = heard.map(|event| Arrival {
            time_s: event.time_s,
            sender: &event.transmitter_id,
            shifts: (-shift_max..=shift_max).filter(|&shift| is_in_turn(slots, event, shift)).collect(),
        });
        let arrivals: Vec<Arrival<'_>> = arrivals.collect();
        let (steps, strange) = (steps(&arrivals, shift_max), strange(&arrivals));
        let reckoning = Self { steps, strange, duration_s: slots.duration_s, outcomes: BTreeMap::new() };
        Self { outcomes: reckoning.outcomes_of(frames, own, recorded), ..reckoning }
    }

    /// What became of transmissions while the clock was wrong, in the slots that they were sent in.
    fn outcomes_of<'a>(
        &self,
        frames: &Frames,
        own: u8,
        recorded: impl Iterator<Item = &'a Event>,
    ) -> BTreeMap<u32, bool> {
        let slots = &frames.team.slots;
        let mut outcomes = BTreeMap::new();
        for event in recorded.filter(|event| self.is_ahead(event.time_s)) {
            // In what it took for its own turn it listened, but noted nothing as missed.
            if slots.sent_in(event.time_s, &event.receiver_id).is_some() {
                continue;
            }
            let slot = slots.turn_at(self.team_s(event.time_s));
            let Some(slot) = slot.filter(|&slot| frames.is_heard_by(slot, own)) else { continue };
            if !event.success || slots.sender(slot) == Some(&event.transmitter_id) {
                *outcomes.entry(slot).or_insert(false) |= event.success;
            }
        }
        outcomes
    }

    /// Whether all that the vehicle recorded counts as it stands.
    pub(crate) fn is_right(&self) -> bool {
        self.strange.is_empty() && self.steps.iter().all(|&(_, ahead)| ahead == 0)
    }

    /// By how many slots its clock was ahead when it heard something last.
    pub(crate) fn ahead_now(&self) -> i32 {
        self.steps.last().map_or(0, |step| step.1)
    }

    /// Who was out of turn when it was heard last.
    pub(crate) fn strange_now(&self) -> impl Iterator<Item = &VehicleId> {
        self.strange.iter().filter(|(_, steps)| steps.last().is_some_and(|step| step.1)).map(|(id, _)| id)
    }

    /// Whether its clock was ahead, or behind, at this time by it.
    fn is_ahead(&self, time_s: f64) -> bool {
        at(&self.steps, time_s) != 0
    }

    /// Whether an event of the vehicle's own counts as it stands: its clock was right, and whom it heard or missed in turn.
    pub(crate) fn counts(&self, event: &Event) -> bool {
        let is_strange = self.strange.get(&event.transmitter_id).is_some_and(|steps| at(steps, event.time_s));
        !is_strange && !self.is_ahead(event.time_s)
    }

    /// The time of the others when its own clock shows this.
    pub(crate) fn team_s(&self, time_s: f64) -> f64 {
        time_s - f64::from(at(&self.steps, time_s)) * self.duration_s
    }
}

/// Whether it was the transmitter's turn so many slots before.
fn is_in_turn(slots: &Slots, event: &Event, shift: i32) -> bool {
    slots.sent_in(event.time_s - f64::from(shift) * slots.duration_s, &event.transmitter_id).is_some()
}

/// The messages in a row that end with one, and those that begin with it: where a clock was set, either those before tell or those behind.
fn rows<T>(arrivals: &[T], place: usize) -> impl Iterator<Item = &[T]> {
    let before = (place + 1).checked_sub(IN_A_ROW).map(|begin| begin..place + 1);
    let behind = place..place + IN_A_ROW;
    before.into_iter().chain([behind]).filter_map(|row| arrivals.get(row))
}

/// From when on the clock was ahead by how many slots.
fn steps(arrivals: &[Arrival<'_>], shift_max: i32) -> Steps<i32> {
    let by_size: Vec<i32> = (0..=shift_max).flat_map(|size| [size, -size]).collect();
    let fits = |row: &[Arrival<'_>], shift: i32| {
        let senders: BTreeSet<&VehicleId> = row.iter().map(|arrival| arrival.sender).collect();
        (shift == 0 || senders.len() >= MEMBERS_MIN) && row.iter().all(|arrival| arrival.shifts.contains(&shift))
    };
    let is_contradicted = |place: usize, shift: i32| {
        let about = &arrivals[place.saturating_sub(ABOUT)..arrivals.len().min(place + ABOUT)];
        let (fitting, not): (Vec<_>, Vec<_>) =
            about.iter().filter(|one| !one.shifts.contains(&0)).partition(|one| one.shifts.contains(&shift));
        FITTING * not.len() > fitting.len()
    };
    let is_it = |place: usize, shift: i32| {
        let is_alone = |row: &[Arrival<'_>]| shift == 0 || !fits(row, -shift) && !is_contradicted(place, shift);
        rows(arrivals, place).any(|row| fits(row, shift) && is_alone(row))
    };
    let found = |place: usize| by_size.iter().copied().find(|&shift| is_it(place, shift));
    let found: Vec<Option<i32>> = (0..arrivals.len()).map(found).collect();
    // Until something else shows it is as it was, and as it was first.
    let mut ahead = found.iter().flatten().next().copied().unwrap_or_default();
    let mut steps = Steps::new();
    for (arrival, found) in arrivals.iter().zip(found) {
        ahead = found.unwrap_or(ahead);
        steps.push((arrival.time_s, ahead));
    }
    steps.dedup_by_key(|step| step.1);
    steps
}

/// From when on members were out of turn, and in turn again; none for who always was in turn.
fn strange(arrivals: &[Arrival<'_>]) -> BTreeMap<VehicleId, Steps<bool>> {
    let mut by_sender = BTreeMap::<&VehicleId, Vec<(f64, bool)>>::new();
    for arrival in arrivals {
        by_sender.entry(arrival.sender).or_default().push((arrival.time_s, !arrival.shifts.contains(&0)));
    }
    let steps = by_sender.into_iter().map(|(id, messages)| {
        let is_strange = |place: usize| rows(&messages, place).any(|row| row.iter().all(|message| message.1));
        let mut steps: Steps<bool> = (0..messages.len()).map(|place| (messages[place].0, is_strange(place))).collect();
        steps.dedup_by_key(|step| step.1);
        (id.clone(), steps)
    });
    steps.filter(|(_, steps)| steps.iter().any(|step| step.1)).collect()
}
