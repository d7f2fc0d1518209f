//! Cost and quality of a long mission.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::Args;
use pingmap_agent::{Agent, AgentOptions, Event, Learning, Position, Sharing, Team, VehicleId, Which};
use pingmap_trial::simulate::{Simulation, Sound};
use pingmap_trial::{EventLog, learn, probabilities, schedule};

use crate::agents::agent_of_all_receivers;
use crate::statistics::{columns, nll};

/// Every such transmission of a vehicle carries a frame.
const FRAME_EVERY: usize = 10;

const FRAME_BYTES: usize = 32;

/// Number of transmissions of a block that are predicted before the block.
const AHEAD: usize = 100;

/// Number of events of the reference fit.
const REFERENCE_EVENTS: usize = 750;

/// Number of transmissions between two reference fits.
const REFERENCE_EVERY: usize = 20;

/// Simulates a long mission, and measures the cost of an event, the size of snapshots, and the NLL block by block.
///
/// Vehicles send in turn. Every tenth transmission of a vehicle carries a frame of 32 bytes to each vehicle that hears
/// it. For every event the receiver predicts the link, records the event, and refits if a refit is due. The first 100
/// transmissions of a block are predicted from the data before the block. The table has their mean NLL: by own events,
/// by the team, by all events in one place, and by the true probabilities. The column "a fit" is the time of one fixed
/// fit of 750 events, because the speed of a machine varies.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Number of transmissions
    #[arg(long, default_value_t = 20_000)]
    slots: usize,
    /// Number of blocks
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..))]
    blocks: u16,
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let log = simulate(self.slots, 1)?;
        let truth = log.true_probability.as_deref().unwrap_or_default();
        let mut mission = LongMission::new(&log)?;
        let per_block = self.slots.div_ceil(self.blocks.into()) * mission.listeners();
        writeln!(
            out,
            "events  an event, ms  fits, ms  frames, ms  longest, ms  a fit, ms  remote  snapshot, kB     own    team     all   truth"
        )?;
        for (block, truth) in log.events.chunks(per_block).zip(truth.chunks(per_block)) {
            let ahead = &block[..block.len().min(AHEAD * mission.listeners())];
            let [own, team, all] = mission.predict(ahead)?;
            let nlls = [own, team, all, block_nll(&truth[..ahead.len()], ahead)];
            let fit = mission.run(block)?;
            writeln!(out, "{}  {}", mission.costs(&fit), columns(&nlls, 4))?;
        }
        Ok(())
    }
}

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

fn simulate(slots: usize, seed: u64) -> anyhow::Result<EventLog> {
    Ok(Simulation { vehicles: 4, slots, area_m: 2000.0, seed, ..Simulation::default() }.run(&Sound::default())?.log)
}

/// Returns a team with the model of a shorter mission in another area.
fn team(log: &EventLog) -> anyhow::Result<Team> {
    let before = simulate(300, 2)?;
    let events: Vec<&Event> = before.events.iter().collect();
    let learned = learn(&Learning::default(), before.chart(), before.inputs(), &events)?.best;
    let mut corners = [Position::new(f64::MAX, f64::MAX), Position::new(f64::MIN, f64::MIN)];
    for at in log.events.iter().flat_map(|event| event.link.ends()) {
        corners[0] = Position::new(corners[0].east_m.min(at.east_m), corners[0].north_m.min(at.north_m));
        corners[1] = Position::new(corners[1].east_m.max(at.east_m), corners[1].north_m.max(at.north_m));
    }
    let slots = schedule(log).context("the log has no schedule")?;
    Ok(Team { slots, ..Team::new(log.vehicles(), learned.model, corners)? })
}

fn block_nll(predicted: &[f64], events: &[Event]) -> f64 {
    nll(predicted, &events.iter().map(|event| event.success).collect::<Vec<_>>())
}

/// A mission in progress.
struct LongMission {
    vehicles: BTreeMap<VehicleId, (Agent, Cost)>,
    /// An agent with all events.
    shore: Agent,
    /// An agent with the events of the reference fit.
    reference: Agent,
    /// Number of transmissions so far.
    slots: usize,
}

impl LongMission {
    fn new(log: &EventLog) -> anyhow::Result<Self> {
        let team = Arc::new(team(log)?);
        let vehicle =
            |id: VehicleId| (id.clone(), (Agent::new(id, team.clone(), AgentOptions::default()), Cost::default()));
        let shore = agent_of_all_receivers("shore", &team, Sharing::default());
        let mut reference = shore.clone();
        reference.record(log.events.iter().take(REFERENCE_EVENTS).cloned())?;
        Ok(Self { vehicles: log.vehicles().into_iter().map(vehicle).collect(), shore, reference, slots: 0 })
    }

    fn listeners(&self) -> usize {
        self.vehicles.len() - 1
    }

    /// Returns the NLL of these events by their receivers alone, by the team, and by all earlier events.
    fn predict(&mut self, events: &[Event]) -> anyhow::Result<[f64; 3]> {
        let (mut own, mut team) = (Vec::new(), Vec::new());
        for event in events {
            let Some((agent, _)) = self.vehicles.get_mut(&event.receiver_id) else { continue };
            own.push(agent.predict([event.query()], Which::Own)?[0].probability);
            team.push(agent.probability(event.link)?);
        }
        self.shore.rebuild()?;
        let all = probabilities(&mut self.shore, &events.iter().map(Event::query).collect::<Vec<_>>())?;
        Ok([&own, &team, &all].map(|predicted| block_nll(predicted, events)))
    }

    /// Runs the transmissions of a block. Returns the cost of the reference fits.
    fn run(&mut self, block: &[Event]) -> anyhow::Result<Cost> {
        self.vehicles.values_mut().for_each(|(_, cost)| *cost = Cost::default());
        let mut fit = Cost::default();
        for (slot, transmission) in block.chunks(self.listeners()).enumerate() {
            let turn = self.slots / self.vehicles.len();
            self.transmit(transmission, turn.is_multiple_of(FRAME_EVERY))?;
            self.slots += 1;
            if slot.is_multiple_of(REFERENCE_EVERY) {
                let begin = Instant::now();
                self.reference.rebuild()?;
                fit.add(begin.elapsed());
                fit.events += 1;
            }
        }
        self.shore.record(block.iter().cloned())?;
        Ok(fit)
    }

    /// Runs one transmission: each listener predicts and records the event, and receives the frame.
    fn transmit(&mut self, events: &[Event], has_frame: bool) -> anyhow::Result<()> {
        let (sender, time_s) = (&events[0].transmitter_id, events[0].time_s);
        let mut frame = None;
        if let Some((agent, cost)) = self.vehicles.get_mut(sender) {
            let begin = Instant::now();
            agent.record_positions([(time_s, events[0].link.transmitter)])?;
            let sending = Instant::now();
            if has_frame {
                frame = agent.next_frame(Some(time_s), FRAME_BYTES)?.map(|frame| frame.bytes);
            }
            cost.frames += sending.elapsed();
            cost.add(begin.elapsed());
        }
        for event in events {
            let Some((agent, cost)) = self.vehicles.get_mut(&event.receiver_id) else { continue };
            let begin = Instant::now();
            agent.probability(event.link)?;
            agent.record([event.clone()])?;
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

    /// Formats the mean costs of an event in the last block, of the reference fit, and of memory.
    fn costs(&self, fit: &Cost) -> String {
        let vehicles = || self.vehicles.values();
        let total = |part: fn(&Cost) -> Duration| vehicles().map(|(_, cost)| part(cost)).sum::<Duration>();
        let count = vehicles().map(|(_, cost)| cost.events).sum::<u32>().max(1);
        let ms = |time: Duration| 1e3 * time.as_secs_f64();
        let longest = vehicles().map(|(_, cost)| cost.longest).max().unwrap_or_default();
        let remote = vehicles().map(|(agent, _)| agent.status().located_events).sum::<usize>() / self.vehicles.len();
        let snapshot = vehicles().map(|(agent, _)| agent.snapshot().len()).max().unwrap_or_default();
        format!(
            "{:6}  {:12.2}  {:8.2}  {:10.2}  {:11.1}  {:9.1}  {remote:6}  {:12.1}",
            self.slots * self.listeners() / self.vehicles.len(),
            ms(total(|cost| cost.all) / count),
            ms(total(|cost| cost.fits) / count),
            ms(total(|cost| cost.frames) / count),
            ms(longest),
            ms(fit.all / fit.events.max(1)),
            snapshot as f64 / 1e3,
        )
    }
}
