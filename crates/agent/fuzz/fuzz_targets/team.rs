//! The small team of the targets that restore a vehicle.

use std::sync::{Arc, LazyLock};

use pingmap_agent::{Chart, InputSpec, Limits, Model, Position, Team, VehicleId};

pub static TEAM: LazyLock<Arc<Team>> = LazyLock::new(|| {
    let model = Model::isotropic(Chart::about([]), InputSpec::Positions, dgpc::Shape::Matern32, true, 300.0, 4.0);
    let reach = [-500.0, 500.0].map(|east_m| Position::new(east_m, 0.0));
    let names = ["a", "b"].map(VehicleId::new);
    let team = Team::new(names, model.expect("numbers in range"), reach).expect("two members");
    Arc::new(Team { limits: Limits { events_max: 20, ..team.limits }, ..team })
});
