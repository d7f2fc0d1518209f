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
        if let Some(layout) = Layout::of(bytes)
            && !self.is_ours(layout)
        {
            return Err(Refusal::OtherForm { name: layout.name });
        }
        let (layout, message) = MapMessage::decode(bytes, self.seal()).map_err(|error| self.refusal(error))?;
        let found = message.model ^ if layout.is_sealed { 0 } else { check_number(&layout.with_model_zeroed(bytes)) };
        let expected = if layout.is_sealed { 0 } else { self.number() };
        if found != expected {
            return Err(Refusal::OtherTeam { found: Some(found), expected });
        }
        if !self.team.members.contains_key(&message.sender) {
            return Err(Refusal::UnknownSender { number: message.sender });
        }
        Ok((layout, message))
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
            pingmap_packet::Error::OtherContext => Refusal::OtherTeam { found: None, expected: self.number() },
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

    /// The bytes of a message: sealed if the team has a key, else with the number of what it agreed on.
    pub(crate) fn write(&self, layout: &Layout, message: &MapMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        if layout.is_sealed {
            return message.encode(layout, self.seal());
        }
        let unnumbered = MapMessage { model: 0, ..message.clone() };
        let model = check_number(&unnumbered.encode(layout, None)?) ^ self.number();
        MapMessage { model, ..unnumbered }.encode(layout, self.seal())
    }

    /// The blocks of a packet that was read before.
    pub(crate) fn blocks(&self, bytes: &[u8]) -> Vec<Block> {
        MapMessage::decode(bytes, self.seal()).map(|(_, message)| message.blocks).unwrap_or_default()
    }

    fn seal(&self) -> Option<Seal<'_>> {
        self.team.key.as_ref().map(|key| Seal { key, context: &self.digest })
    }

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
