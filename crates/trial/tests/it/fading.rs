//! Fading: correlated outcomes at one place count as fewer independent outcomes.

use std::sync::Arc;

use dgpc::Shape;
use pingmap_agent::*;
use rand::RngExt;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::StandardNormal;

/// Probability that the mooring receives a message, with or without fading.
const PROBABILITY: f64 = 0.7;

/// The quantile of the normal distribution for [`PROBABILITY`].
const QUANTILE: f64 = 0.524_400_512_7;

/// Parameters of simulated fading. An outcome is a success if a normal process is below [`QUANTILE`]. A `share` of the
/// variance of the process is correlated over `memory_s` seconds.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    share: f64,
    memory_s: f64,
}

/// The fading that [`Fading::default`] approximates.
const ORDINARY: Drawn = Drawn { share: 0.5, memory_s: 10.0 };

/// Returns outcomes at a mooring that swings by some metres, one each second.
fn mooring(rng: &mut ChaCha8Rng, count: usize, Drawn { share, memory_s }: Drawn) -> Vec<Event> {
    let kept = (-1.0 / memory_s).exp();
    let mut normal = || -> f64 { rng.sample(StandardNormal) };
    let mut slow = normal();
    let event = |n: usize| {
        slow = kept * slow + (1.0 - kept * kept).sqrt() * normal();
        let time_s = n as f64;
        let receiver = Position::new(300.0 + 3.0 * (time_s / 40.0).sin(), 2.0 * (time_s / 55.0).cos());
        Event {
            time_s,
            transmitter_id: VehicleId::new("boat"),
            receiver_id: VehicleId::new("mooring"),
            link: Link { transmitter: Position::new(0.0, 0.0), receiver },
            kind: None,
            success: share.sqrt() * slow + (1.0 - share).sqrt() * normal() < QUANTILE,
        }
    };
    (0..count).map(event).collect()
}

fn model(fading: Fading) -> Model {
    let chart = Chart { scale_m: 500.0, ..Chart::about([]) };
    let model = Model::isotropic(chart, InputSpec::Positions, Shape::Matern52, true, 300.0, 4.0).unwrap();
    Model { fading, ..model }
}

fn counted(fading: Fading, events: &[Event]) -> f64 {
    fading.weights(&events.iter().collect::<Vec<_>>()).iter().sum()
}

/// Returns the effective number of independent outcomes among 300, from the variance of the share of successes over the
/// draws.
fn effective_count(drawn: Drawn, draws: usize) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut off = || {
        let heard = mooring(&mut rng, 300, drawn).iter().filter(|event| event.success).count();
        (heard as f64 / 300.0 - PROBABILITY).powi(2)
    };
    let variance = (0..draws).map(|_| off()).sum::<f64>() / draws as f64;
    PROBABILITY * (1.0 - PROBABILITY) / variance
}

/// Returns the root mean square error of the predicted log-odds at the mooring, in predicted standard deviations.
fn error(fading: Fading, drawn: Drawn, draws: usize) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let names = ["boat", "mooring"].map(VehicleId::new);
    let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
    let team = Arc::new(Team::new(names.clone(), model(fading), reach).unwrap());
    let at = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(300.0, 0.0) };
    let truth = (PROBABILITY / (1.0 - PROBABILITY)).ln();
    let mut square = || {
        let mut agent = Agent::new(names[1].clone(), team.clone(), AgentOptions::default());
        agent.record(mooring(&mut rng, 300, drawn)).unwrap();
        agent.refit().unwrap();
        let predicted = agent.predict([at], Which::Fused).unwrap()[0];
        (predicted.mean - truth).powi(2) / predicted.variance
    };
    ((0..draws).map(|_| square()).sum::<f64>() / draws as f64).sqrt()
}

#[test]
fn weights_sum_to_the_effective_number_of_independent_outcomes() {
    let events = mooring(&mut ChaCha8Rng::seed_from_u64(1), 300, ORDINARY);
    let (effective, counted) = (effective_count(ORDINARY, 2000), counted(Fading::default(), &events));
    let [error, unweighted] = [Fading::default(), Fading::NONE].map(|fading| error(fading, ORDINARY, 100));
    println!(
        "300 outcomes: effective {effective:.0}, weights {counted:.0}; error {error:.2} sd, unweighted {unweighted:.2} sd"
    );
    assert!((30.0..=100.0).contains(&effective) && (30.0..=100.0).contains(&counted), "{effective} {counted}");
    assert!((0.7..1.3).contains(&error) && unweighted > 2.0, "{error} {unweighted}");
}

#[test]
fn fading_is_learned_from_events_at_a_fixed_position() {
    // The sum of the weights of 300 outcomes under the fading learned from 600, mean over five draws.
    let learned = |drawn| {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut once = || {
            let events = mooring(&mut rng, 600, drawn);
            let learning = Learning { additions: Vec::new(), ..Learning::default() };
            let learned = learning.best(model(Fading::NONE).chart, InputSpec::Positions, &events, &[]).unwrap();
            counted(learned.model.fading, &events[..300])
        };
        (0..5).map(|_| once()).sum::<f64>() / 5.0
    };
    let slow = Drawn { share: 0.7, memory_s: 25.0 };
    for (drawn, bounds) in
        [(Drawn { share: 0.0, ..ORDINARY }, 120.0..300.0), (ORDINARY, 30.0..100.0), (slow, 10.0..35.0)]
    {
        let (learned, effective) = (learned(drawn), effective_count(drawn, 1000));
        println!("{drawn:?}: 300 outcomes: effective {effective:.0}, weights {learned:.0}");
        assert!(bounds.contains(&learned), "{drawn:?}: {learned}, effective {effective}");
    }
}

#[test]
fn given_fading_is_not_changed_by_learning() {
    let events = mooring(&mut ChaCha8Rng::seed_from_u64(3), 200, ORDINARY);
    let given = Fading { correlation: 0.2, memory_s: 5.0, drift_m_per_s: 0.1 };
    let learning = Learning { additions: Vec::new(), fading: Some(given), ..Learning::default() };
    let learned = learning.best(model(Fading::NONE).chart, InputSpec::Positions, &events, &[]).unwrap();
    assert_eq!(learned.model.fading, given);
}
