//! The world: water, hosts and clocks.

use std::collections::BTreeSet;
use std::sync::Arc;

use pingmap_agent::{Chart, Event, InputSpec, Key, Model, Position, Slots, Team, VehicleId};
use pingmap_packet::MapMessage;
use pingmap_trial::simulate::{Simulated, Simulation, Sound};
use pingmap_vehicle::{
    At, Departed, FaultCode, FrameIn, FrameLink, FrameRequest, Heard, Hex, Input, Listening, Message, Nav, Peer,
    PeerSource, PiggybackIn, PiggybackRequest, Place, Predict, Token, VehicleConfig,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::sim_disk::SimDisk;
use crate::simulation::checks::{Finding, Selection};
use crate::simulation::faulty::{FAULTS, Fault, Sabotage};
use crate::simulation::member::Member;

/// Transmissions of a mission.
const SLOTS: usize = 60;

const SLOT_S: f64 = 10.0;

/// The result of one run.
pub struct Run {
    pub seed: u64,
    /// The fault of the last member.
    pub fault: Fault,
    pub findings: Vec<Finding>,
    pub selection: Selection,
    /// Mean NLL of honest members minus that of own events alone; `None` without any scored event.
    pub harm: Option<f64>,
    pub crashes: u64,
    pub store_failures: u64,
    pub forgeries: u64,
    /// Every message of every vehicle.
    pub transcript: String,
    /// Frames and final predictions of the first vehicle.
    pub first_vehicle: String,
}

/// A team in simulated water.
pub struct World {
    seed: u64,
    sabotage: Sabotage,
    fault: Fault,
    trial: Simulated,
    members: Vec<Member>,
    names: Vec<VehicleId>,
    rng: ChaCha8Rng,
    /// Offset and drift of each clock, in seconds and seconds per second.
    clocks: Vec<(f64, f64)>,
    /// Whether hosts know where other members are.
    knows_peers: bool,
    /// Frames that members sent.
    genuine: BTreeSet<Vec<u8>>,
    /// Frames that arrive late: slot of arrival, receiver, sender, frame.
    delayed: Vec<(usize, usize, usize, Vec<u8>)>,
    /// Slots that counted: receiver and slot.
    counted: BTreeSet<(usize, usize)>,
    /// Slots of the mission in which a message was sent.
    sent: BTreeSet<usize>,
    events_max: usize,
    findings: Vec<Finding>,
    forgeries: u64,
    first_vehicle: String,
}

impl World {
    pub fn new(seed: u64, sabotage: Sabotage) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let fault =
            if sabotage == Sabotage::None { FAULTS[(seed % FAULTS.len() as u64) as usize] } else { Fault::None };
        let simulation =
            Simulation { vehicles: 3, slots: SLOTS, slot_s: SLOT_S, seed: 7000 + seed, ..Simulation::default() };
        let trial = simulation.run(&Sound::default()).unwrap();
        let names: Vec<VehicleId> = trial.vehicles.iter().map(|(id, _)| id.clone()).collect();
        let events_max = if seed % 4 == 3 || sabotage == Sabotage::RaiseLimit { 16 } else { 100_000 };
        let team = Arc::new(team(&trial, &names, seed, sabotage, events_max));
        let members = names.iter().enumerate().map(|(number, id)| {
            let mut text = format!("schema = 1\nvehicle = {:?}\nteam = \"team.toml\"\n", id.as_str());
            if number == 0 && sabotage == Sabotage::Mute {
                text += &format!("muted = [{:?}]\n", names[1].as_str());
            }
            text += "store.snapshot_interval_s = 200\n";
            if seed % 2 == 1 || sabotage == Sabotage::ReuseCounters {
                text += "sharing.reports = false\n";
            }
            let config = VehicleConfig::parse(&text).unwrap();
            let disk = SimDisk::new(seed * 16 + number as u64);
            Member::new(number, config, team.clone(), disk, sabotage)
        });
        let members = members.collect();
        let clocks = (0..3).map(|_| (rng.random_range(-0.8..0.8), rng.random_range(-1e-4..1e-4))).collect();
        let knows_peers = rng.random_ratio(3, 4) || sabotage != Sabotage::None;
        Self {
            seed,
            sabotage,
            fault,
            trial,
            members,
            names,
            rng,
            clocks,
            knows_peers,
            genuine: BTreeSet::new(),
            delayed: Vec::new(),
            counted: BTreeSet::new(),
            sent: BTreeSet::new(),
            events_max,
            findings: Vec::new(),
            forgeries: 0,
            first_vehicle: String::new(),
        }
    }

    pub fn run(mut self) -> Run {
        (0..SLOTS).for_each(|slot| self.slot(slot));
        for slot in SLOTS..SLOTS + 3 {
            self.navigate(slot);
            // No member transmits any more, so no slot may count as missed.
            (0..self.members.len()).for_each(|member| self.stop_listening(member, slot));
        }
        self.check_clocks();
        self.finish()
    }

    /// Checks that every clock is right at the end, also after a time at which it was wrong.
    fn check_clocks(&mut self) {
        let end_s = SLOT_S * (SLOTS + 3) as f64;
        for (number, member) in self.members.iter_mut().enumerate() {
            let clock_s = member.clock_s();
            if clock_s.is_nan() || (clock_s - end_s).abs() > 5.0 * SLOT_S {
                self.findings.push(Finding::WrongClock { vehicle: number, clock_s });
            }
        }
    }

    /// The member with the fault is the last one.
    fn fault_of(&self, member: usize) -> Fault {
        if member == 2 { self.fault } else { Fault::None }
    }

    /// Returns the time that the clock of a member shows.
    fn clock_s(&self, member: usize, slot: usize, time_s: f64) -> f64 {
        let (offset_s, drift) = self.clocks[member];
        let is_ahead = match self.sabotage {
            Sabotage::AdvanceClocks => slot / 6 % 2 == 1 || slot >= SLOTS,
            _ => self.fault_of(member) == Fault::ClockJump && (20..23).contains(&slot),
        };
        time_s + offset_s + drift * time_s + if is_ahead { 3.0 * 3600.0 } else { 0.0 }
    }

    fn submit(&mut self, member: usize, slot: usize, input: Input) -> Vec<Message> {
        let answers = self.members[member].submit(input, slot as u32, &mut self.findings);
        for answer in &answers {
            if let Message::Event(event) = answer {
                let counted = (event.time / SLOT_S).round() as usize - 1;
                self.counted.insert((member, counted));
            }
        }
        answers
    }

    /// Sends a message that is right by the clock of the host. A clock that has jumped may make it late.
    fn submit_right(&mut self, member: usize, slot: usize, input: Input) -> Vec<Message> {
        let answers = self.submit(member, slot, input);
        for answer in &answers {
            // A clock that goes back needs two reports.
            let is_after_jump = self.fault_of(member) == Fault::ClockJump && slot == 23;
            if let Message::Error { fault, .. } = answer
                && fault.code != FaultCode::StoreFailed
                && !(fault.code == FaultCode::WrongTime && is_after_jump)
            {
                let problem = fault.message.clone();
                self.findings.push(Finding::Refused { vehicle: member, slot: slot as u32, problem });
            }
        }
        answers
    }

    fn place(&self, member: usize, time_s: f64) -> Place {
        let at = self.trial.position(member, time_s);
        let shift_m = if self.fault_of(member) == Fault::WrongDatum { 300.0 } else { 0.0 };
        Place { x: Some(at.east_m + shift_m), y: Some(at.north_m), depth: at.depth_m, ..Place::default() }
    }

    /// Every host reports where its vehicle is, and where the others are.
    fn navigate(&mut self, slot: usize) {
        let time_s = SLOT_S * (slot + 1) as f64;
        for member in 0..self.members.len() {
            let time = self.clock_s(member, slot, time_s);
            let position = self.place(member, time_s);
            let nav = Nav { time, clock_sigma: Some(0.5), position, sigma: Some(3.0), surfaced: false };
            self.submit_right(member, slot, Input::Nav(nav));
            let others = if self.knows_peers { self.members.len() } else { 0 };
            for other in (0..others).filter(|&other| other != member) {
                let (id, position) = (self.names[other].clone(), self.place(other, time_s));
                let peer = Peer { time, member: id, position, source: PeerSource::Other };
                self.submit_right(member, slot, Input::Peer(peer));
            }
        }
    }

    /// Lets disks fail.
    fn disturb(&mut self) {
        if matches!(self.sabotage, Sabotage::Mute | Sabotage::DropFrames) {
            // The number of writes depends on the frames that arrive.
            return;
        }
        for member in &mut self.members {
            match self.rng.random_range(0..1000) {
                0..20 => member.disk.lose_power_at(self.rng.random_range(0..40)),
                20..23 => member.disk.fill_at(self.rng.random_range(0..10)),
                _ => {}
            }
        }
    }

    fn slot(&mut self, slot: usize) {
        let time_s = SLOT_S * (slot + 1) as f64;
        self.disturb();
        self.navigate(slot);
        let due: Vec<_> = self.delayed.extract_if(.., |(due, ..)| *due <= slot).collect();
        for (_, receiver, sender, frame) in due {
            self.deliver_frame(slot, receiver, sender, frame, time_s + 0.5);
        }
        let sender = slot % self.members.len();
        let is_used = !self.rng.random_ratio(1, 12);
        let frame = self.transmit(slot, sender, is_used);
        let piggyback = self.piggyback(slot, sender);
        let events: Vec<Event> = self.trial.log.events[2 * slot..2 * slot + 2].to_vec();
        for event in events {
            let receiver = self.names.iter().position(|id| *id == event.receiver_id).unwrap();
            let heard = self.listens(slot, receiver, event.success) && event.success && is_used;
            self.receive(slot, (receiver, sender), heard, frame.as_ref(), piggyback.clone());
        }
        // Some stores that failed are repaired by a restart.
        for member in 0..self.members.len() {
            if self.rng.random_ratio(1, 200) {
                self.members[member].restart(slot as u32, &mut self.findings);
            }
        }
    }

    /// The sender asks for a frame and transmits it, lets it expire, or leaves its slot unused.
    fn transmit(&mut self, slot: usize, sender: usize, is_used: bool) -> Option<Vec<u8>> {
        let time_s = SLOT_S * (slot + 1) as f64;
        let time = self.clock_s(sender, slot, time_s) + 0.9;
        if is_used {
            self.sent.insert(slot);
        }
        let asks = self.rng.random_ratio(4, 5);
        let expires = self.rng.random_ratio(1, 8);
        if !is_used {
            self.submit(sender, slot, Input::NotSent(At { time, kind: None }));
        }
        let answers = match asks {
            true => self.submit(sender, slot, Input::FrameRequest(FrameRequest { time, bytes: 32 })),
            false => Vec::new(),
        };
        let frame = answers.into_iter().find_map(|answer| match answer {
            Message::Frame { token, bytes, .. } => Some((token, bytes.0)),
            _ => None,
        });
        if sender == 0 {
            self.first_vehicle += &format!("{frame:?}\n");
        }
        match frame {
            Some((token, _)) if expires || !is_used => {
                self.submit(sender, slot, Input::Dropped(Token { token }));
                if is_used {
                    self.submit(sender, slot, Input::Sent(At { time, kind: None }));
                }
                None
            }
            Some((token, bytes)) => {
                self.genuine.insert(bytes.clone());
                self.submit(sender, slot, Input::Departed(Departed { token, time }));
                Some(bytes)
            }
            None => {
                if is_used {
                    self.submit(sender, slot, Input::Sent(At { time, kind: None }));
                }
                None
            }
        }
    }

    fn piggyback(&mut self, slot: usize, sender: usize) -> Option<(String, usize)> {
        let time = self.clock_s(sender, slot, SLOT_S * (slot + 1) as f64) + 0.9;
        let answers = self.submit(sender, slot, Input::PiggybackRequest(PiggybackRequest { time, n_bits: 16 }));
        answers.into_iter().find_map(|answer| match answer {
            Message::Piggyback { bits, n_bits, .. } => Some((bits, n_bits)),
            _ => None,
        })
    }

    /// Whether the receiver listens in a slot. Its host reports when it does not.
    fn listens(&mut self, slot: usize, receiver: usize, success: bool) -> bool {
        let is_deaf =
            self.rng.random_ratio(1, 15) || self.sabotage == Sabotage::HideMisses && !success && slot.is_multiple_of(2);
        if is_deaf {
            self.stop_listening(receiver, slot);
        }
        !is_deaf
    }

    /// The host of a receiver reports that it does not listen in a slot.
    fn stop_listening(&mut self, receiver: usize, slot: usize) {
        let time = self.clock_s(receiver, slot, SLOT_S * (slot + 1) as f64);
        let (from, to, not) = (time + 1.0, time + 3.0, Some("busy".into()));
        self.submit_right(receiver, slot, Input::Listening(Listening { from, to, not }));
    }

    /// A receiver hears a message, or not. Frames get lost, are repeated, delayed, damaged or forged.
    fn receive(
        &mut self,
        slot: usize,
        (receiver, sender): (usize, usize),
        heard: bool,
        frame: Option<&Vec<u8>>,
        piggyback: Option<(String, usize)>,
    ) {
        let time_s = SLOT_S * (slot + 1) as f64 + 1.5;
        let time = self.clock_s(receiver, slot, time_s);
        let heard = match self.fault_of(receiver) {
            Fault::Deaf => false,
            Fault::AllHeard => true,
            Fault::Inverted => !heard,
            _ if self.sabotage == Sabotage::TrustLiars && receiver != 0 => !heard,
            _ => heard,
        };
        let fate = self.rng.random_range(0..10);
        let forged = self.forged(sender);
        if !heard {
            return;
        }
        let from = self.names[sender].clone();
        self.submit(receiver, slot, Input::Heard(Heard { time, from: from.clone(), kind: None, frames: Vec::new() }));
        if let Some((bits, n_bits)) = piggyback.filter(|_| !self.is_dropped(receiver, sender)) {
            self.submit(receiver, slot, Input::PiggybackIn(PiggybackIn { time, from, bits, n_bits }));
        }
        if let Some(frame) = frame {
            let late = slot + 1 + self.rng.random_range(0..6);
            match fate {
                0 => self.delayed.push((late, receiver, sender, frame.clone())),
                1 => (0..2).for_each(|_| self.deliver_frame(slot, receiver, sender, frame.clone(), time_s)),
                2 => {}
                _ => self.deliver_frame(slot, receiver, sender, frame.clone(), time_s),
            }
        }
        if let Some(forged) = forged {
            self.deliver_frame(slot, receiver, sender, forged, time_s);
        }
    }

    /// Returns whether the first vehicle must not receive this frame.
    fn is_dropped(&self, receiver: usize, sender: usize) -> bool {
        self.sabotage == Sabotage::DropFrames && (receiver, sender) == (0, 1)
    }

    fn deliver_frame(&mut self, slot: usize, receiver: usize, sender: usize, frame: Vec<u8>, time_s: f64) {
        if self.is_dropped(receiver, sender) {
            return;
        }
        let is_genuine = self.genuine.contains(&frame);
        self.forgeries += u64::from(!is_genuine);
        let (time, link) = (self.clock_s(receiver, slot, time_s), FrameLink::Other);
        let input = Input::FrameIn(FrameIn { time, from: None, bytes: Hex(frame), link });
        let answers = self.submit(receiver, slot, input);
        let counts = answers.iter().any(|answer| matches!(answer, Message::Acknowledgement { counts: true, .. }));
        if counts && !is_genuine {
            self.findings.push(Finding::AcceptedForgery { vehicle: receiver, slot: slot as u32 });
        }
    }

    /// A frame that no member sent: a damaged one, random bytes, or one with a right tag if the key is known.
    fn forged(&mut self, sender: usize) -> Option<Vec<u8>> {
        let choice = self.rng.random_range(0..20);
        let bit: usize = self.rng.random_range(0..256);
        let bytes: Vec<u8> = (0..32).map(|_| self.rng.random()).collect();
        match choice {
            0 => {
                let mut frame = self.genuine.iter().nth(bit % self.genuine.len().max(1))?.clone();
                let byte = bit / 8 % frame.len();
                frame[byte] ^= 1 << (bit % 8);
                Some(frame).filter(|frame| !self.genuine.contains(frame))
            }
            1 => Some(bytes),
            2 if self.sabotage == Sabotage::LeakKey => {
                let agent = self.members[sender].vehicle.agent();
                let layout = agent.team().layout(32).ok()?;
                let blocks = vec![pingmap_packet::Block::empty(layout); layout.blocks];
                let message = MapMessage { sender: sender as u8, counter: 700, model: 0, blocks };
                agent.codec().write(layout, &message).ok()
            }
            _ => None,
        }
    }

    fn finish(mut self) -> Run {
        for number in 0..self.members.len() {
            // The last restart shows that everything acknowledged is there.
            self.members[number].restart(SLOTS as u32, &mut self.findings);
            self.members[number].check_events(self.events_max, &mut self.findings);
        }
        let query = Predict {
            time: None,
            kind: None,
            links: serde_json::from_str(r#"[{"from":{"x":200,"y":200},"to":{"x":700,"y":500}}]"#).unwrap(),
        };
        let answers = self.submit(0, SLOTS, Input::Predict(query));
        self.first_vehicle += &format!("{answers:?}");
        let mut selection = Selection::default();
        for number in 0..2 * SLOTS {
            let (slot, event) = (number / 2, &self.trial.log.events[number]);
            let receiver = self.names.iter().position(|id| *id == event.receiver_id).unwrap();
            let is_faulty = self.fault_of(receiver) != Fault::None;
            if self.sent.contains(&slot) && !is_faulty && !(self.sabotage == Sabotage::TrustLiars) {
                let probability = self.trial.log.true_probability.as_ref().unwrap()[number];
                selection.add(self.counted.contains(&(receiver, slot)), event.success, probability);
            }
        }
        let is_honest = |number: &usize| match self.sabotage {
            Sabotage::TrustLiars => *number == 0,
            _ => self.fault_of(*number) == Fault::None,
        };
        let honest: Vec<&Member> = (0..3).filter(is_honest).map(|number| &self.members[number]).collect();
        let scored: usize = honest.iter().map(|member| member.scored).sum();
        let difference: f64 = honest.iter().map(|member| member.nll[0] - member.nll[1]).sum();
        Run {
            seed: self.seed,
            fault: self.fault,
            selection,
            harm: (scored > 0).then(|| difference / scored as f64),
            crashes: self.members.iter().map(|member| member.crashes).sum(),
            store_failures: self.members.iter().map(|member| member.store_failures).sum(),
            forgeries: self.forgeries,
            transcript: self.members.iter().map(|member| member.transcript.as_str()).collect(),
            first_vehicle: self.first_vehicle,
            findings: self.findings,
        }
    }
}

fn team(trial: &Simulated, names: &[VehicleId], seed: u64, sabotage: Sabotage, events_max: usize) -> Team {
    let positions: Vec<Position> = trial.log.events.iter().flat_map(|event| event.link.ends()).collect();
    let chart = Chart::about(positions.iter().copied());
    let model = Model::isotropic(chart, InputSpec::Positions, dgpc::Shape::Matern52, true, 400.0, 4.0).unwrap();
    let slots = Slots { start_s: SLOT_S, ..Slots::cycle(SLOT_S, names.to_vec()) };
    let team = Team::new(names.to_vec(), model, positions).unwrap();
    let mut limits = team.limits;
    limits.events_max = if sabotage == Sabotage::RaiseLimit { 100_000 } else { events_max };
    let exclusion_threshold_sd = if sabotage == Sabotage::TrustLiars { 1e9 } else { team.exclusion_threshold_sd };
    let piggyback = Some(seed.is_multiple_of(3));
    let bytes = std::array::from_fn(|index| (index as u64 * 37 + seed) as u8);
    let key = Some(Key::new(bytes).unwrap());
    Team { slots, limits, exclusion_threshold_sd, piggyback, key, ..team }
}
