//! A fleet of 100 vehicles with 500 events each in one process: what a vehicle needs of memory and time, and how that
//! grows with the packets that count. Vehicles are somewhere else at every event, as no report could tell it: what they know goes
//! round by points alone.
//!
//!     cargo bench -p pingmap-trial --bench fleet

#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs)]

use std::sync::Arc;
use std::time::Instant;

use dgpc::Shape;
use pingmap_agent::{
    Agent, Chart, Event, InputSpec, Link, Model, Position, Receipt, Refusal, Team, Telling, VehicleId,
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
    let (mut fleet, observe_s) = timed(|| (0..VEHICLES).into_par_iter().map(vehicle).collect::<Vec<Agent>>());
    println!("{VEHICLES} vehicles, {EVENTS} events each: observed and fitted in {observe_s:.1} s, two at a time");
    let links = random_links(QUERIES, 7);
    println!(
        "live packets | points | memory, MB | next_packet, ms | receive, µs | first query, ms | {QUERIES} queries, ms"
    );
    report(&mut fleet, 0, (f64::NAN, f64::NAN), before, &links);
    let window = usize::from(fleet[0].team().packets_per_sender_max);
    for round in 1..=window + 1 {
        if round == window + 1 {
            leave_out(&mut fleet.clone(), &links[0]);
        }
        let (packets, sending_s) = timed(|| send(&mut fleet));
        let sent = packets.iter().flatten().count();
        let (_, receiving_s) = timed(|| deliver(&mut fleet, &packets));
        let times = (1e3 * sending_s / VEHICLES as f64, 1e6 * receiving_s / (sent * (VEHICLES - 1)) as f64);
        report(&mut fleet, round, times, before, &links);
    }
}

/// What it costs to leave somebody out, beside putting the posteriors together once.
fn leave_out(fleet: &mut [Agent], link: &Link) {
    let mut listener = fleet[0].clone();
    let ask = |listener: &mut Agent| 1e3 * timed(|| listener.probability(link).unwrap()).1;
    let honest = fleet[2].next_packet(1.0, 32).unwrap();
    let lie = lie(&mut fleet[1]);
    assert_eq!(listener.receive(&lie, 0.0), Receipt::Accepted);
    let lie_ms = ask(&mut listener);
    println!("one lie: first query {lie_ms:.0} ms; left out: {:?}", listener.left_out());
    if let Some(honest) = honest {
        listener.receive(&honest, 0.0);
        println!("a packet of an honest member after that: first query {:.0} ms", ask(&mut listener));
    }
    listener.mute(fleet[3].id());
    println!("everything put together once: first query {:.0} ms", ask(&mut listener));
}

/// The next packet of a vehicle, with the contrary of what it knows, very surely.
fn lie(agent: &mut Agent) -> Vec<u8> {
    let honest = agent.next_packet(1.0, 32).unwrap().unwrap_or_else(|| panic!("something is left to tell"));
    let (layout, mut message) = agent.read(&honest).unwrap();
    for point in message.blocks.iter_mut().flat_map(|block| &mut block.points) {
        (point.information, point.mean) = (31, if point.mean > 0 { -15 } else { 15 });
    }
    agent.write(layout, &message).unwrap()
}

/// What a vehicle needs now. Times are per vehicle; sending and receiving run on all threads, queries on one.
fn report(fleet: &mut [Agent], round: usize, (send_ms, receive_us): (f64, f64), before: usize, links: &[Link]) {
    let (_, first_s) = timed(|| fleet[0].probability(links[0]).unwrap());
    fleet.par_iter_mut().for_each(|agent| assert!(agent.probability(links[0]).is_ok()));
    let memory_mb = resident_bytes().saturating_sub(before) as f64 / VEHICLES as f64 / 1e6;
    let (probabilities, queries_s) = timed(|| fleet[0].probabilities(links).unwrap());
    assert!(probabilities.iter().all(|p| (0.0..=1.0).contains(p)));
    let (live, points) = (fleet[0].live_packets(), fleet[0].posterior().unwrap().len());
    let [first_ms, queries_ms] = [first_s, queries_s].map(|seconds| 1e3 * seconds);
    println!(
        "{round:>2}: {live:>8} | {points:>6} | {memory_mb:>10.1} | {send_ms:>15.1} | {receive_us:>11.1} | {first_ms:>15.1} | \
         {queries_ms:>10.0}"
    );
}

fn send(fleet: &mut [Agent]) -> Vec<Option<Vec<u8>>> {
    fleet.par_iter_mut().map(|agent| agent.next_packet(0.0, 32).unwrap()).collect()
}

fn deliver(fleet: &mut [Agent], packets: &[Option<Vec<u8>>]) {
    fleet.par_iter_mut().enumerate().for_each(|(receiver, agent)| {
        let others = packets.iter().enumerate().filter(|(sender, _)| *sender != receiver);
        for packet in others.filter_map(|(_, packet)| packet.as_ref()) {
            let receipt = agent.receive(packet, 0.0);
            // Who has nothing new to say repeats an earlier packet.
            assert!(matches!(receipt, Receipt::Accepted | Receipt::Refused(Refusal::Duplicate)), "{receipt:?}");
        }
    });
}

fn vehicle(number: usize) -> Agent {
    let name = |number: usize| VehicleId::new(format!("v{number:03}"));
    let corner = SIDE_M / 2.0;
    let reach = [Position::new(-corner, -corner), Position::new(corner, corner)];
    let model = Model::isotropic(Chart::about([]), InputSpec::Positions, Shape::Matern32, true, 800.0, 6.0).unwrap();
    let team = Team::new((0..VEHICLES).map(name), model, reach).unwrap();
    let mut agent = Agent::new(name(number), Arc::new(team)).telling(Telling { points: true, reports: false });
    let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
    let events = random_links(EVENTS, 1000 + number as u64).into_iter().enumerate().map(|(n, link)| Event {
        time_s: n as f64,
        transmitter_id: name(rng.random_range(0..VEHICLES)),
        receiver_id: name(number),
        success: heard(&link, rng.random()),
        link,
        kind: None,
    });
    agent.observe_all(events).unwrap();
    agent.rebuild_posteriors().unwrap();
    agent
}

/// Range decides, and a ridge across the middle.
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

/// Memory of this process, where the system tells; 0 elsewhere.
fn resident_bytes() -> usize {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    pages.split_whitespace().nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0) * 4096
}
