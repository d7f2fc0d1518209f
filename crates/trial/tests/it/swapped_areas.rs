//! Offsets of vehicles in missions where they are confounded with positions. Each vehicle stays in its own area in the
//! first half of a mission, and in another area in the second half.

use dgpc::Posterior;
use pingmap_agent::*;
use pingmap_trial::simulate::{Channel, Simulation, Sound};
use pingmap_trial::{EventLog, Score, learn};
use rand::RngExt;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rayon::prelude::*;

/// Number of vehicles and of areas.
const VEHICLES: usize = 3;

/// Number of transmissions in each half.
const SLOTS: usize = 120;

/// Returns the position of a vehicle that surveys an area, a strip of the square from north to south.
fn place(channel: &Channel, area_m: f64, area: usize, slot: usize) -> Position {
    let (t, width_m) = (slot as f64, area_m / VEHICLES as f64);
    let phase = area as f64;
    let east_m = width_m * (area as f64 + 0.5 + 0.4 * (0.13 * t + phase).sin());
    let north_m = area_m * (0.5 + 0.45 * (0.071 * t + 2.0 * phase).cos());
    let depth_m = 10f64.min(channel.floor.depth_at_m(east_m, north_m) - 3.0).max(0.5);
    Position { depth_m: Some(depth_m), ..Position::new(east_m, north_m) }
}

/// Returns both halves of a trial. Between them each vehicle moves to the next area.
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
            has_headings: false,
            unknown_columns: Vec::new(),
            reference: ReferenceSystem::Unknown,
        }
    })
}

/// Returns the NLL of the second half under a model learned from the first half with these optional terms, and whether
/// the model has offsets of receivers.
fn nll([first, second]: &[EventLog; 2], additions: Vec<OptionalTerm>) -> (f64, bool) {
    let learning = Learning { additions, ..Learning::default() };
    let events: Vec<&Event> = first.events.iter().collect();
    let learned = learn(&learning, first.chart(), InputSpec::Positions, &events).unwrap().best;
    let posterior: Posterior = learned.learned.fit.posterior().unwrap();
    let inputs = learned.model.inputs(second.events.iter().map(Event::query)).unwrap();
    let outcomes: Vec<bool> = second.events.iter().map(|event| event.success).collect();
    let score = Score::new(&posterior.probability(&inputs).unwrap(), &outcomes).unwrap();
    (score.nll, learned.structure.additions.has(OptionalTerm::Receivers))
}

/// Returns mean and standard error.
fn mean(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

/// Returns the increase of the NLL of the second half by offsets of vehicles, with its standard error over 20 trials.
/// Also returns the number of trials in which offsets of receivers were accepted.
fn added_by_offsets(spread_db: f64) -> ((f64, f64), usize) {
    let places = vec![OptionalTerm::Range, OptionalTerm::ReceiverPlace];
    let offsets = [places.clone(), vec![OptionalTerm::Receivers, OptionalTerm::Transmitters]].concat();
    let added = |seed: u64| {
        let trial = trial(seed, spread_db);
        let ((with, taken), (without, _)) = (nll(&trial, offsets.clone()), nll(&trial, places.clone()));
        (with - without, taken)
    };
    let added: Vec<(f64, bool)> = (1..=20u64).into_par_iter().map(added).collect();
    let taken = added.iter().filter(|(_, taken)| *taken).count();
    (mean(&added.into_iter().map(|(added, _)| added).collect::<Vec<_>>()), taken)
}

#[test]
fn offsets_do_not_raise_the_nll_if_receivers_are_equal() {
    let ((added, error), taken) = added_by_offsets(0.0);
    println!("equal receivers: offsets, accepted in {taken} of 20 trials, add {added:.4} ± {error:.4} nats");
    assert!(taken <= 2 && added < 0.005, "{taken} {added}");
}

#[test]
fn offsets_lower_the_nll_if_receivers_differ() {
    let ((added, error), taken) = added_by_offsets(10.0);
    println!("different receivers: offsets, accepted in {taken} of 20 trials, add {added:.4} ± {error:.4} nats");
    assert!(taken >= 1 && added < 0.0, "{taken} {added}");
}
