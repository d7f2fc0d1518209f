//! Chooses the next report: a range of slots, and the part of the vehicle's track that locates it.

use std::collections::{BTreeMap, BTreeSet};

use dgpc::spread_out;
use pingmap_packet::{
    Cell, OUTCOME_BYTES_MAX, Outcome, OutcomeCounts, Report as ReportMessage, WAYPOINTS_MAX, Waypoint,
};

use crate::send::delivery::{DeliveryEstimate, Subject};
use crate::store::memory::Memory;
use crate::track::simplification::TrackSimplifier;

/// Candidate reports have at least this share of the value of the best one.
const VALUE_SHARE_MIN: f64 = 0.5;

/// Maximum number of candidate reports from either end of the new slots. Each candidate takes a fraction of the time of
/// a fit.
const CANDIDATES_MAX: usize = 4;

/// A slot that a report may contain.
#[derive(Debug, Clone, Copy)]
struct SlotEntry {
    slot: u32,
    is_own: bool,
    /// Outcome of another member's transmission; for an own slot, `Missed` means unused.
    outcome: Outcome,
    /// Expected number of members that receive the entry for the first time.
    value: f64,
    /// Whether probably no other member has received it.
    is_new: bool,
}

#[derive(Debug)]
pub(crate) struct ReportPlanner<'a> {
    memory: &'a Memory,
    sender: u8,
    frame_bytes: usize,
    delivery: DeliveryEstimate,
    entries: Vec<SlotEntry>,
    waypoints: Vec<(u32, Cell)>,
    /// Number of the connected part of the track that each waypoint belongs to.
    parts: Vec<usize>,
    /// Sums over all entries before an index.
    sums: Vec<PrefixSums>,
}

#[derive(Debug, Clone, Copy, Default)]
struct PrefixSums {
    /// Reported slots of other members, and own slots.
    others: usize,
    own: usize,
    /// Slots of other members without an outcome.
    unreported: usize,
    /// Own slots that were not used.
    unused: usize,
    value: f64,
    new: usize,
}

impl PrefixSums {
    fn add(self, entry: &SlotEntry) -> Self {
        let is_unreported = entry.outcome == Outcome::Unreported;
        Self {
            others: self.others + usize::from(!entry.is_own && !is_unreported),
            own: self.own + usize::from(entry.is_own),
            unreported: self.unreported + usize::from(is_unreported),
            unused: self.unused + usize::from(entry.is_own && entry.outcome == Outcome::Missed),
            value: self.value + entry.value,
            new: self.new + usize::from(entry.is_new),
        }
    }
}

/// A range of entries, both ends included.
#[derive(Debug, Clone, Copy)]
struct SlotRange {
    first: usize,
    last: usize,
    value: f64,
}

impl<'a> ReportPlanner<'a> {
    /// Prepares the reports that fit into `frame_bytes` bytes. O(slots of the report window), each with a segment of
    /// the track.
    pub(crate) fn new(memory: &'a Memory, sender: u8, frame_bytes: usize, delivery: DeliveryEstimate) -> Self {
        let team = &memory.codec.team;
        let simplifier = TrackSimplifier {
            slots: &team.slots,
            grid: &team.grid,
            chart: &team.model.chart,
            has_depth: team.model.inputs.has_depths(),
            tolerance_m: team.track_tolerance_m,
        };
        let nothing = BTreeMap::new();
        let sent = memory.reports.reports_of(sender).map_or(&nothing, |reports| reports.track.waypoints());
        // Waypoints that were sent before stay waypoints.
        let begin = memory.reports.window_begin(sender);
        let begin = sent.range(..=begin).next_back().map_or(begin, |(&slot, _)| slot);
        let parts = simplifier.simplify(&memory.track(), sent, begin).into_iter().enumerate();
        let (parts, waypoints): (Vec<usize>, Vec<(u32, Cell)>) =
            parts.flat_map(|(part, waypoints)| waypoints.into_iter().map(move |waypoint| (part, waypoint))).unzip();
        let entries = slot_entries(memory, sender, &waypoints, &delivery);
        let mut sums = vec![PrefixSums::default()];
        for entry in &entries {
            let before = sums.last().copied().unwrap_or_default();
            sums.push(before.add(entry));
        }
        Self { memory, sender, frame_bytes, delivery, entries, waypoints, parts, sums }
    }

    /// Returns candidate reports for the next frame, the one of largest value last. Where all new slots take several
    /// frames, the candidates also contain some of these frames, counted from the first slot and from the last one.
    /// Empty where nothing is worth sending.
    pub(crate) fn reports(&self) -> Vec<ReportMessage> {
        let Some(best) = self.best_range() else { return Vec::new() };
        let mut ranges = Vec::new();
        let from_begin = self.in_frames(self.new_entries());
        if from_begin.len() > 1 {
            for frames in [from_begin, self.in_frames(self.new_entries().rev())] {
                ranges.extend(spread_out(frames.len(), CANDIDATES_MAX).into_iter().map(|nth| frames[nth]));
            }
            ranges.retain(|range| self.fits(range.first, range.last) && range.value >= VALUE_SHARE_MIN * best.value);
        }
        ranges.push(best);
        ranges.into_iter().map(|range| self.message(range)).collect()
    }

    fn best_range(&self) -> Option<SlotRange> {
        let is_full = self.memory.reports.window_begin(self.sender) > 0;
        // A report that displaces another one must contain something new.
        let is_worth_sending =
            |range: &SlotRange| !is_full || self.sums[range.last + 1].new > self.sums[range.first].new;
        let ranges = self.boundary_ranges().into_iter().filter(is_worth_sending);
        ranges.max_by(|a, b| a.value.total_cmp(&b.value))
    }

    /// Returns full frames that begin or end at an entry of larger value than its neighbour, so that the rest stays in
    /// one piece.
    fn boundary_ranges(&self) -> Vec<SlotRange> {
        let value = |index: usize| self.entries[index].value;
        let worth: Vec<usize> = (0..self.entries.len()).filter(|&index| value(index) > 0.0).collect();
        let mut ranges = Vec::new();
        for (nth, &index) in worth.iter().enumerate().filter(|&(_, &index)| self.fits(index, index)) {
            let exceeds = |other: Option<&usize>| other.is_none_or(|&other| value(index) > value(other));
            if exceeds(nth.checked_sub(1).and_then(|before| worth.get(before))) {
                let onward = worth[nth..].partition_point(|&last| self.fits(index, last));
                ranges.push(self.range(index, worth[nth + onward.max(1) - 1]));
            }
            if exceeds(worth.get(nth + 1)) {
                let back = worth[..=nth].partition_point(|&first| !self.fits(first, index));
                ranges.push(self.range(worth[back.min(nth)], index));
            }
        }
        ranges
    }

    fn new_entries(&self) -> impl DoubleEndedIterator<Item = usize> {
        (0..self.entries.len()).filter(|&index| self.entries[index].is_new)
    }

    /// Divides entries into as few frames as possible, in this order.
    fn in_frames(&self, indices: impl Iterator<Item = usize>) -> Vec<SlotRange> {
        let mut indices = indices.peekable();
        let mut ranges = Vec::new();
        while let Some(begin) = indices.next() {
            let mut end = begin;
            while let Some(next) = indices.next_if(|&next| self.fits(begin.min(next), begin.max(next))) {
                end = next;
            }
            ranges.push(self.range(begin.min(end), begin.max(end)));
        }
        ranges
    }

    fn range(&self, first: usize, last: usize) -> SlotRange {
        SlotRange { first, last, value: self.sums[last + 1].value - self.sums[first].value }
    }

    fn fits(&self, first: usize, last: usize) -> bool {
        let (before, end) = (self.sums[first], self.sums[last + 1]);
        let own = if self.includes_own_slots(first, last) { end.own - before.own } else { 0 };
        let outcomes = OutcomeCounts {
            reported: end.others - before.others + own,
            unreported: end.unreported - before.unreported,
        };
        let (from, to) = self.waypoints_about(first, last);
        let waypoints = to + 1 - from;
        self.parts[from] == self.parts[to]
            && self.memory.codec.report_layout().length(outcomes, waypoints) <= self.frame_bytes
            && waypoints <= WAYPOINTS_MAX
            && outcomes.bytes() <= OUTCOME_BYTES_MAX
    }

    /// Returns whether the sender did not transmit in one of its own slots in this range.
    fn includes_own_slots(&self, first: usize, last: usize) -> bool {
        self.sums[last + 1].unused > self.sums[first].unused
    }

    /// Returns the indices of the waypoints before and after these entries.
    fn waypoints_about(&self, first: usize, last: usize) -> (usize, usize) {
        let (first, last) = (self.entries[first].slot, self.entries[last].slot);
        let from = self.waypoints.partition_point(|waypoint| waypoint.0 <= first).saturating_sub(1);
        let to = self.waypoints.partition_point(|waypoint| waypoint.0 < last).min(self.waypoints.len() - 1);
        (from, to)
    }

    fn message(&self, range: SlotRange) -> ReportMessage {
        let entries = &self.entries[range.first..=range.last];
        let includes_own_slots = self.includes_own_slots(range.first, range.last);
        let first = entries[0].slot;
        let (from, to) = self.waypoints_about(range.first, range.last);
        let mut before = None;
        let waypoint = |&(slot, Cell { east, north, depth }): &(u32, Cell)| {
            let slots = before.replace(slot).map_or(first.saturating_sub(slot), |before| slot - before) as u8;
            Waypoint { slots, east, north, depth }
        };
        let included = entries.iter().filter(|entry| includes_own_slots || !entry.is_own);
        ReportMessage {
            sender: self.sender,
            model: 0,
            first,
            includes_own_slots,
            outcomes: included.map(|entry| entry.outcome).collect(),
            waypoints: self.waypoints[from..=to].iter().map(waypoint).collect(),
        }
    }

    /// Returns whether probably another member has received the outcome of a slot.
    pub(crate) fn is_delivered(&self, slot: u32) -> bool {
        self.delivery.is_delivered(slot)
    }

    /// Returns the first slot that a report may contain.
    pub(crate) fn begin(&self) -> Option<u32> {
        let first = self.entries.first().map(|entry| entry.slot)?;
        Some(first.max(self.memory.reports.window_begin(self.sender)))
    }

    /// Returns the slots whose outcomes a report contains.
    pub(crate) fn slots_in(&self, report: &ReportMessage) -> BTreeSet<u32> {
        let slots = self.memory.codec.slots_of(self.sender, report.first, report.includes_own_slots);
        let reported = slots.zip(&report.outcomes).filter(|(_, outcome)| **outcome != Outcome::Unreported);
        reported.map(|(slot, _)| slot).collect()
    }
}

/// Returns the slots between the first and the last waypoint in which the vehicle could receive another member or
/// transmit.
fn slot_entries(memory: &Memory, sender: u8, waypoints: &[(u32, Cell)], delivery: &DeliveryEstimate) -> Vec<SlotEntry> {
    let (Some(&(begin, _)), Some(&(end, _))) = (waypoints.first(), waypoints.last()) else { return Vec::new() };
    let team = &memory.codec.team;
    let outcomes = memory.outcomes_since(sender, team.slots.begin_s(begin).unwrap_or(f64::NEG_INFINITY));
    let window_begin = memory.reports.window_begin(sender);
    let entry = |slot: u32, subject: Subject, outcome: Outcome, has_content: bool| {
        let sent = delivery.get(subject, slot);
        let is_worth_sending =
            has_content && slot >= window_begin && sent.transmissions < u32::from(team.transmissions_max);
        let value = if is_worth_sending { sent.expected_new_receivers } else { 0.0 };
        SlotEntry {
            slot,
            is_own: matches!(subject, Subject::OwnSlot),
            outcome,
            value,
            is_new: is_worth_sending && sent.is_new(),
        }
    };
    // Without a single outcome in a slot, nothing shows that the team uses this schedule.
    let is_in_use = team.slots.explicit.is_some() || !outcomes.is_empty();
    let of_slot = |slot: u32| {
        if !memory.codec.is_heard_by(slot, sender) {
            let is_unused = memory.reports.is_unused(sender, slot);
            return entry(slot, Subject::OwnSlot, if is_unused { Outcome::Missed } else { Outcome::Heard }, is_in_use);
        }
        let outcome = match outcomes.get(&slot) {
            Some(true) => Outcome::Heard,
            Some(false) => Outcome::Missed,
            None => Outcome::Unreported,
        };
        entry(slot, Subject::Reception, outcome, outcome != Outcome::Unreported)
    };
    let slots = memory.codec.slots_of(sender, begin, true).take_while(|&slot| slot <= end);
    let entries: Vec<SlotEntry> = slots.map(of_slot).collect();
    entries[entries.len().saturating_sub(team.limits.report_window_slots)..].to_vec()
}
