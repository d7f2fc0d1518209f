//! The bytes of a team's packets: who may read them, and what makes them the team's own.

use std::sync::Arc;

use dgpc::Summary;
use pingmap_packet::{Block, Layout, MapMessage, Seal, digest};

use crate::packets::{Packet, PacketKey};
use crate::receipt::Refusal;
use crate::team::Team;

/// What reads and writes a team's packets.
#[derive(Debug, Clone)]
pub(crate) struct Frames {
    pub(crate) team: Arc<Team>,
    pub(crate) digest: [u8; 32],
}

impl Frames {
    pub(crate) fn new(team: Arc<Team>) -> Self {
        Self { digest: team.digest(), team }
    }

    /// A packet of the team: its form, and the numbers in it.
    pub(crate) fn read(&self, bytes: &[u8]) -> Result<(&'static Layout, MapMessage), Refusal> {
        let (layout, message) = MapMessage::decode(bytes, self.seal()).map_err(Refusal::of)?;
        if layout.frame_bytes > self.team.frame_bytes {
            let (length, max) = (layout.frame_bytes, self.team.frame_bytes);
            return Err(Refusal::Malformed(pingmap_packet::Error::TooLong { length, max }));
        }
        let expected = if layout.is_sealed { 0 } else { self.check_number(&layout.with_model_zeroed(bytes)) };
        if layout.has_depth != self.team.model.inputs.has_depths() || message.model != expected {
            return Err(Refusal::OtherModel { found: message.model, expected });
        }
        if !self.team.members.contains_key(&message.sender) {
            return Err(Refusal::UnknownSender { number: message.sender });
        }
        Ok((layout, message))
    }

    /// A packet of the team: its name, and what it says.
    pub(crate) fn packet(&self, bytes: &[u8]) -> Result<(PacketKey, Packet), Refusal> {
        let (layout, message) = self.read(bytes)?;
        let said = message.blocks.iter().filter(|block| block.says_something());
        let summaries: Result<Vec<Summary>, _> = said.map(|block| self.team.wire().decode(block)).collect();
        let summaries = summaries.map_err(Refusal::Unusable)?;
        Ok(((message.sender, message.counter), Packet { bytes: bytes[..layout.length()].to_vec(), summaries }))
    }

    /// The bytes of a message: sealed if the team has a key, else with the check number of what it agreed on.
    pub(crate) fn write(&self, layout: &Layout, message: &MapMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        if layout.is_sealed {
            return message.encode(layout, self.seal());
        }
        let unnumbered = MapMessage { model: 0, ..message.clone() };
        let model = self.check_number(&unnumbered.encode(layout, None)?);
        MapMessage { model, ..unnumbered }.encode(layout, self.seal())
    }

    /// The blocks of a packet that was read before.
    pub(crate) fn blocks(&self, bytes: &[u8]) -> Vec<Block> {
        MapMessage::decode(bytes, self.seal()).map(|(_, message)| message.blocks).unwrap_or_default()
    }

    fn seal(&self) -> Option<Seal<'_>> {
        self.team.key.as_ref().map(|key| Seal { key, context: &self.digest })
    }

    /// The number by which an open packet shows that it is whole, and of this team: 14 bits of the digest of what the
    /// team agreed on and of the packet itself, with zeros where the number will stand.
    fn check_number(&self, unnumbered: &[u8]) -> u16 {
        let digest = digest(&[self.digest.as_slice(), unnumbered].concat());
        u16::from_le_bytes([digest[0], digest[1]]) & 0x3fff
    }
}
