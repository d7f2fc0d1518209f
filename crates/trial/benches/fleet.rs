//! Measures memory and time of a vehicle in a fleet of 100 vehicles with 500 events each, by the number of packets that
//! count.
//!
//! Positions are random at every event, so reports would need one waypoint for each event. The fleet therefore sends
//! summaries alone.
//!
//!     cargo bench -p pingmap-trial --bench fleet

#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs)]

use std::sync::Arc;
use std::time::Instant;

use dgpc::Shape;
use pingmap_agent::{
    Agent, AgentOptions, Chart, Event, IgnoreReason, InputSpec, Link, Model, Position, Receipt, Sharing, Team,
    VehicleId, Which,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

const VEHICLES: usize = 100;
const EVENTS: usize = 500;
const QUERIES: usize = 10_000;
const SIDE_M: f64 = 4000.0;

fn main() {
    let before = resident_bytes();
    let (mut fleet, fit_s) = timed(|| (0..VEHICLES).into_par_iter().map(vehicle).collect::<Vec<Agent>>());
    println!("{VEHICLES} vehicles, {EVENTS} events each: recorded and fitted in {fit_s:.1} s on all threads");
    let links = random_links(QUERIES, 7);
    println!(
        "live packets | points | memory, MB |  next_frame, ms | receive, µs | first query, ms | {QUERIES} queries, ms"
    );
    report(&mut fleet, 0, (f64::NAN, f64::NAN), before, &links);
    let window = usize::from(fleet[0].team().packets_per_sender_max);
    for round in 1..=window + 1 {
        if round == window + 1 {
            exclude(&mut fleet.clone(), &links[0]);
        }
        let (packets, sending_s) = timed(|| send(&mut fleet));
        let sent = packets.iter().flatten().count();
        let (_, receiving_s) = timed(|| deliver(&mut fleet, &packets));
        let times = (1e3 * sending_s / VEHICLES as f64, 1e6 * receiving_s / (sent * (VEHICLES - 1)) as f64);
        report(&mut fleet, round, times, before, &links);
    }
}

/// Measures the cost of excluding a member, in comparison with one fusion of all packets.
fn exclude(fleet: &mut [Agent], link: &Link) {
    let mut listener = fleet[0].clone();
    let query_ms = |listener: &mut Agent| 1e3 * timed(|| listener.probability(link).unwrap()).1;
    let honest = fleet[2].next_frame(Some(1.0), 32).unwrap().map(|frame| frame.bytes);
    let lie = lie(&mut fleet[1]);
    assert_eq!(listener.receive(&lie, Some(0.0)).receipt, Receipt::Accepted);
    let lie_ms = query_ms(&mut listener);
    let status = listener.status();
    let excluded: Vec<_> = status
        .members
        .iter()
        .filter(|(_, member)| member.is_ignored(IgnoreReason::Contradicts))
        .map(|(id, _)| id)
        .collect();
    println!("a false packet: first query {lie_ms:.0} ms; excluded: {excluded:?}");
    if let Some(honest) = honest {
        listener.receive(&honest, Some(0.0));
        println!("a packet of an honest member after that: first query {:.0} ms", query_ms(&mut listener));
    }
    listener.set_muted(fleet[3].id(), true);
    println!("after muting a member: first query {:.0} ms", query_ms(&mut listener));
}

/// Returns the next packet of a vehicle with reversed means and the highest level of information.
fn lie(agent: &mut Agent) -> Vec<u8> {
    let honest = agent
        .next_frame(Some(1.0), 32)
        .unwrap()
        .map(|frame| frame.bytes)
        .unwrap_or_else(|| panic!("the vehicle has no packet left"));
    let (layout, mut message) = agent.codec().read(&honest).unwrap();
    for point in message.blocks.iter_mut().flat_map(|block| &mut block.points) {
        (point.information, point.mean) = (31, if point.mean > 0 { -15 } else { 15 });
    }
    agent.codec().write(layout, &message).unwrap()
}

/// Prints memory and times of a vehicle. Sending and receiving run on all threads, queries on one.
fn report(fleet: &mut [Agent], round: usize, (send_ms, receive_us): (f64, f64), before: usize, links: &[Link]) {
    let (_, first_s) = timed(|| fleet[0].probability(links[0]).unwrap());
    fleet.par_iter_mut().for_each(|agent| assert!(agent.probability(links[0]).is_ok()));
    let memory_mb = resident_bytes().saturating_sub(before) as f64 / VEHICLES as f64 / 1e6;
    let (predictions, queries_s) = timed(|| fleet[0].predict(links, Which::Fused).unwrap());
    assert!(predictions.iter().all(|prediction| (0.0..=1.0).contains(&prediction.probability)));
    let (live, points) = (fleet[0].status().live_packets, fleet[0].posterior(Which::Fused).unwrap().len());
    let [first_ms, queries_ms] = [first_s, queries_s].map(|seconds| 1e3 * seconds);
    println!(
        "{round:>2}: {live:>8} | {points:>6} | {memory_mb:>10.1} | {send_ms:>15.1} | {receive_us:>11.1} | {first_ms:>15.1} | \
         {queries_ms:>10.0}"
    );
}

fn send(fleet: &mut [Agent]) -> Vec<Option<Vec<u8>>> {
    fleet.par_iter_mut().map(|agent| agent.next_frame(Some(0.0), 32).unwrap().map(|frame| frame.bytes)).collect()
}

fn deliver(fleet: &mut [Agent], packets: &[Option<Vec<u8>>]) {
    fleet.par_iter_mut().enumerate().for_each(|(receiver, agent)| {
        let others = packets.iter().enumerate().filter(|(sender, _)| *sender != receiver);
        for packet in others.filter_map(|(_, packet)| packet.as_ref()) {
            let receipt = agent.receive(packet, Some(0.0)).receipt;
            assert_eq!(receipt, Receipt::Accepted);
        }
    });
}

fn vehicle(number: usize) -> Agent {
    let name = |number: usize| VehicleId::new(format!("v{number:03}"));
    let corner = SIDE_M / 2.0;
    let corners = [Position::new(-corner, -corner), Position::new(corner, corner)];
    let model = Model::isotropic(Chart::about([]), InputSpec::Positions, Shape::Matern32, true, 800.0, 6.0).unwrap();
    let team = Team::new((0..VEHICLES).map(name), model, corners).unwrap();
    let options = AgentOptions { sharing: Sharing::summaries(), ..AgentOptions::default() };
    let mut agent = Agent::new(name(number), Arc::new(team), options);
    let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
    let events = random_links(EVENTS, 1000 + number as u64).into_iter().enumerate().map(|(n, link)| Event {
        time_s: n as f64,
        transmitter_id: name(rng.random_range(0..VEHICLES)),
        receiver_id: name(number),
        success: heard(&link, rng.random()),
        link,
        kind: None,
    });
    agent.record(events).unwrap();
    agent.rebuild().unwrap();
    agent
}

/// Returns the outcome over a link: its probability falls with range and across a ridge in the middle.
fn heard(link: &Link, chance: f64) -> bool {
    let across = link.transmitter.east_m * link.receiver.east_m < 0.0;
    let log_odds = 3.0 - link.range_m() / 500.0 - if across { 2.0 } else { 0.0 };
    chance < 1.0 / (1.0 + (-log_odds).exp())
}

fn random_links(count: usize, seed: u64) -> Vec<Link> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut place = || Position::new(SIDE_M * (rng.random::<f64>() - 0.5), SIDE_M * (rng.random::<f64>() - 0.5));
    (0..count).map(|_| Link { transmitter: place(), receiver: place() }).collect()
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let begin = Instant::now();
    let done = work();
    (done, begin.elapsed().as_secs_f64())
}

/// Returns the memory of this process in bytes, or 0 if the system does not report it.
fn resident_bytes() -> usize {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    pages.split_whitespace().nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0) * 4096
}
