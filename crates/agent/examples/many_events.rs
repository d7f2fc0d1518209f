//! Measures the time that a vehicle with many events takes: `cargo run --release -p pingmap-agent --example many_events
//! [events]`.

#![allow(clippy::print_stdout, reason = "the measurements are its output")]

use std::sync::Arc;
use std::time::Instant;

use pingmap_agent::{
    Agent, AgentOptions, Chart, Event, InputSpec, Learning, Link, Model, Position, Team, VehicleId, Which,
};

/// Pseudo-random numbers from 0 to 1 with a fixed seed.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn timed<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let begin = Instant::now();
    let result = work();
    println!("{what}: {:.3} s", begin.elapsed().as_secs_f64());
    result
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let count: usize = std::env::args().nth(1).map_or(Ok(20_000), |count| count.parse())?;
    let names = ["ada", "bob"].map(VehicleId::new);
    let learning = Learning::default();
    let chart = Chart { scale_m: 800.0, ..Chart::about([]) };
    let prior = learning.template(&learning.structure, InputSpec::Positions, chart.scale_m)?;
    let model = Model::new(chart, InputSpec::Positions, prior);
    let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
    let team = Arc::new(Team::new(names.clone(), model, reach)?);

    // Every link is heard within 700 m and missed beyond.
    let mut numbers = Numbers(1);
    let mut place = || Position::new(2000.0 * numbers.next() - 1000.0, 2000.0 * numbers.next() - 1000.0);
    let mut event = |n: usize| {
        let link = Link { transmitter: place(), receiver: place() };
        let [receiver_id, transmitter_id] = names.clone();
        Event { time_s: n as f64, transmitter_id, receiver_id, link, kind: None, success: link.range_m() < 700.0 }
    };
    let mut agent = Agent::new(names[0].clone(), team.clone(), AgentOptions::default());
    let mut slowest_s = 0.0f64;
    timed("recording all", || {
        (0..count).try_for_each(|n| {
            let event = event(n);
            let begin = Instant::now();
            agent.record([event])?;
            slowest_s = slowest_s.max(begin.elapsed().as_secs_f64());
            Ok::<(), Box<dyn std::error::Error>>(())
        })
    })?;
    println!("slowest record: {slowest_s:.6} s");
    timed("first refit", || agent.refit())?;
    let links: Vec<Link> = (0..1000).map(|n| event(n).link).collect();
    timed("1000 queries", || agent.predict(&links, Which::Fused))?;
    (0..65).try_for_each(|n| agent.record([event(count + n)]).map(drop))?;
    timed("refit after 65 more", || agent.refit())?;
    timed("1000 queries", || agent.predict(&links, Which::Fused))?;
    let frame = timed("next frame", || agent.next_frame(None, 32))?;
    println!("frame: {:?} bytes", frame.map(|frame| frame.bytes.len()));
    let snapshot = timed("snapshot", || agent.snapshot());
    println!("{} bytes", snapshot.len());
    timed("restore", || Agent::restore(names[0].clone(), team, AgentOptions::default(), &snapshot))?;
    Ok(())
}
