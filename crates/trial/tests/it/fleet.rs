//! A whole team under way in simulated water: frames are lost, repeated and delayed, vehicles restart, and one member
//! may be faulty.
//!
//! The test runs 66 seeds, six for each fault. `FLEET_SEEDS=10000 cargo nextest run --release -p pingmap-trial fleet`
//! runs more.

use std::sync::Arc;

use pingmap_agent::*;
use pingmap_packet::{Block, MapMessage, Outcome, Report, Waypoint};
use pingmap_trial::simulate::{Simulated, Simulation, Sound};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Transmissions of the mission. As many again are predicted.
const SLOTS: usize = 120;

const SLOT_S: f64 = 10.0;

/// Frames of each member after the mission, which everyone receives.
const LAST_FRAMES: usize = 6;

/// Frames of a flood in each of its slots.
const FLOOD: u32 = 60;

/// Largest increase of the NLL of the honest members by received data, in nats per event.
const HARM_MAX: f64 = 0.005;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    Deaf,
    AllHeard,
    Random,
    Inverted,
    UnusedClaims,
    WrongDatum,
    Mirrored,
    ClockAhead,
    Counters,
    Flood,
}

impl Fault {
    /// Returns whether the outcomes of the member are wrong.
    fn is_of_receiver(self) -> bool {
        matches!(self, Fault::Deaf | Fault::AllHeard | Fault::Random | Fault::Inverted)
    }
}

const FAULTS: [Fault; 11] = [
    Fault::None,
    Fault::Deaf,
    Fault::AllHeard,
    Fault::Random,
    Fault::Inverted,
    Fault::UnusedClaims,
    Fault::WrongDatum,
    Fault::Mirrored,
    Fault::ClockAhead,
    Fault::Counters,
    Fault::Flood,
];

/// A vehicle restored from the snapshot of `agent`.
fn restored(agent: &Agent) -> Agent {
    let team = Arc::new(agent.team().clone());
    Agent::restore(agent.id().clone(), team, agent.options, &agent.snapshot()).unwrap()
}

/// A team under way. The member with number 0 has the fault.
struct Fleet {
    trial: Simulated,
    team: Arc<Team>,
    agents: Vec<Agent>,
    /// Stations ashore that receive every frame: the second one in reverse order, and twice.
    stations: [Agent; 2],
    sent: Vec<(f64, Vec<u8>)>,
    /// Frames that arrive late: slot of arrival, receiver, frame.
    delayed: Vec<(usize, usize, Vec<u8>)>,
    fault: Fault,
    rng: ChaCha8Rng,
}

impl Fleet {
    fn new(seed: u64, fault: Fault) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        let vehicles = 3 + (seed % 2) as usize;
        let simulation =
            Simulation { vehicles, slots: SLOTS, slot_s: SLOT_S, seed: 5000 + seed, ..Simulation::default() };
        // In half of the runs messages travel better one way than the other, which the model of the team cannot
        // represent.
        let direction_loss_db = if seed / FAULTS.len() as u64 % 2 == 1 { 8.0 } else { 0.0 };
        let sound = Sound { direction_loss_db, favoured_bearing_deg: (seed * 37 % 360) as f64, ..Sound::default() };
        let trial = simulation.run(&sound).unwrap();
        let names: Vec<VehicleId> = trial.vehicles.iter().map(|(id, _)| id.clone()).collect();
        let positions: Vec<Position> = trial.log.events.iter().flat_map(|event| event.link.ends()).collect();
        let chart = Chart::about(positions.iter().copied());
        let model = Model::isotropic(chart, InputSpec::Positions, dgpc::Shape::Matern52, true, 400.0, 4.0).unwrap();
        let slots = Slots { start_s: SLOT_S, ..Slots::cycle(SLOT_S, names.clone()) };
        let team = Arc::new(Team { slots, ..Team::new(names.clone(), model, positions).unwrap() });
        let agent = |id: VehicleId| Agent::new(id, team.clone(), AgentOptions::default());
        let stations = ["ashore", "afloat"].map(|id| agent(VehicleId::new(id)));
        let agents = names.into_iter().map(agent).collect();
        Self { trial, team: team.clone(), agents, stations, sent: Vec::new(), delayed: Vec::new(), fault, rng }
    }

    fn fault_of(&self, vehicle: usize) -> Fault {
        if vehicle == 0 { self.fault } else { Fault::None }
    }

    /// The time and the position that the clock and the navigation of a vehicle give.
    fn measured(&self, vehicle: usize, time_s: f64, at: Position) -> (f64, Position) {
        match self.fault_of(vehicle) {
            Fault::WrongDatum => (time_s, Position { east_m: at.east_m + 300.0, ..at }),
            Fault::Mirrored => (time_s, Position { east_m: 1400.0 - at.east_m, ..at }),
            Fault::ClockAhead if time_s == SLOT_S * 31.0 => (time_s + 5.0 * 3600.0, at),
            _ => (time_s, at),
        }
    }

    fn recorded(&mut self, receiver: usize, event: &Event) -> Event {
        let (time_s, at) = self.measured(receiver, event.time_s, event.link.receiver);
        let random = self.rng.random::<bool>();
        let success = match self.fault_of(receiver) {
            Fault::Deaf => false,
            Fault::AllHeard => true,
            Fault::Random => random,
            Fault::Inverted => !event.success,
            _ => event.success,
        };
        let link = Link { receiver: at, ..event.link };
        Event { time_s, link, success, ..event.clone() }
    }

    fn slot(&mut self, slot: usize) {
        let time_s = SLOT_S * (slot + 1) as f64;
        let (count, sender) = (self.agents.len(), slot % self.agents.len());
        for vehicle in 0..count {
            let fix = self.measured(vehicle, time_s, self.trial.position(vehicle, time_s));
            self.agents[vehicle].record_positions([fix]).unwrap();
        }
        for (_, receiver, frame) in self.delayed.extract_if(.., |(due, ..)| *due <= slot) {
            self.agents[receiver].receive(&frame, Some(time_s));
        }
        let frames = self.frames(sender, time_s);
        let piggyback = self.agents[sender].piggyback(time_s, 16);
        let id = self.agents[sender].id().clone();
        for number in slot * (count - 1)..(slot + 1) * (count - 1) {
            let event = self.trial.log.events[number].clone();
            let receiver = self.agents.iter().position(|agent| *agent.id() == event.receiver_id).unwrap();
            let recorded = self.recorded(receiver, &event);
            self.agents[receiver].record([recorded]).unwrap();
            if event.success {
                self.deliver(slot, receiver, &frames);
                piggyback
                    .iter()
                    .for_each(|&bits| drop(self.agents[receiver].receive_piggyback(&id, time_s, bits, 16).receipt));
            }
        }
        self.sent.extend(frames.into_iter().map(|frame| (time_s, frame)));
        for agent in &mut self.agents {
            if self.rng.random::<f64>() < 0.01 {
                *agent = restored(agent);
            }
            if agent.refit_due() {
                agent.refit().unwrap();
            }
        }
    }

    /// Delivers frames: most at once, some of them twice, some late.
    fn deliver(&mut self, slot: usize, receiver: usize, frames: &[Vec<u8>]) {
        for frame in frames {
            let copies = match self.rng.random_range(0..10) {
                0 => {
                    self.delayed.push((slot + 1 + self.rng.random_range(0..6), receiver, frame.clone()));
                    0
                }
                1 => 2,
                _ => 1,
            };
            (0..copies)
                .for_each(|_| drop(self.agents[receiver].receive(frame, Some(SLOT_S * (slot + 1) as f64)).receipt));
        }
    }

    /// The frames that a member sends.
    fn frames(&mut self, sender: usize, time_s: f64) -> Vec<Vec<u8>> {
        let fault = self.fault_of(sender);
        let agent = &mut self.agents[sender];
        if fault == Fault::UnusedClaims {
            agent.record_unused_slots([time_s]).unwrap();
        }
        let mut frames: Vec<Vec<u8>> =
            agent.next_frame(Some(time_s), 32).unwrap().map(|frame| frame.bytes).into_iter().collect();
        match fault {
            Fault::Counters => {
                frames.extend([65_535, 65_534, self.rng.random()].map(|counter| self.empty_summary(counter)))
            }
            Fault::Flood => frames.extend((0..FLOOD).map(|_| self.random_report())),
            _ => {}
        }
        frames
    }

    fn empty_summary(&self, counter: u16) -> Vec<u8> {
        let layout = self.team.layout(32).unwrap();
        let blocks = vec![Block::empty(layout); layout.blocks];
        self.agents[0].codec().write(layout, &MapMessage { sender: 0, counter, model: 0, blocks }).unwrap()
    }

    /// A report about random slots of the epoch, with random outcomes and a random track.
    fn random_report(&mut self) -> Vec<u8> {
        let mut outcome = || if self.rng.random() { Outcome::Heard } else { Outcome::Missed };
        let outcomes = (0..40).map(|_| outcome()).collect();
        let mut waypoint = |slots| Waypoint { slots, east: self.rng.random(), north: self.rng.random(), depth: 0 };
        let waypoints = vec![waypoint(0), waypoint(20), waypoint(20)];
        let first = self.rng.random_range(0..2 * SLOTS as u32);
        let report = Report { sender: 0, model: 0, first, includes_own_slots: self.rng.random(), outcomes, waypoints };
        self.agents[0].codec().write_report(&report).unwrap()
    }

    /// Ends the mission: each member sends its last frames, which all receive.
    fn finish(&mut self) {
        let time_s = SLOT_S * (SLOTS + 1) as f64;
        for (_, receiver, frame) in std::mem::take(&mut self.delayed) {
            self.agents[receiver].receive(&frame, Some(time_s));
        }
        for sender in 0..self.agents.len() {
            for _ in 0..LAST_FRAMES {
                let frames = self.frames(sender, time_s);
                for receiver in (0..self.agents.len()).filter(|&receiver| receiver != sender) {
                    frames.iter().for_each(|frame| drop(self.agents[receiver].receive(frame, Some(time_s)).receipt));
                }
                self.sent.extend(frames.into_iter().map(|frame| (time_s, frame)));
            }
        }
        let [first, second] = &mut self.stations;
        self.sent.iter().for_each(|(_, frame)| drop(first.receive(frame, Some(time_s)).receipt));
        self.sent
            .iter()
            .rev()
            .chain(&self.sent)
            .for_each(|(_, frame)| drop(second.receive(frame, Some(time_s)).receipt));
        self.agents.iter_mut().chain(&mut self.stations).for_each(|agent| agent.rebuild().unwrap());
    }

    fn honest(&mut self) -> impl Iterator<Item = &mut Agent> {
        let faulty = usize::from(self.fault != Fault::None);
        self.agents.iter_mut().skip(faulty)
    }

    /// The expected NLL of the honest members over all links of the mission: from own events, and from all data.
    fn scores(&mut self) -> [f64; 2] {
        let end = SLOTS * (self.agents.len() - 1);
        let queries: Vec<Link> = self.trial.log.events[..end].iter().map(|event| event.link).collect();
        let truth = self.trial.log.true_probability.as_ref().unwrap()[..end].to_vec();
        let nll = |predictions: Vec<Prediction>| {
            let loss = |(prediction, truth): (&Prediction, &f64)| {
                let p = prediction.probability.clamp(1e-12, 1.0 - 1e-12);
                -truth * p.ln() - (1.0 - truth) * (1.0 - p).ln()
            };
            predictions.iter().zip(&truth).map(loss).sum::<f64>() / truth.len() as f64
        };
        let mut scores = [0.0; 2];
        let mut honest = 0.0;
        for agent in self.honest() {
            for (score, options) in scores.iter_mut().zip([Which::Own, Which::Fused]) {
                *score += nll(agent.predict(queries.iter().copied(), options).unwrap());
            }
            honest += 1.0;
        }
        scores.map(|score| score / honest)
    }
}

/// The result of one run.
#[derive(Debug, Clone, Copy)]
struct Outcomes {
    seed: u64,
    fault: Fault,
    own_nll: f64,
    team_nll: f64,
    /// Number of times that an honest member excludes an honest member.
    honest_excluded: usize,
    /// Number of honest members that exclude the faulty one.
    faulty_excluded: usize,
}

impl Outcomes {
    fn harm(&self) -> f64 {
        self.team_nll - self.own_nll
    }
}

fn run(seed: u64) -> Outcomes {
    let fault = FAULTS[(seed % FAULTS.len() as u64) as usize];
    let mut fleet = Fleet::new(seed, fault);
    (0..SLOTS).for_each(|slot| fleet.slot(slot));
    fleet.finish();
    let [own_nll, team_nll] = fleet.scores();
    let faulty = fleet.agents[0].id().clone();
    let (mut honest_excluded, mut faulty_excluded) = (0, 0);
    let all_events = SLOTS * (fleet.agents.len() - 1);
    for agent in fleet.honest() {
        let status = agent.status();
        for (id, _) in status.members.iter().filter(|(_, member)| member.is_ignored(IgnoreReason::Contradicts)) {
            let is_faulty = fault != Fault::None && *id == faulty;
            *(if is_faulty { &mut faulty_excluded } else { &mut honest_excluded }) += 1;
        }
        // A receiver has one outcome in a slot. A flood may hold outcomes of slots after the mission.
        let located = status.located_events;
        assert!(fault == Fault::Flood || located <= all_events - status.own_events, "{fault:?} {seed}: {located}");
        let link = agent.events().next().unwrap().link;
        let mut restored = restored(agent);
        restored.rebuild().unwrap();
        let [kept, restored] = [agent, &mut restored].map(|agent| agent.probability(link).unwrap().to_bits());
        assert_eq!(kept, restored, "{fault:?} {seed}: restored from a snapshot");
    }
    let link = fleet.trial.log.events[0].link;
    let [first, second] = fleet.stations.each_mut().map(|station| station.probability(link).unwrap().to_bits());
    assert_eq!(first, second, "{fault:?} {seed}: the same frames in another order");
    Outcomes { seed, fault, own_nll, team_nll, honest_excluded, faulty_excluded }
}

/// A receiver with 60 to 90 own events cannot always tell a faulty receiver from bad water. Of 1000 seeds 22 exceed the
/// bound, all of them with a member that is deaf, hears all, or is random. The mean over the runs with each fault is
/// far below the bound.
#[test]
fn a_faulty_member_harms_only_itself() {
    let seeds = std::env::var("FLEET_SEEDS").map_or(66, |seeds| seeds.parse().unwrap());
    let outcomes: Vec<Outcomes> = (0..seeds).into_par_iter().map(run).collect();
    for fault in FAULTS {
        let of: Vec<&Outcomes> = outcomes.iter().filter(|outcomes| outcomes.fault == fault).collect();
        let mean = |value: &dyn Fn(&Outcomes) -> f64| of.iter().map(|of| value(of)).sum::<f64>() / of.len() as f64;
        let (own, team) = (mean(&|of| of.own_nll), mean(&|of| of.team_nll));
        let worst = of.iter().map(|of| of.harm()).fold(f64::NEG_INFINITY, f64::max);
        let excluded = mean(&|of| of.faulty_excluded as f64);
        println!("{fault:?}: NLL alone {own:.4}, team {team:.4}; largest harm {worst:+.4}; excluded by {excluded:.2}");
        assert!(team < own - 4.0 * HARM_MAX, "{fault:?}: {own} {team}");
    }
    let mistaken: Vec<u64> = outcomes.iter().filter(|of| of.honest_excluded > 0).map(|of| of.seed).collect();
    assert!(100 * mistaken.len() <= outcomes.len(), "honest members are excluded with the seeds {mistaken:?}");
    let (of_receivers, others): (Vec<Outcomes>, Vec<Outcomes>) = outcomes
        .iter()
        .filter(|outcomes| outcomes.harm() > HARM_MAX)
        .partition(|outcomes| outcomes.fault.is_of_receiver());
    println!("{} receivers harm; honest members are excluded with the seeds {mistaken:?}", of_receivers.len());
    assert!(others.is_empty(), "{others:#?}");
    assert!(of_receivers.len() <= outcomes.len() / 33, "{of_receivers:#?}");
}
