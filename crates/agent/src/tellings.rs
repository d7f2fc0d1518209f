//! What of a vehicle's reports others may have, and so what is worth telling again.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::event::{Event, VehicleId};
use crate::memory::Memory;
use crate::packets::Departure;
use crate::reports::{Kept, Passed, Report, Said, Told};

/// How probable it is that a frame was lost of which nothing is known.
const LOST: f64 = 0.3;

/// How probable it is that what somebody says of the slot of a frame is not what became of the frame: the host may have sent something
/// else when it was heard, and somebody may have passed it on when it was not.
const MISTAKEN: f64 = 0.03;

/// Links are much alike both ways: what the vehicle heard and missed of another one so many rounds of turns before and after tells,
/// too, what of its own that one heard.
const NEAR_ROUNDS: u32 = 6;

/// The least that a telling counts, however probable it is that nobody heard it: not even then is it repeated forever.
const COUNTS_MIN: f64 = 0.125;

/// What is told of a slot.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Of {
    /// What became of another's transmission.
    Other,
    /// Where the vehicle itself was, and whether it sent.
    Itself,
}

/// What a vehicle said in the spare bits of a message.
#[derive(Debug, Clone)]
pub(crate) struct Aside {
    /// The slot of its own in which the message went, as far as is known.
    pub(crate) sent_in: Option<u32>,
    /// The slots that it speaks of.
    pub(crate) slots: Range<u32>,
}

/// How often slots were told in reports, and how probable it is that others do not know it all the same. Who reports what it heard
/// of the vehicle says which of its frames it has: so little is told twice to who has it, and what nobody has is told again.
#[derive(Debug)]
pub(crate) struct Tellings {
    /// What was never told.
    never: Spread,
    /// From here on,
    begin: u32,
    /// by what is told.
    told: [Vec<Spread>; 2],
}

/// How far it has spread what was told of one slot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spread {
    /// How often it was, where a frame counts as one that somebody heard as probably as one of which nothing is known.
    pub(crate) times: f64,
    /// How many others may be expected to learn it by the next frame.
    pub(crate) learning: f64,
    /// How probable it is that no other one knows it.
    nobody: f64,
}

impl Spread {
    /// Whether nobody else knows it, more probably than not.
    pub(crate) fn is_new(&self) -> bool {
        self.nobody > 0.5
    }

    /// Whether it may be told once more, if it is told so many times at most.
    pub(crate) fn may_be_told(&self, tellings_max: u8) -> bool {
        self.times < f64::from(tellings_max)
    }
}

/// Another member, and its number if it says what it heard and is believed.
type Other<'a> = Option<(u8, &'a VehicleId)>;

impl Tellings {
    /// For a frame that goes in this slot, if that is known. Of those who are doubted nothing is known. O(slots that its reports speak
    /// of), for each other member.
    pub(crate) fn new(memory: &Memory, sender: u8, slot: Option<u32>, doubted: &BTreeSet<u8>) -> Self {
        Self::with_asides(memory, sender, slot, doubted, &[])
    }

    /// The same, where it was told in spare bits, too.
    pub(crate) fn with_asides(
        memory: &Memory,
        sender: u8,
        slot: Option<u32>,
        doubted: &BTreeSet<u8>,
        asides: &[Aside],
    ) -> Self {
        let members = memory.frames.team.members.iter().filter(|(number, _)| **number != sender);
        let mut others: Vec<Other<'_>> =
            members.map(|(&number, id)| (!doubted.contains(&number)).then_some((number, id))).collect();
        if others.is_empty() {
            // Whoever listens is no member.
            others.push(None);
        }
        let sent = memory.reports.all(sender).filter(|kept| !kept.sent.is_empty());
        let reports = sent.map(|kept| Sending::of(memory, sender, &others, kept));
        let asides = asides.iter().map(|aside| Sending::of_aside(memory, &others, aside));
        let reached = others.iter().map(|other| 1.0 - lost_by_near(memory, *other, slot));
        Self::of(&reached.collect::<Vec<_>>(), &reports.chain(asides).collect::<Vec<_>>())
    }

    /// Of reports of another member, which go once more in this slot of the vehicle's own: what third ones do not know. Of those who are
    /// doubted nobody knows what they have.
    pub(crate) fn of_passed(memory: &Memory, sender: u8, slot: u32, doubted: &BTreeSet<u8>, passed: &[Passed]) -> Self {
        let members = memory.frames.team.members.iter();
        let is_third = |number: &u8| *number != sender && Some(*number) != memory.own && !doubted.contains(number);
        let others: Vec<Other<'_>> =
            members.filter(|(number, _)| is_third(number)).map(|(&number, id)| Some((number, id))).collect();
        // What its sender's own next frame brings need not be passed on.
        let reached = others
            .iter()
            .map(|other| (1.0 - lost_by_near(memory, *other, Some(slot))) * missed_next(memory, *other, sender));
        let reached: Vec<f64> = reached.collect();
        // Most often nobody misses anything.
        let passed = if reached.iter().any(|reached| *reached > 0.0) { passed } else { &[] };
        let reports: Vec<Sending> =
            passed.iter().map(|passed| Sending::of_passed(memory, sender, &others, passed)).collect();
        Self::of(&reached, &reports)
    }

    /// For a frame that reaches others as probably as this.
    fn of(reached: &[f64], reports: &[Sending]) -> Self {
        let all = || reports.iter().flat_map(|report| &report.spans).map(|(_, span)| span);
        let begin = all().map(|span| span.start).min().unwrap_or(0);
        let length = all().map(|span| span.end).max().map_or(0, |end| (end - begin) as usize);
        let never = Spread { times: 0.0, learning: reached.iter().sum(), nobody: 1.0 };
        let mut told = [(); 2].map(|()| vec![Spread { learning: 0.0, ..never }; length]);
        let place = |span: &Range<u32>| (span.start - begin) as usize..(span.end - begin) as usize;
        for Sending { spans, times, .. } in reports {
            for (of, span) in spans {
                told[*of as usize][place(span)].iter_mut().for_each(|told| told.times += times);
            }
        }
        // One after the other: all of them at once would be slots × members.
        for (nth, reached) in reached.iter().enumerate() {
            let mut unknown = [(); 2].map(|()| vec![1.0; length]);
            for Sending { spans, lost, .. } in reports {
                for (of, span) in spans {
                    unknown[*of as usize][place(span)].iter_mut().for_each(|unknown| *unknown *= lost[nth]);
                }
            }
            for (told, unknown) in told.iter_mut().flatten().zip(unknown.iter().flatten()) {
                told.learning += reached * unknown;
                told.nobody *= unknown;
            }
        }
        Self { never, begin, told }
    }

    pub(crate) fn get(&self, of: Of, slot: u32) -> Spread {
        let place = slot.checked_sub(self.begin).map(|place| place as usize);
        place.and_then(|place| self.told[of as usize].get(place)).copied().unwrap_or(self.never)
    }

    /// Whether somebody knows what became of another's transmission, more probably than not.
    pub(crate) fn is_known(&self, slot: u32) -> bool {
        !self.get(Of::Other, slot).is_new()
    }
}

/// What became of a report.
struct Sending {
    /// The slots that it tells.
    spans: Vec<(Of, Range<u32>)>,
    /// How probable it is, for each other one, that it does not have it.
    lost: Vec<f64>,
    /// How often it was sent: each time counts as much as the one whom it reached most probably.
    times: f64,
}

impl Sending {
    fn of(memory: &Memory, sender: u8, others: &[Other<'_>], kept: &Kept) -> Self {
        let mut sending = Self::unsent(spans(memory, sender, &kept.report), others);
        for Departure { slot, .. } in kept.sent.iter() {
            // It may have been silent after all.
            let never_left = slot.is_some_and(|slot| memory.reports.turn(sender, slot) == Some(false));
            let lost = |other: &Other<'_>| if never_left { 1.0 } else { lost(memory, *other, slot) };
            sending.times += sending.go(others.iter().map(lost));
        }
        sending
    }

    fn unsent(spans: Vec<(Of, Range<u32>)>, others: &[Other<'_>]) -> Self {
        Self { spans, lost: vec![1.0; others.len()], times: 0.0 }
    }

    /// Takes it that it went, and was lost to each other one as probably as this; how much that counts.
    fn go(&mut self, lost: impl Iterator<Item = f64>) -> f64 {
        let mut least: f64 = 1.0;
        for (all, lost) in self.lost.iter_mut().zip(lost) {
            *all *= lost;
            least = least.min(lost);
        }
        ((1.0 - least) / (1.0 - LOST)).clamp(COUNTS_MIN, 1.0)
    }

    /// What became of spare bits. Who says in such ones what it heard says as well which of them it has: neither are sealed.
    fn of_aside(memory: &Memory, others: &[Other<'_>], Aside { sent_in, slots }: &Aside) -> Self {
        let lost = |other: &Other<'_>| {
            let said = other.zip(*sent_in).and_then(|((number, _), slot)| memory.reports.said(number, slot));
            lost_by(said).unwrap_or_else(|| lost_by_near(memory, *other, *sent_in))
        };
        Self { spans: vec![(Of::Other, slots.clone())], lost: others.iter().map(lost).collect(), times: 1.0 }
    }

    /// What became of another's report, whoever passed it on.
    fn of_passed(memory: &Memory, sender: u8, others: &[Other<'_>], Passed { report, slots }: &Passed) -> Self {
        let mut sending = Self::unsent(spans(memory, sender, report), others);
        // It may have been silent after all.
        let never_left = |slot: u32| memory.own.is_some_and(|own| memory.reports.turn(own, slot) == Some(false));
        for slot in slots.iter().copied().filter(|&slot| !never_left(slot)) {
            let counts = sending.go(others.iter().map(|other| lost_of_another(memory, *other, slot)));
            if memory.frames.is_turn_of(slot, memory.own_id()) {
                sending.times += counts;
            }
        }
        sending
    }
}

/// The slots that a report tells. What it says of slots of its sender's own that turned out to be otherwise tells nothing.
pub(crate) fn spans(memory: &Memory, sender: u8, report: &Report) -> Vec<(Of, Range<u32>)> {
    let mut spans: Vec<(Of, Range<u32>)> =
        report.outcomes.iter().map(|&(slot, _)| (Of::Other, slot..slot + 1)).collect();
    let id = memory.frames.team.members.get(&sender);
    if !id.is_some_and(|id| memory.frames.team.slots.always_sends(id)) {
        let holds = |&&(slot, sent): &&(u32, bool)| memory.reports.turn(sender, slot).is_none_or(|turn| turn == sent);
        spans.extend(report.turns.iter().filter(holds).map(|&(slot, _)| (Of::Itself, slot..slot + 1)));
        return spans;
    }
    // All from its first slot to its last knot, but for those in which it was silent and does not say so.
    let last = report.knots.last().map_or(report.first, |knot| knot.0.max(report.first));
    let is_unsaid = |turn: &(u32, bool)| !turn.1 && !report.turns.contains(turn);
    let mut begin = report.first;
    for (slot, _) in memory.reports.turns(sender, report.first..last + 1).filter(is_unsaid) {
        spans.push((Of::Itself, begin..slot));
        begin = slot + 1;
    }
    spans.push((Of::Itself, begin..last + 1));
    spans
}

/// How probable it is that a frame of this slot did not reach another one: by what that one reports or, where it says nothing, by what
/// the vehicle itself heard of it about then.
fn lost(memory: &Memory, other: Other<'_>, slot: Option<u32>) -> f64 {
    let slots = &memory.frames.team.slots;
    // By another clock what was sent at will may have been heard in the stretch before or after.
    let apart = slots.at_will.then(|| slots.at_once() as u32);
    let said = other.zip(slot).and_then(|((number, _), slot)| memory.reports.told_by(number)?.said_about(slot, apart));
    lost_by(said).unwrap_or_else(|| lost_by_near(memory, other, slot))
}

/// How probable it is that what somebody else sent in this slot did not reach another one: by what that one reports of it or, where it
/// says nothing, of what the same one sent about then. Who reports nothing of it is taken to have everything.
fn lost_of_another(memory: &Memory, other: Other<'_>, slot: u32) -> f64 {
    let slots = &memory.frames.team.slots;
    let Some(((number, id), from)) = other.zip(slots.sender(slot)) else { return 0.0 };
    let Some(told) = memory.reports.told_by(number).filter(|_| from != id) else { return 0.0 };
    let near = near_slots(memory);
    let about = slot.saturating_sub(near)..slot.saturating_add(near + 1);
    lost_by(told.said_about(slot, None)).unwrap_or_else(|| missed(memory, told, from, about))
}

/// How probable it is that the next frame of a member does not reach another one, by what that one reports of it last.
fn missed_next(memory: &Memory, other: Other<'_>, sender: u8) -> f64 {
    let told = other.and_then(|(number, _)| memory.reports.told_by(number));
    let (Some(told), Some(id)) = (told, memory.frames.team.members.get(&sender)) else { return 0.0 };
    let last = told.outcomes.last_key_value().map_or(0, |(&last, _)| last);
    missed(memory, told, id, last.saturating_sub(2 * near_slots(memory))..last + 1)
}

/// What share of a member's transmissions in these slots another one says it missed, beside one that it heard.
fn missed(memory: &Memory, told: &Told, sender: &VehicleId, slots: Range<u32>) -> f64 {
    let said = told.outcomes.range(slots).filter(|(slot, _)| memory.frames.team.slots.sender(**slot) == Some(sender));
    let [count, missed] = said.fold([0.0, 0.0], |[count, missed], (_, said)| {
        [count + 1.0, missed + f64::from(u8::from(*said == Said::Missed))]
    });
    missed / (1.0 + count)
}

/// How probable that is by what that one says of the slot.
fn lost_by(said: Option<Said>) -> Option<f64> {
    match said? {
        Said::Heard => Some(MISTAKEN),
        Said::Missed => Some(1.0 - MISTAKEN),
        Said::Contradicted => None,
    }
}

/// The same by what the vehicle itself heard of the other one about then.
fn lost_by_near(memory: &Memory, other: Other<'_>, slot: Option<u32>) -> f64 {
    let Some(((_, id), slot)) = other.zip(slot) else { return LOST };
    let team = &memory.frames.team;
    let near = near_slots(memory);
    let begin_s = |slot: u32| team.slots.begin_s(slot).unwrap_or(f64::INFINITY);
    let end_s = begin_s(slot.saturating_add(near + 1));
    let known = memory.sent_since(begin_s(slot.saturating_sub(near)));
    let known = known.take_while(|known| known.event.time_s < end_s);
    let is_between = |event: &Event| event.transmitter_id == *id && Some(&event.receiver_id) == memory.own_id();
    let known = known.map(|known| &known.event).filter(|event| is_between(event));
    let [heard, missed] = known.fold([0.0, 0.0], |[heard, missed], event| match event.success {
        true => [heard + 1.0, missed],
        false => [heard, missed + 1.0],
    });
    (LOST + missed) / (1.0 + heard + missed)
}

/// So many slots before and after are about then.
fn near_slots(memory: &Memory) -> u32 {
    let team = &memory.frames.team;
    NEAR_ROUNDS * team.slots.order_max().max(team.members.len()) as u32
}
