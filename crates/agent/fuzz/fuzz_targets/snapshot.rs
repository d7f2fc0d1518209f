//! Restores a vehicle from any bytes with a valid check. They are refused, or the snapshot of the vehicle restores the
//! same vehicle.

#![no_main]

use std::sync::{Arc, LazyLock};

use libfuzzer_sys::fuzz_target;
use pingmap_agent::{Agent, AgentOptions, Chart, InputSpec, Limits, Model, Position, Team, VehicleId};

static TEAM: LazyLock<Arc<Team>> = LazyLock::new(|| {
    let model = Model::isotropic(Chart::about([]), InputSpec::Positions, dgpc::Shape::Matern32, true, 300.0, 4.0);
    let reach = [-500.0, 500.0].map(|east_m| Position::new(east_m, 0.0));
    let names = ["a", "b"].map(VehicleId::new);
    let team = Team::new(names, model.expect("numbers in range"), reach).expect("two members");
    Arc::new(Team { limits: Limits { events_max: 20, ..team.limits }, ..team })
});

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
