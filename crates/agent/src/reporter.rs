//! Which report is worth the next frame: what of its own events a vehicle tells one by one, and the part of its track that goes
//! with them.

use std::collections::{BTreeMap, BTreeSet};

use dgpc::spread_out;
use pingmap_packet::{
    Cell, Earlier, KNOTS_MAX, Knot, OUTCOME_BYTES_MAX, Outcome, OutcomeCounts, Report as ReportMessage,
};

use crate::knots::Knots;
use crate::memory::Memory;
use crate::tellings::{Of, Tellings};

/// Which report leaves least untold is asked of those that are worth this share of the best one at least.
const ALIKE: f64 = 0.5;

/// Of the frames that all takes, so many are tried from the begin, and so many from the end: each costs as much as a part of a fit.
const TRIED_MAX: usize = 4;

/// What the vehicle could say of a slot.
#[derive(Debug, Clone, Copy)]
struct Item {
    slot: u32,
    /// Whether it is a slot of its own.
    is_own: bool,
    /// What became of another's transmission, or whether it sent itself.
    outcome: Outcome,
    /// What telling it is worth: how many others may be expected to learn it.
    value: f64,
    /// Whether it is probably known to nobody else.
    is_new: bool,
}

/// What a vehicle could report: slots in the order of time, and where it was.
#[derive(Debug)]
pub(crate) struct Reporter<'a> {
    memory: &'a Memory,
    sender: u8,
    frame_bytes: usize,
    tellings: Tellings,
    /// What a report says of map messages that went before the first one; none did if it is `None`.
    earlier: Option<Earlier>,
    items: Vec<Item>,
    knots: Vec<(u32, Cell)>,
    /// Of each knot the number of its run: between runs nobody says where it was.
    runs: Vec<usize>,
    /// Of all items before that of the same place.
    sums: Vec<Sums>,
}

/// What some items come to.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Slots of others that are told, and slots of its own.
    others: usize,
    own: usize,
    /// Slots of which nothing is told, how many in a row these were last, and how often that was so many that a byte skips them.
    untold: usize,
    gap: usize,
    skips: usize,
    /// Slots of its own in which it must be told whether it sent.
    turns: usize,
    /// What all is worth, and how many of them are new.
    value: f64,
    new: usize,
}

impl Sums {
    fn and(self, item: &Item, always_sends: bool) -> Self {
        let is_untold = item.outcome == Outcome::Untold;
        let is_turn = item.is_own && !is_untold && !(always_sends && item.outcome == Outcome::Heard);
        // Slots of its own stand among the others only where one of them is a turn.
        let gap = match item.is_own && !is_turn {
            _ if is_untold => self.gap + 1,
            true => self.gap,
            false => 0,
        };
        Self {
            others: self.others + usize::from(!item.is_own && !is_untold),
            own: self.own + usize::from(item.is_own && !is_untold),
            untold: self.untold + usize::from(is_untold),
            gap,
            skips: self.skips + usize::from(is_untold && gap % OutcomeCounts::SKIP == 0),
            turns: self.turns + usize::from(is_turn),
            value: self.value + item.value,
            new: self.new + usize::from(item.is_new),
        }
    }
}

/// A part of the items, ends included.
#[derive(Debug, Clone, Copy)]
struct Span {
    first: usize,
    last: usize,
    value: f64,
}

impl<'a> Reporter<'a> {
    /// What could be told in a frame of so many bytes that carries this counter. O(slots that it may report, of a leg each).
    pub(crate) fn new(memory: &'a Memory, sender: u8, frame_bytes: usize, counter: u16, tellings: Tellings) -> Self {
        let team = &memory.frames.team;
        let knots = Knots {
            slots: &team.slots,
            grid: &team.grid,
            chart: &team.model.chart,
            has_depth: team.model.inputs.has_depths(),
            off_max_m: team.track_off_max_m,
        };
        let nothing = BTreeMap::new();
        let reported = memory.reports.told_by(sender);
        let told = reported.map_or(&nothing, |told| told.track.knots());
        // From where on it may report: before that is what was forgotten, and where it was then.
        let begin = memory.reports.begin(sender);
        let begin = told.range(..=begin).next_back().map_or(begin, |(&slot, _)| slot);
        let runs = knots.of(&memory.track(), told, begin).into_iter().enumerate();
        let (runs, knots): (Vec<usize>, Vec<(u32, Cell)>) =
            runs.flat_map(|(run, knots)| knots.into_iter().map(move |knot| (run, knot))).unzip();
        let items = items(memory, sender, &knots, &tellings);
        let mut sums = vec![Sums::default()];
        let always = memory.own_id().is_none_or(|own| team.slots.always_sends(own));
        for item in &items {
            let before = sums.last().copied().unwrap_or_default();
            sums.push(before.and(item, always));
        }
        let before = match reported {
            Some(reported) => reported.before(),
            None => (counter > 0).then_some(counter as u8),
        };
        let earlier = before.map(|before| Earlier { before, counts: false });
        Self { memory, sender, frame_bytes, tellings, earlier, items, knots, runs, sums }
    }

    /// The reports of which one is worth the next frame, that which is worth most last. Where all that is new takes several
    /// frames, some of these are there, too, counted from its begin and from its end: much of a mission is like the rest of it, and
    /// it matters what goes first. Empty where nothing is worth telling (again).
    pub(crate) fn reports(&self) -> Vec<ReportMessage> {
        let Some(best) = self.best() else { return Vec::new() };
        let mut spans = Vec::new();
        let from_begin = self.in_frames(self.untold());
        if from_begin.len() > 1 {
            for frames in [from_begin, self.in_frames(self.untold().rev())] {
                spans.extend(spread_out(frames.len(), TRIED_MAX).into_iter().map(|nth| frames[nth]));
            }
            spans.retain(|span| self.fits(span.first, span.last));
            spans.retain(|span| span.value >= ALIKE * best.value);
        }
        spans.push(best);
        spans.into_iter().map(|span| self.message(span)).collect()
    }

    /// What that one is worth which is worth most: how much others may be expected to learn of it.
    pub(crate) fn value(&self) -> f64 {
        self.best().map_or(0.0, |best| best.value)
    }

    fn best(&self) -> Option<Span> {
        let is_full = self.memory.reports.begin(self.sender) > 0;
        // Where another one has to go for it, it must say something new.
        let is_worth = |span: &Span| !is_full || self.sums[span.last + 1].new > self.sums[span.first].new;
        // The latest of several.
        let ends = self.at_ends().into_iter().filter(is_worth);
        ends.max_by(|a, b| a.value.total_cmp(&b.value))
    }

    /// Full frames that begin or end where something does that is worth more than what is before or after it: what is left is in
    /// one piece.
    fn at_ends(&self) -> Vec<Span> {
        let value = |place: usize| self.items[place].value;
        // Between two items of value there may be some that nothing can be said of.
        let worth: Vec<usize> = (0..self.items.len()).filter(|&place| value(place) > 0.0).collect();
        let mut spans = Vec::new();
        for (nth, &place) in worth.iter().enumerate().filter(|&(_, &place)| self.fits(place, place)) {
            let is_more_than = |other: Option<&usize>| other.is_none_or(|&other| value(place) > value(other));
            if is_more_than(nth.checked_sub(1).and_then(|before| worth.get(before))) {
                let onward = worth[nth..].partition_point(|&last| self.fits(place, last));
                spans.push(self.span(place, worth[nth + onward.max(1) - 1]));
            }
            if is_more_than(worth.get(nth + 1)) {
                let back = worth[..=nth].partition_point(|&first| !self.fits(first, place));
                spans.push(self.span(worth[back.min(nth)], place));
            }
        }
        spans
    }

    /// How many frames it takes to tell all that is new.
    pub(crate) fn frames_needed(&self) -> usize {
        self.in_frames(self.untold()).len()
    }

    fn untold(&self) -> impl DoubleEndedIterator<Item = usize> {
        (0..self.items.len()).filter(|&place| self.items[place].is_new)
    }

    /// Items in as few frames as they fit into, in this order or the other way round.
    fn in_frames(&self, places: impl Iterator<Item = usize>) -> Vec<Span> {
        let mut places = places.peekable();
        let mut spans = Vec::new();
        while let Some(begin) = places.next() {
            let mut end = begin;
            while let Some(next) = places.next_if(|&next| self.fits(begin.min(next), begin.max(next))) {
                end = next;
            }
            spans.push(self.span(begin.min(end), begin.max(end)));
        }
        spans
    }

    fn span(&self, first: usize, last: usize) -> Span {
        Span { first, last, value: self.sums[last + 1].value - self.sums[first].value }
    }

    fn fits(&self, first: usize, last: usize) -> bool {
        let (before, end) = (self.sums[first], self.sums[last + 1]);
        let own = if self.tells_own(first, last) { end.own - before.own } else { 0 };
        let outcomes = OutcomeCounts {
            told: end.others - before.others + own,
            untold: end.untold - before.untold,
            skips: end.skips - before.skips,
        };
        let (from, to) = self.knots_about(first, last);
        let length = self.memory.frames.report_layout().length(outcomes, to + 1 - from, self.earlier.is_some());
        let is_one_run = self.runs[from] == self.runs[to];
        is_one_run
            && self.memory.frames.is_one_order(self.items[first].slot, self.items[last].slot)
            && length <= self.frame_bytes
            && to + 1 - from <= KNOTS_MAX
            && outcomes.bytes_max() <= OUTCOME_BYTES_MAX
    }

    /// Whether it was silent in one of these slots, or may have been as far as others know.
    fn tells_own(&self, first: usize, last: usize) -> bool {
        self.sums[last + 1].turns > self.sums[first].turns
    }

    /// The places of the knots before and after these items.
    fn knots_about(&self, first: usize, last: usize) -> (usize, usize) {
        let (first, last) = (self.items[first].slot, self.items[last].slot);
        let from = self.knots.partition_point(|knot| knot.0 <= first).saturating_sub(1);
        (from, self.knots.partition_point(|knot| knot.0 < last).min(self.knots.len() - 1))
    }

    fn message(&self, span: Span) -> ReportMessage {
        let items = &self.items[span.first..=span.last];
        let tells_own = self.tells_own(span.first, span.last);
        let first = items[0].slot;
        let (from, to) = self.knots_about(span.first, span.last);
        let mut before = None;
        let knot = |&(slot, Cell { east, north, depth }): &(u32, Cell)| {
            let slots = before.replace(slot).map_or(first.saturating_sub(slot), |before| slot - before) as u8;
            Knot { slots, east, north, depth }
        };
        ReportMessage {
            sender: self.sender,
            model: 0,
            first,
            tells_own,
            outcomes: items.iter().filter(|item| tells_own || !item.is_own).map(|item| item.outcome).collect(),
            knots: self.knots[from..=to].iter().map(knot).collect(),
            earlier: self.earlier,
        }
    }

    /// Whose reports these are.
    pub(crate) fn sender(&self) -> u8 {
        self.sender
    }

    /// Whether somebody else knows what became of another's transmission, more probably than not.
    pub(crate) fn is_known(&self, slot: u32) -> bool {
        self.tellings.is_known(slot)
    }

    /// The first slot that reports may begin at.
    pub(crate) fn begin(&self) -> Option<u32> {
        let first = self.items.first().map(|item| item.slot)?;
        Some(first.max(self.memory.reports.begin(self.sender)))
    }

    /// The slots whose outcomes a report tells.
    pub(crate) fn slots_told(&self, report: &ReportMessage) -> BTreeSet<u32> {
        let slots = self.memory.frames.slots_of(self.sender, report.first, report.tells_own);
        let told = slots.zip(&report.outcomes).filter(|(_, outcome)| **outcome != Outcome::Untold);
        told.map(|(slot, _)| slot).collect()
    }
}

/// Slots between the first and the last knot in which the vehicle could hear somebody or send.
fn items(memory: &Memory, sender: u8, knots: &[(u32, Cell)], tellings: &Tellings) -> Vec<Item> {
    let (Some(&(begin, _)), Some(&(end, _))) = (knots.first(), knots.last()) else { return Vec::new() };
    let end = end + memory.frames.team.slots.at_once() as u32;
    let own = memory.outcomes_since(sender, memory.frames.team.slots.begin_s(begin).unwrap_or(f64::NEG_INFINITY));
    let (begin_min, tellings_max) = (memory.reports.begin(sender), memory.frames.team.tellings_max);
    let item = |slot: u32, of: Of, outcome: Outcome, says_something: bool| {
        let told = tellings.get(of, slot);
        let is_worth = says_something && slot >= begin_min && told.may_be_told(tellings_max);
        let value = if is_worth { told.learning } else { 0.0 };
        Item { slot, is_own: matches!(of, Of::Itself), outcome, value, is_new: is_worth && told.is_new() }
    };
    // Where nobody is heard in slots, a schedule says nothing of who sends.
    let is_in_force = memory.frames.team.slots.listed.is_some() || !own.is_empty();
    let at_will = memory.frames.team.slots.at_will;
    // Whose clock is off may have sent in others' slots, and who does not always send cannot say that it did in its own.
    let always_sends = memory.own_id().is_none_or(|own| memory.frames.team.slots.always_sends(own));
    let may_have_sent_elsewhere = |slot: u32| {
        let begin_s = memory.frames.team.slots.begin_s(slot).unwrap_or(f64::NEG_INFINITY);
        !always_sends && memory.reckoning.ahead(memory.reckoning.local_s(begin_s)) != 0
    };
    let of_slot = |slot: u32| {
        if !memory.frames.is_heard_by(slot, sender) {
            let (outcome, says_something) = match memory.reports.turn(sender, slot) {
                Some(true) => (Outcome::Heard, true),
                Some(false) => (Outcome::Missed, at_will || is_in_force),
                None if at_will || may_have_sent_elsewhere(slot) => (Outcome::Untold, false),
                None => (Outcome::Heard, is_in_force),
            };
            return item(slot, Of::Itself, outcome, says_something);
        }
        let outcome = match own.get(&slot) {
            Some(true) => Outcome::Heard,
            Some(false) => Outcome::Missed,
            None => Outcome::Untold,
        };
        item(slot, Of::Other, outcome, outcome != Outcome::Untold)
    };
    let slots = memory.frames.slots_of(sender, begin, true).take_while(|&slot| slot < end);
    let items: Vec<Item> = slots.map(of_slot).collect();
    items[items.len().saturating_sub(memory.frames.team.limits.slots_back_max)..].to_vec()
}
