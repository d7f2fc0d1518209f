//! Entries as bytes, for snapshots and journals. Each entry has exactly one encoding.

use crate::error::AgentError;
use crate::store::entry::{Entry, FrameState};
use crate::team::canonical::{Reader, Writer};
use crate::types::event::{Event, Link, MessageKind, Position, VehicleId};

/// Version of the encoding of one entry. Others are refused.
const ENTRY_VERSION: u8 = 1;

impl Entry {
    /// Returns the entry as bytes, for the journal of a host. They begin with the version of the encoding. They have no
    /// checksum, because the store of the host has one.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = Writer::default();
        out.u8(ENTRY_VERSION);
        write_entry(&mut out, self);
        out.finish()
    }

    /// Returns the entry that [`Entry::to_bytes`] encoded.
    ///
    /// # Errors
    /// [`AgentError::Entry`] for other bytes, and for those of another version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, AgentError> {
        let mut reader = Reader::new(bytes);
        match reader.u8() {
            Some(ENTRY_VERSION) => {}
            Some(version) => {
                let problem = format!("version {version}, but this software reads version {ENTRY_VERSION}");
                return Err(AgentError::Entry { problem });
            }
            None => return Err(AgentError::Entry { problem: "no bytes".into() }),
        }
        let entry = read_entry(&mut reader).filter(|_| reader.is_at_end());
        entry.ok_or_else(|| AgentError::Entry { problem: format!("{} bytes without a valid meaning", bytes.len()) })
    }
}

pub(crate) fn write_entry(out: &mut Writer, entry: &Entry) {
    match entry {
        Entry::Observed { number, event } => {
            out.u8(if event.kind.is_some() { 3 } else { 0 });
            out.u64(*number);
            write_event(out, event);
        }
        Entry::Received { time_s: None, bytes } => {
            out.u8(1);
            out.bytes(bytes);
        }
        Entry::Sent { number, state, slot, bytes } => {
            out.u8(2);
            out.u64(*number);
            out.u8(*state as u8);
            out.u8(slot.is_some().into());
            slot.iter().for_each(|&slot| out.u32(slot));
            out.bytes(bytes);
        }
        Entry::Navigated { time_s, position } => {
            out.u8(4);
            out.f64(*time_s);
            write_position(out, position);
        }
        Entry::Piggyback { sender, newest, outcomes } => {
            out.u8(5);
            out.text(sender.as_str());
            out.u32(*newest);
            out.bytes(&outcomes.iter().map(|&heard| heard.into()).collect::<Vec<u8>>());
        }
        Entry::UnusedSlot { sender, slot } => {
            out.u8(6);
            out.text(sender.as_str());
            out.u32(*slot);
        }
        Entry::Received { time_s: Some(time_s), bytes } => {
            out.u8(7);
            out.f64(*time_s);
            out.bytes(bytes);
        }
        Entry::Outcome { time_s, transmitter_id, success } => {
            out.u8(8);
            out.f64(*time_s);
            out.text(transmitter_id.as_str());
            out.u8((*success).into());
        }
        Entry::PeerPosition { member, time_s, position, is_independent } => {
            out.u8(9);
            out.text(member.as_str());
            out.f64(*time_s);
            write_position(out, position);
            out.u8((*is_independent).into());
        }
    }
}

pub(crate) fn read_entry(reader: &mut Reader<'_>) -> Option<Entry> {
    Some(match reader.u8()? {
        tag @ (0 | 3) => Entry::Observed { number: reader.u64()?, event: read_event(reader, tag == 3)? },
        1 => Entry::Received { time_s: None, bytes: reader.bytes()?.to_vec() },
        2 => Entry::Sent {
            number: reader.u64()?,
            state: read_state(reader)?,
            slot: if reader.bool()? { Some(reader.u32()?) } else { None },
            bytes: reader.bytes()?.to_vec(),
        },
        4 => Entry::Navigated { time_s: reader.f64()?, position: read_position(reader)? },
        5 => Entry::Piggyback {
            sender: VehicleId::new(reader.text()?),
            newest: reader.u32()?,
            outcomes: reader.bytes()?.iter().map(|&heard| (heard <= 1).then_some(heard == 1)).collect::<Option<_>>()?,
        },
        6 => Entry::UnusedSlot { sender: VehicleId::new(reader.text()?), slot: reader.u32()? },
        7 => Entry::Received { time_s: Some(reader.f64()?), bytes: reader.bytes()?.to_vec() },
        8 => Entry::Outcome {
            time_s: reader.f64()?,
            transmitter_id: VehicleId::new(reader.text()?),
            success: reader.bool()?,
        },
        9 => Entry::PeerPosition {
            member: VehicleId::new(reader.text()?),
            time_s: reader.f64()?,
            position: read_position(reader)?,
            is_independent: reader.bool()?,
        },
        _ => return None,
    })
}

fn read_state(reader: &mut Reader<'_>) -> Option<FrameState> {
    let state = reader.u8()?;
    [FrameState::Proposed, FrameState::Dropped, FrameState::Departed].into_iter().find(|&one| one as u8 == state)
}

/// Time, who sent, who should have heard it, whether it did, both ends, and the kind of message if it has one.
fn write_event(out: &mut Writer, event: &Event) {
    out.f64(event.time_s);
    out.text(event.transmitter_id.as_str());
    out.text(event.receiver_id.as_str());
    out.u8(event.success.into());
    event.link.ends().iter().for_each(|end| write_position(out, end));
    event.kind.iter().for_each(|kind| out.text(kind.as_str()));
}

fn write_position(out: &mut Writer, position: &Position) {
    out.f64(position.east_m);
    out.f64(position.north_m);
    out.option(position.depth_m);
    out.option(position.heading_deg);
}

fn read_position(reader: &mut Reader<'_>) -> Option<Position> {
    let (east_m, north_m) = (reader.f64()?, reader.f64()?);
    Some(Position { east_m, north_m, depth_m: reader.option()?, heading_deg: reader.option()? })
}

fn read_event(reader: &mut Reader<'_>, has_kind: bool) -> Option<Event> {
    let time_s = reader.f64()?;
    let mut id = || Some(VehicleId::new(reader.text()?));
    let (transmitter_id, receiver_id) = (id()?, id()?);
    let success = reader.bool()?;
    let link = Link { transmitter: read_position(reader)?, receiver: read_position(reader)? };
    let kind = if has_kind { Some(MessageKind::new(reader.text()?)) } else { None };
    Some(Event { time_s, transmitter_id, receiver_id, link, kind, success })
}
