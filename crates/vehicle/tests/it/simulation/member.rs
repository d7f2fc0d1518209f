//! One vehicle with its store on a simulated disk.

use std::collections::BTreeMap;
use std::sync::Arc;

use pingmap_agent::{Agent, AgentOptions, Entry, Event, Team, Which};
use pingmap_import::Reference;
use pingmap_vehicle::{Contents, Hello, Identity, Input, Message, Output, PROTOCOL, Store, Vehicle, VehicleConfig};

use crate::common::is_entry;
use crate::sim_disk::SimDisk;
use crate::simulation::checks::Finding;
use crate::simulation::faulty::Sabotage;

/// A vehicle, its store, and what its host knows.
pub struct Member {
    number: usize,
    config: VehicleConfig,
    team: Arc<Team>,
    sabotage: Sabotage,
    pub disk: SimDisk,
    store: Option<Store>,
    pub vehicle: Vehicle,
    /// The content that the store has acknowledged.
    acknowledged: Contents,
    /// The content to which the last failed write had led.
    failed: Option<Contents>,
    appended: u64,
    /// Packets by counter.
    packets: BTreeMap<u16, Vec<u8>>,
    /// A vehicle with the same events alone.
    alone: Agent,
    /// Sums of the NLL of the vehicle and of own events alone, and the number of events.
    pub nll: [f64; 2],
    pub scored: usize,
    pub crashes: u64,
    pub store_failures: u64,
    /// Every message to the host.
    pub transcript: String,
}

fn identity(config: &VehicleConfig, team: &Team) -> Identity {
    Identity { vehicle: config.vehicle.to_string(), team_digest: team.digest() }
}

impl Member {
    pub fn new(number: usize, config: VehicleConfig, team: Arc<Team>, disk: SimDisk, sabotage: Sabotage) -> Self {
        let (store, acknowledged) = Store::open_on(disk.clone(), &identity(&config, &team)).unwrap();
        let vehicle = Vehicle::new(config.clone(), team.clone(), Reference::unknown());
        let alone = Agent::new(config.vehicle.clone(), team.clone(), AgentOptions::default());
        let mut member = Self {
            number,
            config,
            team,
            sabotage,
            disk,
            store: Some(store),
            vehicle,
            acknowledged,
            failed: None,
            appended: 0,
            packets: BTreeMap::new(),
            alone,
            nll: [0.0; 2],
            scored: 0,
            crashes: 0,
            store_failures: 0,
            transcript: String::new(),
        };
        member.greet();
        member
    }

    fn greet(&mut self) {
        let hello = Hello { version: PROTOCOL, vehicle: Some(self.config.vehicle.clone()), team: None };
        let outputs = self.vehicle.handle(Input::Hello(hello));
        assert!(matches!(outputs.as_slice(), [Output::Send(Message::Hello(_))]), "{outputs:?}");
    }

    /// Sends a message to the vehicle and takes the steps that it returns. Returns its answers. A loss of power
    /// restarts it; the message and its answers are then lost.
    pub fn submit(&mut self, input: Input, slot: u32, findings: &mut Vec<Finding>) -> Vec<Message> {
        let mut answers = Vec::new();
        let outputs = self.vehicle.handle(input);
        for output in outputs {
            let (next, stored) = match output {
                Output::Send(message) => {
                    answers.push(message);
                    continue;
                }
                Output::Store(records) => {
                    let mut next = self.acknowledged.clone();
                    next.entries.extend(records.iter().cloned());
                    (next, self.append(&records))
                }
                Output::Base(base) => {
                    let next = Contents { base: Some(base.clone()), entries: Vec::new() };
                    let replaced = self.store.as_mut().map(|store| store.replace_base(&base));
                    (next, replaced.map(|replaced| replaced.map_err(|error| error.to_string())))
                }
            };
            match stored {
                None => {}
                Some(Ok(())) => self.acknowledged = next,
                Some(Err(problem)) if problem.contains("power") => {
                    self.failed = Some(next);
                    self.restart(slot, findings);
                    return Vec::new();
                }
                Some(Err(problem)) => {
                    (self.store, self.failed) = (None, Some(next));
                    self.store_failures += 1;
                    let sent = self.vehicle.store_failed(&problem).into_iter();
                    answers = sent
                        .filter_map(|output| if let Output::Send(message) = output { Some(message) } else { None })
                        .collect();
                    break;
                }
            }
        }
        for message in &answers {
            self.transcript += &pingmap_vehicle::write_line(message);
        }
        self.check_answers(&answers, findings);
        answers
    }

    fn append(&mut self, records: &[Vec<u8>]) -> Option<Result<(), String>> {
        self.appended += 1;
        if self.sabotage == Sabotage::LoseRecord && self.appended.is_multiple_of(10) {
            return Some(Ok(()));
        }
        self.store.as_mut().map(|store| store.append(records).map_err(|error| error.to_string()))
    }

    /// Loses power and starts again.
    pub fn restart(&mut self, slot: u32, findings: &mut Vec<Finding>) {
        self.crashes += 1;
        self.store = None;
        self.disk = self.disk.crash();
        let vehicle = self.number;
        let (store, mut contents) = match Store::open_on(self.disk.clone(), &identity(&self.config, &self.team)) {
            Ok(opened) => opened,
            Err(error) => {
                findings.push(Finding::LostRecords { vehicle, slot, problem: error.to_string() });
                self.disk = SimDisk::new(slot.into());
                Store::open_on(self.disk.clone(), &identity(&self.config, &self.team)).unwrap()
            }
        };
        let failed = self.failed.take();
        let is_whole = failed.is_none();
        if contents != self.acknowledged && Some(&contents) != failed.as_ref() {
            let problem = format!("{} records in place of {}", contents.entries.len(), self.acknowledged.entries.len());
            findings.push(Finding::LostRecords { vehicle, slot, problem });
        }
        self.acknowledged = contents.clone();
        match self.sabotage {
            Sabotage::ForgetOnRestart => {
                let last = contents
                    .entries
                    .iter()
                    .rposition(|record| is_entry(record, |entry| matches!(entry, Entry::Observed { .. })));
                last.map(|last| contents.entries.remove(last));
            }
            Sabotage::ReuseCounters => {
                contents.entries.retain(|record| !is_entry(record, |entry| matches!(entry, Entry::Sent { .. })));
            }
            _ => {}
        }
        let restored = |contents: &Contents| {
            Vehicle::restore(self.config.clone(), self.team.clone(), Reference::unknown(), contents).unwrap()
        };
        let expected = restored(&self.acknowledged).agent().snapshot();
        let live = snapshot_at_end(self.vehicle.agent());
        self.vehicle = restored(&contents);
        // The live vehicle had also handled the interrupted input.
        let is_same_as_live = !is_whole || snapshot_at_end(self.vehicle.agent()) == live;
        if self.vehicle.agent().snapshot() != expected || !is_same_as_live {
            findings.push(Finding::OtherSnapshot { vehicle, slot });
        }
        self.store = Some(store);
        if self.sabotage == Sabotage::CountTwice {
            self.count_last_event_twice();
        }
        self.greet();
    }

    fn count_last_event_twice(&mut self) {
        let Some(event) = self.vehicle.agent().events().last().cloned() else { return };
        let number = self.vehicle.agent().status().next_event;
        let record = [&[0], Entry::Observed { number, event }.to_bytes().as_slice()].concat();
        self.acknowledged.entries.push(record.clone());
        self.store.as_mut().unwrap().append(&[record]).unwrap();
        self.vehicle =
            Vehicle::restore(self.config.clone(), self.team.clone(), Reference::unknown(), &self.acknowledged).unwrap();
    }

    fn check_answers(&mut self, answers: &[Message], findings: &mut Vec<Finding>) {
        for message in answers {
            match message {
                Message::Frame { bytes, .. } => self.check_counter(&bytes.0, findings),
                Message::Event(event) => {
                    if let Some(probability) = event.probability {
                        self.score(event.time, probability);
                    }
                }
                _ => {}
            }
        }
    }

    fn check_counter(&mut self, frame: &[u8], findings: &mut Vec<Finding>) {
        let Ok((_, packet)) = self.vehicle.agent().codec().read(frame) else { return };
        let first = self.packets.entry(packet.counter).or_insert_with(|| frame.to_vec());
        if *first != frame {
            findings.push(Finding::ReusedCounter { vehicle: self.number, counter: packet.counter });
        }
    }

    /// Scores a prediction of the vehicle, and that of own events alone.
    fn score(&mut self, time_s: f64, probability: f64) {
        let event: Option<Event> = self.vehicle.agent().events().rev().find(|event| event.time_s == time_s).cloned();
        let Some(event) = event else { return };
        let own = self.alone.predict([event.query()], Which::Own).unwrap()[0].probability;
        for (sum, p) in self.nll.iter_mut().zip([probability, own]) {
            *sum -= if event.success { p } else { 1.0 - p }.max(1e-9).ln();
        }
        self.scored += 1;
        self.alone.record([event]).unwrap();
        if self.alone.refit_due() {
            self.alone.refit().unwrap();
        }
    }

    /// Returns the time of the vehicle's clock.
    pub fn clock_s(&mut self) -> f64 {
        let outputs = self.vehicle.handle(Input::Status {});
        let status = outputs.into_iter().find_map(|output| match output {
            Output::Send(Message::Status(status)) => Some(status),
            _ => None,
        });
        status.map_or(f64::NAN, |status| status.time)
    }

    /// Checks the events of the vehicle after a run.
    pub fn check_events(&self, events_max: usize, findings: &mut Vec<Finding>) {
        let agent = self.vehicle.agent();
        let mut times = std::collections::BTreeSet::new();
        for event in agent.events() {
            if !times.insert(event.time_s.to_bits()) {
                findings.push(Finding::CountedTwice { vehicle: self.number, time_s: event.time_s });
            }
        }
        if agent.events().len() > events_max {
            findings.push(Finding::OverLimit { vehicle: self.number, events: agent.events().len() });
        }
    }
}

/// The snapshot with the clock at the end of the mission. Inputs that are not stored advance the clock, too.
fn snapshot_at_end(agent: &Agent) -> Vec<u8> {
    let mut agent = agent.clone();
    agent.receive(&[], Some(1e7));
    agent.snapshot()
}
