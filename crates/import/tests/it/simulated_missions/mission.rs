//! A simulated mission: its packets, their true outcomes, and the records of all vehicles.

use std::collections::BTreeMap;

use pingmap_agent::{MessageKind, VehicleId};
use pingmap_import::{Arrival, Recording, Recordings, Reply, Rules, Schedule, TransmissionRecord};

use super::kinds::MissionKind;
use super::vehicle::{Vehicle, vehicle_name};
use crate::random::Random;

const SOUND_M_PER_S: f64 = 1500.0;
const SLOTS: usize = 400;

/// Longest time from the end of a message to the answer, in seconds.
const ANSWER_S_MAX: f64 = 3.0;

/// Distance over which the probability of reception changes by a logit, in metres.
const RANGE_SCALE_M: f64 = 250.0;

/// Lengths of packets by kind, in seconds.
const LENGTHS_S: [f64; 4] = [1.0, 2.2, 3.5, 5.0];

/// A packet that a vehicle transmitted.
#[derive(Debug, Clone, Default)]
pub(super) struct Packet {
    pub(super) sender: usize,
    start_s: f64,
    length_s: f64,
    destination: Option<usize>,
    kind: Option<usize>,
    /// The vehicle that answers this packet if it hears it.
    responder: Option<usize>,
    /// The time at which the modem decoded the message that it acknowledges by itself. Only a [`Reply`] records it.
    acknowledged_s: Option<f64>,
}

impl Packet {
    /// Returns whether its sender records it as a transmission.
    pub(super) fn is_recorded(&self) -> bool {
        self.acknowledged_s.is_none()
    }
}

/// One packet at one receiver.
#[derive(Debug, Clone)]
pub(super) struct Opportunity {
    /// Index of the packet.
    pub(super) packet: usize,
    pub(super) receiver: usize,
    decoded_s: f64,
    pub(super) probability: f64,
    /// Whether the receiver transmitted, or its modem was off, while the packet arrived.
    pub(super) is_deaf: bool,
    pub(super) is_heard: bool,
}

/// A mission with its true outcomes.
pub(super) struct Mission {
    vehicles: Vec<Vehicle>,
    pub(super) packets: Vec<Packet>,
    pub(super) opportunities: Vec<Opportunity>,
    pub(super) schedule: Option<Schedule>,
    pub(super) rules: Rules,
    duration_s: f64,
    /// Whether the vehicle with a step of its clock records that satellites set it.
    records_step: bool,
}

/// The next event of the simulation.
enum Step {
    Start(Packet),
    Decode(usize, usize),
}

/// Events in the order of time, in microseconds, and of their addition.
#[derive(Default)]
struct Queue(BTreeMap<(u64, usize), Step>, usize);

impl Queue {
    fn insert(&mut self, time_s: f64, step: Step) {
        self.1 += 1;
        self.0.insert(((1e6 * time_s) as u64, self.1), step);
    }
}

impl Mission {
    /// Simulates a mission. With `clocks_agree`, all clocks are right and the rules state so.
    pub(super) fn new(kind: MissionKind, seed: u64, clocks_agree: bool) -> Self {
        let random = &mut Random::new(1000 * seed + kind as u64);
        let length_s = random.between(1.5, 3.0);
        let longest_s = if kind == MissionKind::MixedLengths { LENGTHS_S[3] } else { length_s };
        let slot_s = longest_s + random.between(3.0, 10.0);
        let duration_s = 100.0 + slot_s * SLOTS as f64;
        let mut vehicles: Vec<Vehicle> =
            (0..3 + random.index(2)).map(|_| Vehicle::random(random, kind, clocks_agree)).collect();
        if random.chance(0.4) {
            let off_s = random.between(500.0, duration_s - 1200.0);
            let vehicle = random.index(vehicles.len());
            vehicles[vehicle].off = Some((off_s, off_s + random.between(200.0, 600.0)));
        }
        if kind == MissionKind::ClockStep {
            let vehicle = random.index(vehicles.len());
            vehicles[vehicle].step =
                Some((duration_s * random.between(0.3, 0.7), vehicles[vehicle].random_step_s(random)));
        }
        let members = (0..vehicles.len()).map(vehicle_name).collect();
        let schedule = Schedule::Cyclic { duration_s: slot_s, restarts_daily: false, orders: vec![(40.0, members)] };
        let mut rules = Rules { message_s: longest_s, ..Rules::default() };
        if clocks_agree {
            rules.clock_offset_s_max = 0.0;
        }
        let has_schedule = random.chance(0.5);
        let records_step = random.chance(0.5);
        let (packets, opportunities) = (Vec::new(), Vec::new());
        let mut mission = Self { vehicles, packets, opportunities, schedule: None, rules, duration_s, records_step };
        let queue = mission.slot_packets(kind, &schedule, length_s, random);
        mission.simulate(kind, queue, random);
        mission.schedule = has_schedule.then_some(schedule);
        mission
    }

    /// Draws the slots that are used, and their packets.
    fn slot_packets(&self, kind: MissionKind, schedule: &Schedule, length_s: f64, random: &mut Random) -> Queue {
        let mut queue = Queue::default();
        let is_acknowledged = kind == MissionKind::Acknowledgements;
        let (use_probability, has_kinds) = (random.between(0.5, 0.8), random.chance(0.5));
        for (sender, vehicle) in self.vehicles.iter().enumerate() {
            for slot_s in schedule.slot_starts_s(&vehicle_name(sender), 0.0, self.duration_s - 30.0) {
                if !random.chance(use_probability) {
                    continue;
                }
                let Some(start_s) = vehicle.true_s(slot_s + random.between(0.0, 0.3)) else { continue };
                let other = (sender + 1 + random.index(self.vehicles.len() - 1)) % self.vehicles.len();
                let length = random.index(LENGTHS_S.len());
                let mut packet = Packet { sender, start_s, length_s, ..Packet::default() };
                match kind {
                    MissionKind::MixedLengths if has_kinds => {
                        (packet.length_s, packet.kind) = (LENGTHS_S[length], Some(length));
                    }
                    MissionKind::MixedLengths => packet.length_s = random.between(LENGTHS_S[0], LENGTHS_S[3]),
                    MissionKind::Acknowledgements | MissionKind::Replies => {
                        packet.responder = Some(other).filter(|_| random.chance(0.6));
                        packet.destination = packet.responder.filter(|_| is_acknowledged);
                    }
                    _ => {}
                }
                queue.insert(start_s, Step::Start(packet));
            }
        }
        queue
    }

    /// Draws the outcome of each packet at each receiver at the end of its arrival, and the answers that follow.
    fn simulate(&mut self, kind: MissionKind, mut queue: Queue, random: &mut Random) {
        let range_m = self.median_range_m() * random.between(0.8, 1.2);
        let has_modem_replies = kind == MissionKind::Acknowledgements && random.chance(0.5);
        while let Some((_, step)) = queue.0.pop_first() {
            let (index, receiver) = match step {
                Step::Start(packet) => {
                    let (start_s, end_s) = (packet.start_s, packet.start_s + packet.length_s);
                    if !self.is_busy(packet.sender, start_s, end_s) {
                        for receiver in (0..self.vehicles.len()).filter(|&receiver| receiver != packet.sender) {
                            let arrival_s = self.range_m(packet.sender, receiver, start_s) / SOUND_M_PER_S;
                            queue.insert(end_s + arrival_s, Step::Decode(self.packets.len(), receiver));
                        }
                        self.packets.push(packet);
                    }
                    continue;
                }
                Step::Decode(index, receiver) => (index, receiver),
            };
            let Packet { sender, start_s, length_s, responder, .. } = self.packets[index];
            let range_m_now = self.range_m(sender, receiver, start_s);
            let arrival_s = start_s + range_m_now / SOUND_M_PER_S;
            let decoded_s = arrival_s + length_s;
            let probability = 1.0 / (1.0 + ((range_m_now - range_m) / RANGE_SCALE_M).exp());
            let is_deaf = self.is_busy(receiver, arrival_s, decoded_s);
            let is_heard = random.chance(probability) && !is_deaf;
            let delay_s = random.between(0.3, ANSWER_S_MAX);
            if is_heard && responder == Some(receiver) {
                let is_short = kind == MissionKind::Acknowledgements;
                let answer = Packet {
                    sender: receiver,
                    start_s: decoded_s + delay_s,
                    length_s: if is_short { 0.4 * length_s } else { length_s },
                    destination: Some(sender).filter(|_| is_short),
                    acknowledged_s: Some(decoded_s).filter(|_| has_modem_replies),
                    ..Packet::default()
                };
                queue.insert(answer.start_s, Step::Start(answer));
            }
            let packet = index;
            self.opportunities.push(Opportunity { packet, receiver, decoded_s, probability, is_deaf, is_heard });
        }
    }

    /// Returns whether a vehicle transmits, or its modem is off, in an interval of true time.
    fn is_busy(&self, vehicle: usize, from_s: f64, to_s: f64) -> bool {
        let overlaps = |packet: &&Packet| packet.start_s < to_s && from_s < packet.start_s + packet.length_s;
        let own_packets = self.packets.iter().rev().take(20).filter(|packet| packet.sender == vehicle);
        self.vehicles[vehicle].is_off(from_s, to_s) || own_packets.into_iter().any(|packet| overlaps(&packet))
    }

    fn range_m(&self, a: usize, b: usize, true_s: f64) -> f64 {
        let (a, b) = (self.vehicles[a].place(true_s), self.vehicles[b].place(true_s));
        (a.0 - b.0).hypot(a.1 - b.1)
    }

    fn median_range_m(&self) -> f64 {
        let pairs = (0..self.vehicles.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        let mut ranges_m: Vec<f64> = pairs
            .flat_map(|(a, b)| (0..40).map(move |n| (a, b, n)))
            .map(|(a, b, n)| self.range_m(a, b, 100.0 * f64::from(n)))
            .collect();
        ranges_m.sort_by(f64::total_cmp);
        ranges_m[ranges_m.len() / 2]
    }

    pub(super) fn vehicles(&self) -> &[Vehicle] {
        &self.vehicles
    }

    /// Returns the time of a packet in the record of its sender.
    pub(super) fn record_s(&self, packet: &Packet) -> f64 {
        let sender = &self.vehicles[packet.sender];
        sender.local_s(packet.start_s + if sender.records_end { packet.length_s } else { 0.0 })
    }

    /// Returns whether the log should have the opportunity if the receiver listened.
    pub(super) fn is_opportunity(&self, opportunity: &Opportunity) -> bool {
        let packet = &self.packets[opportunity.packet];
        packet.is_recorded() && packet.destination.is_none_or(|destination| destination == opportunity.receiver)
    }

    /// Returns the mission with all outcomes inverted and the same transmissions. A deaf receiver still hears nothing.
    pub(super) fn inverted_outcomes(&self) -> Vec<Opportunity> {
        let inverted = |opportunity: &Opportunity| Opportunity {
            is_heard: !opportunity.is_heard && !opportunity.is_deaf,
            ..opportunity.clone()
        };
        self.opportunities.iter().map(inverted).collect()
    }

    /// Makes the records of all vehicles for given outcomes.
    pub(super) fn recordings(&self, outcomes: &[Opportunity]) -> Recordings {
        let mut recordings: Vec<Recording> =
            self.vehicles.iter().map(|vehicle| self.empty_recording(vehicle)).collect();
        let kind = |packet: &Packet| packet.kind.map(|kind| MessageKind::new(format!("rate {kind}")));
        for packet in &self.packets {
            let (sender, recording) = (&self.vehicles[packet.sender], &mut recordings[packet.sender]);
            if let Some(decoded_s) = packet.acknowledged_s {
                let [start_s, end_s] = [0.0, packet.length_s].map(|later_s| sender.local_s(packet.start_s + later_s));
                recording.replies.push(Reply { decoded_s: sender.record_s(decoded_s), start_s, end_s });
                continue;
            }
            let (time_s, destination) = (self.record_s(packet), packet.destination.map(vehicle_name));
            let record = TransmissionRecord { time_s, destination, frames: None, kind: kind(packet), band: None };
            recording.transmissions.get_or_insert_default().push(record);
        }
        for outcome in outcomes.iter().filter(|outcome| outcome.is_heard) {
            let packet = &self.packets[outcome.packet];
            if !packet.is_recorded() {
                continue;
            }
            let arrival = Arrival {
                time_s: self.vehicles[outcome.receiver].record_s(outcome.decoded_s),
                source: vehicle_name(packet.sender),
                destination: packet.destination.map(vehicle_name),
                frame: None,
                frames: None,
                good: true,
                kind: kind(packet),
            };
            recordings[outcome.receiver].arrivals.get_or_insert_default().push(arrival);
        }
        let names = (0..).map(vehicle_name);
        names.zip(recordings).collect::<BTreeMap<VehicleId, Recording>>()
    }

    fn empty_recording(&self, vehicle: &Vehicle) -> Recording {
        let (start_s, end_s) = (0.0, self.duration_s);
        let spans = match vehicle.off {
            Some((off_s, on_s)) => vec![(start_s, off_s), (on_s, end_s)],
            None => vec![(start_s, end_s)],
        };
        let is_set = |step: &(f64, f64)| [(vehicle.local_s(step.0 - 1.0), false), (vehicle.local_s(step.0), true)];
        Recording {
            fixes: vehicle.fixes(self.duration_s),
            transmissions: Some(Vec::new()),
            arrivals: Some(Vec::new()),
            modem_activity: spans.iter().map(|span| (vehicle.local_s(span.0), vehicle.local_s(span.1))).collect(),
            clock_syncs: vehicle.step.iter().filter(|_| self.records_step).flat_map(is_set).collect(),
            ..Recording::default()
        }
    }
}
