//! What reports are worth where things are not as they should be: NLL of held-out events by own events, by the team after ten
//! packets each, and by all events in one place, mean over vehicles and splits; and by how much the mean probability that each of
//! these, and the truth where it is known, gives is off the share that was heard. What was not sent is neither learned nor asked.
//!
//! Vehicles send in turn, in slots of ten seconds from second 10 on, as in the shipped trials. A position error turns around the
//! true place once in half an hour, another way for each vehicle, and is in all that the vehicle says of itself. A clock that is off, or a
//! schedule that changed unnoticed, makes the last vehicle take others' slots for others': it notes as missed whoever should have
//! sent by its own reckoning, and itself never. Silent slots are one in ten: nobody sent, and whoever listened took it for a miss.
//!
//! `cargo run --release -p pingmap-trial --example reports_in_need -- events.csv splits.csv [packets]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use common::{Failure, log_splits_and_packets};
use pingmap_agent::{Agent, Attempt, Event, Learning, Position, SlotChange, Slots, Team, Telling, VehicleId};
use pingmap_trial::{EventLog, Mission, Plan, Score, Split};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

const SLOT_S: f64 = 10.0;

/// How exactly times are told where all send at will.
const STRETCH_S: f64 = 2.0;

/// What is not as it should be.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Need {
    Nothing,
    /// Vehicles are off where they take themselves to be by so many metres. It is asked of where they were,
    Positions(f64),
    /// or of where they take themselves to be, as they would ask.
    OwnPositions(f64),
    /// The clock of the last vehicle is a slot ahead.
    Clock,
    /// At half time the order was to be reversed, and was not: all but the last vehicle know that this was taken back.
    Order,
    /// The last vehicle records nothing: what its ear heard or missed is not there for anybody, in one place neither.
    NoEar,
    /// Nobody knows who sends when, and nobody says so.
    NoSchedule,
    /// All send at will and say when they did.
    AtWill,
    /// Who did not hear the first vehicle's latest transmission has nothing to answer, and is silent.
    Polled,
    /// Everybody hears the frames of its neighbours in the order of names alone, and passes on what it hears.
    Chain,
    /// One slot in ten is silent; whether senders say so, and whether others wait for their word.
    Silence {
        told: bool,
        awaited: bool,
    },
}

const NEEDS: [(&str, Need); 17] = [
    ("as it should be", Need::Nothing),
    ("positions off by 10 m", Need::Positions(10.0)),
    ("30 m", Need::Positions(30.0)),
    ("100 m", Need::Positions(100.0)),
    ("10 m, asked of these", Need::OwnPositions(10.0)),
    ("30 m", Need::OwnPositions(30.0)),
    ("100 m", Need::OwnPositions(100.0)),
    ("one clock off by a slot", Need::Clock),
    ("one missed a change of order", Need::Order),
    ("one records nothing", Need::NoEar),
    ("no schedule: points alone", Need::NoSchedule),
    ("no schedule: what was sent is told", Need::AtWill),
    ("polled vehicles", Need::Polled),
    ("a chain", Need::Chain),
    ("silent slots, told", Need::Silence { told: true, awaited: false }),
    ("silent slots, waited for", Need::Silence { told: true, awaited: true }),
    ("silent slots, not told", Need::Silence { told: false, awaited: false }),
];

/// Where everybody was when somebody sent.
type Places = BTreeMap<VehicleId, BTreeMap<u64, Position>>;

fn slot(time_s: f64) -> u64 {
    (time_s / SLOT_S).round() as u64
}

fn places(log: &EventLog) -> Places {
    let mut places = Places::new();
    for event in &log.events {
        let ends = [(&event.transmitter_id, event.link.transmitter), (&event.receiver_id, event.link.receiver)];
        for (id, position) in ends {
            places.entry(id.clone()).or_default().insert(slot(event.time_s), position);
        }
    }
    places
}

/// What comes out, mean over vehicles: NLL, and mean probability less the share heard.
#[derive(Debug, Clone, Copy, Default)]
struct Scores {
    own: f64,
    team: f64,
    all: f64,
    own_off: f64,
    team_off: f64,
    all_off: f64,
    true_off: f64,
}

/// A mission of this log in which something is amiss.
struct Amiss<'a> {
    need: Need,
    log: &'a EventLog,
    split: &'a Split,
    places: &'a Places,
    ids: Vec<VehicleId>,
    silent: BTreeSet<u64>,
}

impl Amiss<'_> {
    /// How far a vehicle takes itself to be from where it is.
    fn off(&self, id: &VehicleId, time_s: f64) -> [f64; 2] {
        let (Need::Positions(off_m) | Need::OwnPositions(off_m)) = self.need else { return [0.0; 2] };
        let number = self.ids.iter().position(|other| other == id).unwrap_or_default() as f64;
        let turn =
            std::f64::consts::TAU * (time_s / 1800.0 * if number % 2.0 == 0.0 { 1.0 } else { -1.0 } + number / 3.0);
        [off_m * turn.cos(), off_m * turn.sin()]
    }

    fn moved(&self, id: &VehicleId, time_s: f64, at: Position) -> Position {
        let [east_m, north_m] = self.off(id, time_s);
        Position { east_m: at.east_m + east_m, north_m: at.north_m + north_m, ..at }
    }

    /// An event as vehicles that say where they are know it.
    fn said(&self, event: &Event) -> Event {
        let mut said = event.clone();
        said.link.transmitter = self.moved(&event.transmitter_id, event.time_s, event.link.transmitter);
        said.link.receiver = self.moved(&event.receiver_id, event.time_s, event.link.receiver);
        said
    }

    /// What can be learned from.
    fn training(&self) -> impl Iterator<Item = Event> {
        let there = self.split.indices(false).into_iter().map(|n| self.said(&self.log.events[n]));
        there.filter(|event| self.need != Need::NoEar || self.ids.last() != Some(&event.receiver_id))
    }

    fn sender(&self, slot: u64) -> VehicleId {
        self.ids[((slot - 1) % self.ids.len() as u64) as usize].clone()
    }

    fn is_lost(&self, id: &VehicleId) -> bool {
        matches!(self.need, Need::Clock | Need::Order) && self.ids.last() == Some(id)
    }

    /// The first slot of the second half.
    fn half(&self) -> u64 {
        self.log.events.iter().map(|event| slot(event.time_s)).max().unwrap_or_default() / 2
    }

    /// Whose turn it would be where the order is reversed from half time on.
    fn reversed(&self, number: u64) -> usize {
        let members = self.ids.len() as u64;
        ((2 * (self.half() % members) + members - number % members) % members) as usize
    }

    /// Who should send in a slot, and when it is, as the last vehicle reckons.
    fn reckoned(&self, event: &Event) -> (VehicleId, f64) {
        let (members, number) = (self.ids.len() as u64, slot(event.time_s) - 1);
        let (turn, time_s) = match self.need {
            Need::Clock => ((number + 1) % members, event.time_s + SLOT_S),
            Need::Order if number > self.half() => (self.reversed(number) as u64, event.time_s),
            _ => (number % members, event.time_s),
        };
        (self.ids[turn as usize].clone(), time_s)
    }

    /// What a vehicle records.
    fn recorded(&self, id: &VehicleId) -> Vec<Event> {
        let mut recorded = Vec::new();
        for event in self.training().filter(|event| event.receiver_id == *id) {
            if self.silent.contains(&slot(event.time_s)) {
                recorded.push(Event { success: false, ..event });
            } else if self.is_lost(id) {
                let (expected, time_s) = self.reckoned(&event);
                let place = self.places[&expected].get(&slot(event.time_s)).copied();
                if (!event.success || expected != event.transmitter_id) && expected != *id {
                    let mut missed = Event { time_s, transmitter_id: expected, success: false, ..event.clone() };
                    missed.link.transmitter = place.unwrap_or(event.link.transmitter);
                    recorded.push(missed);
                }
                if event.success {
                    recorded.push(Event { time_s, ..event });
                }
            } else {
                recorded.push(event);
            }
        }
        recorded
    }

    fn team(&self, team: &Team, id: &VehicleId) -> Arc<Team> {
        let slots = match self.need {
            Need::AtWill => Slots::at_will(STRETCH_S, self.ids.clone()),
            _ => Slots { start_s: SLOT_S, ..Slots::in_turn(SLOT_S, self.ids.clone()) },
        };
        let may_be_silent = match self.need {
            Need::Silence { awaited: true, .. } => self.ids.iter().cloned().collect(),
            Need::Polled => self.ids[1..].iter().cloned().collect(),
            _ => BTreeSet::new(),
        };
        let from = |from: u64, turn: &dyn Fn(u64) -> usize| SlotChange {
            from: from as u32,
            order: (from..).take(self.ids.len()).map(|number| self.ids[turn(number)].clone()).collect(),
        };
        let there = from(self.half(), &|number| self.reversed(number));
        let back = from(self.half() + 1, &|number| number as usize % self.ids.len());
        let changes = match self.need {
            Need::Order if self.is_lost(id) => vec![there],
            Need::Order => vec![there, back],
            _ => Vec::new(),
        };
        Arc::new(Team { slots: Slots { may_be_silent, changes, ..slots }, ..team.clone() })
    }

    fn vehicle(&self, team: &Team, id: &VehicleId) -> Result<Agent, Failure> {
        let telling = Telling { points: true, reports: self.need != Need::NoSchedule };
        let mut agent = Agent::new(id.clone(), self.team(team, id)).telling(telling);
        let ahead_s = if self.need == Need::Clock && self.is_lost(id) { SLOT_S } else { 0.0 };
        let fix = |(&slot, &at): (&u64, &Position)| {
            let time_s = SLOT_S * slot as f64;
            (time_s + ahead_s, self.moved(id, time_s, at))
        };
        agent.navigate(self.places[id].iter().map(fix))?;
        agent.observe_all(self.recorded(id))?;
        if let Need::Silence { told: true, .. } | Need::Polled = self.need {
            let own = self.silent.iter().filter(|&&slot| self.sender(slot) == *id);
            agent.stay_silent(own.map(|&slot| SLOT_S * slot as f64))?;
        }
        if self.need == Need::AtWill {
            // What others sent their messages' numbers show.
            for event in self.training().filter(|event| event.transmitter_id == *id || event.receiver_id == *id) {
                agent.sent(&event.transmitter_id, [event.time_s])?;
            }
        }
        agent.rebuild_posteriors()?;
        Ok(agent)
    }

    fn scores(&self, mission: &Mission, packets: usize) -> Result<Scores, Failure> {
        let mut agents = self.ids.iter().map(|id| self.vehicle(&mission.team, id)).collect::<Result<Vec<_>, _>>()?;
        let mut sent: Vec<Vec<Vec<u8>>> = Vec::new();
        for agent in &agents {
            let (mut agent, mut frames) = (agent.clone(), Vec::new());
            while frames.len() < packets
                && let Some(frame) = agent.next_packet(0.0, 32)?
            {
                frames.push(frame);
            }
            sent.push(frames);
        }
        let came = if self.need == Need::Chain { passed_on(&sent, packets) } else { to_everybody(&sent) };
        let is_there = |event: &Event| !self.silent.contains(&slot(event.time_s));
        let mut all = Agent::new(VehicleId::new("shore"), mission.team.clone()).owning_all_events();
        all.observe_all(self.training().filter(is_there))?;
        all.rebuild_posteriors()?;
        let (held_out, outcomes) = self.asked(mission);
        let nll = |predicted: &[f64]| Score::new(predicted, &outcomes).map_or(f64::NAN, |score| score.nll);
        let off = |predicted: &[f64]| {
            let heard = outcomes.iter().filter(|heard| **heard).count() as f64;
            (predicted.iter().sum::<f64>() - heard) / outcomes.len() as f64
        };
        let (mut scores, count) = (Scores::default(), agents.len() as f64);
        for (number, agent) in agents.iter_mut().enumerate() {
            let predicted = agent.probabilities(&held_out)?;
            scores.own += nll(&predicted) / count;
            scores.own_off += off(&predicted) / count;
            for frame in &came[number] {
                agent.receive(frame, 0.0);
            }
            agent.rebuild_posteriors()?;
            let predicted = agent.probabilities(&held_out)?;
            scores.team += nll(&predicted) / count;
            scores.team_off += off(&predicted) / count;
        }
        let predicted = all.probabilities(&held_out)?;
        (scores.all, scores.all_off) = (nll(&predicted), off(&predicted));
        scores.true_off = self.log.true_probability.as_ref().map_or(f64::NAN, |truth| {
            let truth: Vec<f64> = self.held_out_made().map(|n| truth[n]).collect();
            off(&truth)
        });
        Ok(scores)
    }

    /// Held-out events that were made: their places in the log.
    fn held_out_made(&self) -> impl Iterator<Item = usize> {
        let held_out = self.split.indices(true).into_iter();
        held_out.filter(|&n| !self.silent.contains(&slot(self.log.events[n].time_s)))
    }

    /// What is asked of these, and what became of them.
    fn asked(&self, mission: &Mission) -> (Vec<Attempt>, Vec<bool>) {
        let made: BTreeSet<usize> = self.held_out_made().collect();
        let held_out = self.split.indices(true).into_iter().zip(&mission.held_out).zip(&mission.outcomes);
        let made = held_out.filter(|((n, _), _)| made.contains(n));
        let asked = made.map(|((n, attempt), outcome)| match self.need {
            Need::OwnPositions(_) => (Attempt { link: self.said(&self.log.events[n]).link, ..*attempt }, *outcome),
            _ => (*attempt, *outcome),
        });
        asked.unzip()
    }
}

/// What comes to each where everybody hears everybody.
fn to_everybody(sent: &[Vec<Vec<u8>>]) -> Vec<Vec<Vec<u8>>> {
    let others = |number: usize| sent.iter().enumerate().filter(move |&(sender, _)| sender != number);
    (0..sent.len()).map(|number| others(number).flat_map(|(_, frames)| frames.clone()).collect()).collect()
}

/// What comes to each where everybody hears its neighbours and may send so many frames: in turn one of its own and the oldest that it
/// heard and did not pass on.
fn passed_on(sent: &[Vec<Vec<u8>>], packets: usize) -> Vec<Vec<Vec<u8>>> {
    let mut own: Vec<_> = sent.iter().map(|frames| frames.iter().cloned()).collect();
    let mut came = vec![Vec::<Vec<u8>>::new(); own.len()];
    let mut passed = vec![0; own.len()];
    for turn in 0..packets {
        for number in 0..own.len() {
            let heard = came[number].get(passed[number]).cloned();
            let is_own = turn % 2 == 0 || heard.is_none();
            passed[number] += usize::from(!is_own);
            let Some(frame) = (if is_own { own[number].next() } else { heard }) else { continue };
            for neighbour in [number.wrapping_sub(1), number + 1].into_iter().filter(|&other| other < sent.len()) {
                if !came[neighbour].contains(&frame) && !sent[neighbour].contains(&frame) {
                    came[neighbour].push(frame.clone());
                }
            }
        }
    }
    came
}

/// The slots in which vehicles have nothing to answer: they did not hear the latest transmission of the first one.
fn unasked(log: &EventLog, ids: &[VehicleId]) -> BTreeSet<u64> {
    let asked = |id: &VehicleId, slot: u64| {
        let requests = log.events.iter().filter(|event| event.transmitter_id == ids[0] && event.receiver_id == *id);
        let before = requests.filter(|event| self::slot(event.time_s) < slot);
        before.max_by(|a, b| a.time_s.total_cmp(&b.time_s)).is_none_or(|event| event.success)
    };
    let answers = log.events.iter().filter(|event| event.transmitter_id != ids[0]);
    let silent = answers.filter(|event| !asked(&event.transmitter_id, slot(event.time_s)));
    silent.map(|event| slot(event.time_s)).collect()
}

fn main() -> Result<(), Failure> {
    let (log, splits, packets) = log_splits_and_packets()?;
    let places = places(&log);
    let plan = Plan::new(Learning::default(), 1);
    let prepare = |split: &Split| Ok(Mission::prepare(&log, split, &plan, 0)?);
    let missions = splits.par_iter().map(prepare).collect::<Result<Vec<_>, Failure>>()?;
    println!(
        "                                        own    team     all  mean probability less share heard: own, team, all, truth"
    );
    for (name, need) in NEEDS {
        let of_split = |(number, (split, mission)): (usize, (&Split, &Mission))| {
            let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
            let last = log.events.iter().map(|event| slot(event.time_s)).max().unwrap_or_default();
            let is_silent = |_: &u64| matches!(need, Need::Silence { .. }) && rng.random::<f64>() < 0.1;
            let silent = match need {
                Need::Polled => unasked(&log, &log.vehicles()),
                _ => (1..=last).filter(is_silent).collect(),
            };
            Amiss { need, log: &log, split, places: &places, ids: log.vehicles(), silent }.scores(mission, packets)
        };
        let pairs: Vec<_> = splits.iter().zip(&missions).enumerate().collect();
        let all = pairs.into_par_iter().map(of_split).collect::<Result<Vec<_>, Failure>>()?;
        let mean = |of: fn(&Scores) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        let [own, team, centralised] = [mean(|all| all.own), mean(|all| all.team), mean(|all| all.all)];
        let off =
            [mean(|all| all.own_off), mean(|all| all.team_off), mean(|all| all.all_off), mean(|all| all.true_off)];
        let [own_off, team_off, all_off, true_off] = off;
        println!(
            "{name:36} {own:.4}  {team:.4}  {centralised:.4}  {own_off:+.3}  {team_off:+.3}  {all_off:+.3}  {true_off:+.3}"
        );
    }
    Ok(())
}
