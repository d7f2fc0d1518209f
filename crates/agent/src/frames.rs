//! The bytes of a team's packets: who may read them, and what makes them the team's own.

use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::Summary;
use pingmap_packet::{Block, Cell, Layout, MapMessage, Outcome, Report as ReportMessage, ReportLayout, Seal, digest};

use crate::event::{Event, VehicleId};
use crate::packets::{Packet, PacketKey};
use crate::receipt::Refusal;
use crate::reports::Report;
use crate::team::Team;

/// A told event, by the number of who heard or missed it, and the slot.
pub(crate) type ToldKey = (u8, u32);

/// What reads and writes a team's packets.
#[derive(Debug, Clone)]
pub(crate) struct Frames {
    pub(crate) team: Arc<Team>,
    /// What was agreed on about slots before each change of order, and about all slots last.
    agreements: Arc<[Agreement]>,
}

const DIGEST_BYTES: usize = 32;

/// What was agreed on about slots before some slot.
#[derive(Debug, Clone, Copy)]
struct Agreement {
    digest: [u8; 32],
    end: u32,
}

impl Frames {
    pub(crate) fn new(team: Arc<Team>) -> Self {
        let ends: BTreeSet<u32> = team.slots.changes.iter().map(|change| change.from).chain([u32::MAX]).collect();
        let about = |end: u32| Agreement { digest: team.digest_before(end), end };
        Self { agreements: ends.into_iter().map(about).collect(), team }
    }

    /// Whether one order holds in all slots from one to another: who does not know the next one reads a report of these.
    pub(crate) fn is_one_order(&self, first: u32, last: u32) -> bool {
        self.agreement_about(first).end == self.agreement_about(last).end
    }

    /// The agreements as bytes: the digest of that about the first slots, and for each change its first slot and the digest of the
    /// next one.
    pub(crate) fn agreements(&self) -> Vec<u8> {
        let [first, changes @ ..] = &*self.agreements else { return Vec::new() };
        let ends = self.agreements.iter().map(|agreement| agreement.end.to_le_bytes());
        let next = ends.zip(changes).flat_map(|(end, next)| [&end[..], &next.digest].concat());
        first.digest.into_iter().chain(next).collect()
    }

    /// The slot up to which the same was agreed on as these bytes say; `None` where more than the order of slots is another.
    pub(crate) fn agree_until(&self, bytes: &[u8]) -> Option<u32> {
        let own = self.agreements();
        let alike = own.iter().zip(bytes).take_while(|(own, other)| own == other).count();
        let changes = alike.checked_sub(DIGEST_BYTES)? / (DIGEST_BYTES + 4);
        let begin = DIGEST_BYTES + changes * (DIGEST_BYTES + 4);
        let end = |bytes: &[u8]| bytes.get(begin..begin + 4)?.try_into().ok().map(u32::from_le_bytes);
        Some([end(&own), end(bytes)].into_iter().flatten().min().unwrap_or(u32::MAX))
    }

    /// What slots up to this one follow from: whoever does not know of a later change of order agrees on it.
    fn agreement_about(&self, slot: u32) -> &Agreement {
        let place = self.agreements.partition_point(|agreement| agreement.end <= slot);
        &self.agreements[place.min(self.agreements.len() - 1)]
    }

    /// A packet of the team: its form, and the numbers in it.
    pub(crate) fn read(&self, bytes: &[u8]) -> Result<(&'static Layout, MapMessage), Refusal> {
        if let Some(layout) = Layout::of(bytes)
            && !self.is_ours(layout)
        {
            return Err(Refusal::OtherForm { name: layout.name });
        }
        let agreement = self.about_no_slot();
        let (layout, message) = MapMessage::decode(bytes, self.seal(agreement)).map_err(|error| self.refusal(error))?;
        if !layout.is_sealed {
            self.check_number(message.model, &layout.with_model_zeroed(bytes), agreement)?;
        }
        self.check_sender(message.sender)?;
        Ok((layout, message))
    }

    /// A report of the team in the first so many bytes: its form, and what it says.
    pub(crate) fn read_report(&self, bytes: &[u8]) -> Result<(&'static ReportLayout, ReportMessage, usize), Refusal> {
        self.read_report_about(bytes).map(|(layout, message, length, _)| (layout, message, length))
    }

    /// The same, and the slot from which on its sender may have had another order in mind.
    fn read_report_about(&self, bytes: &[u8]) -> Result<(&'static ReportLayout, ReportMessage, usize, u32), Refusal> {
        if let Some(layout) = ReportLayout::of(bytes)
            && (layout.has_depth != self.team.model.inputs.has_depths() || layout.is_sealed != self.team.key.is_some())
        {
            return Err(Refusal::OtherForm { name: layout.name });
        }
        let read = |agreement: &Agreement| {
            let decoded = ReportMessage::decode(bytes, self.seal(agreement));
            let (layout, message, length) = decoded.map_err(|error| self.refusal(error))?;
            if !layout.is_sealed {
                self.check_number(message.model, &layout.with_model_zeroed(&bytes[..length]), agreement)?;
            }
            self.check_sender(message.sender)?;
            Ok((layout, message, length, agreement.end))
        };
        let is_of_another = |read: &Result<_, Refusal>| matches!(read, Err(Refusal::OtherTeam { .. }));
        let latest = read(self.agreement_about(u32::MAX));
        if !is_of_another(&latest) {
            return latest;
        }
        self.agreements.iter().rev().skip(1).map(read).find(|found| !is_of_another(found)).unwrap_or(latest)
    }

    /// Whether an open message was formed under this agreement, and is whole.
    fn check_number(&self, model: u16, unnumbered: &[u8], agreement: &Agreement) -> Result<(), Refusal> {
        let (found, expected) = (model ^ check_number(unnumbered), agreement.number());
        if found == expected { Ok(()) } else { Err(Refusal::OtherTeam { found: Some(found), expected }) }
    }

    fn check_sender(&self, number: u8) -> Result<(), Refusal> {
        match self.team.members.contains_key(&number) {
            true => Ok(()),
            false => Err(Refusal::UnknownSender { number }),
        }
    }

    /// Whether members of the team send packets of this form.
    fn is_ours(&self, layout: &Layout) -> bool {
        layout.has_depth == self.team.model.inputs.has_depths()
            && layout.is_sealed == self.team.key.is_some()
            && layout.frame_bytes <= self.team.frame_bytes
    }

    /// What a decoder's error means to a receiver.
    fn refusal(&self, error: pingmap_packet::Error) -> Refusal {
        match error {
            pingmap_packet::Error::OtherContext => {
                Refusal::OtherTeam { found: None, expected: self.about_no_slot().number() }
            }
            pingmap_packet::Error::Forged | pingmap_packet::Error::Seal(_) => Refusal::Forged(error),
            other => Refusal::Malformed(other),
        }
    }

    /// A packet of the team: its name, and what it says.
    pub(crate) fn packet(&self, bytes: &[u8]) -> Result<(PacketKey, Packet), Refusal> {
        let (layout, message) = self.read(bytes)?;
        let said = message.blocks.iter().filter(|block| block.says_something());
        let wire = self.team.wire_of(message.sender);
        let summaries: Result<Vec<Summary>, _> = said.map(|block| wire.decode(block)).collect();
        let summaries = summaries.map_err(Refusal::Unusable)?;
        let links = message.blocks.iter().flat_map(|block| wire.attempts(block));
        let longest_m = links.map(|attempt| attempt.link.range_m()).fold(0.0, f64::max);
        let bytes = bytes[..layout.length()].to_vec();
        Ok(((message.sender, message.counter), Packet { bytes, summaries, longest_m }))
    }

    /// A report of the team: who sent it, and what it says of which slots. What it says of slots that there are not is left out, and of
    /// those that stand in another order than its sender knew.
    pub(crate) fn report(&self, bytes: &[u8]) -> Result<(u8, Report), Refusal> {
        let (_, message, length, end) = self.read_report_about(bytes)?;
        let (mut outcomes, mut turns) = (Vec::new(), Vec::new());
        let mut said = message.outcomes.iter();
        for slot in self.slots_of(message.sender, message.first, message.tells_own).take_while(|&slot| slot < end) {
            let Some(outcome) = said.next() else { break };
            match (self.is_heard_by(slot, message.sender), outcome) {
                (_, Outcome::Untold) => {}
                (true, outcome) => outcomes.push((slot, *outcome == Outcome::Heard)),
                (false, outcome) => turns.push((slot, *outcome == Outcome::Heard)),
            }
        }
        let mut slot = message.first;
        let knots = message.knots.iter().enumerate().map(|(place, knot)| {
            let slots = u32::from(knot.slots);
            slot = if place == 0 { slot.saturating_sub(slots) } else { slot + slots };
            (slot, Cell { east: knot.east, north: knot.north, depth: knot.depth })
        });
        let knots = knots.collect();
        let report = Report {
            bytes: bytes[..length].to_vec(),
            first: message.first,
            outcomes,
            turns,
            knots,
            earlier: message.earlier,
        };
        Ok((message.sender, report))
    }

    /// The slots from `first` on that outcomes of a member stand for: those in which it could hear somebody and, where it tells
    /// of them, its own.
    pub(crate) fn slots_of(&self, member: u8, first: u32, tells_own: bool) -> impl Iterator<Item = u32> {
        let id = self.team.members.get(&member);
        let slots = first..id.map_or(first, |_| self.team.slots.end());
        slots.filter(move |&slot| self.is_heard_by(slot, member) || tells_own && self.team.slots.sender(slot) == id)
    }

    /// Whether a slot is one of this member's own.
    pub(crate) fn is_turn_of(&self, slot: u32, id: Option<&VehicleId>) -> bool {
        slot < self.team.slots.end() && id.is_some() && self.team.slots.sender(slot) == id
    }

    /// The slots from `newest` back in which a member could hear somebody.
    pub(crate) fn slots_back(&self, member: u8, newest: u32) -> impl Iterator<Item = u32> {
        (0..=newest.min(self.team.slots.end())).rev().filter(move |&slot| self.is_heard_by(slot, member))
    }

    /// The slot of an event between members, and the number of who heard or missed it.
    pub(crate) fn slot_of(&self, event: &Event) -> Option<ToldKey> {
        let slot = self.team.slots.sent_in(event.time_s, &event.transmitter_id)?;
        let receiver = self.team.number(&event.receiver_id)?;
        self.is_heard_by(slot, receiver).then_some((receiver, slot))
    }

    /// Whether a member could hear another one in a slot. Who is no member never says where it was.
    pub(crate) fn is_heard_by(&self, slot: u32, member: u8) -> bool {
        let slots = &self.team.slots;
        self.team.members.get(&member).is_some_and(|id| slots.is_heard_by(slot, id))
            && slots.sender(slot).is_some_and(|sender| self.team.number(sender).is_some())
    }

    /// The bytes of a report: see [`Frames::write`].
    pub(crate) fn write_report(&self, message: &ReportMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        let layout = self.report_layout();
        let slots = self.slots_of(message.sender, message.first, message.tells_own);
        let agreement = self.agreement_about(slots.take(message.outcomes.len()).last().unwrap_or(message.first));
        let unnumbered = ReportMessage { model: 0, ..message.clone() };
        let bytes = unnumbered.encode(layout, self.seal(agreement))?;
        if layout.is_sealed {
            return Ok(bytes);
        }
        ReportMessage { model: check_number(&bytes) ^ agreement.number(), ..unnumbered }.encode(layout, None)
    }

    /// The form of the team's reports.
    pub(crate) fn report_layout(&self) -> &'static ReportLayout {
        ReportLayout::new(self.team.model.inputs.has_depths(), self.team.key.is_some())
    }

    /// The bytes of a message: sealed if the team has a key, else with the number of what it agreed on.
    pub(crate) fn write(&self, layout: &Layout, message: &MapMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        let agreement = self.about_no_slot();
        if layout.is_sealed {
            return message.encode(layout, self.seal(agreement));
        }
        let unnumbered = MapMessage { model: 0, ..message.clone() };
        let model = check_number(&unnumbered.encode(layout, None)?) ^ agreement.number();
        MapMessage { model, ..unnumbered }.encode(layout, None)
    }

    /// The blocks of a packet that was read before.
    pub(crate) fn blocks(&self, bytes: &[u8]) -> Vec<Block> {
        MapMessage::decode(bytes, self.seal(self.about_no_slot()))
            .map(|(_, message)| message.blocks)
            .unwrap_or_default()
    }

    /// What messages follow from that speak of places and not of slots: no change of order.
    fn about_no_slot(&self) -> &Agreement {
        self.agreement_about(0)
    }

    fn seal<'a>(&'a self, agreement: &'a Agreement) -> Option<Seal<'a>> {
        self.team.key.as_ref().map(|key| Seal { key, context: &agreement.digest })
    }
}

impl Agreement {
    /// The number of the agreement in open packets: 14 bits of its digest.
    fn number(&self) -> u16 {
        u16::from_le_bytes([self.digest[0], self.digest[1]]) & NUMBER_MASK
    }
}

/// The bits of an agreement's number, and of a check number.
const NUMBER_MASK: u16 = 0x3fff;

/// 14 bits of the digest of an open packet with zeros in their place. Combined (by exclusive or) with the number of the
/// agreement they show a receiver which agreement a whole packet was formed under.
fn check_number(unnumbered: &[u8]) -> u16 {
    let digest = digest(unnumbered);
    u16::from_le_bytes([digest[0], digest[1]]) & NUMBER_MASK
}
