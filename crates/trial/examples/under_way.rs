//! What frames bring under way, beside what they would if each brought all earlier events of its sender, exactly placed: mean NLL of
//! coming events by own events, by the team, by such frames, and by all earlier events of all without delay; and the share of what
//! such frames bring that is known, event by event, when a frame is heard.
//!
//! Every so many of its transmissions a vehicle sends a frame of 32 bytes to whoever hears that, by the log. All that a transmission
//! can tell is predicted before anybody learns from it. Vehicles send in turn.
//!
//! `cargo run --release -p pingmap-trial --example under_way -- events.csv every [model.toml]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use pingmap_agent::{Agent, Event, Learning, ModelFile, Team, VehicleId};
use pingmap_trial::{Agreed, EventLog, Plan, Score, schedule};

type Failure = Box<dyn Error + Send + Sync>;

const FRAME_BYTES: usize = 32;

/// A vehicle, and the same one if frames brought everything.
struct Vehicle {
    agent: Agent,
    given: Agent,
    /// Its own events so far.
    events: Vec<Event>,
    /// How many events of each other one it was given.
    known: BTreeMap<VehicleId, usize>,
    transmissions: usize,
}

/// Mean NLL of events as they come.
#[derive(Default)]
struct Scores {
    own: f64,
    team: f64,
    given: f64,
    all: f64,
    count: f64,
}

struct Run {
    every: usize,
    vehicles: BTreeMap<VehicleId, Vehicle>,
    all: Agent,
    scores: Scores,
    /// Of each frame that was heard, the share of what it might bring that is known.
    shares: Vec<f64>,
}

impl Run {
    fn new(log: &EventLog, plan: &Plan, every: usize) -> Result<Self, Failure> {
        let slots = schedule(log).ok_or("vehicles do not keep to a schedule")?;
        let team = Arc::new(Team { slots, ..plan.team(log, None)?.0 });
        let who_is_given = |id: &str| Agent::new(VehicleId::new(id), team.clone()).owning_all_events();
        let vehicle = |id: VehicleId| {
            let (agent, given) = (Agent::new(id.clone(), team.clone()), who_is_given(id.as_str()));
            (id, Vehicle { agent, given, events: Vec::new(), known: BTreeMap::new(), transmissions: 0 })
        };
        let vehicles = log.vehicles().into_iter().map(vehicle).collect();
        Ok(Self { every, vehicles, all: who_is_given("all"), scores: Scores::default(), shares: Vec::new() })
    }

    /// One transmission: whoever listens predicts, learns, and reads what came with it.
    fn transmit(&mut self, events: &[Event]) -> Result<(), Failure> {
        let (sender, time_s) = (&events[0].transmitter_id, events[0].time_s);
        let mut frame = None;
        if let Some(vehicle) = self.vehicles.get_mut(sender) {
            vehicle.agent.navigate([(time_s, events[0].link.transmitter)])?;
            vehicle.transmissions += 1;
            if vehicle.transmissions.is_multiple_of(self.every) {
                vehicle.agent.refit()?;
                frame = vehicle.agent.next_packet(time_s, FRAME_BYTES)?;
            }
        }
        for event in events {
            self.predict(event)?;
        }
        for event in events {
            learn(&mut self.all, [event.clone()])?;
            let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { continue };
            learn(&mut vehicle.agent, [event.clone()])?;
            learn(&mut vehicle.given, [event.clone()])?;
            vehicle.events.push(event.clone());
        }
        for event in events.iter().filter(|event| event.success) {
            if let Some(frame) = &frame {
                self.deliver(event, frame)?;
            }
        }
        Ok(())
    }

    fn predict(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return Ok(()) };
        let nll = |p: f64| Score::new(&[p], &[event.success]).map_or(f64::NAN, |score| score.nll);
        let attempt = event.attempt();
        self.scores.own += nll(vehicle.agent.own_probabilities([attempt])?[0]);
        self.scores.team += nll(vehicle.agent.probability(attempt)?);
        self.scores.given += nll(vehicle.given.probability(attempt)?);
        self.scores.all += nll(self.all.probability(attempt)?);
        self.scores.count += 1.0;
        Ok(())
    }

    /// A frame comes to who heard it, and with it, in the other case, all earlier events of its sender.
    fn deliver(&mut self, event: &Event, frame: &[u8]) -> Result<(), Failure> {
        let sender = &event.transmitter_id;
        let its = self.vehicles.get(sender).map(|vehicle| vehicle.events.clone()).unwrap_or_default();
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return Ok(()) };
        vehicle.agent.receive(frame, event.time_s);
        let known = vehicle.known.insert(sender.clone(), its.len()).unwrap_or_default();
        learn(&mut vehicle.given, its[known..].iter().cloned())?;
        let might_be = vehicle.known.values().sum::<usize>().max(1);
        self.shares.push(vehicle.agent.told_events().0 as f64 / might_be as f64);
        Ok(())
    }
}

fn learn(agent: &mut Agent, events: impl IntoIterator<Item = Event>) -> Result<(), Failure> {
    agent.observe_all(events)?;
    if agent.refit_due() {
        agent.refit()?;
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [events, every, model @ ..] = arguments.as_slice() else {
        return Err("expected: events.csv every [model.toml]".into());
    };
    let log = EventLog::open(Path::new(events))?;
    let mut plan = Plan::new(Learning::default(), 1);
    if let Some(model) = model.first() {
        plan.agreed = Agreed::Model(ModelFile::parse(&std::fs::read_to_string(model)?)?.model);
    }
    let mut run = Run::new(&log, &plan, every.parse::<usize>()?.max(1))?;
    let mut events = log.events.clone();
    events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then_with(|| a.transmitter_id.cmp(&b.transmitter_id)));
    let is_same = |a: &Event, b: &Event| a.time_s == b.time_s && a.transmitter_id == b.transmitter_id;
    for transmission in events.chunk_by(is_same) {
        run.transmit(transmission)?;
    }
    let Scores { own, team, given, all, count } = run.scores;
    let [own, team, given, all] = [own, team, given, all].map(|sum| sum / count);
    let closed = |nll: f64| 100.0 * (own - nll) / (own - all);
    println!("   own    team   closed, %  if all came  closed, %     all  known of that");
    println!(
        "{own:.4}  {team:.4}  {:10.0}  {given:11.4}  {:9.0}  {all:.4}  {:.3}",
        closed(team),
        closed(given),
        run.shares.iter().sum::<f64>() / run.shares.len().max(1) as f64
    );
    Ok(())
}
