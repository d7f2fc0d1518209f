//! Simulates a long mission, and measures block by block the cost of an event for a vehicle, the size of its snapshot,
//! and the NLL of the team.
//!
//! Vehicles send in turn. Every tenth transmission of a vehicle carries a frame of 32 bytes to each vehicle that hears
//! it. For every event the receiver predicts the link, records the event, and refits if a refit is due. The first 100
//! transmissions of a block are predicted from the data before the block. The program prints their mean NLL: by own
//! events, by the team, by all events in one place, and by the true probabilities. The column "a fit" is the time of
//! one fixed fit of 750 events, because the speed of a machine varies.
//!
//! `cargo run --release -p pingmap-trial --example long_mission -- [slots] [blocks]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pingmap_agent::{Agent, AgentOptions, Event, Learning, Position, PredictOptions, Team, VehicleId};
use pingmap_trial::simulate::{Simulation, Sound};
use pingmap_trial::{EventLog, Score, learn_best, schedule};

type Failure = Box<dyn Error + Send + Sync>;

const SLOTS: usize = 20_000;

const BLOCKS: usize = 10;

/// Every such transmission of a vehicle carries a frame.
const FRAME_EVERY: usize = 10;

/// Number of transmissions of a block that are predicted before the block.
const AHEAD: usize = 100;

/// Number of events of the reference fit.
const REFERENCE_EVENTS: usize = 750;

/// Number of transmissions between two reference fits.
const REFERENCE_EVERY: usize = 20;

/// Cost of a vehicle's events.
#[derive(Default)]
struct Cost {
    events: u32,
    all: Duration,
    longest: Duration,
    fits: Duration,
    frames: Duration,
}

impl Cost {
    fn add(&mut self, time: Duration) {
        self.all += time;
        self.longest = self.longest.max(time);
    }
}

fn mission(slots: usize, seed: u64) -> Result<EventLog, Failure> {
    Ok(Simulation { vehicles: 4, slots, area_m: 2000.0, seed, ..Simulation::default() }.run(&Sound::default())?.log)
}

/// Returns a team with the model of a shorter mission in another area.
fn team(log: &EventLog) -> Result<Team, Failure> {
    let before = mission(300, 2)?;
    let events: Vec<&Event> = before.events.iter().collect();
    let learned = learn_best(&Learning::default(), before.chart(), before.inputs(), &events)?;
    let mut corners = [Position::new(f64::MAX, f64::MAX), Position::new(f64::MIN, f64::MIN)];
    for at in log.events.iter().flat_map(|event| event.link.ends()) {
        corners[0] = Position::new(corners[0].east_m.min(at.east_m), corners[0].north_m.min(at.north_m));
        corners[1] = Position::new(corners[1].east_m.max(at.east_m), corners[1].north_m.max(at.north_m));
    }
    let slots = schedule(log).ok_or("the log has no schedule")?;
    Ok(Team { slots, ..Team::new(log.vehicles(), learned.model, corners)? })
}

/// Runs one transmission: each listener predicts and records the event, and receives the frame.
fn transmit(
    vehicles: &mut BTreeMap<VehicleId, (Agent, Cost)>,
    events: &[Event],
    frame_bytes: Option<usize>,
) -> Result<(), Failure> {
    let (sender, time_s) = (&events[0].transmitter_id, events[0].time_s);
    let mut frame = None;
    if let Some((agent, cost)) = vehicles.get_mut(sender) {
        let begin = Instant::now();
        agent.record_positions([(time_s, events[0].link.transmitter)])?;
        let sending = Instant::now();
        if let Some(bytes) = frame_bytes {
            frame = agent.next_frame(Some(time_s), bytes)?;
        }
        cost.frames += sending.elapsed();
        cost.add(begin.elapsed());
    }
    for event in events {
        let Some((agent, cost)) = vehicles.get_mut(&event.receiver_id) else { continue };
        let begin = Instant::now();
        agent.probability(event.link)?;
        agent.record(event.clone())?;
        if let Some(frame) = frame.as_ref().filter(|_| event.success) {
            agent.receive(frame, Some(time_s));
        }
        let fitting = Instant::now();
        if agent.refit_due() {
            agent.refit()?;
        }
        cost.fits += fitting.elapsed();
        cost.events += 1;
        cost.add(begin.elapsed());
    }
    Ok(())
}

fn nll(predicted: &[f64], events: &[Event]) -> f64 {
    let outcomes: Vec<bool> = events.iter().map(|event| event.success).collect();
    Score::new(predicted, &outcomes).map_or(f64::NAN, |score| score.nll)
}

/// Returns the NLL of these events by their receivers alone, by the team, and by all earlier events.
fn scores(
    vehicles: &mut BTreeMap<VehicleId, (Agent, Cost)>,
    shore: &mut Agent,
    events: &[Event],
) -> Result<[f64; 3], Failure> {
    let (mut own, mut team) = (Vec::new(), Vec::new());
    for event in events {
        let Some((agent, _)) = vehicles.get_mut(&event.receiver_id) else { continue };
        own.push(agent.predict([event.query()], PredictOptions::own())?[0].probability);
        team.push(agent.probability(event.link)?);
    }
    shore.rebuild()?;
    let all = shore.predict(events.iter().map(|event| event.query()), PredictOptions::default())?;
    let all: Vec<f64> = all.iter().map(|prediction| prediction.probability).collect();
    Ok([&own, &team, &all].map(|predicted| nll(predicted, events)))
}

fn main() -> Result<(), Failure> {
    let mut numbers = std::env::args().skip(1).map(|number| number.parse::<usize>());
    let slots = numbers.next().transpose()?.unwrap_or(SLOTS);
    let blocks = numbers.next().transpose()?.unwrap_or(BLOCKS).max(1);
    let log = mission(slots, 1)?;
    let truth = log.true_probability.as_deref().unwrap_or_default();
    let team = Arc::new(team(&log)?);
    let options = AgentOptions::default();
    let agent = |id: VehicleId| (id.clone(), (Agent::new(id, team.clone(), options), Cost::default()));
    let mut vehicles: BTreeMap<VehicleId, (Agent, Cost)> = log.vehicles().into_iter().map(agent).collect();
    let options = AgentOptions { record_all_receivers: true, ..options };
    let mut shore = Agent::new(VehicleId::new("shore"), team.clone(), options);
    let listeners = vehicles.len() - 1;
    let mut reference = shore.clone();
    reference.record_all(log.events.iter().take(REFERENCE_EVENTS).cloned())?;
    let per_block = slots.div_ceil(blocks) * listeners;
    println!(
        "events  an event, ms  fits, ms  frames, ms  longest, ms  a fit, ms  remote  snapshot, kB     own    team     all   truth"
    );
    for (number, (block, truth)) in log.events.chunks(per_block).zip(truth.chunks(per_block)).enumerate() {
        let ahead = &block[..block.len().min(AHEAD * listeners)];
        let [own, together, all] = scores(&mut vehicles, &mut shore, ahead)?;
        let truth = nll(&truth[..ahead.len()], ahead);
        vehicles.values_mut().for_each(|(_, cost)| *cost = Cost::default());
        let mut fit = Cost::default();
        for (slot, transmission) in block.chunks(listeners).enumerate() {
            let turn = (number * per_block / listeners + slot) / vehicles.len();
            let frame_bytes = turn.is_multiple_of(FRAME_EVERY).then_some(32);
            transmit(&mut vehicles, transmission, frame_bytes)?;
            if slot.is_multiple_of(REFERENCE_EVERY) {
                let begin = Instant::now();
                reference.rebuild()?;
                fit.add(begin.elapsed());
                fit.events += 1;
            }
        }
        shore.record_all(block.iter().cloned())?;
        let total = |part: fn(&Cost) -> Duration| vehicles.values().map(|(_, cost)| part(cost)).sum::<Duration>();
        let count = vehicles.values().map(|(_, cost)| cost.events).sum::<u32>().max(1);
        let ms = |time: Duration| 1e3 * time.as_secs_f64();
        let longest = vehicles.values().map(|(_, cost)| cost.longest).max().unwrap_or_default();
        let remote = vehicles.values().map(|(agent, _)| agent.status().located_events).sum::<usize>() / vehicles.len();
        let snapshot = vehicles.values().map(|(agent, _)| agent.snapshot().len()).max().unwrap_or_default();
        println!(
            "{:6}  {:12.2}  {:8.2}  {:10.2}  {:11.1}  {:9.1}  {remote:6}  {:12.1}  {own:.4}  {together:.4}  {all:.4}  {truth:.4}",
            (number * per_block + block.len()) / vehicles.len(),
            ms(total(|cost| cost.all) / count),
            ms(total(|cost| cost.fits) / count),
            ms(total(|cost| cost.frames) / count),
            ms(longest),
            ms(fit.all / fit.events.max(1)),
            snapshot as f64 / 1e3,
        );
    }
    Ok(())
}
