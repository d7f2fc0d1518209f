//! Any bytes as a snapshot, with a check that fits them: refused, or a vehicle whose own snapshot says the same again.

#![no_main]

use std::sync::{Arc, LazyLock};

use libfuzzer_sys::fuzz_target;
use pingmap_agent::{Agent, Chart, InputSpec, Limits, Model, Position, Team, VehicleId};

static TEAM: LazyLock<Arc<Team>> = LazyLock::new(|| {
    let model = Model::isotropic(Chart::about([]), InputSpec::Positions, dgpc::Shape::Matern32, true, 300.0, 4.0);
    let reach = [-500.0, 500.0].map(|east_m| Position::new(east_m, 0.0));
    let names = ["a", "b"].map(VehicleId::new);
    let team = Team::new(names, model.expect("numbers in range"), reach).expect("two members");
    Arc::new(Team { limits: Limits { events_max: 20, ..team.limits }, ..team })
});

/// What the snapshot of a vehicle begins with. Of one that knows nothing two counts follow, and the check.
static HEAD: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut nothing = Agent::new(VehicleId::new("a"), TEAM.clone()).snapshot();
    nothing.truncate(nothing.len() - (2 + 8 + 32));
    nothing
});

fuzz_target!(|bytes: &[u8]| {
    // The check is not for a fuzzer to guess, nor is the digest of the team.
    let mut content = HEAD.clone();
    content.extend(bytes);
    content.extend(blake3::hash(&content).as_bytes());
    let restore = |bytes: &[u8]| Agent::restore(VehicleId::new("a"), TEAM.clone(), bytes);
    let Ok(agent) = restore(&content) else { return };
    let said = agent.snapshot();
    let again = restore(&said).expect("its own snapshot");
    assert_eq!(again.snapshot(), said);
    assert!(agent.events().len() <= 20);
});
