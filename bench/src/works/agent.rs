//! What a vehicle does under way, with nearly a thousand events: as many as are fitted densely.

use std::sync::Arc;

use dgpc::Shape;
use pingmap_agent::{Agent, Chart, Event, InputSpec, Link, Model, Position, Team, Telling, VehicleId};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const EVENTS: usize = 992;
const SIDE_M: f64 = 4000.0;

/// A member of a team of two with a thousand events, all of them fitted.
fn agent(frame_bytes: usize) -> Agent {
    let corner = SIDE_M / 2.0;
    let reach = [Position::new(-corner, -corner), Position::new(corner, corner)];
    let chart = Chart::about([]);
    let model = Model::isotropic(chart, InputSpec::Positions, Shape::Matern32, true, 800.0, 6.0).expect("a model");
    let team = Team::new(["alice", "bob"].map(VehicleId::new), model, reach).expect("a team").with_frames(frame_bytes);
    let points_only = Telling { reports: false, ..Telling::default() };
    let mut agent = Agent::new(VehicleId::new("alice"), Arc::new(team)).telling(points_only);
    agent.observe_all(events(EVENTS, 1)).expect("sensible events");
    agent.rebuild_posteriors().expect("posteriors");
    agent
}

/// Range decides, and a ridge across the middle.
fn events(count: usize, seed: u64) -> Vec<Event> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let event = |(n, link): (usize, Link)| {
        let across = link.transmitter.east_m * link.receiver.east_m < 0.0;
        let log_odds = 3.0 - link.range_m() / 500.0 - if across { 2.0 } else { 0.0 };
        let success = rng.random::<f64>() < 1.0 / (1.0 + (-log_odds).exp());
        let [transmitter_id, receiver_id] = ["bob", "alice"].map(VehicleId::new);
        Event { time_s: 10.0 * n as f64, transmitter_id, receiver_id, success, link, kind: None }
    };
    links(count, 1000 + seed).into_iter().enumerate().map(event).collect()
}

fn links(count: usize, seed: u64) -> Vec<Link> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut place = || Position::new(SIDE_M * (rng.random::<f64>() - 0.5), SIDE_M * (rng.random::<f64>() - 0.5));
    (0..count).map(|_| Link { transmitter: place(), receiver: place() }).collect()
}

/// What to tell in so many bytes: its length.
pub fn next_frame(bytes: usize) -> Box<dyn FnMut() -> f64> {
    let agent = agent(bytes);
    Box::new(move || {
        let frame = agent.clone().next_packet(1e4, bytes).expect("a frame").expect("something to tell");
        frame.len() as f64
    })
}

/// New events, and one question after each: so many that the copy of the vehicle that every run begins with counts for little.
pub fn observe_and_query(count: usize) -> Box<dyn FnMut() -> f64> {
    let (agent, new, link) = (agent(32), events(EVENTS + count, 1).split_off(EVENTS), links(1, 5)[0]);
    Box::new(move || {
        let mut agent = agent.clone();
        let answers = new.iter().map(|event| {
            agent.observe(event.clone()).expect("a sensible event");
            agent.probability(link).expect("a probability")
        });
        answers.fold(f64::NAN, |_, answer| answer)
    })
}

/// Everything fitted anew from where it was, and one question.
pub fn refit_and_query() -> Box<dyn FnMut() -> f64> {
    let (mut agent, link) = (agent(32), links(1, 5)[0]);
    agent.observe_all(events(EVENTS + 8, 1).split_off(EVENTS)).expect("sensible events");
    Box::new(move || {
        let mut agent = agent.clone();
        agent.refit().expect("a fit");
        agent.probability(link).expect("a probability")
    })
}

/// 10 000 questions: their mean.
pub fn queries() -> Box<dyn FnMut() -> f64> {
    let (mut agent, links) = (agent(32), links(10_000, 5));
    Box::new(move || agent.probabilities(&links).expect("probabilities").iter().sum::<f64>() / links.len() as f64)
}
