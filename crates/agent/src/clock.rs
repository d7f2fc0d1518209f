//! Whether vehicles keep to the schedule: what was heard shows by when it came whose clock, or schedule, differs.

use std::collections::{BTreeMap, BTreeSet};

use crate::event::{Event, VehicleId};
use crate::events::Events;
use crate::frames::Frames;
use crate::shifts::Shifts;
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
    /// From the last message by one reckoning to the first by another nothing counts, but these two.
    gaps: Vec<(f64, f64)>,
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
    event: &'a Event,
    shifts: Shifts,
}

impl Arrival<'_> {
    fn fits(&self, shift: i32) -> bool {
        self.shifts.has(shift)
    }
}

impl Reckoning {
    /// Of what a member recorded. O(events) where several messages were heard out of turn, else O(1).
    pub(crate) fn new(frames: &Frames, own: Option<u8>, events: &Events) -> Self {
        let Some(own) = own.filter(|_| events.strange >= IN_A_ROW) else { return Self::default() };
        let in_slots = events.recorded().iter().filter_map(|known| Some((&known.event, known.shifts?)));
        let (heard, missed): (Vec<_>, Vec<_>) = in_slots.partition(|(event, _)| event.success);
        let within = missed.iter().filter(|(_, shifts)| shifts.has(0)).count();
        if within < IN_A_ROW || FITTING * (missed.len() - within) > within {
            return Self::default();
        }
        let arrivals: Vec<_> = heard.into_iter().map(|(event, shifts)| Arrival { event, shifts }).collect();
        let (steps, gaps) = steps(&arrivals);
        let duration_s = frames.team.slots.duration_s;
        let reckoning = Self { steps, gaps, strange: strange(&arrivals), duration_s, outcomes: BTreeMap::new() };
        Self { outcomes: reckoning.outcomes_of(frames, own, events), ..reckoning }
    }

    /// What became of transmissions while the clock was wrong, in the slots that they were sent in; what counts as it stands is not
    /// among them.
    fn outcomes_of(&self, frames: &Frames, own: u8, events: &Events) -> BTreeMap<u32, bool> {
        let mut outcomes = BTreeMap::new();
        if self.was_never_ahead() {
            return outcomes;
        }
        let (slots, id) = (&frames.team.slots, frames.team.members.get(&own));
        let recorded = events.iter().filter(|event| Some(&event.receiver_id) == id);
        for event in recorded.filter(|event| self.ahead(event.time_s) != 0 && !self.is_in_gap(event.time_s)) {
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
        let counting = events.recorded().iter().filter(|known| self.counts(&known.event));
        let known: BTreeSet<u32> =
            counting.filter_map(|known| known.key).filter(|key| key.0 == own).map(|key| key.1).collect();
        outcomes.retain(|slot, _| !known.contains(slot));
        outcomes
    }

    /// Whether all that the vehicle recorded counts as it stands.
    pub(crate) fn is_right(&self) -> bool {
        self.strange.is_empty() && self.was_never_ahead()
    }

    fn was_never_ahead(&self) -> bool {
        self.steps.iter().all(|&(_, ahead)| ahead == 0)
    }

    /// By how many slots its clock was ahead when it heard something last.
    pub(crate) fn ahead_now(&self) -> i32 {
        self.steps.last().map_or(0, |step| step.1)
    }

    /// Who was out of turn when it was heard last.
    pub(crate) fn strange_now(&self) -> impl Iterator<Item = &VehicleId> {
        self.strange.iter().filter(|(_, steps)| steps.last().is_some_and(|step| step.1)).map(|(id, _)| id)
    }

    /// By how many slots its clock was ahead at this time by it.
    pub(crate) fn ahead(&self, time_s: f64) -> i32 {
        at(&self.steps, time_s)
    }

    fn is_in_gap(&self, time_s: f64) -> bool {
        let place = self.gaps.partition_point(|gap| gap.1 <= time_s);
        self.gaps.get(place).is_some_and(|gap| gap.0 < time_s)
    }

    /// Whether an event of the vehicle's own counts as it stands: its clock was right, and whom it heard or missed in turn.
    pub(crate) fn counts(&self, event: &Event) -> bool {
        let is_strange = self.strange.get(&event.transmitter_id).is_some_and(|steps| at(steps, event.time_s));
        !is_strange && self.ahead(event.time_s) == 0 && !self.is_in_gap(event.time_s)
    }

    /// The time of the others when its own clock shows this.
    pub(crate) fn team_s(&self, time_s: f64) -> f64 {
        time_s - f64::from(self.ahead(time_s)) * self.duration_s
    }

    /// The slot in which the vehicle sends what leaves at this time by its clock: one of its own, or its next. Where the clock is
    /// wrong that may be none of its own.
    pub(crate) fn departs_in(&self, slots: &Slots, own: &VehicleId, time_s: f64) -> Option<u32> {
        match self.ahead(time_s) {
            0 => slots.next_turn(time_s, own),
            _ => slots.sent_in(self.team_s(time_s), own),
        }
    }

    /// What its own clock shows at this time of the others.
    pub(crate) fn local_s(&self, team_s: f64) -> f64 {
        let shown = |&(_, ahead): &(f64, i32)| team_s + f64::from(ahead) * self.duration_s;
        let is_then = |&time_s: &f64| (self.team_s(time_s) - team_s).abs() < 0.5 * self.duration_s;
        self.steps.iter().map(shown).find(is_then).unwrap_or(team_s)
    }
}

/// The rows of messages that have this one in them.
fn rows<T>(arrivals: &[T], place: usize) -> impl Iterator<Item = &[T]> {
    let begins = (0..IN_A_ROW).filter_map(move |before| place.checked_sub(before));
    begins.filter_map(|begin| arrivals.get(begin..begin + IN_A_ROW))
}

/// From when on the clock was ahead by how many slots, and where one cannot say.
fn steps(arrivals: &[Arrival<'_>]) -> (Steps<i32>, Vec<(f64, f64)>) {
    let found: Vec<Option<i32>> = (0..arrivals.len()).map(|place| shown(arrivals, place)).collect();
    // Until something else shows it is as it was, and as it was first.
    let mut ahead = found.iter().flatten().next().copied().unwrap_or_default();
    let (mut steps, mut gaps) = (Steps::<i32>::new(), Vec::new());
    let mut last_s = f64::NEG_INFINITY;
    for (place, (arrival, found)) in arrivals.iter().zip(found).enumerate() {
        let is_as_before = found.is_none_or(|found| found == ahead) && (ahead == 0 || arrival.fits(ahead));
        // A message that does not fit a clock that is off may be the first one since it was set.
        if found.is_none() && !is_as_before {
            continue;
        }
        if !is_as_before || place > 0 && last_s < arrivals[place - 1].event.time_s {
            gaps.push((last_s, arrival.event.time_s));
        }
        ahead = found.unwrap_or(ahead);
        steps.push((arrival.event.time_s, ahead));
        last_s = arrival.event.time_s;
    }
    if arrivals.last().is_some_and(|last| last_s < last.event.time_s) {
        gaps.push((last_s, f64::INFINITY));
    }
    steps.dedup_by_key(|step| step.1);
    (steps, gaps)
}

/// By how many slots the clock was ahead when a message was heard, if a row about it shows that: no other shift would do.
fn shown(arrivals: &[Arrival<'_>], place: usize) -> Option<i32> {
    let of_row = |row: &[Arrival<'_>]| {
        let shift = Shifts::only_one_of(row.iter().map(|arrival| arrival.shifts))?;
        let out: BTreeSet<&VehicleId> =
            row.iter().filter(|one| !one.fits(0)).map(|one| &one.event.transmitter_id).collect();
        (shift == 0 || out.len() >= MEMBERS_MIN && !is_contradicted(arrivals, place, shift)).then_some(shift)
    };
    rows(arrivals, place).filter_map(of_row).min_by_key(|shift| shift.abs())
}

/// Whether too many of the messages about one say otherwise: out of turn in another way, or in turn between others that are out of it.
fn is_contradicted(arrivals: &[Arrival<'_>], place: usize, shift: i32) -> bool {
    let about = &arrivals[place.saturating_sub(ABOUT)..arrivals.len().min(place + ABOUT)];
    let is_out_so = |one: &Arrival<'_>| !one.fits(0) && one.fits(shift);
    let (first, last) = (about.iter().position(is_out_so), about.iter().rposition(is_out_so));
    let is_between = |nth: usize| first <= Some(nth) && Some(nth) <= last;
    let against = about.iter().enumerate().filter(|(nth, one)| !one.fits(shift) && (!one.fits(0) || is_between(*nth)));
    FITTING * against.count() > about.iter().filter(|one| is_out_so(one)).count()
}

/// From when on members were out of turn, and in turn again; none for who always was in turn.
fn strange(arrivals: &[Arrival<'_>]) -> BTreeMap<VehicleId, Steps<bool>> {
    let mut by_sender = BTreeMap::<&VehicleId, Vec<(f64, bool)>>::new();
    for arrival in arrivals {
        by_sender.entry(&arrival.event.transmitter_id).or_default().push((arrival.event.time_s, !arrival.fits(0)));
    }
    let steps = by_sender.into_iter().map(|(id, messages)| {
        let is_strange = |place: usize| rows(&messages, place).any(|row| row.iter().all(|message| message.1));
        let mut steps: Steps<bool> = (0..messages.len()).map(|place| (messages[place].0, is_strange(place))).collect();
        steps.dedup_by_key(|step| step.1);
        (id.clone(), steps)
    });
    steps.filter(|(_, steps)| steps.iter().any(|step| step.1)).collect()
}
