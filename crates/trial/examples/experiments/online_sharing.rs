//! Benefit of frames and piggybacked outcomes during a mission.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use clap::Args;
use pingmap_agent::{Agent, AgentOptions, Event, Learning, Sharing, Team, VehicleId, Which};
use pingmap_trial::{EventLog, Plan, Preshared, record_and_refit, schedule, transmissions};

use crate::agents::agent_of_all_receivers;
use crate::arguments::{read_model, sharing_without};
use crate::statistics::{columns, jackknife, mean, nll};

const FRAME_BYTES: usize = 32;

const PIGGYBACK_BITS: usize = 16;

/// Number of parts of a mission for standard errors.
const TENTHS: usize = 10;

/// Measures the benefit of frames and piggybacked outcomes during a mission.
///
/// The program predicts every event from the vehicle's own earlier events, and from all earlier events of all vehicles
/// without delay. The table has both mean NLLs, and the share of their gap that three kinds of sharing close: frames,
/// ideal frames, and two piggybacked bytes on every transmission. An ideal frame carries all earlier events of its
/// sender at exact positions. The last two columns contain the share of remote events that is known when a frame is
/// received, and the same for piggybacked bytes.
///
/// Vehicles that heard a transmission by the log receive its frame of 32 bytes and its piggybacked bytes. Shares have
/// jackknife standard errors: between tenths of a mission, or between missions.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// A vehicle sends a frame on every n-th of its transmissions
    #[arg(long, default_value_t = 10, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    every: u16,
    /// Model file; without it, the vehicles use the prior
    #[arg(long)]
    model: Option<PathBuf>,
    /// Features of sharing that are turned off, separated by commas
    #[arg(long = "without", value_name = "FEATURES", value_parser = sharing_without, default_value = "", hide_default_value = true)]
    sharing: Sharing,
    /// Event logs, one mission each
    #[arg(required = true)]
    events: Vec<PathBuf>,
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let mut plan = Plan { sharing: self.sharing, ..Plan::new(Learning::default(), 1) };
        if let Some(model) = &self.model {
            plan.preshared = Preshared::Model(read_model(model)?);
        }
        writeln!(
            out,
            "    own      all   frames    ideal  piggyb.  closed, %:  frames     ideal   piggyb.   known  piggyb."
        )?;
        let mut missions = Vec::new();
        for path in &self.events {
            let run = Run::of_log(&EventLog::open(path)?, &plan, self.every.into())?;
            let [frames, piggyback] = [&run.shares, &run.piggyback_shares].map(|shares| mean(shares.iter().copied()));
            writeln!(out, "{}  {frames:6.3}  {piggyback:7.3}  {}", row(&run.losses), path.display())?;
            missions.push(Losses::sum(&run.losses, None));
        }
        if missions.len() > 1 {
            writeln!(out, "{}  all together", row(&missions))?;
        }
        Ok(())
    }
}

/// Formats the mean NLLs of all parts together, and the closed shares of the gap with their jackknife standard errors.
fn row(parts: &[Losses]) -> String {
    let sum = Losses::sum(parts, None);
    let nlls = [sum.own, sum.all, sum.team, sum.ideal, sum.piggyback].map(|nll| nll / sum.count);
    let [frames, ideal, piggyback] = [0, 1, 2].map(|kind| {
        let (share, se) = jackknife(parts.len(), |omitted| Losses::sum(parts, omitted).closed()[kind]);
        format!("{share:.0} ± {se:.0}")
    });
    format!("{}  {frames:>18} {ideal:>9} {piggyback:>9}", columns(&nlls, 5))
}

/// Sums of the NLL of events.
#[derive(Default, Clone, Copy)]
struct Losses {
    own: f64,
    team: f64,
    ideal: f64,
    piggyback: f64,
    all: f64,
    count: f64,
}

impl Losses {
    /// Returns the percentages of the gap between own and all events that frames, ideal frames and piggybacked bytes
    /// close.
    fn closed(&self) -> [f64; 3] {
        [self.team, self.ideal, self.piggyback].map(|nll| 100.0 * (self.own - nll) / (self.own - self.all))
    }

    /// Returns the sum of all parts, without one part if it is given.
    fn sum(parts: &[Self], omitted: Option<usize>) -> Self {
        let counted = parts.iter().enumerate().filter(|(part, _)| Some(*part) != omitted);
        counted.fold(Self::default(), |sum, (_, part)| Self {
            own: sum.own + part.own,
            team: sum.team + part.team,
            ideal: sum.ideal + part.ideal,
            piggyback: sum.piggyback + part.piggyback,
            all: sum.all + part.all,
            count: sum.count + part.count,
        })
    }
}

/// A vehicle with three agents: one receives frames, one ideal frames, and one piggybacked bytes alone.
struct Vehicle {
    agent: Agent,
    ideal: Agent,
    piggyback: Agent,
    /// Own events so far.
    events: Vec<Event>,
    /// Number of events of each other vehicle that ideal frames brought.
    ideal_events: BTreeMap<VehicleId, usize>,
    /// Number of events of each other vehicle at its last received transmission.
    piggyback_events: BTreeMap<VehicleId, usize>,
    transmissions: usize,
}

impl Vehicle {
    fn new(id: &VehicleId, team: &Arc<Team>, sharing: Sharing) -> Self {
        let options = AgentOptions { sharing, ..AgentOptions::default() };
        let agent = Agent::new(id.clone(), team.clone(), options);
        Self {
            piggyback: agent.clone(),
            agent,
            ideal: agent_of_all_receivers(id.as_str(), team, sharing),
            events: Vec::new(),
            ideal_events: BTreeMap::new(),
            piggyback_events: BTreeMap::new(),
            transmissions: 0,
        }
    }

    fn agents(&mut self) -> [&mut Agent; 3] {
        [&mut self.agent, &mut self.ideal, &mut self.piggyback]
    }
}

/// A mission in progress.
struct Run {
    every: usize,
    vehicles: BTreeMap<VehicleId, Vehicle>,
    all: Agent,
    /// One entry for each tenth of the mission.
    losses: Vec<Losses>,
    /// The share of remote events that is known, for each received frame.
    shares: Vec<f64>,
    /// The share of remote events that is known, for each transmission with received piggybacked bytes.
    piggyback_shares: Vec<f64>,
}

impl Run {
    /// Runs the mission of a log.
    fn of_log(log: &EventLog, plan: &Plan, every: usize) -> anyhow::Result<Self> {
        let slots = schedule(log).context("the log has no schedule")?;
        let team = Arc::new(Team { slots, ..plan.team(log, None)?.0 });
        let vehicles = log.vehicles().into_iter();
        let mut run = Self {
            every,
            vehicles: vehicles.map(|id| (id.clone(), Vehicle::new(&id, &team, plan.sharing))).collect(),
            all: agent_of_all_receivers("all", &team, plan.sharing),
            losses: Vec::new(),
            shares: Vec::new(),
            piggyback_shares: Vec::new(),
        };
        let transmissions = transmissions(&log.events);
        for tenth in transmissions.chunks(transmissions.len().div_ceil(TENTHS)) {
            run.losses.push(Losses::default());
            for transmission in tenth {
                run.transmit(transmission)?;
            }
        }
        Ok(run)
    }

    /// Runs one transmission: each listener predicts and records the event, and receives frame and piggybacked bytes.
    fn transmit(&mut self, events: &[&Event]) -> anyhow::Result<()> {
        let (sender, time_s) = (&events[0].transmitter_id, events[0].time_s);
        let (mut frame, mut bits) = (None, None);
        if let Some(vehicle) = self.vehicles.get_mut(sender) {
            for agent in [&mut vehicle.agent, &mut vehicle.piggyback] {
                agent.record_positions([(time_s, events[0].link.transmitter)])?;
            }
            vehicle.transmissions += 1;
            bits = vehicle.piggyback.piggyback(time_s, PIGGYBACK_BITS);
            if vehicle.transmissions.is_multiple_of(self.every) {
                // All three agents refit at the same time.
                vehicle.agents().into_iter().try_for_each(Agent::refit)?;
                frame = vehicle.agent.next_frame(Some(time_s), FRAME_BYTES)?.map(|frame| frame.bytes);
            }
        }
        for event in events {
            self.predict(event)?;
        }
        for &event in events {
            record_and_refit(&mut self.all, [event.clone()])?;
            let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { continue };
            for agent in vehicle.agents() {
                record_and_refit(agent, [event.clone()])?;
            }
            vehicle.events.push(event.clone());
        }
        for event in events.iter().filter(|event| event.success) {
            if let Some(bits) = bits {
                self.deliver_piggyback(event, bits);
            }
            if let Some(frame) = &frame {
                self.deliver(event, frame)?;
            }
        }
        Ok(())
    }

    fn predict(&mut self, event: &Event) -> anyhow::Result<()> {
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return Ok(()) };
        let Some(losses) = self.losses.last_mut() else { return Ok(()) };
        let nll = |p: f64| nll(&[p], &[event.success]);
        let query = event.query();
        losses.own += nll(vehicle.agent.predict([query], Which::Own)?[0].probability);
        losses.team += nll(vehicle.agent.probability(query)?);
        losses.ideal += nll(vehicle.ideal.probability(query)?);
        losses.piggyback += nll(vehicle.piggyback.probability(query)?);
        losses.all += nll(self.all.probability(query)?);
        losses.count += 1.0;
        Ok(())
    }

    fn deliver_piggyback(&mut self, event: &Event, bits: u64) {
        let sender = &event.transmitter_id;
        let count = self.vehicles.get(sender).map_or(0, |vehicle| vehicle.events.len());
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return };
        vehicle.piggyback.receive_piggyback(sender, event.time_s, bits, PIGGYBACK_BITS);
        vehicle.piggyback_events.insert(sender.clone(), count);
        self.piggyback_shares.push(located_share(&vehicle.piggyback, &vehicle.piggyback_events));
    }

    /// Delivers a frame, and to the ideal agent all earlier events of its sender.
    fn deliver(&mut self, event: &Event, frame: &[u8]) -> anyhow::Result<()> {
        let sender = &event.transmitter_id;
        let events = self.vehicles.get(sender).map(|vehicle| vehicle.events.clone()).unwrap_or_default();
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return Ok(()) };
        vehicle.agent.receive(frame, Some(event.time_s));
        let earlier = vehicle.ideal_events.insert(sender.clone(), events.len()).unwrap_or_default();
        record_and_refit(&mut vehicle.ideal, events[earlier..].iter().cloned())?;
        self.shares.push(located_share(&vehicle.agent, &vehicle.ideal_events));
        Ok(())
    }
}

/// Returns the share of remote events that an agent located. `remote_events` has the number of each other vehicle.
fn located_share(agent: &Agent, remote_events: &BTreeMap<VehicleId, usize>) -> f64 {
    agent.status().located_events as f64 / remote_events.values().sum::<usize>().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closed_share_is_that_of_the_gap() {
        let part = |team: f64| Losses { own: 6.0, team, ideal: 3.0, piggyback: 6.0, all: 2.0, count: 10.0 };
        assert_eq!(part(5.0).closed(), [25.0, 75.0, 0.0]);
        let parts = [part(5.0), part(3.0)];
        assert_eq!(Losses::sum(&parts, None).closed()[0], 50.0);
        assert_eq!(Losses::sum(&parts, Some(0)).closed()[0], 75.0);
    }
}
