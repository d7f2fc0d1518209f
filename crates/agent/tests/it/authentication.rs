//! Authenticated packets: frames of strangers change nothing, and no counter is used twice under one key.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;

fn authenticated() -> Team {
    Team { key: Some(key(7)), ..team(3, model()) }
}

fn first_packet(team: Team) -> Vec<u8> {
    vehicle(&Arc::new(team), 1, walk(1, 30, 1.0)).next_frame(Some(0.0), 32).unwrap().unwrap().bytes
}

/// A vehicle of the authenticated team that recorded events and received one packet.
fn listener() -> Agent {
    let mut agent = vehicle(&Arc::new(authenticated()), 0, walk(0, 10, 0.0));
    assert_eq!(agent.receive(&first_packet(authenticated()), Some(0.0)).receipt, Receipt::Accepted);
    agent
}

/// The counter of a packet.
fn counter(bytes: &[u8], team: &Arc<Team>) -> u16 {
    vehicle(team, 2, []).codec().read(bytes).unwrap().1.counter
}

#[test]
fn a_tag_takes_the_place_of_one_point_in_a_small_frame() {
    let points = |has_depth: bool, key: Option<Key>| {
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
        let bytes = agent.next_frame(Some(0.0), 32).unwrap().unwrap().bytes;
        assert!(bytes.len() <= 32, "{}", bytes.len());
        summarised_links(&agent, 0).concat().len()
    };
    let with_key = || Some(key(1));
    assert_eq!(
        [points(false, None), points(false, with_key()), points(true, None), points(true, with_key())],
        [5, 4, 4, 3]
    );
}

#[test]
fn a_frame_with_any_changed_bit_is_refused_and_changes_nothing() {
    let mut agent = listener();
    let before = (agent.snapshot(), test_probabilities(&mut agent));
    let mut sender = vehicle(&Arc::new(authenticated()), 2, walk(2, 30, 1.0));
    let bytes = sender.next_frame(Some(0.0), 32).unwrap().unwrap().bytes;
    for bit in 0..8 * bytes.len() {
        let mut altered = bytes.clone();
        altered[bit / 8] ^= 1 << (bit % 8);
        let receipt = agent.receive(&altered, Some(0.0)).receipt;
        assert!(matches!(receipt, Receipt::Refused(refusal) if refusal != Refusal::Duplicate), "{bit}");
    }
    let [forged, malformed, other_team] = ["forged", "malformed", "other-team"].map(|class| count(&agent, class));
    assert_eq!((count(&agent, "accepted"), forged + malformed + other_team), (1, 8 * bytes.len() as u64));
    // A change in 48 bits of the tag looks like another configuration, and a change of the message id like another
    // form.
    assert!(forged > malformed && other_team >= 48, "{:?}", agent.status().counts);
    assert_eq!((agent.snapshot(), test_probabilities(&mut agent)), before);
    assert_eq!(agent.receive(&bytes, Some(0.0)).receipt, Receipt::Accepted);
}

#[test]
fn an_authenticated_report_with_any_changed_bit_is_refused_and_changes_nothing() {
    let team = Arc::new(authenticated());
    let mut sender = vehicle_with(&team, 2, reports_alone(), []);
    sender.record_positions([0.0, 300.0].map(|time_s| (time_s, Position::new(time_s, 0.0)))).unwrap();
    let link = link([0.0, 0.0, 100.0, 0.0]);
    let event =
        |n: usize| Event { transmitter_id: name(n % 3), ..event_at(2, 10.0 * n as f64, link, n.is_multiple_of(2)) };
    sender.record((0..30).filter(|n| n % 3 != 2).map(event)).unwrap();
    let report = sender.next_frame(None, 32).unwrap().unwrap().bytes;
    let mut agent = listener();
    let before = agent.snapshot();
    for bit in 0..8 * report.len() {
        let mut altered = report.clone();
        altered[bit / 8] ^= 1 << (bit % 8);
        let receipt = agent.receive(&altered, None).receipt;
        assert!(matches!(receipt, Receipt::Refused(refusal) if refusal != Refusal::Duplicate), "{bit}");
    }
    assert_eq!(agent.snapshot(), before);
    assert_eq!(agent.receive(&report, None).receipt, Receipt::Accepted);
}

#[test]
fn packets_under_another_configuration_are_refused() {
    let other_grid = Grid { cell_m: 21.0, ..authenticated().grid };
    let foreign = [
        Team { epoch: 1, ..authenticated() },
        Team { packets_per_sender_max: 9, ..authenticated() },
        Team { grid: other_grid, ..authenticated() },
        Team { key: authenticated().key, ..team(3, isotropic(dgpc::Shape::Matern52, true, 301.0, 4.0)) },
        Team { key: authenticated().key, ..team(4, model()) },
        Team { frame_bytes: 64, ..authenticated() },
        Team { slots: Slots { start_s: 1.0, ..authenticated().slots }, ..authenticated() },
    ];
    let mut agent = listener();
    let before = agent.snapshot();
    let mut refusal = |bytes: &[u8]| match agent.receive(bytes, Some(0.0)).receipt {
        Receipt::Refused(Refusal::OtherTeam { found: None, .. }) => "configuration",
        Receipt::Refused(Refusal::OtherForm(_)) => "form",
        Receipt::Refused(Refusal::Forged(_)) => "forged",
        receipt => panic!("{receipt:?}"),
    };
    // Under the same key the tag shows that the configuration differs. Under another key it shows nothing.
    let found: Vec<&str> = foreign.into_iter().map(|foreign| refusal(&first_packet(foreign))).collect();
    assert_eq!(found, ["configuration"; 7]);
    assert_eq!(refusal(&first_packet(Team { key: Some(key(8)), ..authenticated() })), "forged");
    let mut large = vehicle(&Arc::new(Team { frame_bytes: 64, ..authenticated() }), 1, walk(1, 30, 1.0));
    assert_eq!(refusal(&large.next_frame(Some(0.0), 64).unwrap().unwrap().bytes), "form");
    assert_eq!(refusal(&first_packet(Team { key: None, ..authenticated() })), "form");
    assert_eq!((count(&agent, "other-team"), count(&agent, "forged"), agent.snapshot()), (9, 1, before));
}

#[test]
fn a_plain_packet_names_the_number_of_its_configuration() {
    let plain = |epoch| Team { key: None, epoch, ..authenticated() };
    let mut agent = vehicle(&Arc::new(plain(0)), 0, []);
    let receipt = agent.receive(&first_packet(authenticated()), Some(0.0)).receipt;
    assert!(matches!(receipt, Receipt::Refused(Refusal::OtherForm(_))));
    let mut number = |epoch, phase| {
        let mut sender = vehicle(&Arc::new(plain(epoch)), 1, walk(1, 30, phase));
        match agent.receive(&sender.next_frame(Some(0.0), 32).unwrap().unwrap().bytes, Some(0.0)).receipt {
            Receipt::Refused(Refusal::OtherTeam { found: Some(found), expected }) => (found, expected),
            receipt => panic!("{receipt:?}"),
        }
    };
    let (one, two) = ([number(1, 0.0), number(1, 1.0)], number(2, 0.0));
    assert_eq!(one[0], one[1], "the number does not depend on the content of the packet");
    assert!(one[0].0 != two.0 && one[0].0 != one[0].1, "{one:?} {two:?}");
    let status = agent.status();
    assert_eq!((status.counts["other-team"], status.live_packets), (4, 0));
}

#[test]
fn a_replayed_frame_changes_nothing() {
    let mut agent = listener();
    let before = agent.snapshot();
    for _ in 0..3 {
        let receipt = agent.receive(&first_packet(authenticated()), Some(9.0)).receipt;
        assert_eq!(receipt, Receipt::Refused(Refusal::Duplicate));
    }
    assert_eq!((count(&agent, "duplicate"), agent.snapshot()), (3, before));
    assert_eq!(member(&agent, &name(1)).last_heard_s, Some(0.0));
}

#[test]
fn counters_continue_after_a_restart_from_a_snapshot() {
    let team = Arc::new(authenticated());
    let mut agent = vehicle(&team, 0, walk(0, 20, 0.0));
    let mut counters = Vec::new();
    for n in 0..4 {
        let bytes = agent.next_frame(Some(0.0), 32).unwrap().unwrap().bytes;
        counters.push(counter(&bytes, &team));
        agent = restored(&agent, &agent.snapshot());
        agent.record(walk(0, 20 + 5 * n, 0.9)).unwrap();
        agent.refit().unwrap();
    }
    assert_eq!(counters, [0, 1, 2, 3]);
}

#[test]
fn a_vehicle_that_lost_its_memory_skips_a_window_of_counters_after_its_old_packets() {
    let team = Arc::new(authenticated());
    let packets = frames(&mut vehicle(&team, 0, walk(0, 40, 0.0)), 3);
    assert_eq!(packets.len(), 3);
    let mut reborn = vehicle(&team, 0, walk(0, 40, 0.5));
    for n in [2, 0] {
        let counter = n as u16;
        assert_eq!(reborn.receive(&packets[n], Some(0.0)).receipt, Receipt::Refused(Refusal::OwnNumber(counter)));
        assert_eq!(reborn.receive(&packets[n], Some(0.0)).receipt, Receipt::Refused(Refusal::Duplicate));
    }
    assert_eq!(count(&reborn, "own-number"), 2);
    let bytes = reborn.next_frame(Some(0.0), 32).unwrap().unwrap().bytes;
    assert_eq!(counter(&bytes, &team), 2 + team.packets_per_sender_max);
    // Packets of its own number do not change its predictions: they follow from its own events.
    let mut fresh = vehicle(&team, 0, walk(0, 40, 0.5));
    assert_eq!(rebuilt_probabilities(&mut reborn), rebuilt_probabilities(&mut fresh));
}

#[test]
fn a_vehicle_without_further_counters_sends_no_summaries_until_the_next_epoch() {
    let team = Arc::new(authenticated());
    let (agent, id) = (vehicle(&team, 0, walk(0, 40, 0.0)), name(0));
    let mut last = after_counter(agent.clone(), 65_534);
    assert_eq!(counter(&last.next_frame(Some(0.0), 32).unwrap().unwrap().bytes, &team), 65_535);
    let used_up = AgentError::CountersUsedUp { id: id.clone(), epoch: 0 };
    assert_eq!(last.next_frame(Some(1.0), 32), Err(used_up.clone()));
    assert_eq!(restored(&last, &last.snapshot()).next_frame(Some(0.0), 32), Err(used_up));

    let next = Arc::new(Team { epoch: 1, ..authenticated() });
    let mut again = Agent::restore(id, next.clone(), AgentOptions::default(), &last.snapshot()).unwrap();
    again.refit().unwrap();
    assert_eq!((events(&again), again.status().live_packets), (events(&agent), 0));
    assert_eq!(counter(&again.next_frame(Some(0.0), 32).unwrap().unwrap().bytes, &next), 0);
}
