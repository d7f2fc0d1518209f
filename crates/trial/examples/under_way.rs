//! What frames and spare bytes bring under way: mean NLL of coming events by own events, and by all earlier events of all without
//! delay; and the share of what lies between them that is closed by frames, by frames that each bring all earlier events of their
//! sender, exactly placed, and by two spare bytes of every transmission. Last, the shares of what such frames bring that are known,
//! event by event, when a frame is heard, and that wait until it is known where they took place; what share of those was heard, and of
//! these; and the share of their sender's earlier events that is known when spare bytes are heard.
//!
//! Every so many of its transmissions a vehicle sends a frame of 32 bytes to whoever hears that, by the log. All that a transmission
//! can tell is predicted before anybody learns from it. Vehicles send in turn. Shares have the jackknife's standard error, between
//! tenths of a mission or, where they are those of several missions together, between missions.
//!
//! `cargo run --release -p pingmap-trial --example under_way -- every model.toml events.csv...` (`-` for no model)

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use pingmap_agent::{Agent, Event, Learning, ModelFile, Team, VehicleId};
use pingmap_trial::{Agreed, EventLog, Plan, Score, schedule};

type Failure = Box<dyn Error + Send + Sync>;

const FRAME_BYTES: usize = 32;

const SPARE_BITS: usize = 16;

/// Parts of a mission that errors go by.
const TENTHS: usize = 10;

/// A vehicle that hears frames, the same one if they brought everything, and the same one with spare bytes alone.
struct Vehicle {
    agent: Agent,
    given: Agent,
    spare: Agent,
    /// Its own events so far.
    events: Vec<Event>,
    /// How many events of each other one it was given.
    known: BTreeMap<VehicleId, usize>,
    /// How many each other one had when it was heard last.
    had: BTreeMap<VehicleId, usize>,
    transmissions: usize,
}

/// Sums of the NLL of events as they come.
#[derive(Default, Clone, Copy)]
struct Scores {
    own: f64,
    team: f64,
    given: f64,
    spare: f64,
    all: f64,
    count: f64,
}

impl Scores {
    /// Which percentages of the gap between own events and all are closed by frames, by such that bring everything, by spare bytes.
    fn closed(&self) -> [f64; 3] {
        [self.team, self.given, self.spare].map(|nll| 100.0 * (self.own - nll) / (self.own - self.all))
    }

    /// Those of all parts but one, if one is named.
    fn sum(parts: &[Self], but: Option<usize>) -> Self {
        let counted = parts.iter().enumerate().filter(|(nth, _)| Some(*nth) != but);
        counted.fold(Self::default(), |sum, (_, one)| Self {
            own: sum.own + one.own,
            team: sum.team + one.team,
            given: sum.given + one.given,
            spare: sum.spare + one.spare,
            all: sum.all + one.all,
            count: sum.count + one.count,
        })
    }
}

struct Run {
    every: usize,
    vehicles: BTreeMap<VehicleId, Vehicle>,
    all: Agent,
    /// By tenths of the mission.
    scores: Vec<Scores>,
    /// Of each frame that was heard, the shares of what it might bring that are known and that wait.
    shares: Vec<[f64; 2]>,
    /// And what share was heard of those that are known, and of those that wait.
    shares_heard: [Vec<f64>; 2],
    /// Of all spare bytes that were heard, the shares of their senders' events that are known.
    spare_shares: Vec<f64>,
}

impl Run {
    fn new(log: &EventLog, plan: &Plan, every: usize) -> Result<Self, Failure> {
        let slots = schedule(log).ok_or("vehicles do not keep to a schedule")?;
        let team = Arc::new(Team { slots, ..plan.team(log, None)?.0 });
        let who_is_given = |id: &str| Agent::new(VehicleId::new(id), team.clone()).owning_all_events();
        let vehicle = |id: VehicleId| {
            let [agent, spare] = [(); 2].map(|()| Agent::new(id.clone(), team.clone()));
            let given = who_is_given(id.as_str());
            (
                id,
                Vehicle {
                    agent,
                    given,
                    spare,
                    events: Vec::new(),
                    known: BTreeMap::new(),
                    had: BTreeMap::new(),
                    transmissions: 0,
                },
            )
        };
        let vehicles = log.vehicles().into_iter().map(vehicle).collect();
        Ok(Self {
            every,
            vehicles,
            all: who_is_given("all"),
            scores: Vec::new(),
            shares: Vec::new(),
            shares_heard: Default::default(),
            spare_shares: Vec::new(),
        })
    }

    /// One transmission: whoever listens predicts, learns, and reads what came with it.
    fn transmit(&mut self, events: &[Event]) -> Result<(), Failure> {
        let (sender, time_s) = (&events[0].transmitter_id, events[0].time_s);
        let (mut frame, mut bits) = (None, None);
        if let Some(vehicle) = self.vehicles.get_mut(sender) {
            for agent in [&mut vehicle.agent, &mut vehicle.spare] {
                agent.navigate([(time_s, events[0].link.transmitter)])?;
            }
            vehicle.transmissions += 1;
            bits = vehicle.spare.recent(time_s, SPARE_BITS);
            if vehicle.transmissions.is_multiple_of(self.every) {
                // All three of it are as fresh.
                for agent in [&mut vehicle.agent, &mut vehicle.given, &mut vehicle.spare] {
                    agent.refit()?;
                }
                frame = vehicle.agent.next_packet(time_s, FRAME_BYTES)?;
            }
        }
        for event in events {
            self.predict(event)?;
        }
        for event in events {
            learn(&mut self.all, [event.clone()])?;
            let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { continue };
            for agent in [&mut vehicle.agent, &mut vehicle.given, &mut vehicle.spare] {
                learn(agent, [event.clone()])?;
            }
            vehicle.events.push(event.clone());
        }
        for event in events.iter().filter(|event| event.success) {
            if let Some(bits) = bits {
                self.deliver_spare(event, bits);
            }
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
        let Some(scores) = self.scores.last_mut() else { return Ok(()) };
        scores.own += nll(vehicle.agent.own_probabilities([attempt])?[0]);
        scores.team += nll(vehicle.agent.probability(attempt)?);
        scores.given += nll(vehicle.given.probability(attempt)?);
        scores.spare += nll(vehicle.spare.probability(attempt)?);
        scores.all += nll(self.all.probability(attempt)?);
        scores.count += 1.0;
        Ok(())
    }

    fn deliver_spare(&mut self, event: &Event, bits: u64) {
        let sender = &event.transmitter_id;
        let had = self.vehicles.get(sender).map_or(0, |vehicle| vehicle.events.len());
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return };
        vehicle.spare.receive_recent(sender, event.time_s, bits, SPARE_BITS);
        vehicle.had.insert(sender.clone(), had);
        let might_be = vehicle.had.values().sum::<usize>().max(1);
        self.spare_shares.push(vehicle.spare.told_events().0 as f64 / might_be as f64);
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
        let (told, waiting) = vehicle.agent.told_events();
        self.shares.push([told, waiting].map(|count| count as f64 / might_be as f64));
        let heard = vehicle.agent.told_shares_heard();
        self.shares_heard.iter_mut().zip(heard).for_each(|(all, heard)| all.extend(heard));
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
    let [every, model, logs @ ..] = arguments.as_slice() else {
        return Err("expected: every model.toml events.csv... (- for no model)".into());
    };
    let mut plan = Plan::new(Learning::default(), 1);
    if model != "-" {
        plan.agreed = Agreed::Model(ModelFile::parse(&std::fs::read_to_string(model)?)?.model);
    }
    println!(
        "   own     all  closed, %:  frames  if all came  spare bytes   known of that  waiting  heard of these  known by spare bytes"
    );
    let mut missions = Vec::new();
    for path in logs {
        let run = mission(&EventLog::open(Path::new(path))?, &plan, every.parse::<usize>()?.max(1))?;
        let [known, waiting] = [0, 1].map(|nth| mean(run.shares.iter().map(|share| share[nth])));
        let known_by_spare = mean(run.spare_shares.iter().copied());
        let heard = run.shares_heard.each_ref().map(|shares| match shares.is_empty() {
            true => "none".into(),
            false => format!("{:.3}", mean(shares.iter().copied())),
        });
        let heard = heard.join(", ");
        println!("{}  {known:14.3}  {waiting:7.3}  {heard:>14}  {known_by_spare:20.3}  {path}", row(&run.scores));
        missions.push(Scores::sum(&run.scores, None));
    }
    if missions.len() > 1 {
        println!("{}  all together", row(&missions));
    }
    Ok(())
}

fn mean(shares: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = shares.len().max(1) as f64;
    shares.sum::<f64>() / count
}

/// What parts come to together, and the shares that are closed of the gap.
fn row(parts: &[Scores]) -> String {
    let sum = Scores::sum(parts, None);
    let [own, all] = [sum.own, sum.all].map(|nll| nll / sum.count);
    let [frames, given, spare] = [0, 1, 2].map(|nth| with_error(parts, nth));
    format!("{own:.4}  {all:.4}  {frames:>18}  {given:>11}  {spare:>11}")
}

fn mission(log: &EventLog, plan: &Plan, every: usize) -> Result<Run, Failure> {
    let mut run = Run::new(log, plan, every)?;
    let mut events = log.events.clone();
    events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then_with(|| a.transmitter_id.cmp(&b.transmitter_id)));
    let is_same = |a: &Event, b: &Event| a.time_s == b.time_s && a.transmitter_id == b.transmitter_id;
    let transmissions: Vec<&[Event]> = events.chunk_by(is_same).collect();
    for tenth in transmissions.chunks(transmissions.len().div_ceil(TENTHS)) {
        run.scores.push(Scores::default());
        for transmission in tenth {
            run.transmit(transmission)?;
        }
    }
    Ok(run)
}

/// A share of all parts, and its standard error: by how much it changes where one of them is left out.
fn with_error(parts: &[Scores], nth: usize) -> String {
    let count = parts.len() as f64;
    let without: Vec<f64> = (0..parts.len()).map(|one| Scores::sum(parts, Some(one)).closed()[nth]).collect();
    let mean = without.iter().sum::<f64>() / count;
    let squares = without.iter().map(|one| (one - mean).powi(2)).sum::<f64>();
    format!("{:.0} ± {:.0}", Scores::sum(parts, None).closed()[nth], (squares * (count - 1.0) / count).sqrt())
}
