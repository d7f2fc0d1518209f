//! Operations of a vehicle with 992 events, nearly the largest number that is fitted densely.

use std::sync::Arc;

use dgpc::Shape;
use pingmap_agent::{
    Agent, AgentOptions, Chart, Event, InputSpec, Link, Model, Position, Receipt, Sharing, Team, VehicleId, Which,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const EVENTS: usize = 992;
const SIDE_M: f64 = 4000.0;

/// Members of the team: the vehicle of the benchmarks, and its peer.
const MEMBERS: [&str; 2] = ["alice", "bob"];

fn agent(frame_bytes: usize) -> Agent {
    member(MEMBERS, frame_bytes)
}

/// Returns the first of two members of a team, with fitted events. It sends summaries alone.
fn member([own, peer]: [&str; 2], frame_bytes: usize) -> Agent {
    let corner = SIDE_M / 2.0;
    let corners = [Position::new(-corner, -corner), Position::new(corner, corner)];
    let chart = Chart::about([]);
    let model = Model::isotropic(chart, InputSpec::Positions, Shape::Matern32, true, 800.0, 6.0).expect("a model");
    let team = Team::new(MEMBERS.map(VehicleId::new), model, corners).expect("a team").with_frames(frame_bytes);
    let options = AgentOptions { sharing: Sharing::summaries(), ..AgentOptions::default() };
    let mut agent = Agent::new(VehicleId::new(own), Arc::new(team), options);
    agent.record(events(EVENTS, 1, [own, peer])).expect("valid events");
    agent.rebuild().expect("posteriors");
    agent
}

/// Returns receptions whose probability falls with range and across a ridge in the middle.
fn events(count: usize, seed: u64, [receiver, transmitter]: [&str; 2]) -> Vec<Event> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let event = |(n, link): (usize, Link)| {
        let across = link.transmitter.east_m * link.receiver.east_m < 0.0;
        let log_odds = 3.0 - link.range_m() / 500.0 - if across { 2.0 } else { 0.0 };
        let success = rng.random::<f64>() < 1.0 / (1.0 + (-log_odds).exp());
        let [transmitter_id, receiver_id] = [transmitter, receiver].map(VehicleId::new);
        Event { time_s: 10.0 * n as f64, transmitter_id, receiver_id, success, link, kind: None }
    };
    links(count, 1000 + seed).into_iter().enumerate().map(event).collect()
}

fn links(count: usize, seed: u64) -> Vec<Link> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut place = || Position::new(SIDE_M * (rng.random::<f64>() - 0.5), SIDE_M * (rng.random::<f64>() - 0.5));
    (0..count).map(|_| Link { transmitter: place(), receiver: place() }).collect()
}

/// Frames that a vehicle forms one after the other.
pub const FRAMES: usize = 10;

/// Forms frames one after the other, each of which departs; returns their length.
pub fn next_frames(bytes: usize) -> Box<dyn FnMut() -> f64> {
    let agent = agent(bytes);
    Box::new(move || {
        let mut agent = agent.clone();
        let mut next = |number| agent.next_frame(Some(1e4 + 10.0 * number as f64), bytes).expect("a frame");
        (0..FRAMES).filter_map(|number| next(number)).map(|frame| frame.bytes.len() as f64).sum()
    })
}

/// Records new events, with one query after each. The copy of the vehicle at the start of each run takes little time in comparison.
pub fn record_and_query(count: usize) -> Box<dyn FnMut() -> f64> {
    records_and_queries(agent(32), count)
}

/// As [`record_and_query`], for a vehicle that received a summary packet. Its own and its fused posterior differ.
pub fn record_and_query_with_peer(count: usize) -> Box<dyn FnMut() -> f64> {
    let [own, peer] = MEMBERS;
    let frame = member([peer, own], 32).next_frame(Some(1e4), 32).expect("a frame").expect("something to send");
    let mut agent = agent(32);
    assert_eq!(agent.receive(&frame.bytes, Some(1e4)).receipt, Receipt::Accepted);
    agent.rebuild().expect("posteriors");
    records_and_queries(agent, count)
}

fn records_and_queries(agent: Agent, count: usize) -> Box<dyn FnMut() -> f64> {
    let (new, link) = (events(EVENTS + count, 1, MEMBERS).split_off(EVENTS), links(1, 5)[0]);
    Box::new(move || {
        let mut agent = agent.clone();
        let answers = new.iter().map(|event| {
            agent.record([event.clone()]).expect("a valid event");
            agent.probability(link).expect("a probability")
        });
        answers.fold(f64::NAN, |_, answer| answer)
    })
}

/// Refits all events from the last fit, and answers one query.
pub fn refit_and_query() -> Box<dyn FnMut() -> f64> {
    let (mut agent, link) = (agent(32), links(1, 5)[0]);
    agent.record(events(EVENTS + 8, 1, MEMBERS).split_off(EVENTS)).expect("valid events");
    Box::new(move || {
        let mut agent = agent.clone();
        agent.refit().expect("a fit");
        agent.probability(link).expect("a probability")
    })
}

/// Answers 10 000 queries; returns the mean probability.
pub fn queries() -> Box<dyn FnMut() -> f64> {
    let (mut agent, links) = (agent(32), links(10_000, 5));
    Box::new(move || {
        let predictions = agent.predict(&links, Which::Fused).expect("predictions");
        predictions.iter().map(|prediction| prediction.probability).sum::<f64>() / links.len() as f64
    })
}
