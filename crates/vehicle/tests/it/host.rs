//! A host with one vehicle, whose store is in memory.

use std::sync::Arc;

use pingmap_agent::{Chart, Entry, InputSpec, Model, Position, Slots, Team, VehicleId};
use pingmap_import::Reference;
use pingmap_vehicle::{
    Answer, At, Contents, End, FaultCode, Heard, Hello, Input, LearnedEvent, Message, Nav, Output, PROTOCOL, Peer,
    PeerSource, PiggybackIn, Place, Predict, QueryLink, StatusReport, Vehicle, VehicleConfig,
};

use crate::common::is_entry;

pub const SLOT_S: f64 = 10.0;

pub fn team() -> Arc<Team> {
    team_with_order(&["ada", "bob"])
}

pub fn team_with_order(order: &[&str]) -> Arc<Team> {
    let model = Model::isotropic(Chart::about([]), InputSpec::Positions, dgpc::Shape::Matern52, true, 400.0, 4.0);
    let names = ["ada", "bob"].map(VehicleId::new);
    let corners = [-1000.0, 1000.0].map(|east_m| Position::new(east_m, east_m));
    let team = Team::new(names.clone(), model.unwrap(), corners).unwrap();
    let order = order.iter().copied().map(VehicleId::new).collect();
    Arc::new(Team { slots: Slots::cycle(SLOT_S, order), ..team })
}

pub fn config(more: &str) -> VehicleConfig {
    VehicleConfig::parse(&format!("schema = 1\nvehicle = \"ada\"\nteam = \"team.toml\"\n{more}")).unwrap()
}

/// A vehicle with its store in memory.
pub struct Host {
    pub vehicle: Vehicle,
    pub contents: Contents,
    pub config: VehicleConfig,
    pub events: Vec<LearnedEvent>,
}

impl Host {
    pub fn new(more: &str) -> Self {
        Self::with_order(more, &["ada", "bob"])
    }

    pub fn with_order(more: &str, order: &[&str]) -> Self {
        let contents = Contents { base: None, entries: Vec::new() };
        Self::with(config(more), team_with_order(order), contents)
    }

    pub fn with(config: VehicleConfig, team: Arc<Team>, contents: Contents) -> Self {
        let vehicle = Vehicle::restore(config.clone(), team, Reference::unknown(), &contents).unwrap();
        Self::greeted(config, contents, vehicle)
    }

    pub fn greeted(config: VehicleConfig, contents: Contents, vehicle: Vehicle) -> Self {
        let mut host = Self { vehicle, contents, config, events: Vec::new() };
        host.greet();
        host
    }

    pub fn greet(&mut self) {
        self.send(Input::Hello(Hello { version: PROTOCOL, vehicle: None, team: None }));
    }

    /// Ends the process. Returns the content of its store.
    pub fn stopped(mut self) -> Contents {
        self.send(Input::Stop {});
        self.contents
    }

    pub fn restarted(self) -> Self {
        let team = Arc::new(self.vehicle.agent().team().clone());
        Self::with(self.config, team, self.contents)
    }

    /// Sends a message, and returns the answer.
    pub fn send(&mut self, input: Input) -> Message {
        let mut answer = None;
        for output in self.vehicle.handle(input) {
            match output {
                Output::Store(records) => self.contents.entries.extend(records),
                Output::Base(base) => self.contents = Contents { base: Some(base), entries: Vec::new() },
                Output::Send(Message::Event(event)) => self.events.push(event),
                Output::Send(message) => answer = Some(message),
            }
        }
        answer.unwrap()
    }

    pub fn nav(&mut self, time: f64) {
        let answer = self.try_nav(time);
        assert!(matches!(answer, Message::Ok { stored: true, .. }), "{answer:?}");
    }

    pub fn try_nav(&mut self, time: f64) -> Message {
        self.send(Input::Nav(Nav { time, clock_sigma: None, position: place(0.0), sigma: None, surfaced: false }))
    }

    pub fn peer(&mut self, time: f64, source: PeerSource) {
        let position = place(300.0);
        self.send(Input::Peer(Peer { time, member: VehicleId::new("bob"), position, source }));
    }

    pub fn hear(&mut self, time: f64) -> Message {
        let from = VehicleId::new("bob");
        self.send(Input::Heard(Heard { time, from, kind: None, frames: Vec::new() }))
    }

    /// Bob's piggybacked bits arrive.
    pub fn receive_bits(&mut self, time: f64, bits: u64) {
        let (from, bits) = (VehicleId::new("bob"), format!("{bits:x}"));
        self.send(Input::PiggybackIn(PiggybackIn { time, from, bits, n_bits: 16 }));
    }

    /// Ten cycles with positions every five seconds. Bob transmits in the second slot of each cycle, and is heard in
    /// these cycles.
    pub fn cycles(&mut self, heard: impl Fn(usize) -> bool, mut disturb: impl FnMut(&mut Self, usize, f64)) {
        for cycle in 0..10 {
            let begin_s = 2.0 * SLOT_S * cycle as f64;
            self.nav(begin_s);
            self.send(Input::Sent(At { time: begin_s + 0.1, kind: None }));
            self.peer(begin_s + 5.0, PeerSource::Other);
            disturb(self, cycle, begin_s + SLOT_S);
            self.nav(begin_s + SLOT_S + 1.0);
            if heard(cycle) {
                self.hear(begin_s + SLOT_S + 2.0);
            }
        }
        self.peer(205.0, PeerSource::Other);
        self.nav(220.0);
    }

    /// One cycle in which Bob is missed. Every event lies elsewhere, so that there is something to summarise.
    pub fn miss_elsewhere(&mut self, cycle: usize) {
        let begin_s = 2.0 * SLOT_S * cycle as f64;
        let at = |east_m: usize| place(40.0 * east_m as f64);
        for time in [begin_s, begin_s + 6.0, begin_s + SLOT_S + 1.0, begin_s + 2.0 * SLOT_S - 1.0] {
            let position = at(cycle % 17);
            self.send(Input::Nav(Nav { time, clock_sigma: None, position, sigma: None, surfaced: false }));
            let (member, position) = (VehicleId::new("bob"), at(cycle * 7 % 23));
            self.send(Input::Peer(Peer { time, member, position, source: PeerSource::Other }));
        }
    }

    /// Returns the number of entries of a kind among the records of the store from `first` on.
    pub fn entries(&self, first: usize, is_wanted: fn(&Entry) -> bool) -> usize {
        self.contents.entries[first..].iter().filter(|record| is_entry(record, is_wanted)).count()
    }

    /// Returns the number of own slots that were reported as unused, among the records from `first` on.
    pub fn unused_slots(&self, first: usize) -> usize {
        self.entries(first, |entry| matches!(entry, Entry::UnusedSlot { .. }))
    }

    pub fn status(&mut self) -> StatusReport {
        match self.send(Input::Status {}) {
            Message::Status(status) => *status,
            other => panic!("{other:?}"),
        }
    }

    pub fn predict(&mut self, east_m: f64) -> Answer {
        let link = QueryLink { from: End::Place(place(east_m)), to: End::Member(VehicleId::new("ada")) };
        match self.send(Input::Predict(Predict { time: None, kind: None, links: vec![link] })) {
            Message::Prediction { mut links, .. } => links.remove(0),
            other => panic!("{other:?}"),
        }
    }
}

pub fn place(east_m: f64) -> Place {
    Place { x: Some(east_m), y: Some(0.0), ..Place::default() }
}

pub fn code(message: &Message) -> FaultCode {
    match message {
        Message::Error { fault, .. } => fault.code,
        other => panic!("{other:?}"),
    }
}
