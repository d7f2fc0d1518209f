//! Sealed packets: what does not come from the team changes nothing, and no counter is used twice under one key.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::*;
use pingmap_agent::*;

fn sealed() -> Team {
    Team { key: Some(key(7)), ..team(3, model()) }
}

fn first_packet(team: Team) -> Vec<u8> {
    vehicle(&Arc::new(team), 1, walk(1, 30, 1.0)).next_packet(0.0, 32).unwrap().unwrap()
}

/// A vehicle of the sealed team that has seen something and heard one packet.
fn listener() -> Agent {
    let mut agent = vehicle(&Arc::new(sealed()), 0, walk(0, 10, 0.0));
    assert_eq!(agent.receive(&first_packet(sealed()), 0.0), Receipt::Accepted);
    agent
}

#[test]
fn a_seal_costs_one_point_of_a_small_frame() {
    let deep = |has_depth: bool, key: Option<Key>| {
        let inputs = if has_depth { InputSpec::PositionsAndDepths } else { InputSpec::Positions };
        let model = Model::isotropic(Chart::about([]), inputs, dgpc::Shape::Matern52, true, 200.0, 4.0).unwrap();
        let mut team = Team { key, ..team(2, model) };
        team.grid.depth_cell_m = 2.0;
        let events = walk(0, 60, 0.0).into_iter().enumerate().map(|(n, mut event)| {
            event.link.transmitter.depth_m = Some(n as f64);
            event.link.receiver.depth_m = Some(60.0 - n as f64);
            event
        });
        let mut agent = vehicle(&Arc::new(team), 0, events);
        let bytes = agent.next_packet(0.0, 32).unwrap().unwrap();
        assert!(bytes.len() <= 32, "{}", bytes.len());
        told_by(&agent, 0).concat().len()
    };
    let sealed = || Some(key(1));
    assert_eq!([deep(false, None), deep(false, sealed()), deep(true, None), deep(true, sealed())], [5, 4, 4, 3]);
}

#[test]
fn a_frame_with_any_bit_changed_is_refused_and_changes_nothing() {
    let mut agent = listener();
    let before = (agent.snapshot(), agent.probabilities(somewhere()).unwrap());
    let mut sender = vehicle(&Arc::new(sealed()), 2, walk(2, 30, 1.0));
    let bytes = sender.next_packet(0.0, 32).unwrap().unwrap();
    for bit in 0..8 * bytes.len() {
        let mut altered = bytes.clone();
        altered[bit / 8] ^= 1 << (bit % 8);
        let receipt = agent.receive(&altered, 0.0);
        assert!(matches!(receipt, Receipt::Refused(refusal) if refusal != Refusal::Duplicate), "{bit}");
    }
    let counts = *agent.counts();
    let refused = counts.forged + counts.malformed + counts.other_team;
    assert_eq!((counts.accepted, refused), (1, 8 * bytes.len() as u64));
    // Bits of the tag that depend on the agreement look like another one; changed ids like another form.
    assert!(counts.forged > counts.malformed && counts.other_team >= 48, "{counts:?}");
    assert_eq!((agent.snapshot(), agent.probabilities(somewhere()).unwrap()), before);
    assert_eq!(agent.receive(&bytes, 0.0), Receipt::Accepted);
}

#[test]
fn who_agreed_on_something_else_is_not_of_the_team() {
    let other_grid = Grid { cell_m: 21.0, ..sealed().grid };
    let foreign = [
        Team { epoch: 1, ..sealed() },
        Team { packets_per_sender_max: 9, ..sealed() },
        Team { grid: other_grid, ..sealed() },
        Team { key: sealed().key, ..team(3, isotropic(dgpc::Shape::Matern52, true, 301.0, 4.0)) },
        Team { key: sealed().key, ..team(4, model()) },
        Team { frame_bytes: 64, ..sealed() },
        Team { slots: Slots { start_s: 1.0, ..sealed().slots }, ..sealed() },
    ];
    let mut agent = listener();
    let before = agent.snapshot();
    let mut is_other = |bytes: &[u8]| match agent.receive(bytes, 0.0) {
        Receipt::Refused(Refusal::OtherTeam { found: None, .. }) => "key",
        Receipt::Refused(Refusal::OtherForm { .. }) => "form",
        Receipt::Refused(Refusal::Forged(_)) => "forged",
        receipt => panic!("{receipt:?}"),
    };
    // With the same key it shows that they have another team file; with another key nothing does.
    let found: Vec<&str> = foreign.into_iter().map(|foreign| is_other(&first_packet(foreign))).collect();
    assert_eq!(found, ["key"; 7]);
    assert_eq!(is_other(&first_packet(Team { key: Some(key(8)), ..sealed() })), "forged");
    let mut large = vehicle(&Arc::new(Team { frame_bytes: 64, ..sealed() }), 1, walk(1, 30, 1.0));
    assert_eq!(is_other(&large.next_packet(0.0, 64).unwrap().unwrap()), "form");
    assert_eq!(is_other(&first_packet(Team { key: None, ..sealed() })), "form");
    assert_eq!((agent.counts().other_team, agent.counts().forged, agent.snapshot()), (9, 1, before));
}

#[test]
fn an_open_packet_shows_under_which_agreement_it_was_formed() {
    let open = |epoch| Team { key: None, epoch, ..sealed() };
    let mut agent = vehicle(&Arc::new(open(0)), 0, []);
    assert!(matches!(agent.receive(&first_packet(sealed()), 0.0), Receipt::Refused(Refusal::OtherForm { .. })));
    let mut number = |epoch, first| {
        let mut sender = vehicle(&Arc::new(open(epoch)), 1, walk(1, 30, first));
        match agent.receive(&sender.next_packet(0.0, 32).unwrap().unwrap(), 0.0) {
            Receipt::Refused(Refusal::OtherTeam { found: Some(found), expected }) => (found, expected),
            receipt => panic!("{receipt:?}"),
        }
    };
    let (one, two) = ([number(1, 0.0), number(1, 1.0)], number(2, 0.0));
    assert_eq!(one[0], one[1], "whatever the packet says, its number is that of the agreement");
    assert!(one[0].0 != two.0 && one[0].0 != one[0].1, "{one:?} {two:?}");
    assert_eq!((agent.counts().other_team, agent.live_packets()), (4, 0));
}

#[test]
fn a_replayed_frame_changes_nothing() {
    let mut agent = listener();
    let before = agent.snapshot();
    for _ in 0..3 {
        assert_eq!(agent.receive(&first_packet(sealed()), 9.0), Receipt::Refused(Refusal::Duplicate));
    }
    assert_eq!((agent.counts().duplicate, agent.snapshot()), (3, before));
    assert_eq!(agent.heard_s(&names(2)[1]), Some(0.0));
}

/// The counter of a packet that somebody else of the team reads.
fn counter(bytes: &[u8], team: &Arc<Team>) -> u16 {
    vehicle(team, 2, []).read(bytes).unwrap().1.counter
}

#[test]
fn counters_go_on_from_a_snapshot() {
    let team = Arc::new(sealed());
    let mut agent = vehicle(&team, 0, walk(0, 20, 0.0));
    let mut counters = Vec::new();
    for n in 0..4 {
        let bytes = agent.next_packet(0.0, 32).unwrap().unwrap();
        counters.push(counter(&bytes, &team));
        agent = restored(&agent, &agent.snapshot());
        agent.observe_all(walk(0, 20 + 5 * n, 0.9)).unwrap();
        agent.refit().unwrap();
    }
    assert_eq!(counters, [0, 1, 2, 3]);
}

#[test]
fn a_vehicle_that_hears_what_it_said_before_it_lost_its_memory_goes_on_a_window_behind_it() {
    let team = Arc::new(sealed());
    let packets = sent(&mut vehicle(&team, 0, walk(0, 40, 0.0)), 3);
    assert_eq!(packets.len(), 3);
    let mut reborn = vehicle(&team, 0, walk(0, 40, 0.5));
    for n in [2, 0] {
        let counter = n as u16;
        assert_eq!(reborn.receive(&packets[n], 0.0), Receipt::Refused(Refusal::OwnNumber { counter }));
        assert_eq!(reborn.receive(&packets[n], 0.0), Receipt::Refused(Refusal::Duplicate));
    }
    assert_eq!(reborn.counts().own_number, 2);
    let bytes = reborn.next_packet(0.0, 32).unwrap().unwrap();
    assert_eq!(counter(&bytes, &team), 2 + team.packets_per_sender_max);
    // What it said is nothing to it: it knows its own events, and is not told of them.
    let mut alone = vehicle(&team, 0, walk(0, 40, 0.5));
    alone.rebuild_posteriors().unwrap();
    reborn.rebuild_posteriors().unwrap();
    assert_eq!(reborn.probabilities(somewhere()).unwrap(), alone.probabilities(somewhere()).unwrap());
}

#[test]
fn used_up_counters_stop_a_vehicle_until_the_next_epoch() {
    let team = Arc::new(sealed());
    let (agent, id) = (vehicle(&team, 0, walk(0, 40, 0.0)), names(1).remove(0));
    let mut last = after_counter(agent.clone(), 65_534);
    assert_eq!(counter(&last.next_packet(0.0, 32).unwrap().unwrap(), &team), 65_535);
    let used_up = AgentError::CountersUsedUp { id: id.clone(), epoch: 0 };
    assert_eq!(last.next_packet(1.0, 32), Err(used_up.clone()));
    assert_eq!(restored(&last, &last.snapshot()).next_packet(0.0, 32), Err(used_up));

    let next = Arc::new(Team { epoch: 1, ..sealed() });
    let mut again = Agent::restore(id, next.clone(), &last.snapshot()).unwrap();
    again.refit().unwrap();
    assert_eq!((events(&again), again.live_packets()), (events(&agent), 0));
    assert_eq!(counter(&again.next_packet(0.0, 32).unwrap().unwrap(), &next), 0);
}
