//! Snapshots: they restore everything that a vehicle must not lose, and anything else is refused.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// Bytes of the check at the end.
const CHECK_BYTES: usize = 32;

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn a_restored_vehicle_predicts_and_sends_the_same(fleet in fleets()) {
        let mut agent = fleet.vehicle(0);
        frames(&mut agent, 2);
        receive_all(&mut agent, &fleet.packets(2));
        let mut again = restored(&agent, &agent.snapshot());
        prop_assert_eq!(again.snapshot(), agent.snapshot());
        let live_packets = |agent: &Agent| agent.status().live_packets;
        prop_assert_eq!((events(&again), live_packets(&again)), (events(&agent), live_packets(&agent)));
        prop_assert_eq!(bits(&rebuilt_probabilities(&mut agent)), bits(&rebuilt_probabilities(&mut again)));
        prop_assert_eq!(agent.next_frame(None, 32).unwrap().map(|frame| frame.bytes), again.next_frame(None, 32).unwrap().map(|frame| frame.bytes));
    }
}

#[test]
fn a_snapshot_keeps_depths_and_all_digits() {
    let mut event = walk(0, 1, 0.123_456_789).remove(0);
    event.time_s = 1.6e9 + 0.1;
    event.link.receiver.depth_m = Some(0.1 + 0.2);
    event.link.transmitter.east_m = -1e-300;
    let team = Arc::new(team(2, model()));
    let agent = vehicle(&team, 0, [event.clone()]);
    assert_eq!(events(&restored(&agent, &agent.snapshot())), [event]);
}

#[test]
fn a_snapshot_keeps_muted_members() {
    let team = Arc::new(team(3, model()));
    let packets = [1, 2].map(|n| frames(&mut vehicle(&team, n, walk(n, 40, n as f64)), 3));
    let mut agent = vehicle(&team, 0, walk(0, 20, 0.3));
    receive_all(&mut agent, packets.iter().flatten());
    let unmuted = agent.snapshot();
    agent.set_muted(&name(1), true);
    let snapshot = agent.snapshot();
    assert_ne!(snapshot, unmuted);
    let mut again = restored(&agent, &snapshot);
    assert!(
        member(&again, &name(1)).is_ignored(IgnoreReason::Muted)
            && !member(&again, &name(2)).is_ignored(IgnoreReason::Muted)
    );
    assert_eq!(again.snapshot(), snapshot);
    assert_eq!(rebuilt_probabilities(&mut again), rebuilt_probabilities(&mut agent));
    assert_eq!(again.status().live_packets, packets[1].len());
    again.set_muted(&name(1), false);
    assert_eq!(again.snapshot(), unmuted);
}

#[test]
fn muted_members_are_kept_under_a_new_epoch() {
    let mut agent = vehicle(&Arc::new(team(3, model())), 0, walk(0, 20, 0.3));
    agent.set_muted(&name(1), true);
    let next = Arc::new(Team { epoch: 1, ..team(3, model()) });
    let again = Agent::restore(name(0), next, AgentOptions::default(), &agent.snapshot()).unwrap();
    assert!(
        member(&again, &name(1)).is_ignored(IgnoreReason::Muted)
            && !member(&again, &name(2)).is_ignored(IgnoreReason::Muted)
    );
}

#[test]
fn muted_members_are_kept_by_name_where_another_team_numbers_them_otherwise() {
    let mut agent = vehicle(&Arc::new(team(3, model())), 0, walk(0, 20, 0.3));
    agent.set_muted(&name(1), true);
    let members = [(0, name(0)), (1, name(2)), (2, name(1))];
    let renumbered = Arc::new(Team { members: Members::new(members.into()), ..team(3, model()) });
    let again = Agent::restore(name(0), renumbered, AgentOptions::default(), &agent.snapshot()).unwrap();
    assert!(
        member(&again, &name(1)).is_ignored(IgnoreReason::Muted)
            && !member(&again, &name(2)).is_ignored(IgnoreReason::Muted)
    );
}

/// A snapshot of a vehicle that recorded, received and sent something.
fn snapshot(team: &Arc<Team>) -> (VehicleId, Vec<u8>) {
    let mut agent = vehicle(team, 0, walk(0, 10, 0.0));
    frames(&mut agent, 1);
    receive_all(&mut agent, &frames(&mut vehicle(team, 1, walk(1, 10, 0.0)), 1));
    (agent.id().clone(), agent.snapshot())
}

fn restore(id: &VehicleId, team: &Arc<Team>, bytes: &[u8]) -> Result<Agent, AgentError> {
    Agent::restore(id.clone(), team.clone(), AgentOptions::default(), bytes)
}

/// The snapshot with a valid check.
fn with_check(mut snapshot: Vec<u8>) -> Vec<u8> {
    snapshot.truncate(snapshot.len() - CHECK_BYTES);
    snapshot.extend(pingmap_packet::digest(&snapshot));
    snapshot
}

#[test]
fn bytes_that_are_no_snapshot_of_this_vehicle_are_refused() {
    let team = Arc::new(team(2, model()));
    let (id, good) = snapshot(&team);
    let with = |place: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[place] = byte;
        with_check(bytes)
    };
    let cases = [
        (Vec::new(), "too few"),
        (b"garbage".to_vec(), "too few"),
        (good[..good.len() / 2].to_vec(), "its check does not fit"),
        (b"garbage that is long enough to have a check of its own".to_vec(), "does not begin"),
        (with(10, 200), "makes no sense"),
        (with_check([good.as_slice(), &[0]].concat()), "makes no sense"),
        (with(22, b'1'), "it is of vehicle 1"),
    ];
    for (bytes, expected) in cases {
        assert_ne!(bytes, good, "{expected}");
        let error = restore(&id, &team, &bytes).unwrap_err();
        assert!(matches!(error, AgentError::Snapshot { .. }) && error.to_string().contains(expected), "{error}");
    }
    assert!(restore(&id, &team, &good).is_ok());
}

#[test]
fn an_older_or_newer_snapshot_is_refused_with_its_version() {
    let team = Arc::new(team(2, model()));
    let (id, good) = snapshot(&team);
    assert_eq!(good[8..10], [7, 0]);
    for version in [6, 8, 9] {
        let mut bytes = good.clone();
        bytes[8] = version;
        let error = restore(&id, &team, &with_check(bytes)).unwrap_err().to_string();
        assert!(error.contains(&format!("version {version}, but this software reads version 7")), "{error}");
    }
}

#[test]
fn every_changed_bit_of_a_snapshot_is_detected() {
    for key in [None, Some(key(1))] {
        let team = Arc::new(Team { key, ..team(2, model()) });
        let (id, good) = snapshot(&team);
        for bit in 0..8 * good.len() {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(restore(&id, &team, &bytes).is_err(), "{bit}");
        }
    }
}

#[test]
fn a_snapshot_is_restored_with_its_own_key_alone() {
    let of = |key: Option<Key>| Arc::new(Team { key, epoch: 3, ..team(2, model()) });
    let (id, authenticated) = snapshot(&of(Some(key(1))));
    for key in [None, Some(key(2))] {
        let error = restore(&id, &of(key), &authenticated).unwrap_err();
        assert!(error.to_string().contains("another key"), "{error}");
    }
}

#[test]
fn a_snapshot_with_an_unreadable_packet_keeps_its_events() {
    let team = Arc::new(team(2, model()));
    let (id, good) = snapshot(&team);
    let packet = good.len() - CHECK_BYTES - 20;
    let mut damaged = good;
    damaged[packet] ^= 1;
    let agent = restore(&id, &team, &with_check(damaged)).unwrap();
    let status = agent.status();
    assert_eq!((agent.events().len(), status.live_packets, status.counts["other-team"]), (10, 1, 1));
}

#[test]
fn a_restored_vehicle_has_the_given_options() {
    let team = Arc::new(team(2, model()));
    let (id, good) = snapshot(&team);
    let options = AgentOptions { allow_extrapolated_increase: true, ..reports_alone() };
    let agent = Agent::restore(id, team, options, &good).unwrap();
    assert_eq!(agent.options, options);
}

#[test]
fn a_snapshot_of_every_receiver_is_restored_with_any_options() {
    let team = Arc::new(team(2, model()));
    let station = station(&team, walk(0, 5, 0.0).into_iter().chain(walk(1, 5, 1.0)));
    let again = restore(station.id(), &team, &station.snapshot()).unwrap();
    assert_eq!(events(&again), events(&station));
}
