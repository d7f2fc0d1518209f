//! Which reports of others are worth passing on: those that did not come to everybody.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::memory::Memory;
use crate::reports::{Passed, Report};
use crate::tellings::{Of, Tellings, spans};

/// So many reports of each other member may be passed on: those that went over the water last.
const REPORTS_MAX: usize = 64;

/// So many slots in which a report went are kept: the latest.
const SLOTS_MAX: usize = 16;

/// What must be learned of a report by all others together, as far as one may expect, that it is passed on.
const LEARNED_MIN: f64 = 1.0;

/// Reports of others, and in which slots they went over the water, as far as the vehicle was there. No part of a snapshot: who
/// lost it passes on nothing that came before.
#[derive(Debug, Clone, Default)]
pub(crate) struct Passing {
    by_sender: BTreeMap<u8, Vec<Passed>>,
}

/// A report that is worth passing on.
#[derive(Debug)]
pub(crate) struct Worthy {
    sender: u8,
    report: Arc<Report>,
    /// How much others may be expected to learn of it: events, as in what a report of the vehicle's own is worth.
    pub(crate) value: f64,
}

impl Passing {
    /// Notes that a report of this member went in a slot. O(reports of the member that are here).
    pub(crate) fn note(&mut self, sender: u8, report: Arc<Report>, slot: u32) {
        let all = self.by_sender.entry(sender).or_default();
        match all.iter_mut().find(|passed| passed.report.bytes == report.bytes) {
            Some(passed) => {
                passed.slots.insert(slot);
                while passed.slots.len() > SLOTS_MAX {
                    passed.slots.pop_first();
                }
            }
            None => all.push(Passed { report, slots: BTreeSet::from([slot]) }),
        }
        if all.len() > REPORTS_MAX
            && let Some((oldest, _)) = all.iter().enumerate().min_by_key(|(_, passed)| passed.slots.last())
        {
            all.remove(oldest);
        }
    }

    /// What of this others may be expected to learn most, if it goes in this slot of the vehicle's own, in a frame of so many bytes.
    /// Nothing is passed on of members of whom nothing counts, nor to these. O(slots from the first to the last that the reports speak
    /// of), for each two other members of whom one misses the other.
    pub(crate) fn best(
        &self,
        memory: &Memory,
        slot: Option<u32>,
        doubted: &BTreeSet<u8>,
        frame_bytes: usize,
    ) -> Option<Worthy> {
        let slot = slot?;
        let senders = self.by_sender.iter();
        let senders = senders.filter(|(sender, _)| Some(**sender) != memory.own && !doubted.contains(sender));
        let worthy = senders.flat_map(|(&sender, all)| {
            let tellings = Tellings::of_passed(memory, sender, slot, doubted, all);
            let fitting = all.iter().filter(|passed| passed.report.bytes.len() <= frame_bytes);
            let values = fitting.map(|passed| (passed, value(memory, sender, &passed.report, &tellings)));
            let best = values.max_by(|(_, one), (_, other)| one.total_cmp(other));
            best.map(|(passed, value)| Worthy { sender, report: passed.report.clone(), value })
        });
        worthy.filter(|worthy| worthy.value >= LEARNED_MIN).max_by(|one, other| one.value.total_cmp(&other.value))
    }

    /// Its bytes, as they came; it goes in this slot.
    pub(crate) fn pass_on(&mut self, Worthy { sender, report, .. }: Worthy, slot: Option<u32>) -> Vec<u8> {
        let bytes = report.bytes.clone();
        slot.into_iter().for_each(|slot| self.note(sender, report.clone(), slot));
        bytes
    }
}

/// How much others may be expected to learn of a report: what became of transmissions, and where those of its sender were sent.
fn value(memory: &Memory, sender: u8, report: &Report, tellings: &Tellings) -> f64 {
    let frames = &memory.frames;
    let id = frames.team.members.get(&sender);
    let told = spans(memory, sender, report).into_iter().flat_map(|(of, span)| span.map(move |slot| (of, slot)));
    let told = told.filter(|&(of, slot)| matches!(of, Of::Other) || frames.is_turn_of(slot, id));
    let spreads = told.map(|(of, slot)| tellings.get(of, slot));
    spreads.filter(|spread| spread.may_be_told(frames.team.tellings_max)).map(|spread| spread.learning).sum()
}
