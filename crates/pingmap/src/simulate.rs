//! `pingmap simulate`: a field trial of one's own.

use pingmap_agent::VehicleId;
use pingmap_trial::simulate::{Simulated, Simulation};
use serde_json::{Value, json};

use crate::cli;
use crate::output::{BadInput, count, print, print_json, table, write_file};

/// What must be said of such a trial.
const STAND_IN: &str =
    "simulated, a stand-in for a field trial: sound travels in straight lines, without refraction or multipath";

pub fn run(options: &cli::Simulate) -> anyhow::Result<()> {
    let simulation = options.simulation();
    let mut trial = simulation.run(&options.sound()).map_err(|error| BadInput(error.to_string()))?;
    trial.log.has_depths = options.depths;
    write_file(&options.output, trial.log.to_csv().as_bytes())?;
    if options.json {
        return print_json(&summary_json(&simulation, &trial));
    }
    let text = format!("{}: {}", options.output.display(), summary(&simulation, &trial));
    print(&text)
}

fn summary(simulation: &Simulation, trial: &Simulated) -> String {
    let row = |(id, noise_db): &(VehicleId, f64)| {
        let (events, heard) = events_and_heard(trial, id);
        vec![
            id.to_string(),
            format!("{noise_db:.1}"),
            format!("{:.0}", trial.channel.even_odds_range_m(*noise_db)),
            events.to_string(),
            if events > 0 { format!("{:.3}", heard as f64 / events as f64) } else { "–".into() },
        ]
    };
    let header = ["vehicle", "own noise (dB)", "even odds at (m)", "events", "heard"];
    format!(
        "{} of {} in {:.1} hours.\n\n{}\n\nEven odds: over a flat floor. This log is {STAND_IN}.",
        count(trial.log.events.len(), "event"),
        count(simulation.vehicles, "vehicle"),
        simulation.slots as f64 * simulation.slot_s / 3600.0,
        table(&header, &trial.vehicles.iter().map(row).collect::<Vec<_>>()),
    )
}

fn summary_json(simulation: &Simulation, trial: &Simulated) -> Value {
    let vehicle = |(id, noise_db): &(VehicleId, f64)| {
        let (events, heard) = events_and_heard(trial, id);
        json!({
            "vehicle": id.as_str(), "self_noise_db": noise_db,
            "even_odds_range_m": trial.channel.even_odds_range_m(*noise_db), "events": events, "successes": heard,
        })
    };
    let (ridge, mound) = (&trial.channel.floor.ridge, &trial.channel.floor.mound);
    json!({
        "schema": 1, "note": STAND_IN, "seed": simulation.seed, "events": trial.log.events.len(),
        "vehicles": trial.vehicles.iter().map(vehicle).collect::<Vec<_>>(),
        "ridge": {
            "easting_m": ridge.east_m, "northing_m": ridge.north_m, "direction_rad": ridge.direction_rad,
            "height_m": ridge.height_m, "width_m": ridge.width_m,
        },
        "mound": {
            "easting_m": mound.east_m, "northing_m": mound.north_m, "height_m": mound.height_m, "width_m": mound.width_m,
        },
    })
}

/// How many events a vehicle owns, and how many of them it heard.
fn events_and_heard(trial: &Simulated, id: &VehicleId) -> (usize, usize) {
    let own = || trial.log.events.iter().filter(|event| event.receiver_id == *id);
    (own().count(), own().filter(|event| event.success).count())
}
