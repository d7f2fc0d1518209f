//! Where every vehicle keeps to an area of its own, its ear and its place say the same; then they swap areas.

#![allow(clippy::unwrap_used)]

use dgpc::Posterior;
use pingmap_agent::*;
use pingmap_trial::simulate::{Channel, Simulation, Sound};
use pingmap_trial::{EventLog, Score, learn_best};
use rand::RngExt;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rayon::prelude::*;

/// Vehicles, and areas.
const VEHICLES: usize = 3;

/// Transmissions in each half.
const SLOTS: usize = 120;

/// Where a vehicle is that surveys an area, a strip of the square from north to south.
fn place(channel: &Channel, area_m: f64, area: usize, slot: usize) -> Position {
    let (t, width_m) = (slot as f64, area_m / VEHICLES as f64);
    let phase = area as f64;
    let east_m = width_m * (area as f64 + 0.5 + 0.4 * (0.13 * t + phase).sin());
    let north_m = area_m * (0.5 + 0.45 * (0.071 * t + 2.0 * phase).cos());
    let depth_m = 10f64.min(channel.floor.depth_at_m(east_m, north_m) - 3.0).max(0.5);
    Position { east_m, north_m, depth_m: Some(depth_m) }
}

/// Both halves of a trial: the vehicles move on by one area in between.
fn trial(seed: u64, spread_db: f64) -> [EventLog; 2] {
    let simulation = Simulation { seed, vehicles: VEHICLES, self_noise_spread_db: spread_db, ..Simulation::default() };
    let simulated = simulation.run(&Sound::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    [0, 1].map(|half| {
        let (mut events, mut probabilities) = (Vec::new(), Vec::new());
        for slot in half * SLOTS..(half + 1) * SLOTS {
            let place =
                |vehicle: usize| place(&simulated.channel, simulation.area_m, (vehicle + half) % VEHICLES, slot);
            let sender = slot % VEHICLES;
            for receiver in (0..VEHICLES).filter(|&receiver| receiver != sender) {
                let link = Link { transmitter: place(sender), receiver: place(receiver) };
                let (receiver_id, noise_db) = simulated.vehicles[receiver].clone();
                let p = simulated.channel.probability(&link, noise_db);
                let transmitter_id = simulated.vehicles[sender].0.clone();
                let (time_s, success) = (10.0 * slot as f64, rng.random::<f64>() < p);
                events.push(Event { time_s, transmitter_id, receiver_id, link, kind: None, success });
                probabilities.push(p);
            }
        }
        EventLog {
            events,
            true_probability: Some(probabilities),
            has_depths: true,
            unknown_columns: Vec::new(),
            reference: ReferenceSystem::Unknown,
        }
    })
}

/// NLL of the second half by what was learned of the first one, with these additions; and whether ears differ in it.
fn nll([first, second]: &[EventLog; 2], additions: Vec<Addition>) -> (f64, bool) {
    let learning = Learning { additions, ..Learning::default() };
    let events: Vec<&Event> = first.events.iter().collect();
    let learned = learn_best(&learning, first.chart(), InputSpec::Positions, &events).unwrap();
    let posterior: Posterior = learned.learned.fit.posterior().unwrap();
    let inputs = learned.model.inputs(second.events.iter().map(Event::attempt)).unwrap();
    let outcomes: Vec<bool> = second.events.iter().map(|event| event.success).collect();
    let score = Score::new(&posterior.probability(&inputs).unwrap(), &outcomes).unwrap();
    (score.nll, learned.structure.additions.has(Addition::Receivers))
}

/// Mean and standard error.
fn mean(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

/// What offsets of vehicles add to the NLL of the second half over 20 trials, with its standard error, and in how many they
/// were taken.
fn added_by_offsets(spread_db: f64) -> ((f64, f64), usize) {
    let places = vec![Addition::Range, Addition::ReceiverPlace];
    let ears = vec![Addition::Range, Addition::ReceiverPlace, Addition::Receivers, Addition::Transmitters];
    let added = |seed: u64| {
        let trial = trial(seed, spread_db);
        let ((with, taken), (without, _)) = (nll(&trial, ears.clone()), nll(&trial, places.clone()));
        (with - without, taken)
    };
    let added: Vec<(f64, bool)> = (1..=20u64).into_par_iter().map(added).collect();
    let taken = added.iter().filter(|(_, taken)| *taken).count();
    (mean(&added.into_iter().map(|(added, _)| added).collect::<Vec<_>>()), taken)
}

#[test]
fn offsets_do_no_harm_where_all_ears_are_equal() {
    let ((added, error), taken) = added_by_offsets(0.0);
    println!("equal ears: offsets, taken in {taken} of 20 trials, add {added:.4} ± {error:.4} nats");
    assert!(taken <= 2 && added < 0.005, "{taken} {added}");
}

#[test]
fn offsets_are_worth_it_where_ears_differ() {
    let ((added, error), taken) = added_by_offsets(10.0);
    println!("ears that differ: offsets, taken in {taken} of 20 trials, add {added:.4} ± {error:.4} nats");
    assert!(taken >= 1 && added < 0.0, "{taken} {added}");
}
