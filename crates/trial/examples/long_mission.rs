//! A long mission, simulated: what an event costs a vehicle, how large its memory is, and what the team knows beside everything in one
//! place, block by block.
//!
//! Every vehicle sends in turn, and each tenth of its transmissions carries a frame of 32 bytes to whoever hears it. An event is
//! recorded, the link of it predicted before, and a fit made when it is due. The first 100 transmissions of a block are predicted
//! by what is known before it: mean NLL, and how much above that of the true probabilities. Beside it the time that one and the same
//! fit of 750 events takes: machines are not always equally fast.
//!
//! `cargo run --release -p pingmap-trial --example long_mission -- [slots] [blocks]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pingmap_agent::{Agent, Event, Learning, Position, Team, VehicleId};
use pingmap_trial::simulate::{Simulation, Sound};
use pingmap_trial::{EventLog, Score, learn_best, schedule};

type Failure = Box<dyn Error + Send + Sync>;

const SLOTS: usize = 20_000;

const BLOCKS: usize = 10;

/// Transmissions of a vehicle of which one carries a frame.
const FRAME_EVERY: usize = 10;

/// Transmissions of a block that are predicted before it begins.
const AHEAD: usize = 100;

/// Events of the fit that is timed beside, and transmissions from one time to the next.
const REFERENCE_EVENTS: usize = 750;
const REFERENCE_EVERY: usize = 20;

/// What a vehicle's events cost it.
#[derive(Default)]
struct Cost {
    events: u32,
    all: Duration,
    longest: Duration,
    fits: Duration,
    frames: Duration,
}

impl Cost {
    fn add(&mut self, of: Duration) {
        self.all += of;
        self.longest = self.longest.max(of);
    }
}

fn mission(slots: usize, seed: u64) -> Result<EventLog, Failure> {
    Ok(Simulation { vehicles: 4, slots, area_m: 2000.0, seed, ..Simulation::default() }.run(&Sound::default())?.log)
}

/// What the team agreed on: the model of a shorter mission, elsewhere.
fn team(log: &EventLog) -> Result<Team, Failure> {
    let before = mission(300, 2)?;
    let events: Vec<&Event> = before.events.iter().collect();
    let learned = learn_best(&Learning::default(), before.chart(), before.inputs(), &events)?;
    let mut reach = [Position::new(f64::MAX, f64::MAX), Position::new(f64::MIN, f64::MIN)];
    for at in log.events.iter().flat_map(|event| event.link.ends()) {
        reach[0] = Position::new(reach[0].east_m.min(at.east_m), reach[0].north_m.min(at.north_m));
        reach[1] = Position::new(reach[1].east_m.max(at.east_m), reach[1].north_m.max(at.north_m));
    }
    let slots = schedule(log).ok_or("vehicles do not keep to a schedule")?;
    Ok(Team { slots, ..Team::new(log.vehicles(), learned.model, reach)? })
}

/// One transmission: whoever listens predicts, learns, and reads what came with it.
fn transmit(
    vehicles: &mut BTreeMap<VehicleId, (Agent, Cost)>,
    events: &[Event],
    frame_bytes: Option<usize>,
) -> Result<(), Failure> {
    let (sender, time_s) = (&events[0].transmitter_id, events[0].time_s);
    let mut frame = None;
    if let Some((agent, cost)) = vehicles.get_mut(sender) {
        let begin = Instant::now();
        agent.navigate([(time_s, events[0].link.transmitter)])?;
        let sending = Instant::now();
        if let Some(bytes) = frame_bytes {
            frame = agent.next_packet(time_s, bytes)?;
        }
        cost.frames += sending.elapsed();
        cost.add(begin.elapsed());
    }
    for event in events {
        let Some((agent, cost)) = vehicles.get_mut(&event.receiver_id) else { continue };
        let begin = Instant::now();
        agent.probability(event.link)?;
        agent.observe(event.clone())?;
        if let Some(frame) = frame.as_ref().filter(|_| event.success) {
            agent.receive(frame, time_s);
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

/// NLL of these events by their receivers alone, by the team, and by all that happened before.
fn scores(
    vehicles: &mut BTreeMap<VehicleId, (Agent, Cost)>,
    shore: &mut Agent,
    events: &[Event],
) -> Result<[f64; 3], Failure> {
    let (mut own, mut team) = (Vec::new(), Vec::new());
    for event in events {
        let Some((agent, _)) = vehicles.get_mut(&event.receiver_id) else { continue };
        own.extend(agent.own_probabilities([event.attempt()])?);
        team.push(agent.probability(event.link)?);
    }
    shore.rebuild_posteriors()?;
    let all = shore.probabilities(events.iter().map(|event| event.attempt()))?;
    Ok([&own, &team, &all].map(|predicted| nll(predicted, events)))
}

fn main() -> Result<(), Failure> {
    let mut numbers = std::env::args().skip(1).map(|number| number.parse::<usize>());
    let slots = numbers.next().transpose()?.unwrap_or(SLOTS);
    let blocks = numbers.next().transpose()?.unwrap_or(BLOCKS).max(1);
    let log = mission(slots, 1)?;
    let truth = log.true_probability.as_deref().unwrap_or_default();
    let team = Arc::new(team(&log)?);
    let agent = |id: VehicleId| (id.clone(), (Agent::new(id, team.clone()), Cost::default()));
    let mut vehicles: BTreeMap<VehicleId, (Agent, Cost)> = log.vehicles().into_iter().map(agent).collect();
    let mut shore = Agent::new(VehicleId::new("shore"), team.clone()).owning_all_events();
    let listeners = vehicles.len() - 1;
    let mut reference = shore.clone();
    reference.observe_all(log.events.iter().take(REFERENCE_EVENTS).cloned())?;
    let per_block = slots.div_ceil(blocks) * listeners;
    println!(
        "events  an event, ms  of it fits  frames  longest, ms  a fit, ms  told  snapshot, kB    own    team     all   truth"
    );
    for (number, (block, truth)) in log.events.chunks(per_block).zip(truth.chunks(per_block)).enumerate() {
        let ahead = &block[..block.len().min(AHEAD * listeners)];
        let [own, together, all] = scores(&mut vehicles, &mut shore, ahead)?;
        let known = nll(&truth[..ahead.len()], ahead);
        vehicles.values_mut().for_each(|(_, cost)| *cost = Cost::default());
        let mut fit = Cost::default();
        for (slot, transmission) in block.chunks(listeners).enumerate() {
            let turn = (number * per_block / listeners + slot) / vehicles.len();
            let frame_bytes = turn.is_multiple_of(FRAME_EVERY).then_some(32);
            transmit(&mut vehicles, transmission, frame_bytes)?;
            if slot.is_multiple_of(REFERENCE_EVERY) {
                let begin = Instant::now();
                reference.rebuild_posteriors()?;
                fit.add(begin.elapsed());
                fit.events += 1;
            }
        }
        shore.observe_all(block.iter().cloned())?;
        let of_all = |of: fn(&Cost) -> Duration| vehicles.values().map(|(_, cost)| of(cost)).sum::<Duration>();
        let count = vehicles.values().map(|(_, cost)| cost.events).sum::<u32>().max(1);
        let ms = |time: Duration| 1e3 * time.as_secs_f64();
        let longest = vehicles.values().map(|(_, cost)| cost.longest).max().unwrap_or_default();
        let told = vehicles.values().map(|(agent, _)| agent.told_events().0).sum::<usize>() / vehicles.len();
        let snapshot = vehicles.values().map(|(agent, _)| agent.snapshot().len()).max().unwrap_or_default();
        println!(
            "{:6}  {:12.2}  {:10.2}  {:6.2}  {:11.1}  {:9.1}  {told:4}  {:12.1}  {own:.4}  {together:.4}  {all:.4}  {known:.4}",
            (number * per_block + block.len()) / vehicles.len(),
            ms(of_all(|cost| cost.all) / count),
            ms(of_all(|cost| cost.fits) / count),
            ms(of_all(|cost| cost.frames) / count),
            ms(longest),
            ms(fit.all / fit.events.max(1)),
            snapshot as f64 / 1e3,
        );
    }
    Ok(())
}
