//! One vehicle as a state machine: which slots count, and what its host learns.

use std::sync::Arc;

use pingmap_agent::{Chart, Entry, InputSpec, Model, Position, Slots, Team, VehicleId};
use pingmap_import::Reference;
use pingmap_packet::OutcomeBitmap;
use pingmap_vehicle::{
    Answer, At, Contents, Departed, End, FaultCode, FrameIn, FrameLink, FrameRequest, Heard, Hello, Hex, Input,
    LearnedEvent, Listening, Message, Nav, Nmea, Output, PROTOCOL, Peer, PeerSource, PiggybackIn, Place, Predict,
    QueryLink, StatusReport, StoreState, Token, Vehicle, VehicleConfig,
};

const SLOT_S: f64 = 10.0;

fn team() -> Arc<Team> {
    team_with_order(&["ada", "bob"])
}

fn team_with_order(order: &[&str]) -> Arc<Team> {
    let model = Model::isotropic(Chart::about([]), InputSpec::Positions, dgpc::Shape::Matern52, true, 400.0, 4.0);
    let names = ["ada", "bob"].map(VehicleId::new);
    let corners = [-1000.0, 1000.0].map(|east_m| Position::new(east_m, east_m));
    let team = Team::new(names.clone(), model.unwrap(), corners).unwrap();
    let order = order.iter().copied().map(VehicleId::new).collect();
    Arc::new(Team { slots: Slots::cycle(SLOT_S, order), ..team })
}

fn config(more: &str) -> VehicleConfig {
    VehicleConfig::parse(&format!("schema = 1\nvehicle = \"ada\"\nteam = \"team.toml\"\n{more}")).unwrap()
}

/// A vehicle with its store in memory.
struct Host {
    vehicle: Vehicle,
    contents: Contents,
    config: VehicleConfig,
    events: Vec<LearnedEvent>,
}

impl Host {
    fn new(more: &str) -> Self {
        Self::with_order(more, &["ada", "bob"])
    }

    fn with_order(more: &str, order: &[&str]) -> Self {
        let contents = Contents { base: None, entries: Vec::new() };
        Self::with(config(more), team_with_order(order), contents)
    }

    fn with(config: VehicleConfig, team: Arc<Team>, contents: Contents) -> Self {
        let vehicle = Vehicle::restore(config.clone(), team, Reference::unknown(), &contents).unwrap();
        Self::greeted(config, contents, vehicle)
    }

    fn greeted(config: VehicleConfig, contents: Contents, vehicle: Vehicle) -> Self {
        let mut host = Self { vehicle, contents, config, events: Vec::new() };
        host.send(Input::Hello(Hello { version: PROTOCOL, vehicle: None, team: None }));
        host
    }

    /// Ends the process. Returns the content of its store.
    fn stopped(mut self) -> Contents {
        self.send(Input::Stop {});
        self.contents
    }

    fn restarted(self) -> Self {
        let team = Arc::new(self.vehicle.agent().team().clone());
        Self::with(self.config, team, self.contents)
    }

    /// Sends a message, and returns the answer.
    fn send(&mut self, input: Input) -> Message {
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

    fn nav(&mut self, time: f64) {
        let nav = Nav { time, clock_sigma: None, position: place(0.0), sigma: None, surfaced: false };
        assert!(matches!(self.send(Input::Nav(nav)), Message::Ok { stored: true, .. }));
    }

    fn peer(&mut self, time: f64, source: PeerSource) {
        let position = place(300.0);
        self.send(Input::Peer(Peer { time, member: VehicleId::new("bob"), position, source }));
    }

    fn hear(&mut self, time: f64) -> Message {
        let from = VehicleId::new("bob");
        self.send(Input::Heard(Heard { time, from, kind: None, frames: Vec::new() }))
    }

    /// Ten cycles with positions every five seconds. Bob transmits in the second slot of each cycle, and is heard in
    /// these cycles.
    fn cycles(&mut self, heard: impl Fn(usize) -> bool, mut disturb: impl FnMut(&mut Self, usize, f64)) {
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
    fn miss_elsewhere(&mut self, cycle: usize) {
        let begin_s = 2.0 * SLOT_S * cycle as f64;
        let at = |east_m: usize| place(40.0 * east_m as f64);
        for time in [begin_s, begin_s + 6.0, begin_s + SLOT_S + 1.0, begin_s + 2.0 * SLOT_S - 1.0] {
            let position = at(cycle % 17);
            self.send(Input::Nav(Nav { time, clock_sigma: None, position, sigma: None, surfaced: false }));
            let (member, position) = (VehicleId::new("bob"), at(cycle * 7 % 23));
            self.send(Input::Peer(Peer { time, member, position, source: PeerSource::Other }));
        }
    }

    fn status(&mut self) -> StatusReport {
        match self.send(Input::Status {}) {
            Message::Status(status) => *status,
            other => panic!("{other:?}"),
        }
    }

    fn predict(&mut self, east_m: f64) -> Answer {
        let link = QueryLink { from: End::Place(place(east_m)), to: End::Member(VehicleId::new("ada")) };
        match self.send(Input::Predict(Predict { time: None, kind: None, links: vec![link] })) {
            Message::Prediction { mut links, .. } => links.remove(0),
            other => panic!("{other:?}"),
        }
    }
}

fn place(east_m: f64) -> Place {
    Place { x: Some(east_m), y: Some(0.0), ..Place::default() }
}

fn code(message: &Message) -> FaultCode {
    match message {
        Message::Error { fault, .. } => fault.code,
        other => panic!("{other:?}"),
    }
}

#[test]
fn every_slot_of_a_peer_counts_as_heard_or_missed() {
    let mut host = Host::new("");
    host.cycles(|cycle| cycle % 3 == 0, |_, _, _| {});
    let outcomes: Vec<bool> = host.events.iter().map(|event| event.heard).collect();
    assert_eq!(outcomes, [true, false, false, true, false, false, true, false, false, true]);
    assert!(host.events.iter().all(|event| event.probability.is_some() && event.by_range.is_some()));
    assert_eq!(host.status().own_events, 10);
    assert_eq!(host.vehicle.agent().events().next().unwrap().link.transmitter, Position::new(300.0, 0.0));
}

#[test]
fn whether_a_slot_counts_does_not_depend_on_whether_it_was_heard() {
    let counted = |heard: bool| {
        let mut host = Host::new("");
        host.cycles(
            |_| heard,
            |host, cycle, begin_s| match cycle {
                2 => {
                    let (from, to, not) = (begin_s + 4.0, begin_s + 5.0, Some("pinging".into()));
                    host.send(Input::Listening(Listening { from, to, not }));
                }
                4 => {
                    let position = place(0.0);
                    let nav = Nav { time: begin_s, clock_sigma: None, position, sigma: None, surfaced: true };
                    host.send(Input::Nav(nav));
                }
                6 => {
                    let position = place(0.0);
                    let nav = Nav { time: begin_s, clock_sigma: Some(4.0), position, sigma: None, surfaced: false };
                    host.send(Input::Nav(nav));
                }
                _ => {}
            },
        );
        let times: Vec<f64> = host.events.iter().map(|event| event.time).collect();
        (times, host.status().excluded_slots)
    };
    let (times, excluded) = counted(true);
    assert_eq!((times.clone(), excluded.clone()), counted(false));
    assert_eq!(times, [10.0, 30.0, 70.0, 110.0, 150.0, 170.0, 190.0]);
    let reasons: Vec<(&str, u64)> = excluded.iter().map(|(reason, &count)| (reason.as_str(), count)).collect();
    assert_eq!(reasons, [("clock uncertain", 1), ("pinging", 1), ("surfaced", 1)]);
}

#[test]
fn slots_do_not_count_across_a_restart_or_a_gap_without_inputs() {
    let mut host = Host::new("clock.gap_s = 60");
    host.cycles(|_| true, |_, _, _| {});
    // The slot from 230 s on is under way when the process ends.
    host.peer(225.0, PeerSource::Other);
    host.hear(231.0);
    let before = host.status().own_events;
    let mut host = host.restarted();
    assert_eq!(host.status().own_events, before);
    host.nav(235.0);
    for time_s in [245.0, 255.0, 265.0] {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    // Slot 23 is excluded, slot 25 counts, and the slots in the gap do not.
    host.nav(400.0);
    host.nav(460.0);
    let times: Vec<f64> = host.events.iter().map(|event| event.time).collect();
    assert_eq!(times, [250.0, 410.0, 430.0, 450.0][..times.len()], "{times:?}");
    let excluded = host.status().excluded_slots;
    assert!(excluded["the vehicle was not running"] >= 1 && excluded["no input from the host"] >= 5, "{excluded:?}");
}

#[test]
fn outcomes_without_positions_count_when_positions_arrive() {
    let mut host = Host::new("");
    for cycle in 0..5 {
        let begin_s = 2.0 * SLOT_S * f64::from(cycle);
        host.nav(begin_s);
        host.nav(begin_s + SLOT_S + 1.0);
        host.hear(begin_s + SLOT_S + 2.0);
    }
    host.nav(120.0);
    let status = host.status();
    assert_eq!((status.own_events, status.located_events, status.unlocated_events), (0, 0, 5));
    assert!(host.events.iter().all(|event| event.probability.is_none()));
    host.peer(0.0, PeerSource::Other);
    host.peer(110.0, PeerSource::Other);
    let status = host.status();
    assert_eq!((status.located_events, status.unlocated_events), (5, 0));
}

#[test]
fn a_reception_after_its_slot_was_counted_is_reported_as_late() {
    let mut host = Host::new("");
    host.cycles(|_| false, |_, _, _| {});
    host.hear(12.0);
    assert_eq!(host.status().late_receptions, 1);
    assert_eq!(host.status().own_events, 10);
}

#[test]
fn trust_follows_from_predictions_that_were_made_before_the_events() {
    let mut host = Host::new("");
    host.nav(0.0);
    let before = host.predict(300.0);
    assert!(!before.trusted && before.reason.unwrap().starts_with("0 of 20 events"));
    host.cycles(|_| true, |_, _, _| {});
    let trust = host.status().trust;
    let nll = |of: fn(&LearnedEvent) -> Option<f64>| {
        host.events.iter().map(|event| -of(event).unwrap().ln()).sum::<f64>() / host.events.len() as f64
    };
    assert!((trust.map_nll.unwrap() - nll(|event| event.probability)).abs() < 1e-9);
    assert!((trust.range_nll.unwrap() - nll(|event| event.by_range)).abs() < 1e-9);
    let evidence = 10.0 * (trust.range_nll.unwrap() - trust.map_nll.unwrap());
    assert!((trust.map_weight - 1.0 / (1.0 + (-evidence).exp())).abs() < 1e-9);
    let after = host.predict(300.0);
    assert!(!after.trusted && after.reason.unwrap().starts_with("10 of 20 events"));
    assert!(after.low <= after.probability && after.probability <= after.high && after.probability > 0.8);
    let restored = host.restarted().status().trust;
    assert_eq!(restored, trust);
}

#[test]
fn positions_in_messages_alone_give_scores_that_do_not_depend_on_the_outcome() {
    // The position has the time at which it arrived, or the earlier time at which Bob measured it.
    for lead_s in [0.0, 6.0, 20.0, -8.5] {
        let scored = |heard: bool| {
            let mut host = Host::new("");
            for cycle in 0..12 {
                let begin_s = 2.0 * SLOT_S * f64::from(cycle);
                host.nav(begin_s);
                host.nav(begin_s + SLOT_S + 1.0);
                // Bob is heard in the first cycle. A message gives his position.
                if cycle == 0 || heard {
                    host.hear(begin_s + SLOT_S + 2.0);
                    host.peer(begin_s + SLOT_S + 2.0 - lead_s, PeerSource::Message);
                }
            }
            host.nav(260.0);
            host.events.iter().map(|event| (event.time, event.probability.is_some())).collect::<Vec<_>>()
        };
        let (heard, missed) = (scored(true), scored(false));
        assert!(!heard[0].1 && heard[1..].iter().all(|event| event.1), "{heard:?}");
        assert_eq!(heard, missed);
    }
}

#[test]
fn before_any_event_the_answer_is_that_of_the_conservative_range() {
    let mut host = Host::new("conservative_range_m = 500");
    host.nav(0.0);
    let [near, middle, far] = [0.0, 500.0, 1000.0].map(|east_m| host.predict(east_m));
    assert!((middle.probability - 0.5).abs() < 1e-12 && middle.probability == middle.by_range);
    assert!((near.probability + far.probability - 1.0).abs() < 1e-12 && near.probability > 0.98);
    assert!(near.low <= near.probability && near.probability <= near.high);
    host.cycles(|_| true, |_, _, _| {});
    let after = host.predict(500.0);
    assert!(after.probability > 0.5 && (after.by_range - 0.5).abs() < 1e-12);
}

#[test]
fn a_prediction_uses_no_data_that_arrived_in_its_slot() {
    // Bob's bits say that he heard Ada, and arrive with the last message.
    let bits = OutcomeBitmap { slot_mod: 18, outcomes: vec![true; 10] }.encode();
    let predicted = |receives_bits: bool| {
        let mut host = Host::new("");
        host.cycles(
            |cycle| cycle < 9,
            |host, cycle, begin_s| {
                if cycle == 9 && receives_bits {
                    let (from, bits, n_bits) = (VehicleId::new("bob"), format!("{bits:x}"), 16);
                    host.send(Input::PiggybackIn(PiggybackIn { time: begin_s + 2.0, from, bits, n_bits }));
                }
            },
        );
        (host.events.last().unwrap().probability.unwrap(), host.status().located_events)
    };
    let ((without, none), (with, some)) = (predicted(false), predicted(true));
    assert!(none == 0 && some > 0, "{some}");
    assert_eq!(without, with);
}

#[test]
fn the_predictions_of_a_heard_and_of_a_missed_slot_use_the_same_events() {
    // Bob has two slots in a row. The first of them counts while the second one lasts.
    let predicted = |is_last_heard: bool| {
        let mut host = Host::with_order("", &["ada", "bob", "bob"]);
        for second in 0..122 {
            let time_s = f64::from(second);
            host.nav(time_s);
            host.peer(time_s, PeerSource::Other);
            let is_last = second == 112;
            if second % 10 == 2 && second % 30 > 10 && (is_last_heard || !is_last) {
                let frames = vec![Hex(vec![0; 32])];
                host.send(Input::Heard(Heard { time: time_s, from: VehicleId::new("bob"), kind: None, frames }));
            }
        }
        host.nav(126.0);
        let last = host.events.pop().unwrap();
        assert_eq!((last.time, last.heard), (110.0, is_last_heard));
        last.probability.unwrap()
    };
    assert_eq!(predicted(true), predicted(false));
}

#[test]
fn a_slot_that_continues_counts_after_its_last_part() {
    let mut host = Host::with_order("", &["ada", "bob", "", ""]);
    host.nav(0.0);
    for time_s in [10.0, 20.0, 30.0, 38.0] {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    assert_eq!(host.events, []);
    // The message ends in the last part of the slot.
    host.hear(39.0);
    host.nav(46.0);
    assert_eq!(host.events.iter().map(|event| (event.time, event.heard)).collect::<Vec<_>>(), [(10.0, true)]);
    assert_eq!(host.status().late_receptions, 0);
}

#[test]
fn receptions_and_positions_of_peers_do_not_move_the_clock() {
    let counted = |is_heard: bool| {
        let mut host = Host::new("clock.gap_s = 60");
        host.nav(0.0);
        host.peer(0.0, PeerSource::Other);
        host.peer(190.0, PeerSource::Other);
        for cycle in 0..9 {
            let begin_s = 2.0 * SLOT_S * f64::from(cycle);
            if is_heard {
                host.hear(begin_s + SLOT_S + 2.0);
            }
        }
        assert_eq!(host.status().time, 0.0);
        [189.0, 190.0, 196.0].into_iter().for_each(|time_s| host.nav(time_s));
        (host.events.len(), host.status().excluded_slots)
    };
    assert_eq!(counted(true), counted(false));
    assert_eq!(counted(true).0, 0);
}

#[test]
fn a_single_wrong_time_does_not_move_the_clock() {
    let mut host = Host::new("");
    host.cycles(
        |_| true,
        |host, cycle, _| {
            if cycle == 4 {
                host.nav(50_000.0)
            }
        },
    );
    assert_eq!(host.events.len(), 10);
    // The second report confirms that time has passed.
    host.nav(5000.0);
    assert_eq!(host.status().time, 220.0);
    host.nav(5001.0);
    assert_eq!(host.status().time, 5001.0);
    // A gap of more than a day is refused once.
    let nav = |time| Input::Nav(Nav { time, clock_sigma: None, position: place(0.0), sigma: None, surfaced: false });
    assert_eq!(code(&host.send(nav(1e6))), FaultCode::WrongTime);
    assert_eq!(host.status().time, 5001.0);
    host.nav(1e6 + 1.0);
    assert_eq!(host.status().time, 1e6 + 1.0);
}

#[test]
fn a_wrong_first_time_does_not_stop_the_count() {
    for wrong_s in [1e6, 0.0] {
        let mut host = Host::new("");
        host.nav(wrong_s);
        let counted = |host: &mut Host, first_s: f64| {
            for time_s in (0..5).map(|n| first_s + 10.0 * f64::from(n)) {
                host.peer(time_s, PeerSource::Other);
                host.nav(time_s);
            }
            host.events.iter().filter(|event| event.time >= first_s).count()
        };
        assert_eq!(counted(&mut host, 20_001.0), 1, "{:?}", host.events);
        // The same after a restart.
        let mut host = host.restarted();
        host.nav(wrong_s);
        assert_eq!(counted(&mut host, 40_001.0), 1, "{:?}", host.events);
    }
}

#[test]
fn reports_that_are_rarer_than_the_gap_move_the_clock_and_count_no_slot() {
    let mut host = Host::new("clock.gap_s = 60");
    (0..6).for_each(|n| host.nav(90.0 * f64::from(n)));
    let status = host.status();
    assert!(status.time >= 360.0, "{}", status.time);
    assert_eq!(host.events, []);
    assert!(status.excluded_slots["no input from the host"] >= 10, "{:?}", status.excluded_slots);
}

#[test]
fn wrong_times_and_places_change_nothing_about_surfacing() {
    let counted = |disturb: &dyn Fn(&mut Host)| {
        let mut host = Host::new("");
        let nav =
            |time, x, surfaced| Input::Nav(Nav { time, clock_sigma: None, position: place(x), sigma: None, surfaced });
        for time_s in (0..30).map(|n| 5.0 * f64::from(n)) {
            host.peer(time_s, PeerSource::Other);
            host.send(nav(time_s, 0.0, (50.0..100.0).contains(&time_s)));
            if time_s == 60.0 {
                disturb(&mut host);
            }
        }
        (host.events.iter().map(|event| event.time).collect::<Vec<_>>(), host.status().excluded_slots)
    };
    let expected = counted(&|_| {});
    assert_eq!(expected.0, [10.0, 30.0, 110.0, 130.0]);
    let wrong_time = |host: &mut Host| host.nav(50_000.0);
    assert_eq!(counted(&wrong_time), expected);
    let wrong_place = |host: &mut Host| {
        let nav = Nav { time: 75.0, clock_sigma: None, position: place(4e5), sigma: None, surfaced: false };
        assert_eq!(code(&host.send(Input::Nav(nav))), FaultCode::WrongPlace);
        assert_eq!(host.status().time, 60.0);
    };
    assert_eq!(counted(&wrong_place), expected);
}

#[test]
fn a_team_that_is_used_again_gets_no_counter_twice() {
    let mut host = Host::new("sharing.reports = false");
    let request = |host: &mut Host, time: f64| match host.send(Input::FrameRequest(FrameRequest { time, bytes: 32 })) {
        Message::Frame { bytes, .. } => host.vehicle.agent().codec().read(&bytes.0).unwrap().1.counter,
        other => panic!("{other:?}"),
    };
    (0..10).for_each(|cycle| host.miss_elsewhere(cycle));
    let first = request(&mut host, 200.0);
    let other = Arc::new(Team { epoch: 1, ..(*team()).clone() });
    let adopted = |host: Host, team: Arc<Team>| {
        let (config, former) = (host.config.clone(), host.vehicle.agent().team().digest());
        let contents = host.contents;
        let vehicle = Vehicle::adopt(config.clone(), team, Reference::unknown(), &contents, &former).unwrap();
        let mut host = Host::greeted(config, Contents::default(), vehicle);
        // The base is in the store from the begin on.
        host.contents.base = host.vehicle.handle(Input::Stop {}).into_iter().find_map(|output| match output {
            Output::Base(base) => Some(base),
            _ => None,
        });
        host
    };
    let mut host = adopted(host, other);
    assert_eq!(request(&mut host, 260.0), 0);
    let mut host = adopted(host, team());
    assert!(request(&mut host, 280.0) > first);
}

#[test]
fn a_slot_that_was_not_counted_before_a_restart_does_not_count() {
    let restarted = |is_heard: bool| {
        let mut host = Host::new("slots.settle_s = 15");
        host.cycles(|_| true, |_, _, _| {});
        // The slot from 210 s on has ended, and is not counted yet.
        if is_heard {
            host.hear(212.0);
        }
        host.nav(224.0);
        let mut host = host.restarted();
        // A late report is no sign that the vehicle ran.
        host.nav(223.0);
        host.peer(224.0, PeerSource::Other);
        host.nav(224.5);
        host.nav(240.0);
        (host.events.len(), host.status().excluded_slots["the vehicle was not running"])
    };
    assert_eq!(restarted(true), (0, 1));
    assert_eq!(restarted(false), (0, 1));
}

#[test]
fn an_own_slot_before_the_start_is_not_reported_as_unused() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    host.contents.entries.clear();
    // The vehicle was deaf for another reason, too.
    let (from, to, not) = (221.0, 239.0, Some("pinging".into()));
    host.send(Input::Listening(Listening { from, to, not }));
    let mut host = host.restarted();
    host.nav(238.0);
    host.nav(250.0);
    let unused = host.contents.entries.iter().filter(|record| record.get(2) == Some(&6)).count();
    assert_eq!(unused, 0);
}

#[test]
fn a_reception_that_is_reported_twice_is_not_late() {
    let mut host = Host::new("");
    host.cycles(|cycle| cycle == 9, |_, _, _| {});
    host.hear(192.5);
    assert_eq!(host.status().late_receptions, 0);
    host.hear(172.5);
    assert_eq!(host.status().late_receptions, 1);
}

#[test]
fn receptions_in_a_slot_of_another_member_are_one_outcome() {
    let mut host = Host::new("");
    [0.0, 0.5].into_iter().for_each(|time_s| host.nav(time_s));
    (0..50).for_each(|n| drop(host.hear(1.0 + 0.1 * f64::from(n))));
    let outcomes = host.contents.entries.iter().filter(|record| {
        record.first() == Some(&0) && matches!(Entry::from_bytes(&record[1..]), Ok(Entry::Outcome { .. }))
    });
    assert_eq!(outcomes.count(), 1);
}

#[test]
fn an_adopted_store_keeps_events_and_forgets_slots_and_frames() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let request = Input::FrameRequest(FrameRequest { time: 220.0, bytes: 32 });
    assert!(matches!(host.send(request.clone()), Message::Frame { .. }));
    host.nav(260.0);
    let other =
        Arc::new(Team { epoch: 1, slots: Slots { start_s: 100.0, ..team().slots.clone() }, ..(*team()).clone() });
    let stopped = Host { contents: host.contents.clone(), ..Host::new("") };
    for contents in [host.contents.clone(), stopped.restarted().stopped()] {
        let vehicle =
            Vehicle::adopt(host.config.clone(), other.clone(), Reference::unknown(), &contents, &team().digest());
        let vehicle = vehicle.unwrap();
        let mut adopted = Host::greeted(host.config.clone(), Contents::default(), vehicle);
        let (before, after) = (host.status(), adopted.status());
        assert_eq!((after.own_events, after.trust, after.open_frames), (before.own_events, before.trust, 0));
        assert_eq!(after.excluded_slots, before.excluded_slots);
        for time_s in (0..14).map(|n| 265.0 + 5.0 * f64::from(n)) {
            adopted.peer(time_s, PeerSource::Other);
            adopted.nav(time_s);
        }
        // The slots of the new schedule count from the first report on.
        let times: Vec<f64> = adopted.events.iter().map(|event| event.time).collect();
        assert_eq!(times, [270.0, 290.0, 310.0]);
        let request = FrameRequest { time: 330.0, bytes: 32 };
        assert!(matches!(adopted.send(Input::FrameRequest(request)), Message::Frame { .. }));
    }
}

#[test]
fn a_restart_and_a_base_keep_everything() {
    let mut host = Host::new("store.snapshot_interval_s = 50");
    host.cycles(|cycle| cycle % 2 == 0, |_, _, _| {});
    assert!(host.contents.base.is_some());
    let (snapshot, status, answer) = (host.vehicle.agent().snapshot(), host.status(), host.predict(200.0));
    let mut host = host.restarted();
    assert!(host.vehicle.agent().snapshot() == snapshot);
    // The live vehicle absorbed the last events, and the restarted one fitted all of them.
    assert!((host.predict(200.0).probability - answer.probability).abs() < 1e-3);
    assert_eq!(StatusReport { input: status.input, ..host.status() }, status);
}

#[test]
fn a_dropped_frame_is_sent_again_and_tokens_are_checked() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let request = |host: &mut Host, time: f64| match host.send(Input::FrameRequest(FrameRequest { time, bytes: 32 })) {
        Message::Frame { token, bytes, .. } => Some((token, bytes)),
        Message::Nothing { .. } => None,
        other => panic!("{other:?}"),
    };
    let (first, bytes) = request(&mut host, 240.0).unwrap();
    host.send(Input::Dropped(Token { token: first }));
    let (second, again) = request(&mut host, 240.0).unwrap();
    assert!(second > first && again == bytes);
    assert_eq!(host.status().open_frames, 1);
    host.send(Input::Departed(Departed { token: second, time: 240.5 }));
    assert_eq!(host.status().open_frames, 0);
    assert_eq!(code(&host.send(Input::Dropped(Token { token: 99 }))), FaultCode::UnknownToken);
    let small = host.send(Input::FrameRequest(FrameRequest { time: 260.0, bytes: 5 }));
    assert_eq!(code(&small), FaultCode::OutOfBounds);
}

#[test]
fn recoveries_from_the_last_snapshot_use_no_counter_twice() {
    const WINDOW: u16 = 6;
    let team = Arc::new(Team { packets_per_sender_max: WINDOW, ..(*team()).clone() });
    // Snapshots by time are rare, so that the counters must ask for them.
    let more = "sharing.reports = false\nstore.snapshot_interval_s = 1e5";
    for (fails_from, expected_refusals) in [(60, false), (5, true)] {
        let mut host = Host::with(config(more), team.clone(), Contents::default());
        let (mut counters, mut refusals) = (std::collections::BTreeSet::new(), 0);
        let mut snapshot: Option<Vec<u8>> = None;
        for cycle in 0..60 {
            let begin_s = 2.0 * SLOT_S * cycle as f64;
            host.miss_elsewhere(cycle);
            for output in host.vehicle.handle(Input::FrameRequest(FrameRequest { time: begin_s + 20.0, bytes: 32 })) {
                match output {
                    Output::Base(_) if cycle >= fails_from => host.vehicle.snapshot_failed(),
                    Output::Base(base) => snapshot = Some(base),
                    Output::Send(Message::Frame { bytes, .. }) => {
                        let (_, packet) = host.vehicle.agent().codec().read(&bytes.0).unwrap();
                        assert!(counters.insert(packet.counter), "counter {} twice", packet.counter);
                    }
                    Output::Send(Message::Error { fault, .. }) => {
                        assert_eq!(fault.code, FaultCode::StoreFailed);
                        refusals += 1;
                    }
                    _ => {}
                }
            }
            // The store is damaged.
            if let Some(base) = snapshot.take_if(|_| cycle % 11 == 10) {
                let contents = Contents { base: Some(base), entries: Vec::new() };
                let restored = Vehicle::restore(config(more), team.clone(), Reference::unknown(), &contents);
                let mut vehicle = restored.unwrap();
                snapshot = Some(vehicle.note_recovery(true, "damage"));
                host = Host::greeted(config(more), contents, vehicle);
            }
        }
        assert!(counters.len() >= WINDOW.into(), "{counters:?}");
        assert_eq!(refusals > 0, expected_refusals, "{refusals}");
    }
}

#[test]
fn after_a_failure_of_the_store_the_vehicle_continues_in_memory_and_sends_nothing() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let outputs = host.vehicle.store_failed("no space left");
    assert!(matches!(&outputs[0], Output::Send(Message::Error { fault, .. }) if fault.code == FaultCode::StoreFailed));
    assert!(matches!(host.status().store, StoreState::Failed { .. }));
    let request = Input::FrameRequest(FrameRequest { time: 240.0, bytes: 32 });
    assert_eq!(code(&host.send(request)), FaultCode::StoreFailed);
    let nav = Nav { time: 241.0, clock_sigma: None, position: place(0.0), sigma: None, surfaced: false };
    assert!(matches!(host.send(Input::Nav(nav)), Message::Ok { stored: false, .. }));
    assert!(host.predict(100.0).probability > 0.5);
}

#[test]
fn a_frame_by_an_acoustic_link_names_its_sender_and_shows_that_its_slot_was_heard() {
    let mut host = Host::new("");
    host.nav(0.0);
    let bytes = Hex(vec![0; 32]);
    let nameless = FrameIn { time: 11.0, from: None, bytes: bytes.clone(), link: FrameLink::Acoustic };
    assert_eq!(code(&host.send(Input::FrameIn(nameless))), FaultCode::WrongField);
    host.peer(5.0, PeerSource::Other);
    let frame = FrameIn { time: 11.0, from: Some(VehicleId::new("bob")), bytes, link: FrameLink::Acoustic };
    // A damaged frame is a reception all the same.
    assert!(matches!(host.send(Input::FrameIn(frame)), Message::Acknowledgement { counts: false, .. }));
    host.peer(25.0, PeerSource::Other);
    host.nav(30.0);
    assert_eq!(host.events.iter().map(|event| event.heard).collect::<Vec<_>>(), [true]);
}

#[test]
fn sentences_of_a_modem_show_receptions_and_transmissions() {
    let mut host = Host::new("[modem_ids]\n1 = \"ada\"\n2 = \"bob\"\n");
    host.nav(0.0);
    let mut say = |time: f64, sentence: &str| {
        let answer = host.send(Input::Nmea(Nmea { time, sentence: sentence.into() }));
        assert!(matches!(answer, Message::Ok { .. }), "{answer:?}");
    };
    say(10.5, "$CACYC,0,2,1,0,0,1");
    say(13.0, "$CARXD,2,1,0,1,00FF");
    say(14.0, "$CACST,0,120013,0,2,1,0,0,0,0,0,0,0");
    // No later sentence ends the message.
    host.peer(5.0, PeerSource::Other);
    host.peer(25.0, PeerSource::Other);
    host.nav(30.0);
    assert_eq!(host.events.iter().map(|event| event.heard).collect::<Vec<_>>(), [true]);
    let wrong = host.send(Input::Nmea(Nmea { time: 31.0, sentence: "$CARXD,2,1*00".into() }));
    assert_eq!(code(&wrong), FaultCode::WrongField);
}

#[test]
fn own_slots_without_a_transmission_are_reported_as_unused() {
    let unused = |reports: bool| {
        let mut host = Host::new(&format!("slots.reports_transmissions = {reports}"));
        host.cycles(|_| true, |_, _, _| {});
        // Two further own slots, from 220 s and from 240 s on, have no transmission.
        for time_s in [230.0, 245.0, 260.0] {
            host.nav(time_s);
        }
        host.contents.entries.iter().filter(|record| record.get(2) == Some(&6)).count()
    };
    assert_eq!((unused(false), unused(true)), (0, 3));
}
