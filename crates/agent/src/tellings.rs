//! What of a vehicle's reports others may have, and so what is worth telling again.

use std::ops::Range;

use crate::event::VehicleId;
use crate::memory::Memory;
use crate::reports::{Kept, Said};

/// How probable it is that a frame was lost of which nothing is known.
const LOST: f64 = 0.3;

/// The same where somebody heard the vehicle in the slot of the frame: its host may have sent something else then.
const MISTAKEN: f64 = 0.03;

/// Links are much alike both ways: what the vehicle heard and missed of another one so many slots before and after tells, too, what of
/// its own that one heard.
const NEAR_SLOTS: u32 = 12;

/// What is told of a slot.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Of {
    /// What became of another's transmission.
    Other,
    /// Where the vehicle itself was, and whether it sent.
    Itself,
}

/// How often slots were told in reports, and how probable it is that others do not know it all the same. Who reports what it heard
/// of the vehicle says which of its frames it has: so little is told twice to who has it, and what nobody has is told again.
#[derive(Debug)]
pub(crate) struct Tellings {
    /// What was never told.
    never: Telling,
    /// From here on,
    begin: u32,
    /// by what is told.
    told: [Vec<Telling>; 2],
}

/// What was told of one slot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Telling {
    /// How often it was, where a frame of which nothing is known counts as one, and one that reached nobody not at all.
    pub(crate) times: f64,
    /// How many others may be expected to learn it by the next frame.
    pub(crate) learning: f64,
    /// Whether no other one knows it, more probably than not.
    pub(crate) is_new: bool,
}

impl Tellings {
    /// For a frame that goes in this slot, if that is known. O(slots that its reports speak of), for each other member.
    pub(crate) fn new(memory: &Memory, sender: u8, slot: Option<u32>) -> Self {
        let spans: Vec<Vec<(Of, Range<u32>)>> = memory.reports.all(sender).map(|kept| spans(memory, kept)).collect();
        let all = || spans.iter().flatten().map(|(_, span)| span);
        let begin = all().map(|span| span.start).min().unwrap_or(0);
        let length = all().map(|span| span.end).max().map_or(0, |end| (end - begin) as usize);
        let members = memory.frames.team.members.iter().filter(|(number, _)| **number != sender);
        let mut others: Vec<Option<(u8, &VehicleId)>> = members.map(|(&number, id)| Some((number, id))).collect();
        if others.is_empty() {
            // Whoever listens is no member.
            others.push(None);
        }
        let mut never = Telling { times: 0.0, learning: 0.0, is_new: true };
        let mut told = [(); 2].map(|()| vec![never; length]);
        for other in &others {
            let reached = 1.0 - lost(memory, *other, slot);
            never.learning += reached;
            let mut unknown = [(); 2].map(|()| vec![1.0; length]);
            for (kept, spans) in memory.reports.all(sender).zip(&spans) {
                let lost: Vec<f64> = kept.sent.iter().map(|sent| lost(memory, *other, sent.slot)).collect();
                let times = lost.iter().map(|lost| (1.0 - lost) / (1.0 - LOST)).sum::<f64>() / others.len() as f64;
                let lost: f64 = lost.iter().product();
                for (of, span) in spans {
                    let slots = (span.start - begin) as usize..(span.end - begin) as usize;
                    unknown[*of as usize][slots.clone()].iter_mut().for_each(|unknown| *unknown *= lost);
                    told[*of as usize][slots].iter_mut().for_each(|told| told.times += times);
                }
            }
            for (told, unknown) in told.iter_mut().flatten().zip(unknown.iter().flatten()) {
                told.learning += reached * unknown;
                told.is_new &= *unknown > 0.5;
            }
        }
        Self { never, begin, told }
    }

    pub(crate) fn get(&self, of: Of, slot: u32) -> Telling {
        let place = slot.checked_sub(self.begin).map(|place| place as usize);
        place.and_then(|place| self.told[of as usize].get(place)).copied().unwrap_or(self.never)
    }

    /// Whether somebody knows what became of another's transmission, more probably than not.
    pub(crate) fn is_known(&self, slot: u32) -> bool {
        !self.get(Of::Other, slot).is_new
    }
}

/// The slots that a report of the vehicle's own tells.
fn spans(memory: &Memory, Kept { report, .. }: &Kept) -> Vec<(Of, Range<u32>)> {
    let others = report.outcomes.iter().map(|&(slot, _)| (Of::Other, slot..slot + 1));
    if memory.frames.team.slots.at_will {
        return others.chain(report.turns.iter().map(|&(slot, _)| (Of::Itself, slot..slot + 1))).collect();
    }
    // All slots of its own from its first slot to its last knot.
    let last = report.knots.last().map_or(report.first, |knot| knot.0);
    others.chain([(Of::Itself, report.first..last.max(report.first) + 1)]).collect()
}

/// How probable it is that a frame of this slot did not reach another one, or will not: by what that one said, or what the vehicle itself heard of it about then.
fn lost(memory: &Memory, other: Option<(u8, &VehicleId)>, slot: Option<u32>) -> f64 {
    let Some(((number, id), slot)) = other.zip(slot) else { return LOST };
    match memory.reports.outcomes(number, slot..slot + 1).next() {
        Some((_, Said::Heard, _)) => return MISTAKEN,
        Some((_, Said::Missed, _)) => return 1.0,
        Some((_, Said::Contradicted, _)) | None => {}
    }
    let begin_s = |slot: u32| memory.frames.team.slots.begin_s(slot).unwrap_or(f64::INFINITY);
    let end_s = begin_s(slot.saturating_add(NEAR_SLOTS + 1));
    let near = memory.sent_since(begin_s(slot.saturating_sub(NEAR_SLOTS)));
    let near = near.take_while(|known| known.event.time_s < end_s).filter(|known| known.event.transmitter_id == *id);
    let [heard, missed] = near.fold([0.0, 0.0], |[heard, missed], known| match known.event.success {
        true => [heard + 1.0, missed],
        false => [heard, missed + 1.0],
    });
    (LOST + missed) / (1.0 + heard + missed)
}
