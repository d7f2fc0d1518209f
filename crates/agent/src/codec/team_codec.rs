//! Encodes, decodes and authenticates the packets of a team.

use std::sync::Arc;

use dgpc::Summary;
use pingmap_packet::{
    Authenticator, Block, Cell, Layout, MapMessage, Outcome, Report as ReportMessage, ReportLayout, digest,
};

use crate::codec::decoded::{EventKey, Packet, PacketKey, Report};
use crate::codec::receipt::Refusal;
use crate::team::config::Team;
use crate::types::event::{Event, VehicleId};

/// Encodes and decodes the packets of one team.
#[derive(Debug, Clone)]
pub struct TeamCodec {
    pub(crate) team: Arc<Team>,
    digest: [u8; 32],
}

impl TeamCodec {
    pub(crate) fn new(team: Arc<Team>) -> Self {
        Self { digest: team.digest(), team }
    }

    pub(crate) fn digest(&self) -> &[u8; 32] {
        &self.digest
    }

    /// Decodes a summary packet of the team. Returns its form and the numbers in it.
    ///
    /// # Errors
    /// [`Refusal`] for a packet that is malformed, forged, or of another team, and for an unknown sender.
    pub fn read(&self, bytes: &[u8]) -> Result<(&'static Layout, MapMessage), Refusal> {
        if let Some(layout) = Layout::of(bytes)
            && !self.is_ours(layout)
        {
            return Err(Refusal::OtherForm(layout.name));
        }
        let (layout, message) = MapMessage::decode(bytes, self.authenticator()).map_err(|error| self.refusal(error))?;
        if !layout.is_authenticated {
            self.check_configuration(message.model, &layout.with_model_zeroed(bytes))?;
        }
        self.check_sender(message.sender)?;
        Ok((layout, message))
    }

    /// Decodes a report of the team. Returns its form, its content and its length in bytes.
    ///
    /// # Errors
    /// As [`TeamCodec::read`].
    pub fn read_report(&self, bytes: &[u8]) -> Result<(&'static ReportLayout, ReportMessage, usize), Refusal> {
        if let Some(layout) = ReportLayout::of(bytes)
            && (layout.has_depth != self.team.model.inputs.has_depths()
                || layout.is_authenticated != self.team.key.is_some())
        {
            return Err(Refusal::OtherForm(layout.name));
        }
        let decoded = ReportMessage::decode(bytes, self.authenticator());
        let (layout, message, length) = decoded.map_err(|error| self.refusal(error))?;
        if !layout.is_authenticated {
            self.check_configuration(message.model, &layout.with_model_zeroed(&bytes[..length]))?;
        }
        self.check_sender(message.sender)?;
        Ok((layout, message, length))
    }

    /// Checks that a plain packet is intact and was formed under the team's configuration.
    fn check_configuration(&self, model: u16, unnumbered: &[u8]) -> Result<(), Refusal> {
        let (found, expected) = (model ^ check_number(unnumbered), self.configuration_number());
        if found == expected { Ok(()) } else { Err(Refusal::OtherTeam { found: Some(found), expected }) }
    }

    fn check_sender(&self, number: u8) -> Result<(), Refusal> {
        match self.team.members.contains_key(&number) {
            true => Ok(()),
            false => Err(Refusal::UnknownSender(number)),
        }
    }

    /// Returns whether members of the team send packets of this form.
    fn is_ours(&self, layout: &Layout) -> bool {
        layout.has_depth == self.team.model.inputs.has_depths()
            && layout.is_authenticated == self.team.key.is_some()
            && layout.frame_bytes <= self.team.frame_bytes
    }

    /// Converts a decoding error into the reason for a refusal.
    fn refusal(&self, error: pingmap_packet::Error) -> Refusal {
        match error {
            pingmap_packet::Error::OtherContext => {
                Refusal::OtherTeam { found: None, expected: self.configuration_number() }
            }
            pingmap_packet::Error::Forged | pingmap_packet::Error::Authentication(_) => Refusal::Forged(error),
            other => Refusal::Malformed(other),
        }
    }

    /// Decodes a summary packet of the team. Returns its key and its summaries.
    pub(crate) fn decode_packet(&self, bytes: &[u8]) -> Result<(PacketKey, Packet), Refusal> {
        let (layout, message) = self.read(bytes)?;
        let blocks = message.blocks.iter().filter(|block| block.has_content());
        let quantizer = self.team.quantizer_of(message.sender);
        let summaries: Result<Vec<Summary>, _> = blocks.map(|block| quantizer.decode(block)).collect();
        let summaries = summaries.map_err(Refusal::Unusable)?;
        let links = message.blocks.iter().flat_map(|block| quantizer.queries(block));
        let longest_m = links.map(|query| query.link.range_m()).fold(0.0, f64::max);
        let bytes = bytes[..layout.length()].to_vec();
        Ok(((message.sender, message.counter), Packet { bytes, summaries, longest_m }))
    }

    /// Decodes a report of the team. Returns its sender, and its outcomes, unused slots and waypoints by slot. Outcomes
    /// after the last numbered slot are ignored.
    pub(crate) fn decode_report(&self, bytes: &[u8]) -> Result<(u8, Report), Refusal> {
        let (_, message, length) = self.read_report(bytes)?;
        let max = self.team.frame_bytes;
        if length > max {
            return Err(Refusal::TooLong { length, max });
        }
        let (mut outcomes, mut unused) = (Vec::new(), Vec::new());
        let slots = self.slots_of(message.sender, message.first, message.includes_own_slots);
        for (slot, outcome) in slots.zip(&message.outcomes) {
            match (self.is_heard_by(slot, message.sender), outcome) {
                (_, Outcome::Unreported) => {}
                (true, outcome) => outcomes.push((slot, *outcome == Outcome::Heard)),
                (false, outcome) => unused.extend((*outcome == Outcome::Missed).then_some(slot)),
            }
        }
        let mut slot = message.first;
        let waypoints = message.waypoints.iter().enumerate().map(|(index, waypoint)| {
            let slots = u32::from(waypoint.slots);
            slot = if index == 0 { slot.saturating_sub(slots) } else { slot + slots };
            (slot, Cell { east: waypoint.east, north: waypoint.north, depth: waypoint.depth })
        });
        let waypoints = waypoints.collect();
        let bytes = bytes[..length].to_vec();
        Ok((message.sender, Report { bytes, first: message.first, outcomes, unused, waypoints }))
    }

    /// Returns the slots, from `first` on, that the outcomes in a report of this member stand for. These are the slots
    /// in which it could receive another member. Its own slots are among them if `includes_own_slots` is set.
    pub(crate) fn slots_of(&self, member: u8, first: u32, includes_own_slots: bool) -> impl Iterator<Item = u32> {
        let id = self.team.members.get(&member);
        let slots = first..id.map_or(first, |_| self.team.slots.end());
        slots.filter(move |&slot| {
            self.is_heard_by(slot, member) || includes_own_slots && self.team.slots.sender(slot) == id
        })
    }

    /// Returns whether a slot belongs to this member.
    pub(crate) fn is_slot_of(&self, slot: u32, id: Option<&VehicleId>) -> bool {
        slot < self.team.slots.end() && id.is_some() && self.team.slots.sender(slot) == id
    }

    /// Returns the slots of the schedule, from `newest` backwards, in which another member transmits and this member
    /// can listen.
    pub(crate) fn slots_back(&self, member: u8, newest: u32) -> impl Iterator<Item = u32> {
        (0..=newest.min(self.team.slots.end())).rev().filter(move |&slot| self.is_heard_by(slot, member))
    }

    /// Returns the key of an event: the number of its receiver, and its slot. `None` for an event outside the schedule
    /// or with a vehicle that is not a member.
    pub(crate) fn slot_of(&self, event: &Event) -> Option<EventKey> {
        let slot = self.team.slots.sent_in(event.time_s, &event.transmitter_id)?;
        let receiver = self.team.number(&event.receiver_id)?;
        self.is_heard_by(slot, receiver).then_some((receiver, slot))
    }

    /// Returns whether a member could receive another member in a slot. A transmitter that is not a member reports no
    /// track.
    pub(crate) fn is_heard_by(&self, slot: u32, member: u8) -> bool {
        let slots = &self.team.slots;
        self.team.members.get(&member).is_some_and(|id| slots.is_heard_by(slot, id))
            && slots.sender(slot).is_some_and(|sender| self.team.is_member(sender))
    }

    /// Encodes a report: see [`TeamCodec::write`].
    ///
    /// # Errors
    /// [`pingmap_packet::Error`] for a value that the form cannot represent.
    pub fn write_report(&self, message: &ReportMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        let layout = self.report_layout();
        let unnumbered = ReportMessage { model: 0, ..message.clone() };
        let bytes = unnumbered.encode(layout, self.authenticator())?;
        if layout.is_authenticated {
            return Ok(bytes);
        }
        ReportMessage { model: check_number(&bytes) ^ self.configuration_number(), ..unnumbered }.encode(layout, None)
    }

    pub(crate) fn report_layout(&self) -> &'static ReportLayout {
        ReportLayout::new(self.team.model.inputs.has_depths(), self.team.key.is_some())
    }

    /// Encodes a summary packet. It is authenticated if the team has a key. A plain packet contains the number of the
    /// team configuration.
    ///
    /// # Errors
    /// [`pingmap_packet::Error`] for a value that the form cannot represent.
    pub fn write(&self, layout: &Layout, message: &MapMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        if layout.is_authenticated {
            return message.encode(layout, self.authenticator());
        }
        let unnumbered = MapMessage { model: 0, ..message.clone() };
        let model = check_number(&unnumbered.encode(layout, None)?) ^ self.configuration_number();
        MapMessage { model, ..unnumbered }.encode(layout, None)
    }

    /// Returns the blocks of a packet that was decoded before.
    pub(crate) fn blocks(&self, bytes: &[u8]) -> Vec<Block> {
        MapMessage::decode(bytes, self.authenticator()).map(|(_, message)| message.blocks).unwrap_or_default()
    }

    fn authenticator(&self) -> Option<Authenticator<'_>> {
        self.team.key.as_ref().map(|key| Authenticator { key, context: &self.digest })
    }

    /// Returns the number of the team configuration in plain packets: 14 bits of its digest.
    fn configuration_number(&self) -> u16 {
        u16::from_le_bytes([self.digest[0], self.digest[1]]) & NUMBER_MASK
    }
}

/// Bits of a configuration number and of a check number.
const NUMBER_MASK: u16 = 0x3fff;

/// Returns the check number of a plain packet: 14 bits of the digest of the packet with its field `model` set to zero.
/// The field contains the exclusive or of the check number and the configuration number. A receiver thus recovers the
/// configuration number of an intact packet.
fn check_number(unnumbered: &[u8]) -> u16 {
    let digest = digest(unnumbered);
    u16::from_le_bytes([digest[0], digest[1]]) & NUMBER_MASK
}
