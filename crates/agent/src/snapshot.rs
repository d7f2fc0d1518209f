//! A vehicle's memory as bytes: events and live packets, in canonical order. Equal memories are equal bytes.

use std::sync::Arc;

use pingmap_packet::{from_hex, to_hex};
use serde::{Deserialize, Serialize};

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::event::{Event, Link, Position, VehicleId};
use crate::team::Team;

/// Version of a snapshot. A newer one is refused.
const SNAPSHOT_SCHEMA: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Snapshot {
    schema: u32,
    vehicle: String,
    /// Digest of what the team agreed on, in hexadecimal.
    team: String,
    counter_next: u32,
    events: Vec<EventLayout>,
    /// Live packets in hexadecimal, by sender and counter.
    packets: Vec<String>,
}

/// Time, who sent, who should have heard, both ends, and whether it worked.
#[derive(Serialize, Deserialize)]
struct EventLayout(f64, String, String, PositionLayout, PositionLayout, bool);

/// East, north, depth.
#[derive(Serialize, Deserialize)]
struct PositionLayout(f64, f64, Option<f64>);

impl Agent {
    /// What it must not lose with its memory, as JSON: events, live packets, and the counter of its next packet. (A
    /// model it learned can be learned again, and counts begin afresh.) Does not depend on the order in which events
    /// and packets arrived, nor on how often.
    pub fn snapshot(&self) -> Vec<u8> {
        let position = |place: Position| PositionLayout(place.east_m, place.north_m, place.depth_m);
        let event = |event: &Event| {
            let [transmitter, receiver] = event.link.ends().map(position);
            let name = |id: &VehicleId| id.as_str().to_owned();
            let (sender, hearer) = (name(&event.transmitter_id), name(&event.receiver_id));
            EventLayout(event.time_s, sender, hearer, transmitter, receiver, event.success)
        };
        let snapshot = Snapshot {
            schema: SNAPSHOT_SCHEMA,
            vehicle: self.id().as_str().to_owned(),
            team: to_hex(&self.digest),
            counter_next: self.counter_next,
            events: self.events().iter().map(event).collect(),
            packets: self.live.iter().map(|(_, packet)| to_hex(&packet.bytes)).collect(),
        };
        // Numbers, texts and lists always have a form in JSON.
        serde_json::to_vec(&snapshot).unwrap_or_default()
    }

    /// The vehicle that a snapshot was taken of. Under another agreement (a new key epoch, say) it keeps its events,
    /// and begins to share afresh.
    ///
    /// # Errors
    /// [`AgentError::Snapshot`] for bytes that are no snapshot, one of another vehicle, or one of a newer version.
    pub fn restore(id: VehicleId, team: Arc<Team>, bytes: &[u8]) -> Result<Self, AgentError> {
        let wrong = |problem: String| AgentError::Snapshot { id: id.clone(), problem };
        let snapshot: Snapshot = serde_json::from_slice(bytes).map_err(|error| wrong(error.to_string()))?;
        if snapshot.schema > SNAPSHOT_SCHEMA {
            let found = snapshot.schema;
            return Err(wrong(format!("schema {found}, but this version reads schema {SNAPSHOT_SCHEMA}")));
        }
        if snapshot.vehicle != id.as_str() {
            return Err(wrong(format!("it is of {}", snapshot.vehicle)));
        }
        let mut agent = Agent::new(id.clone(), team);
        agent.observe_all(snapshot.events.into_iter().map(|layout| {
            let EventLayout(time_s, transmitter, receiver, from, to, success) = layout;
            let place =
                |PositionLayout(east_m, north_m, depth_m): PositionLayout| Position { east_m, north_m, depth_m };
            let link = Link { transmitter: place(from), receiver: place(to) };
            let (transmitter_id, receiver_id) = (VehicleId::new(transmitter), VehicleId::new(receiver));
            Event { time_s, transmitter_id, receiver_id, link, success }
        }))?;
        if snapshot.team == to_hex(&agent.digest) {
            for packet in &snapshot.packets {
                let bytes = from_hex(packet).ok_or_else(|| wrong(format!("{packet:?} is not hexadecimal")))?;
                agent.take_in(&bytes).map_err(|refusal| wrong(format!("packet {packet}: {refusal}")))?;
            }
            agent.counter_next = agent.counter_next.max(snapshot.counter_next);
        }
        Ok(agent)
    }
}
