//! Restores a vehicle from any bytes with a valid check. They are refused, or the snapshot of the vehicle restores the
//! same vehicle.

#![no_main]

mod team;

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::{Agent, AgentOptions, VehicleId};

use crate::team::TEAM;

/// The beginning of a snapshot. In that of an empty vehicle three counts follow (senders, muted members and entries),
/// and the check.
static HEAD: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut head = Agent::new(VehicleId::new("a"), TEAM.clone(), AgentOptions::default()).snapshot();
    head.truncate(head.len() - (2 + 2 + 8 + 32));
    head
});

fuzz_target!(|bytes: &[u8]| {
    // A fuzzer cannot guess the check or the digest of the team.
    let mut content = HEAD.clone();
    content.extend(bytes);
    content.extend(blake3::hash(&content).as_bytes());
    let restore = |bytes: &[u8]| Agent::restore(VehicleId::new("a"), TEAM.clone(), AgentOptions::default(), bytes);
    let Ok(agent) = restore(&content) else { return };
    let snapshot = agent.snapshot();
    let again = restore(&snapshot).expect("its own snapshot");
    assert_eq!(again.snapshot(), snapshot);
    assert!(agent.events().len() <= 20);
});
