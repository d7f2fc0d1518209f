//! The reports that a vehicle remembers, and what they say together.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use pingmap_packet::{Cell, Earlier};

use crate::packets::{Departure, PacketKey, Sent};
use crate::told_track::ToldTrack;

/// All slots there are.
pub(crate) const EVERY_SLOT: Range<u32> = 0..u32::MAX;

/// A report as it came, and what it says.
#[derive(Debug)]
pub(crate) struct Report {
    pub(crate) bytes: Vec<u8>,
    /// The slot that it begins at.
    pub(crate) first: u32,
    /// What its sender heard (true) and missed, by slot.
    pub(crate) outcomes: Vec<(u32, bool)>,
    /// Whether it sent, by slot of its own.
    pub(crate) turns: Vec<(u32, bool)>,
    /// Where it was.
    pub(crate) knots: Vec<(u32, Cell)>,
    /// Which of its packets speak of the same events.
    pub(crate) earlier: Option<Earlier>,
}

/// What became of a transmission, by all that a sender said of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Said {
    Heard,
    Missed,
    /// Both, which nobody says by mistake: two vehicles go by one number. It counts as neither.
    Contradicted,
}

impl From<bool> for Said {
    fn from(heard: bool) -> Self {
        if heard { Self::Heard } else { Self::Missed }
    }
}

/// What a packet counts for beside the reports of its sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Worth {
    /// What it says is told better by reports.
    Nothing,
    /// For what it says beyond them.
    Beyond,
    /// For what it says.
    All,
}

/// What all reports of one sender say together.
#[derive(Debug, Clone, Default)]
pub(crate) struct Told {
    pub(crate) outcomes: BTreeMap<u32, Said>,
    pub(crate) track: ToldTrack,
    earlier: BTreeSet<(u8, bool)>,
}

/// Notes what is said of a slot; whether that is new.
fn say(outcomes: &mut BTreeMap<u32, Said>, slot: u32, heard: bool) -> bool {
    let said = Said::from(heard);
    match outcomes.entry(slot) {
        Entry::Vacant(place) => drop(place.insert(said)),
        Entry::Occupied(known) if *known.get() == said || *known.get() == Said::Contradicted => return false,
        Entry::Occupied(mut known) => drop(known.insert(Said::Contradicted)),
    }
    true
}

/// A slot, the one so many before it, and the one so many after it.
fn near(slot: u32, apart: u32) -> impl Iterator<Item = u32> {
    [Some(slot), slot.checked_sub(apart), slot.checked_add(apart)].into_iter().flatten()
}

impl Told {
    fn take(&mut self, report: &Report) {
        for &(slot, heard) in &report.outcomes {
            say(&mut self.outcomes, slot, heard);
        }
        self.track.take(&report.knots);
        self.earlier.extend(report.earlier.map(|earlier| (earlier.before, earlier.counts)));
    }

    /// Outside of these slots the same follows with this report beside all others as without it, whichever is the case now: it speaks
    /// of these, and in these it moves its sender.
    fn touched_by(&self, report: &Report) -> Range<u32> {
        let moved = self.track.moved_by(&report.knots);
        let (Some(first), Some(last)) = (report.outcomes.first(), report.outcomes.last()) else { return moved };
        let told = first.0..last.0 + 1;
        if moved.is_empty() { told } else { told.start.min(moved.start)..told.end.max(moved.end) }
    }

    /// What it says of the transmission of a slot; where it says nothing of that, but heard that of the slot before or after, so many
    /// apart, it is taken for that one.
    pub(crate) fn said_about(&self, slot: u32, apart: Option<u32>) -> Option<Said> {
        let is_heard = |slot: &u32| self.outcomes.get(slot) == Some(&Said::Heard);
        let heard_near = || near(slot, apart?).find(is_heard).map(|_| Said::Heard);
        self.outcomes.get(&slot).copied().or_else(heard_near)
    }

    /// The end of the counter below which packets speak of the same events, if there are any.
    pub(crate) fn before(&self) -> Option<u8> {
        self.earlier.first().map(|&(before, _)| before)
    }

    /// What a packet of this counter counts for, by whatever said least of it. What is meant by 8 bits of a counter is the one
    /// nearest to the next packet of the sender, as far as is known.
    fn worth(&self, counter: u16, latest: u16) -> Worth {
        let next = i32::from(latest) + 1;
        let meant = |before: u8| next + i32::from((before.wrapping_sub(next as u8)) as i8);
        let said = self.earlier.iter().filter(|(before, _)| i32::from(counter) < meant(*before));
        said.map(|&(_, counts)| if counts { Worth::Beyond } else { Worth::Nothing }).min().unwrap_or(Worth::All)
    }
}

/// A report, and when the vehicle sent it, if it did.
#[derive(Debug, Clone)]
pub(crate) struct Kept {
    pub(crate) report: Arc<Report>,
    pub(crate) sent: Sent,
}

/// A report of another member that went over the water.
#[derive(Debug, Clone)]
pub(crate) struct Passed {
    pub(crate) report: Arc<Report>,
    /// The slots in which it did, whoever sent it then.
    pub(crate) slots: BTreeSet<u32>,
}

#[derive(Debug, Clone, Default)]
struct Sender {
    /// By the slot that they begin at, and their bytes.
    reports: BTreeMap<(u32, Vec<u8>), Kept>,
    told: Arc<Told>,
    /// What spare bits said, by slot. Nothing shows who wrote them: where a report says something, it counts.
    recent: BTreeMap<u32, Said>,
    /// Whether it sent, by slot of its own, as far as it ever said so.
    turns: BTreeMap<u32, bool>,
}

/// What became of a report that was put in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Filed {
    /// It says something: of these slots something else may follow now.
    New(Vec<Range<u32>>),
    Known,
    /// Its sender has reported on so many later slots that it is forgotten.
    TooOld,
}

/// Reports. Of every sender those are kept that begin latest; what counts depends on the set of those that arrived, not on
/// their order or number.
#[derive(Debug, Clone)]
pub(crate) struct Reports {
    per_sender_max: usize,
    slots_back_max: u32,
    senders: BTreeMap<u8, Sender>,
}

impl Reports {
    pub(crate) fn new(per_sender_max: u16, slots_back_max: usize) -> Self {
        Self {
            per_sender_max: usize::from(per_sender_max).max(1),
            slots_back_max: slots_back_max as u32,
            senders: BTreeMap::new(),
        }
    }

    /// Puts in a report, heard or sent by the vehicle. O(log) and its length; where an old one goes for it, O(all of its
    /// sender).
    pub(crate) fn insert(&mut self, sender: u8, report: Report, sent: Option<Departure>) -> Filed {
        let max = self.per_sender_max;
        report.turns.iter().for_each(|&(slot, sent)| self.insert_turn(sender, slot, sent));
        let sender = self.senders.entry(sender).or_default();
        let key = (report.first, report.bytes.clone());
        let report = Arc::new(report);
        match sender.reports.entry(key.clone()) {
            Entry::Occupied(known) => {
                known.into_mut().sent.note(sent);
                return Filed::Known;
            }
            Entry::Vacant(place) => {
                place.insert(Kept { report: report.clone(), sent: sent.into() });
            }
        }
        let mut touched = vec![sender.told.touched_by(&report)];
        if sender.reports.len() <= max {
            Arc::make_mut(&mut sender.told).take(&report);
            return Filed::New(touched);
        }
        let gone = sender.reports.pop_first();
        if gone.as_ref().is_some_and(|(gone, _)| *gone == key) {
            return Filed::TooOld;
        }
        let mut told = Told::default();
        sender.reports.values().for_each(|kept| told.take(&kept.report));
        touched.extend(gone.map(|(_, gone)| told.touched_by(&gone.report)));
        sender.told = Arc::new(told);
        Filed::New(touched)
    }

    /// The slot from which on a report of this sender must begin to be kept.
    pub(crate) fn begin(&self, sender: u8) -> u32 {
        let full = self.senders.get(&sender).filter(|sender| sender.reports.len() >= self.per_sender_max);
        full.and_then(|sender| sender.reports.first_key_value()).map_or(0, |((first, _), _)| first + 1)
    }

    /// Puts in whether a member sent in a slot of its own. Of both it is that it did not.
    pub(crate) fn insert_turn(&mut self, sender: u8, slot: u32, sent: bool) {
        let turns = &mut self.senders.entry(sender).or_default().turns;
        *turns.entry(slot).or_insert(sent) &= sent;
        let begin = turns.last_key_value().map_or(0, |(&last, _)| last.saturating_sub(self.slots_back_max));
        while turns.first_key_value().is_some_and(|(&first, _)| first < begin) {
            turns.pop_first();
        }
    }

    /// Whether a member sent in a slot of its own, if it ever said so.
    pub(crate) fn turn(&self, sender: u8, slot: u32) -> Option<bool> {
        self.senders.get(&sender)?.turns.get(&slot).copied()
    }

    /// The slot in which a member says that it sent: this one, or else the last one of its own before it or the next one, so many further.
    pub(crate) fn sent_about(&self, sender: u8, slot: u32, apart: u32) -> Option<u32> {
        near(slot, apart).find(|&slot| self.turn(sender, slot) == Some(true))
    }

    /// What a member said of those of these slots that are its own.
    pub(crate) fn turns(&self, sender: u8, slots: Range<u32>) -> impl Iterator<Item = (u32, bool)> {
        let turns = self.senders.get(&sender).into_iter().flat_map(move |sender| sender.turns.range(slots.clone()));
        turns.map(|(&slot, &sent)| (slot, sent))
    }

    /// Whether anybody said anything of slots of its own.
    pub(crate) fn has_turns(&self) -> bool {
        self.senders.values().any(|sender| !sender.turns.is_empty())
    }

    /// Puts in what spare bits said of some slots; whether any of it is new. O(log) each.
    pub(crate) fn insert_recent(&mut self, sender: u8, outcomes: impl IntoIterator<Item = (u32, bool)>) -> bool {
        let recent = &mut self.senders.entry(sender).or_default().recent;
        let mut is_new = false;
        for (slot, heard) in outcomes {
            let last = recent.last_key_value().map_or(slot, |(&last, _)| last.max(slot));
            if last - slot < self.slots_back_max {
                is_new |= say(recent, slot, heard);
            }
            let is_too_old = |(&first, _): (&u32, &Said)| last - first >= self.slots_back_max;
            while recent.first_key_value().is_some_and(is_too_old) {
                recent.pop_first();
            }
        }
        is_new
    }

    /// What spare bits said of slots.
    pub(crate) fn recent(&self, sender: u8) -> impl Iterator<Item = (u32, Said)> {
        self.senders.get(&sender).into_iter().flat_map(|sender| sender.recent.iter().map(|(&slot, &said)| (slot, said)))
    }

    /// What a sender says of these slots, and whether spare bits did.
    pub(crate) fn outcomes(&self, sender: u8, slots: Range<u32>) -> impl Iterator<Item = (u32, Said, bool)> {
        self.senders.get(&sender).into_iter().flat_map(move |sender| {
            let (told, recent) = (&sender.told.outcomes, &sender.recent);
            let by_report = told.range(slots.clone());
            let by_report = by_report.map(|(&slot, &said)| (slot, said, recent.contains_key(&slot)));
            let others = recent.range(slots.clone()).filter(|(slot, _)| !told.contains_key(slot));
            by_report.chain(others.map(|(&slot, &said)| (slot, said, true)))
        })
    }

    /// What a sender says of one slot, by reports or, where these do not speak of it, by spare bits.
    pub(crate) fn said(&self, sender: u8, slot: u32) -> Option<Said> {
        self.outcomes(sender, slot..slot + 1).next().map(|(_, said, _)| said)
    }

    /// Everybody who said something.
    pub(crate) fn senders(&self) -> impl Iterator<Item = u8> {
        self.senders.keys().copied()
    }

    /// What one member says.
    pub(crate) fn told_by(&self, sender: u8) -> Option<&Told> {
        self.senders.get(&sender).filter(|sender| !sender.reports.is_empty()).map(|sender| &*sender.told)
    }

    /// The same, shared: it stays the same thing until something new is said.
    pub(crate) fn told_by_shared(&self, sender: u8) -> Option<Arc<Told>> {
        self.senders.get(&sender).filter(|sender| !sender.reports.is_empty()).map(|sender| sender.told.clone())
    }

    /// All reports of one sender.
    pub(crate) fn all(&self, sender: u8) -> impl Iterator<Item = &Kept> {
        self.senders.get(&sender).into_iter().flat_map(|sender| sender.reports.values())
    }

    /// Everybody's.
    pub(crate) fn everything(&self) -> impl Iterator<Item = &Kept> {
        self.senders.values().flat_map(|sender| sender.reports.values())
    }

    /// What a packet counts for, where this is the latest of its sender.
    pub(crate) fn worth(&self, (sender, counter): PacketKey, latest: u16) -> Worth {
        let Some(sender) = self.senders.get(&sender) else { return Worth::All };
        // Who never reported sends packets about all its events, those in spare bits among them.
        match sender.reports.is_empty() && !sender.recent.is_empty() {
            true => Worth::Beyond,
            false => sender.told.worth(counter, latest),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_heard_by_another_clock_may_be_of_the_slot_before_or_after() {
        let mut told = Told::default();
        for (slot, heard) in [(3, true), (9, false), (12, true), (15, false)] {
            say(&mut told.outcomes, slot, heard);
        }
        let said = |apart| [0, 3, 6, 9, 15, 18, 21].map(|slot| told.said_about(slot, apart));
        let (heard, missed) = (Some(Said::Heard), Some(Said::Missed));
        assert_eq!(said(None), [None, heard, None, missed, missed, None, None]);
        assert_eq!(said(Some(3)), [heard, heard, heard, missed, missed, None, None]);
    }
}
