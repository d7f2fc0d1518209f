//! A vehicle's memory as bytes: equal memories are equal bytes (docs/reference/protocol.md, "Snapshots").

use std::sync::Arc;

use pingmap_packet::Key;

use crate::agent::options::AgentOptions;
use crate::agent::state::Agent;
use crate::error::AgentError;
use crate::store::entry::Entry;
use crate::store::entry_bytes::{read_entry, write_entry};
use crate::team::canonical::{Reader, Writer, checksum};
use crate::team::config::Team;
use crate::types::event::{Event, Position, VehicleId};

const MAGIC: &[u8; 8] = b"pingmapS";

/// Version of a snapshot. Others are refused.
const SNAPSHOT_VERSION: u16 = 7;

const CHECK_BYTES: usize = 32;

impl Agent {
    /// Returns everything that the vehicle must not lose. The snapshot contains events, outcomes, positions, received
    /// and sent frames, piggybacked outcomes and unused slots. It also contains muted members, the latest counter of
    /// each sender, and the clock. A learned model and the counts are not part of it. The snapshot ends with a
    /// checksum, which is keyed where the team has a key. Vehicles with the same entries, clock, latest counters and
    /// muted members have equal snapshots, whatever the order of the entries.
    pub fn snapshot(&self) -> Vec<u8> {
        let mut out = Writer::default();
        MAGIC.iter().for_each(|&byte| out.u8(byte));
        out.u16(SNAPSHOT_VERSION);
        out.text(self.id().as_str());
        out.bytes(self.memory.codec.digest());
        let packets = &self.memory.packets;
        let latest: Vec<(u8, u16)> =
            packets.senders().filter_map(|sender| Some((sender, packets.latest(sender)?))).collect();
        out.u16(latest.len() as u16);
        for (sender, latest) in latest {
            out.u8(sender);
            out.u16(latest);
        }
        out.f64(self.memory.clock.latest_s());
        let muted: Vec<&VehicleId> =
            self.memory.muted.iter().filter_map(|number| self.team().members.get(number)).collect();
        out.u16(muted.len() as u16);
        muted.iter().for_each(|member| out.text(member.as_str()));
        let entries: Vec<Entry> = self.memory.entries().collect();
        out.u64(entries.len() as u64);
        entries.iter().for_each(|entry| write_entry(&mut out, entry));
        let mut bytes = out.finish();
        bytes.extend(checksum(self.team().key.as_ref(), &bytes));
        bytes
    }

    /// Restores the vehicle of a snapshot. Under another team configuration, a new epoch for example, it keeps its
    /// events, outcomes and positions, and begins to share again from nothing. Packets that cannot be decoded are left
    /// out and counted in [`Status`](crate::Status). Fits nothing: see [`Agent::refit_due`].
    ///
    /// # Errors
    /// [`AgentError::Snapshot`] for bytes that are no snapshot, damaged, of another vehicle, of another version, or
    /// checked with another key than the team's.
    pub fn restore(id: VehicleId, team: Arc<Team>, options: AgentOptions, bytes: &[u8]) -> Result<Self, AgentError> {
        let wrong = |problem: String| AgentError::Snapshot { id: id.clone(), problem };
        let content = checked(bytes, team.key.as_ref()).map_err(wrong)?;
        let Contents { vehicle, digest, latest, clock_s, muted, events, fixes, outcomes, frames } =
            contents(content).ok_or_else(|| wrong("what it says makes no sense".into()))?;
        if vehicle != id.as_str() {
            return Err(wrong(format!("it is of {vehicle}")));
        }
        let mut agent = Agent::new(id.clone(), team, options);
        agent.advance_clock(Some(clock_s));
        agent.record_numbered(events)?;
        agent.record_positions(fixes)?;
        for entry in outcomes {
            agent.apply(entry)?;
        }
        muted.iter().for_each(|member| agent.set_muted(member, true));
        if digest == agent.memory.codec.digest() {
            for (sender, latest) in latest {
                agent.memory.packets.advance_to(sender, latest);
            }
            for entry in frames {
                agent.apply(entry)?;
            }
        }
        Ok(agent)
    }
}

struct Contents<'a> {
    vehicle: &'a str,
    digest: &'a [u8],
    latest: Vec<(u8, u16)>,
    clock_s: f64,
    muted: Vec<VehicleId>,
    events: Vec<(u64, Event)>,
    fixes: Vec<(f64, Position)>,
    /// Own outcomes without positions, and positions of other members.
    outcomes: Vec<Entry>,
    frames: Vec<Entry>,
}

/// The bytes between the version and the check, if the check is that of all before it.
fn checked<'a>(bytes: &'a [u8], key: Option<&Key>) -> Result<&'a [u8], String> {
    let Some((content, check)) = bytes.len().checked_sub(CHECK_BYTES).map(|end| bytes.split_at(end)) else {
        return Err(format!("{} bytes are too few", bytes.len()));
    };
    let mut reader = Reader::new(content);
    let (magic, version) = (reader.take(MAGIC.len()), reader.u16());
    let (Some(magic), Some(version)) = (magic, version) else {
        return Err(format!("{} bytes are too few", bytes.len()));
    };
    if magic != MAGIC {
        return Err("it does not begin as snapshots do".into());
    }
    if version != SNAPSHOT_VERSION {
        return Err(format!("version {version}, but this software reads version {SNAPSHOT_VERSION}"));
    }
    if check != checksum(key, content) {
        return Err("its check does not fit: damaged, or taken under another key".into());
    }
    Ok(&content[MAGIC.len() + 2..])
}

fn contents(bytes: &[u8]) -> Option<Contents<'_>> {
    let mut reader = Reader::new(bytes);
    let (vehicle, digest) = (reader.text()?, reader.bytes()?);
    let senders = reader.u16()?;
    let latest = (0..senders).map(|_| Some((reader.u8()?, reader.u16()?))).collect::<Option<_>>()?;
    let clock_s = reader.f64()?;
    let muted = (0..reader.u16()?).map(|_| Some(VehicleId::new(reader.text()?))).collect::<Option<_>>()?;
    // No list is made longer than the bytes that are there.
    let (mut events, mut fixes, mut outcomes, mut frames) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for _ in 0..reader.u64()? {
        match read_entry(&mut reader)? {
            Entry::Observed { number, event } => events.push((number, event)),
            Entry::Navigated { time_s, position } => fixes.push((time_s, position)),
            entry @ (Entry::Outcome { .. } | Entry::PeerPosition { .. }) => outcomes.push(entry),
            frame => frames.push(frame),
        }
    }
    reader.is_at_end().then_some(Contents { vehicle, digest, latest, clock_s, muted, events, fixes, outcomes, frames })
}
