//! Estimates which of a vehicle's outcomes the other members have received.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::codec::decoded::Report;
use crate::store::memory::Memory;
use crate::store::packets::Transmission;
use crate::store::reports::{ReportedOutcome, StoredReport};

/// Probability that a frame without acknowledgement was lost.
const PRIOR_LOSS: f64 = 0.3;

/// The subject of one slot entry of a report.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Subject {
    /// The outcome of another member's transmission.
    Reception,
    /// Position and use of a slot of the vehicle itself.
    OwnSlot,
}

/// Delivery estimates of all slots that the vehicle's own reports cover.
#[derive(Debug)]
pub(crate) struct DeliveryEstimate {
    never_sent: Delivery,
    begin: u32,
    /// One table for each [`Subject`].
    tables: [Vec<Delivery>; 2],
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Delivery {
    pub(crate) transmissions: u32,
    /// Expected number of members that receive the slot for the first time with the next frame.
    pub(crate) expected_new_receivers: f64,
    /// Probability that no other member has received the slot.
    p_undelivered: f64,
}

impl Delivery {
    /// Returns whether no other member has received the outcome of the slot, with a probability above one half.
    pub(crate) fn is_new(&self) -> bool {
        self.p_undelivered > 0.5
    }
}

/// The slots of one transmitted report, and for each other member the probability that all its transmissions were lost.
struct SentReport {
    slots: Vec<(Subject, Range<u32>)>,
    p_lost: Vec<f64>,
    transmissions: u32,
}

impl DeliveryEstimate {
    /// Estimates delivery of the reports of `sender`. A report of a member that lists the slot of a frame as heard
    /// acknowledges that frame. Every other transmission is lost with probability .3. Reports of `ignored` members
    /// acknowledge nothing. O(reported slots) for each other member.
    pub(crate) fn new(memory: &Memory, sender: u8, ignored: &BTreeSet<u8>) -> Self {
        let members = memory.codec.team.members.keys().copied().filter(|&number| number != sender);
        let mut receivers: Vec<Option<u8>> =
            members.map(|number| Some(number).filter(|number| !ignored.contains(number))).collect();
        if receivers.is_empty() {
            // A listener that is no member of the team.
            receivers.push(None);
        }
        let sent = memory.reports.all(sender).filter(|stored| !stored.sent.is_empty());
        let sent: Vec<SentReport> = sent.map(|stored| SentReport::new(memory, sender, &receivers, stored)).collect();
        Self::of(receivers.len(), &sent)
    }

    fn of(receivers: usize, sent: &[SentReport]) -> Self {
        let all = || sent.iter().flat_map(|report| &report.slots).map(|(_, slots)| slots);
        let begin = all().map(|slots| slots.start).min().unwrap_or(0);
        let length = all().map(|slots| slots.end).max().map_or(0, |end| (end - begin) as usize);
        let reached = 1.0 - PRIOR_LOSS;
        let never_sent =
            Delivery { transmissions: 0, expected_new_receivers: reached * receivers as f64, p_undelivered: 1.0 };
        let sent_before = Delivery { expected_new_receivers: 0.0, ..never_sent };
        let mut tables = [vec![sent_before; length], vec![sent_before; length]];
        let index = |slots: &Range<u32>| (slots.start - begin) as usize..(slots.end - begin) as usize;
        for report in sent {
            for (subject, slots) in &report.slots {
                let entries = &mut tables[*subject as usize][index(slots)];
                entries.iter_mut().for_each(|entry| entry.transmissions += report.transmissions);
            }
        }
        // One receiver at a time, because a table of all receivers would take O(slots · members) of memory.
        for receiver in 0..receivers {
            let mut p_undelivered = [vec![1.0; length], vec![1.0; length]];
            for report in sent {
                for (subject, slots) in &report.slots {
                    let entries = &mut p_undelivered[*subject as usize][index(slots)];
                    entries.iter_mut().for_each(|entry| *entry *= report.p_lost[receiver]);
                }
            }
            for (entry, p_undelivered) in tables.iter_mut().flatten().zip(p_undelivered.iter().flatten()) {
                entry.expected_new_receivers += reached * p_undelivered;
                entry.p_undelivered *= p_undelivered;
            }
        }
        Self { never_sent, begin, tables }
    }

    pub(crate) fn get(&self, subject: Subject, slot: u32) -> Delivery {
        let index = slot.checked_sub(self.begin).map(|index| index as usize);
        index.and_then(|index| self.tables[subject as usize].get(index)).copied().unwrap_or(self.never_sent)
    }

    /// Returns whether at least one other member has received our outcome of a slot with a probability above one half.
    pub(crate) fn is_delivered(&self, slot: u32) -> bool {
        !self.get(Subject::Reception, slot).is_new()
    }
}

impl SentReport {
    fn new(memory: &Memory, sender: u8, receivers: &[Option<u8>], stored: &StoredReport) -> Self {
        let mut p_lost = vec![1.0; receivers.len()];
        let mut transmissions = 0;
        for Transmission { slot, .. } in stored.sent.undropped() {
            // The host reported later that it did not transmit this frame.
            if slot.is_some_and(|slot| memory.reports.is_unused(sender, slot)) {
                continue;
            }
            transmissions += 1;
            for (p_lost, receiver) in p_lost.iter_mut().zip(receivers) {
                *p_lost *= match receiver.zip(slot).and_then(|(receiver, slot)| outcome(memory, receiver, slot)) {
                    Some(ReportedOutcome::Heard) => 0.0,
                    Some(ReportedOutcome::Missed) => 1.0,
                    Some(ReportedOutcome::Contradictory) | None => PRIOR_LOSS,
                };
            }
        }
        Self { slots: slots_of(memory, sender, &stored.report), p_lost, transmissions }
    }
}

/// Returns the outcome of a slot in the reports of a member. Piggybacked outcomes are not authenticated and do not
/// count.
fn outcome(memory: &Memory, receiver: u8, slot: u32) -> Option<ReportedOutcome> {
    memory.reports.reports_of(receiver)?.outcomes.get(&slot).copied()
}

/// Returns the slots that a report covers. The range of own slots runs from its first slot to its last waypoint. Own
/// slots that turned out to be unused are excluded, unless the report lists them as unused.
fn slots_of(memory: &Memory, sender: u8, report: &Report) -> Vec<(Subject, Range<u32>)> {
    let mut covered: Vec<(Subject, Range<u32>)> =
        report.outcomes.iter().map(|&(slot, _)| (Subject::Reception, slot..slot + 1)).collect();
    let last = report.waypoints.last().map_or(report.first, |waypoint| waypoint.0.max(report.first));
    let mut begin = report.first;
    for slot in memory.reports.unused(sender, report.first..last + 1).filter(|slot| !report.unused.contains(slot)) {
        covered.push((Subject::OwnSlot, begin..slot));
        begin = slot + 1;
    }
    covered.push((Subject::OwnSlot, begin..last + 1));
    covered
}
