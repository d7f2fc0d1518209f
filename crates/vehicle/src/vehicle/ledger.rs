//! The ledger of slots: what the vehicle knows of slots that are not counted yet.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::Slots;
use serde::{Deserialize, Serialize};

/// Intervals in which the vehicle could not receive, at most. The oldest are forgotten.
const INTERVALS_MAX: usize = 10_000;

/// Number of counted slots whose receptions stay stored. A repeated report of one of them is not late.
const HEARD_KEPT: u32 = 64;

/// Longest lead of a time over the clock, in seconds: one day.
pub(crate) const LEAD_S_MAX: f64 = 86_400.0;

/// Jumps of the clock that are stored, at most, and intervals that were counted ahead. The shortest jumps and the
/// earliest intervals are forgotten.
const JUMPS_MAX: usize = 100;

/// Reason of slots before the first report, and during a pause of the process or of its host.
pub(crate) const NOT_RUNNING: &str = "the vehicle was not running";

/// Reason of slots in a gap between reports.
pub(crate) const NO_INPUT: &str = "no input from the host";

/// Reason of slots that were counted while the clock was ahead, and of slots before it went back.
pub(crate) const WRONG_CLOCK: &str = "the clock was wrong";

/// Different reasons that are counted. Further ones are counted as other reasons.
const REASONS_MAX: usize = 32;

/// Longest text of a reason, in characters.
const REASON_CHARS_MAX: usize = 60;

/// A change of the ledger.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) enum LedgerRecord {
    /// The vehicle heard a member in its slot.
    Heard { slot: u32 },
    /// The vehicle transmitted in a slot of its own.
    Sent { slot: u32 },
    /// The vehicle could not receive, for this reason.
    Deaf { from_s: f64, to_s: f64, reason: String },
    /// From this time on the vehicle could not receive, for this reason.
    DeafSince { from_s: f64, reason: String },
    /// The reason ended.
    DeafUntil { to_s: f64, reason: String },
    /// The host reported that the vehicle could receive.
    Listened { from_s: f64, to_s: f64 },
    /// All slots before `next` are counted. Some of them did not count, by reason.
    Settled { next: u32, excluded: BTreeMap<String, u64> },
    /// The clock moved across a gap.
    Jumped { jump: Jump },
    /// The clock was ahead after a jump, and goes back to a time before the end of this jump.
    WentBack { jump: Jump },
    /// The clock of the vehicle reached this time.
    Handled { time_s: f64 },
}

/// A jump of the clock across a gap, or to its first time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Jump {
    /// Time of the clock before the jump. Far in the past for the first jump.
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    /// The first slot that began after `from_s`.
    pub(crate) next: u32,
}

/// How a slot of another member counts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum SlotOutcome {
    /// It counts as heard or missed.
    Counts { heard: bool },
    /// It does not count, for this reason.
    Excluded(String),
}

/// The slots that are not counted yet, and when the vehicle could receive.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Ledger {
    /// The first slot that is not counted.
    next: u32,
    /// The clock: the latest time of navigation or of listening.
    clock_s: Option<f64>,
    jumps: Vec<Jump>,
    /// Intervals whose slots were counted while the clock was ahead.
    counted_ahead: Vec<(f64, f64)>,
    heard: BTreeSet<u32>,
    sent: BTreeSet<u32>,
    deaf: Vec<(f64, f64, String)>,
    /// Reasons that last, and since when.
    deaf_since_s: BTreeMap<String, f64>,
    listened: Vec<(f64, f64)>,
    /// Counted slots of other members that did not count, by reason.
    pub(crate) excluded: BTreeMap<String, u64>,
}

impl Ledger {
    pub(crate) fn apply(&mut self, record: &LedgerRecord) {
        match record {
            LedgerRecord::Heard { slot } => drop(self.heard.insert(*slot)),
            LedgerRecord::Sent { slot } => drop(self.sent.insert(*slot)),
            LedgerRecord::Deaf { from_s, to_s, reason } => self.add_deaf(*from_s, *to_s, reason),
            LedgerRecord::DeafSince { from_s, reason } => {
                self.deaf_since_s.entry(reason.clone()).or_insert(*from_s);
            }
            LedgerRecord::DeafUntil { to_s, reason } => {
                if let Some(from_s) = self.deaf_since_s.remove(reason) {
                    self.add_deaf(from_s, *to_s, reason);
                }
            }
            LedgerRecord::Listened { from_s, to_s } => {
                self.listened.push((*from_s, *to_s));
                let excess = self.listened.len().saturating_sub(INTERVALS_MAX);
                self.listened.drain(..excess);
            }
            LedgerRecord::Settled { next, excluded } => {
                self.next = self.next.max(*next);
                excluded.iter().for_each(|(reason, count)| self.add_excluded(reason, *count));
                self.heard = self.heard.split_off(&self.next.saturating_sub(HEARD_KEPT));
                self.sent = self.sent.split_off(&self.next);
            }
            LedgerRecord::Jumped { jump } => {
                if self.jumps.len() >= JUMPS_MAX {
                    let length_s = |index: &usize| self.jumps[*index].to_s - self.jumps[*index].from_s;
                    let shortest = (0..self.jumps.len()).min_by(|a, b| length_s(a).total_cmp(&length_s(b)));
                    shortest.map(|index| self.jumps.remove(index));
                }
                self.jumps.push(*jump);
            }
            LedgerRecord::WentBack { jump } => self.go_back(*jump),
            LedgerRecord::Handled { time_s } => {
                self.clock_s = Some(self.clock_s.map_or(*time_s, |clock_s| clock_s.max(*time_s)));
            }
        }
    }

    /// Restarts the count at a jump after which the clock was ahead. No slot counts twice. Reports about the time
    /// before the end of the jump stay, and reasons that last.
    fn go_back(&mut self, jump: Jump) {
        let Self { clock_s, mut jumps, mut counted_ahead, mut deaf, mut deaf_since_s, mut listened, excluded, .. } =
            std::mem::take(self);
        let mut begin_s = jump.to_s;
        for later in jumps.iter().filter(|later| later.from_s >= jump.to_s) {
            counted_ahead.push((begin_s, later.from_s));
            begin_s = later.to_s;
        }
        counted_ahead.extend(clock_s.map(|clock_s| (begin_s, clock_s)));
        counted_ahead.sort_by(|a, b| a.1.total_cmp(&b.1));
        counted_ahead.drain(..counted_ahead.len().saturating_sub(JUMPS_MAX));
        jumps.retain(|earlier| earlier.to_s < jump.to_s);
        // The gap before the wrong time was none.
        let is_gap = |reason: &str| [NO_INPUT, NOT_RUNNING, WRONG_CLOCK].contains(&reason);
        deaf.retain(|(from_s, _, reason)| *from_s < jump.to_s && !is_gap(reason));
        listened.retain(|(from_s, _)| *from_s < jump.to_s);
        // Their begin may be wrong.
        deaf_since_s.values_mut().for_each(|from_s| *from_s = f64::MIN);
        let next = jump.next;
        *self = Self { next, jumps, counted_ahead, deaf, deaf_since_s, listened, excluded, ..Self::default() };
    }

    fn add_deaf(&mut self, from_s: f64, to_s: f64, reason: &str) {
        self.deaf.push((from_s, to_s, reason.into()));
        let excess = self.deaf.len().saturating_sub(INTERVALS_MAX);
        self.deaf.drain(..excess);
    }

    fn add_excluded(&mut self, reason: &str, count: u64) {
        let is_known = self.excluded.contains_key(reason) || self.excluded.len() < REASONS_MAX;
        let reason = if is_known { reason } else { "other reasons" };
        *self.excluded.entry(reason.into()).or_default() += count;
    }

    /// Returns whether a reason lasts because of which the vehicle cannot receive.
    pub(crate) fn is_deaf_by(&self, reason: &str) -> bool {
        self.deaf_since_s.contains_key(reason)
    }

    /// Forgets intervals that end before the first slot that is not counted.
    pub(crate) fn forget_intervals(&mut self, slots: &Slots) {
        let Some(begin_s) = slots.begin_s(self.next) else { return };
        // The clock may go back to a jump.
        let is_in_jump = |to_s: f64| self.jumps.iter().any(|jump| (jump.from_s..jump.to_s).contains(&to_s));
        self.deaf.retain(|(_, to_s, _)| *to_s >= begin_s || is_in_jump(*to_s));
        self.listened.retain(|(_, to_s)| *to_s >= begin_s || is_in_jump(*to_s));
    }

    /// Returns the time of the clock; `None` before the first report.
    pub(crate) fn clock_s(&self) -> Option<f64> {
        self.clock_s
    }

    /// Returns the jump in which the clock moved past a time, if slots around that time were never counted. A report
    /// may be up to `late_s` older than the clock was.
    pub(crate) fn find_jump(&self, time_s: f64, late_s: f64) -> Option<Jump> {
        let is_within = |jump: &&Jump| (jump.from_s - late_s..jump.to_s).contains(&time_s);
        self.jumps.iter().rev().find(is_within).copied()
    }

    /// Returns the first slot that is not counted.
    pub(crate) fn next(&self) -> u32 {
        self.next
    }

    /// Returns the slots that ended `settle_s` before the time of the clock, and are not counted yet.
    pub(crate) fn due(&self, slots: &Slots, settle_s: f64) -> std::ops::Range<u32> {
        let latest = self.clock_s.and_then(|clock_s| slots.number(clock_s - settle_s));
        // The slot of that time has not ended. It may continue an earlier one.
        let end = match latest {
            Some(latest) => slots.transmission_slot(latest).unwrap_or(latest),
            None => self.clock_s.filter(|&s| s > slots.start_s + settle_s).map_or(0, |_| slots.end()),
        };
        self.next..end.max(self.next)
    }

    /// Returns the ledger for a new count with another schedule.
    pub(crate) fn restarted(self) -> Self {
        Self { excluded: self.excluded, ..Self::default() }
    }

    /// Returns whether a slot is counted already.
    pub(crate) fn is_settled(&self, slot: u32) -> bool {
        slot < self.next
    }

    pub(crate) fn has_sent(&self, slot: u32) -> bool {
        self.sent.contains(&slot)
    }

    pub(crate) fn has_heard(&self, slot: u32) -> bool {
        self.heard.contains(&slot)
    }

    /// Returns whether the vehicle could not receive for one of these reasons, in a part of an interval.
    pub(crate) fn is_deaf_for(&self, reasons: &[&str], span_s: (f64, f64)) -> bool {
        let lasting =
            self.deaf_since_s.iter().filter(|(_, from_s)| **from_s < span_s.1).map(|(reason, _)| reason.as_str());
        self.deaf_in(span_s).chain(lasting).any(|reason| reasons.contains(&reason))
    }

    /// Returns the reasons of intervals in which the vehicle could not receive, and that overlap with an interval.
    fn deaf_in(&self, span_s: (f64, f64)) -> impl Iterator<Item = &str> {
        let overlapping = self.deaf.iter().filter(move |(from_s, to_s, _)| overlap((*from_s, *to_s), span_s));
        overlapping.map(|(.., reason)| reason.as_str())
    }

    /// Returns why the vehicle could not receive during a whole interval; `None` if it could.
    pub(crate) fn deafness(&self, (begin_s, end_s): (f64, f64), listens: bool) -> Option<String> {
        if self.counted_ahead.iter().any(|&interval_s| overlap(interval_s, (begin_s, end_s))) {
            return Some(WRONG_CLOCK.into());
        }
        if let Some(reason) = self.deaf_in((begin_s, end_s)).next() {
            return Some(reason.into());
        }
        if let Some((reason, _)) = self.deaf_since_s.iter().find(|(_, from_s)| **from_s < end_s) {
            return Some(reason.clone());
        }
        (!listens && !self.has_listened(begin_s, end_s)).then(|| "not reported as listening".into())
    }

    /// Returns whether the reported intervals cover the time from `begin_s` to `end_s`.
    fn has_listened(&self, begin_s: f64, end_s: f64) -> bool {
        let mut covered_s = begin_s;
        let mut intervals = self.listened.clone();
        intervals.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (from_s, to_s) in intervals {
            if from_s <= covered_s {
                covered_s = covered_s.max(to_s);
            }
        }
        covered_s >= end_s
    }

    /// Decides how a slot of another member counts. The rule does not depend on whether the vehicle heard the slot.
    pub(crate) fn outcome(&self, slot: u32, span_s: (f64, f64), listens: bool) -> SlotOutcome {
        match self.deafness(span_s, listens) {
            Some(reason) => SlotOutcome::Excluded(reason),
            None => SlotOutcome::Counts { heard: self.heard.contains(&slot) },
        }
    }
}

/// Returns the slot of a message of a member, and its span: from its beginning to the beginning of the next slot with
/// a sender.
pub(crate) fn span_s(slots: &Slots, slot: u32) -> Option<(f64, f64)> {
    let begin_s = slots.begin_s(slot)?;
    Some((begin_s, slots.next_begin_s(slot).unwrap_or(begin_s + slots.duration_s)))
}

/// Returns whether two intervals have more than an end in common.
fn overlap(a: (f64, f64), b: (f64, f64)) -> bool {
    a.0 < b.1 && a.1 > b.0
}

/// Returns the text of a reason, shortened.
pub(crate) fn shortened(reason: &str) -> String {
    reason.chars().take(REASON_CHARS_MAX).collect()
}
