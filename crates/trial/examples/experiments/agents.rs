//! Agents that several experiments run.

use std::sync::Arc;

use pingmap_agent::{Agent, AgentError, AgentOptions, Sharing, Team, VehicleId};

/// Returns an agent that records the events of all receivers.
pub(crate) fn agent_of_all_receivers(id: &str, team: &Arc<Team>, sharing: Sharing) -> Agent {
    let options = AgentOptions { sharing, record_all_receivers: true, ..AgentOptions::default() };
    Agent::new(VehicleId::new(id), team.clone(), options)
}

/// Delivers the frames of all vehicles but the listener, and rebuilds the posterior. `frames` returns the frames of a
/// vehicle by its number.
pub(crate) fn receive_from_others<'a>(
    agent: &mut Agent,
    listener: usize,
    vehicles: usize,
    frames: impl Fn(usize) -> &'a Vec<Vec<u8>>,
    time_s: f64,
) -> Result<(), AgentError> {
    for frame in (0..vehicles).filter(|&sender| sender != listener).flat_map(frames) {
        agent.receive(frame, Some(time_s));
    }
    agent.rebuild()
}
