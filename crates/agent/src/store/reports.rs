//! The reports and piggybacked outcomes that a vehicle stores.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use crate::codec::decoded::Report;
use crate::codec::receipt::Refusal;
use crate::store::packets::{Transmission, Transmissions};
use crate::track::received::ReceivedTrack;

/// The range of all slots.
pub(crate) const EVERY_SLOT: Range<u32> = 0..u32::MAX;

/// The outcome of one transmission according to all reports of one receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReportedOutcome {
    Heard,
    Missed,
    /// Reported as heard and as missed: two vehicles use one number. It counts as neither.
    Contradictory,
}

impl From<bool> for ReportedOutcome {
    fn from(heard: bool) -> Self {
        if heard { Self::Heard } else { Self::Missed }
    }
}

/// The content of all stored reports of one sender.
#[derive(Debug, Clone, Default)]
pub(crate) struct ReceivedReports {
    pub(crate) outcomes: BTreeMap<u32, ReportedOutcome>,
    pub(crate) track: ReceivedTrack,
}

/// Adds an outcome of a slot. Returns whether that changed anything.
pub(crate) fn add_outcome(outcomes: &mut BTreeMap<u32, ReportedOutcome>, slot: u32, heard: bool) -> bool {
    let outcome = ReportedOutcome::from(heard);
    match outcomes.entry(slot) {
        Entry::Vacant(vacant) => drop(vacant.insert(outcome)),
        Entry::Occupied(stored) if *stored.get() == outcome || *stored.get() == ReportedOutcome::Contradictory => {
            return false;
        }
        Entry::Occupied(mut stored) => drop(stored.insert(ReportedOutcome::Contradictory)),
    }
    true
}

impl ReceivedReports {
    fn add(&mut self, report: &Report) {
        for &(slot, heard) in &report.outcomes {
            add_outcome(&mut self.outcomes, slot, heard);
        }
        self.track.add(&report.waypoints);
    }

    /// Removes a report. `others` are all other reports, in the order of their first slots. The removed report has
    /// the smallest first slot.
    fn remove<'a>(&mut self, report: &Report, others: impl Iterator<Item = &'a Report>) {
        for (slot, _) in &report.outcomes {
            self.outcomes.remove(slot);
        }
        self.track.remove(&report.waypoints);
        // The first waypoint of a report lies at most 255 slots before its first slot.
        let end = report.latest_slot().saturating_add(u8::MAX.into());
        others.take_while(|other| other.first <= end).for_each(|other| self.add(other));
    }

    /// Returns the range of slots whose located events can change when this report is added or removed.
    fn range_affected_by(&self, report: &Report) -> Range<u32> {
        let moved = self.track.range_affected_by(&report.waypoints);
        let (Some(first), Some(last)) = (report.outcomes.first(), report.outcomes.last()) else { return moved };
        let outcomes = first.0..last.0 + 1;
        if moved.is_empty() { outcomes } else { outcomes.start.min(moved.start)..outcomes.end.max(moved.end) }
    }
}

/// A report, and when the vehicle transmitted it if it is the vehicle's own.
#[derive(Debug, Clone)]
pub(crate) struct StoredReport {
    pub(crate) report: Arc<Report>,
    pub(crate) sent: Transmissions,
}

#[derive(Debug, Clone, Default)]
struct Sender {
    reports: BTreeMap<(u32, Vec<u8>), StoredReport>,
    content: Arc<ReceivedReports>,
    /// Piggybacked outcomes by slot. They are not authenticated: a report about the same slot replaces them.
    piggybacked: BTreeMap<u32, ReportedOutcome>,
    /// Slots in which the sender reported that it did not transmit.
    unused: BTreeSet<u32>,
}

/// Reports by sender. The store keeps the reports of each sender with the latest first slots.
#[derive(Debug, Clone)]
pub(crate) struct Reports {
    per_sender_max: usize,
    window_slots: u32,
    senders: BTreeMap<u8, Sender>,
}

impl Reports {
    pub(crate) fn new(per_sender_max: u16, window_slots: usize) -> Self {
        Self {
            per_sender_max: usize::from(per_sender_max).max(1),
            window_slots: window_slots as u32,
            senders: BTreeMap::new(),
        }
    }

    /// Stores a report that was received, or transmitted by the vehicle itself. Returns the slots whose located events
    /// may change. O(log N + length). If an old report is removed for it, reports that overlap the old one are added
    /// again.
    ///
    /// # Errors
    /// [`Refusal::Duplicate`], and [`Refusal::TooOld`] if the sender has sent a full window of later reports.
    pub(crate) fn insert(
        &mut self,
        sender: u8,
        report: Report,
        sent: Option<Transmission>,
    ) -> Result<Vec<Range<u32>>, Refusal> {
        let max = self.per_sender_max;
        report.unused.iter().for_each(|&slot| self.insert_unused(sender, slot));
        let sender = self.senders.entry(sender).or_default();
        let key = (report.first, report.bytes.clone());
        let report = Arc::new(report);
        let is_duplicate = sender.reports.contains_key(&key);
        let new = || StoredReport { report: report.clone(), sent: Transmissions::default() };
        sender.reports.entry(key.clone()).or_insert_with(new).sent.add(sent);
        if is_duplicate {
            return Err(Refusal::Duplicate);
        }
        let mut affected = vec![sender.content.range_affected_by(&report)];
        if sender.reports.len() <= max {
            Arc::make_mut(&mut sender.content).add(&report);
            return Ok(affected);
        }
        let Some((removed_key, removed)) = sender.reports.pop_first() else { return Err(Refusal::TooOld) };
        if removed_key == key {
            return Err(Refusal::TooOld);
        }
        let content = Arc::make_mut(&mut sender.content);
        content.add(&report);
        content.remove(&removed.report, sender.reports.values().map(|stored| &*stored.report));
        affected.push(content.range_affected_by(&removed.report));
        Ok(affected)
    }

    /// Returns the earliest first slot of a report of this sender that the store still accepts.
    pub(crate) fn window_begin(&self, sender: u8) -> u32 {
        let full = self.senders.get(&sender).filter(|sender| sender.reports.len() >= self.per_sender_max);
        full.and_then(|sender| sender.reports.first_key_value()).map_or(0, |((first, _), _)| first + 1)
    }

    /// Stores that a member did not transmit in a slot of its own.
    pub(crate) fn insert_unused(&mut self, sender: u8, slot: u32) {
        let unused = &mut self.senders.entry(sender).or_default().unused;
        unused.insert(slot);
        let begin = unused.last().map_or(0, |last| last.saturating_sub(self.window_slots));
        while unused.first().is_some_and(|&first| first < begin) {
            unused.pop_first();
        }
    }

    /// Returns whether a member reported that it did not transmit in a slot.
    pub(crate) fn is_unused(&self, sender: u8, slot: u32) -> bool {
        self.senders.get(&sender).is_some_and(|sender| sender.unused.contains(&slot))
    }

    /// Returns the slots in which a member reported that it did not transmit.
    pub(crate) fn unused(&self, sender: u8, slots: Range<u32>) -> impl Iterator<Item = u32> {
        self.senders.get(&sender).into_iter().flat_map(move |sender| sender.unused.range(slots.clone()).copied())
    }

    /// Stores piggybacked outcomes. Returns whether any of them is new. O(log N) each.
    pub(crate) fn insert_piggybacked(&mut self, sender: u8, outcomes: impl IntoIterator<Item = (u32, bool)>) -> bool {
        let piggybacked = &mut self.senders.entry(sender).or_default().piggybacked;
        let mut is_new = false;
        for (slot, heard) in outcomes {
            let last = piggybacked.last_key_value().map_or(slot, |(&last, _)| last.max(slot));
            if last - slot < self.window_slots {
                is_new |= add_outcome(piggybacked, slot, heard);
            }
            let is_too_old = |(&first, _): (&u32, &ReportedOutcome)| last - first >= self.window_slots;
            while piggybacked.first_key_value().is_some_and(is_too_old) {
                piggybacked.pop_first();
            }
        }
        is_new
    }

    pub(crate) fn piggybacked(&self, sender: u8) -> impl Iterator<Item = (u32, ReportedOutcome)> {
        let sender = self.senders.get(&sender).into_iter();
        sender.flat_map(|sender| sender.piggybacked.iter().map(|(&slot, &outcome)| (slot, outcome)))
    }

    /// Returns the outcomes of a sender by slot, and whether each was piggybacked. A reported outcome replaces a
    /// piggybacked one.
    pub(crate) fn outcomes(&self, sender: u8, slots: Range<u32>) -> impl Iterator<Item = (u32, ReportedOutcome, bool)> {
        self.senders.get(&sender).into_iter().flat_map(move |sender| {
            let (reported, piggybacked) = (&sender.content.outcomes, &sender.piggybacked);
            let by_report = reported.range(slots.clone());
            let by_report = by_report.map(|(&slot, &outcome)| (slot, outcome, piggybacked.contains_key(&slot)));
            let others = piggybacked.range(slots.clone()).filter(|(slot, _)| !reported.contains_key(slot));
            by_report.chain(others.map(|(&slot, &outcome)| (slot, outcome, true)))
        })
    }

    /// Returns whether a sender reports that it heard the message of a slot.
    pub(crate) fn has_heard(&self, sender: u8, slot: u32) -> bool {
        self.outcomes(sender, slot..slot + 1).any(|(_, outcome, _)| outcome == ReportedOutcome::Heard)
    }

    /// Returns every sender with a stored report, piggybacked outcome or unused slot.
    pub(crate) fn senders(&self) -> impl Iterator<Item = u8> {
        self.senders.keys().copied()
    }

    pub(crate) fn reports_of(&self, sender: u8) -> Option<&Arc<ReceivedReports>> {
        self.senders.get(&sender).filter(|sender| !sender.reports.is_empty()).map(|sender| &sender.content)
    }

    /// Returns all stored reports of one sender.
    pub(crate) fn all(&self, sender: u8) -> impl Iterator<Item = &StoredReport> {
        self.senders.get(&sender).into_iter().flat_map(|sender| sender.reports.values())
    }
}
