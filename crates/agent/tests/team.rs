//! What a team agrees on as a file, and what a vehicle keeps as a snapshot.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::*;
use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};
use pingmap_agent::*;
use proptest::prelude::*;

const SMALL: &str = "schema = 1\nmodel_file = \"model.toml\"\n[members]\nada = 4\nbob = 1\n[grid]\ncell_m = 25.0\n";

fn read(text: &str) -> Result<Team, TeamError> {
    TeamFile::parse(text)?.team(model(), None)
}

/// The text with one line for another.
fn with(line: &str, other: &str) -> String {
    assert!(SMALL.contains(line), "{line}");
    SMALL.replace(line, other)
}

#[test]
fn what_a_team_file_leaves_out_has_a_default() {
    let team = read(SMALL).unwrap();
    let [ada, bob] = ["ada", "bob"].map(VehicleId::new);
    assert_eq!(
        team.members.iter().map(|(&n, id)| (n, id.clone())).collect::<Vec<_>>(),
        [(1, bob.clone()), (4, ada.clone())]
    );
    assert_eq!((team.number(&ada), team.number(&VehicleId::new("eve"))), (Some(4), None));
    assert_eq!((team.frame_bytes, team.epoch, team.repeats_max, team.packets_per_sender_max), (32, 0, 0, 64));
    assert_eq!(
        (team.grid, team.limits),
        (Grid { cell_m: 25.0, depth_cell_m: 1.0, start_s: 0.0, time_cell_s: 600.0 }, Limits::default())
    );
    assert_eq!((team.slots.duration_s, &team.slots.order), (10.0, &vec![bob, ada]));
    let same = Team::new(names(2), model(), []).unwrap();
    assert_eq!((team.worth_nats, team.packets_per_sender_max), (same.worth_nats, same.packets_per_sender_max));
}

#[test]
fn what_was_written_reads_back_to_the_same_agreement() {
    let mut written = team(3, model());
    written.members =
        [(7, "a b"), (0, "\"quoted\""), (255, "wal.do")].map(|(n, name)| (n, VehicleId::new(name))).into();
    written.grid = Grid { cell_m: 17.3, depth_cell_m: 2.1, start_s: 1.76e9, time_cell_s: 170.5 };
    (written.reports_per_sender_max, written.tellings_max) = (77, 2);
    (written.track_off_max_m, written.onward_s_max) = (31.5, 45.0);
    written.slots =
        Slots { start_s: 3.25, ..Slots::in_turn(7.5, ["wal.do", "a b", "wal.do"].map(VehicleId::new).into()) };
    written.slots.may_be_silent = [VehicleId::new("a b")].into();
    written.spare_bits = Some(true);
    let change =
        |from, order: &[&str]| SlotChange { from, order: order.iter().map(|&name| VehicleId::new(name)).collect() };
    written.slots.changes = vec![change(9, &["a b", ""]), change(1000, &["wal.do"])];
    (written.frame_bytes, written.epoch, written.repeats_max, written.packets_per_sender_max) = (64, 9, 2, 5);
    written.worth_nats = 1.25e-5;
    written.limits = Limits {
        events_max: 1,
        dense_events_max: 2,
        inducing_points_max: 3,
        candidates_max: 4,
        events_beside_max: 5,
        slots_back_max: 6,
    };
    written.key = Some(key(3));
    let text = TeamFile::write(&written, "m.toml", Some("key.hex"), Some("c0ffee")).unwrap();
    let file = TeamFile::parse(&text).unwrap();
    assert_eq!((file.model_file.as_str(), file.key_file.as_deref()), ("m.toml", Some("key.hex")));
    assert_eq!(file.log_digest.as_deref(), Some("c0ffee"));
    let found = file.team(model(), Some(key(3))).unwrap();
    assert_eq!((&found.members, found.grid, &found.slots), (&written.members, written.grid, &written.slots));
    assert_eq!((found.frame_bytes, found.epoch, found.repeats_max), (64, 9, 2));
    let reports = (found.reports_per_sender_max, found.tellings_max, found.track_off_max_m, found.onward_s_max);
    assert_eq!(reports, (77, 2, 31.5, 45.0));
    assert_eq!(found.spare_bits, Some(true));
    assert_eq!((found.worth_nats, found.limits, found.digest()), (1.25e-5, written.limits, written.digest()));
    assert_eq!(TeamFile::write(&found, "m.toml", Some("key.hex"), Some("c0ffee")).unwrap(), text);
}

#[test]
fn a_team_without_turns_is_written_and_read() {
    let team = team(3, model());
    let at_will = |order: Vec<VehicleId>| Team { slots: Slots::at_will(2.5, order), ..team.clone() };
    let written = at_will(names(3));
    let text = TeamFile::write(&written, "m.toml", None, None).unwrap();
    let found = TeamFile::parse(&text).unwrap().team(model(), None).unwrap();
    assert_eq!((&found.slots, found.digest()), (&written.slots, written.digest()));
    assert!(!found.has_spare_bits());
    // Every stretch has a slot for each.
    let slots = [7.4, 7.6].map(|time_s| found.slots.sent_in(time_s, &names(3)[1]));
    assert_eq!(slots, [Some(7), Some(10)]);
    assert_eq!((found.slots.begin_s(7), found.slots.sender(7)), (Some(5.0), Some(&names(3)[1])));
    assert_eq!((found.slots.owner(7.4), found.slots.number(-0.1)), (None, None));
    let begun = found.slots.beginning_by(9.0);
    assert_eq!(begun.start_s, 7.5);
    // A file says no other order.
    assert!(TeamFile::write(&at_will(names(2)), "m.toml", None, None).is_err());
}

/// A line of a file, what stands there instead, and what is said of it.
const NO_TEAMS: &[(&str, &str, &str)] = &[
    ("schema = 1", "schema = 4", "newer version"),
    (
        "schema = 1",
        "schema = 1\nreports_per_sender_max = 0",
        "reports_per_sender_max must be a whole number from 1 to 1024",
    ),
    ("schema = 1", "schema = 1\ntrack_off_max_m = 0.0", "track_off_max_m must be a number of metres from 1e-6 to 1e9"),
    ("schema = 1", "schema = 1\nonward_s_max = -1.0", "onward_s_max must be a number of seconds from 0"),
    ("[grid]", "[[slots.changes]]\nfrom_s = 50.0\norder = [\"eve\"]\n[grid]", "slots: eve is not a member"),
    (
        "[grid]",
        "[[slots.changes]]\nfrom_s = 50.0\norder = [\"bob\"]\n[[slots.changes]]\nfrom_s = 50.0\norder = []\n[grid]",
        "slots.changes: 50 s is no later",
    ),
    ("schema = 1", "schema = 1\ncolour = \"red\"", "colour"),
    ("cell_m = 25.0", "cell_m = 25.0\nwidth = 3", "width"),
    ("schema = 1\n", "", "schema"),
    ("model_file = \"model.toml\"\n", "", "model_file"),
    ("bob = 1", "bob = 4", "ada and bob both have number 4"),
    ("bob = 1", "bob = 256", "256"),
    ("bob = 1", "ada = 1", "duplicate"),
    ("ada = 4\nbob = 1\n", "", "1 to 256 members, found 0"),
    ("schema = 1", "schema = 1\nframe_bytes = 16", "frame_bytes must be at least 32, found 16"),
    (
        "schema = 1",
        "schema = 1\npackets_per_sender_max = 0",
        "packets_per_sender_max must be a whole number from 1 to 1024, found 0",
    ),
    ("schema = 1", "schema = 1\nworth_nats = -1.0", "worth_nats must be a number above 0, at most 1000, found -1"),
    ("cell_m = 25.0", "cell_m = 0.0", "grid.cell_m must be a number of metres from 1e-6 to 1e9, found 0"),
    ("cell_m = 25.0", "cell_m = nan", "grid.cell_m"),
    ("cell_m = 25.0", "cell_m = 1.0\ndepth_cell_m = -2.0", "grid.depth_cell_m"),
    ("[grid]", "[slots]\norder = [\"ada\", \"eve\"]\n[grid]", "slots: eve is not a member"),
    ("[grid]", "[slots]\nmay_be_silent = [\"eve\"]\n[grid]", "slots: eve is not a member"),
    ("[grid]", "[slots]\nat_will = true\norder = [\"ada\"]\n[grid]", "where all send at_will there is no order"),
    (
        "[grid]",
        "[limits]\nevents_beside_max = 0\n[grid]",
        "limits.events_beside_max must be a whole number from 1 to 1000",
    ),
    (
        "[grid]",
        "[limits]\nslots_back_max = 262145\n[grid]",
        "limits.slots_back_max must be a whole number from 1 to 262144",
    ),
    ("[grid]", "[slots]\nduration_s = 0.0\n[grid]", "slots.duration_s"),
    ("schema = 1", "schema = 1\nframe_bytes = 65537", "frame_bytes must be a whole number from 32 to 65536"),
    (
        "[grid]",
        "[limits]\ninducing_points_max = 9223372036854775807\n[grid]",
        "limits.inducing_points_max must be a whole number from 1 to 4000",
    ),
    ("[grid]", "[limits]\ndense_events_max = 1000000\n[grid]", "limits.dense_events_max must be a whole number"),
    ("[grid]", "[limits]\ncandidates_max = 1000000\n[grid]", "limits.candidates_max must be a whole number"),
    ("cell_m = 25.0", "cell_m = 1e300", "grid.cell_m"),
    ("[grid]", "[slots]\nstart_s = inf\n[grid]", "slots.start_s must be a finite number of seconds"),
    (
        "[grid]",
        "[limits]\nevents_max = 0\n[grid]",
        "limits.events_max must be a whole number from 1 to 10000000, found 0",
    ),
];

#[test]
fn what_makes_no_team_is_refused_by_name() {
    for (line, other, expected) in NO_TEAMS {
        let error = read(&with(line, other)).unwrap_err().to_string();
        assert!(error.contains(expected), "{other}: {error}");
    }
    assert_eq!(read(&with("schema = 1", "schema = 4\nfuture = true")).unwrap_err(), TeamError::Newer { found: 4 });
    assert_eq!(Team::new([], model(), []).unwrap_err(), TeamError::Members { found: 0 });
    assert_eq!(Team::new(names(257), model(), []).unwrap_err(), TeamError::Members { found: 257 });
    assert_eq!(Team::new(names(256), model(), []).unwrap().members.len(), 256);
}

#[test]
fn all_that_gives_packets_their_meaning_is_in_the_digest_and_nothing_else_is() {
    let team = team(3, model());
    let cell_m = team.grid.cell_m;
    let mut renamed = team.clone();
    renamed.members.insert(1, VehicleId::new("somebody else"));
    let other = [
        Team { model: isotropic(dgpc::Shape::Matern52, true, 300.0001, 4.0), ..team.clone() },
        Team { grid: Grid { cell_m: cell_m * 1.01, ..team.grid }, ..team.clone() },
        Team { grid: Grid { depth_cell_m: 3.0, ..team.grid }, ..team.clone() },
        Team { grid: Grid { start_s: 1.0, ..team.grid }, ..team.clone() },
        Team { grid: Grid { time_cell_s: 60.0, ..team.grid }, ..team.clone() },
        Team { epoch: 1, ..team.clone() },
        Team { packets_per_sender_max: 3, ..team.clone() },
        Team { frame_bytes: 64, ..team.clone() },
        Team { slots: Slots { start_s: 0.5, ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { duration_s: 9.0, ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { order: names(2), ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { at_will: true, ..team.slots.clone() }, ..team.clone() },
        Team {
            slots: Slots { changes: vec![SlotChange { from: 5, order: names(1) }], ..team.slots.clone() },
            ..team.clone()
        },
        Team { slots: Slots { listed: Some(listed(3)), ..team.slots.clone() }, ..team.clone() },
        Team { slots: Slots { listed: Some(listed(2)), ..team.slots.clone() }, ..team.clone() },
        Team { reports_per_sender_max: 255, ..team.clone() },
        Team { key: Some(key(1)), ..team.clone() },
        Team { key: Some(key(2)), ..team.clone() },
        renamed,
    ];
    let mut digests: Vec<_> = other.iter().chain([&team]).map(Team::digest).collect();
    digests.sort_unstable();
    digests.dedup();
    assert_eq!(digests.len(), other.len() + 1);
    let limits = Limits { events_max: 5, ..team.limits };
    let mut same = Team {
        worth_nats: 1.0,
        repeats_max: 3,
        tellings_max: 1,
        track_off_max_m: 99.0,
        onward_s_max: 1.0,
        limits,
        ..team.clone()
    };
    same.model.chart.scale_m = 7.0;
    assert_eq!(same.digest(), team.digest());
    // Minus zero is zero.
    same.model.chart.origin.east_m = -0.0;
    assert_eq!(same.digest(), team.digest());
    // How length-scales are tied says what is learned, not what is meant.
    let tied = |ties: &[usize]| {
        let path = Correlation::new(Shape::Matern32, &[4, 5], &[200.0, 200.0]).unwrap().tied(ties).unwrap();
        let kernel = Kernel::new(vec![Term::of(4.0, path).unwrap()]).unwrap();
        let prior = Prior::new(kernel, PriorMean::Zero).unwrap();
        Team { model: Model::new(team.model.chart, team.model.inputs, prior), ..team.clone() }.digest()
    };
    assert_eq!(tied(&[0, 0]), tied(&[0, 1]));
}

/// One transmission that so many could hear.
fn listed(listeners: usize) -> std::sync::Arc<[Opportunity]> {
    [Opportunity { time_s: 4.0, sender: names(1).remove(0), listeners: names(listeners) }].into()
}

#[test]
fn slots_come_round_before_and_after_time_zero() {
    let slots = Slots::in_turn(2.5, names(3));
    for (time_s, owner) in
        [(0.0, 0), (2.4, 0), (2.5, 1), (7.4, 2), (7.5, 0), (7.5e6, 0), (-0.1, 2), (-7.5, 0), (-2.6, 1)]
    {
        assert_eq!(slots.owner(time_s), Some(&names(3)[owner]), "{time_s}");
    }
    let late = Slots { start_s: 1.0, ..slots.clone() };
    assert_eq!((late.owner(0.9), late.owner(1.0)), (Some(&names(3)[2]), Some(&names(3)[0])));
    for time_s in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(slots.owner(time_s), None);
    }
    assert_eq!(Slots::in_turn(1.0, Vec::new()).owner(3.0), None);
}

#[test]
fn a_team_that_no_file_can_say_is_not_written() {
    let good = team(2, model());
    let write = |team: &Team, key_file| TeamFile::write(team, "m.toml", key_file, None);
    let cell = |cell_m: f64| Team { grid: Grid { cell_m, ..good.grid }, ..good.clone() };
    let slots = |order: Vec<VehicleId>| Team { slots: Slots { order, ..good.slots.clone() }, ..good.clone() };
    let twins = [(0, "ada"), (1, "ada")].map(|(number, name)| (number, VehicleId::new(name))).into();
    let bad = [
        (cell(f64::NAN), None),
        (cell(0.0), None),
        (Team { frame_bytes: 20, ..good.clone() }, None),
        (Team { packets_per_sender_max: 2000, ..good.clone() }, None),
        (Team { key: Some(key(1)), ..good.clone() }, None),
        (good.clone(), Some("key.hex")),
        (slots(vec![VehicleId::new("eve")]), None),
        (slots(Vec::new()), None),
        (Team { members: twins, ..good.clone() }, None),
        (Team { worth_nats: -1.0, ..good.clone() }, None),
    ];
    for (number, (team, key_file)) in bad.iter().enumerate() {
        let error = write(team, *key_file).unwrap_err();
        assert!(matches!(error, TeamError::Unwritable { .. }), "{number}: {error}");
    }
    assert!(write(&good, None).is_ok());
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn a_snapshot_is_all_that_a_vehicle_knows(fleet in fleets()) {
        let mut agent = fleet.vehicle(0);
        sent(&mut agent, 2);
        for bytes in fleet.packets(2) {
            agent.receive(&bytes, 0.0);
        }
        let mut again = restored(&agent, &agent.snapshot());
        prop_assert_eq!(again.snapshot(), agent.snapshot());
        prop_assert_eq!((events(&again), again.live_packets()), (events(&agent), agent.live_packets()));
        for agent in [&mut agent, &mut again] {
            agent.rebuild_posteriors().unwrap();
        }
        let p = [&mut agent, &mut again].map(|agent| bits(&agent.probabilities(somewhere()).unwrap()));
        prop_assert_eq!(&p[0], &p[1]);
        prop_assert_eq!(agent.next_packet(0.0, 32).unwrap(), again.next_packet(0.0, 32).unwrap());
    }
}

#[test]
fn a_snapshot_keeps_depths_and_every_digit() {
    let mut event = walk(0, 1, 0.123_456_789).remove(0);
    event.time_s = 1.6e9 + 0.1;
    event.link.receiver.depth_m = Some(0.1 + 0.2);
    event.link.transmitter.east_m = -1e-300;
    let team = Arc::new(team(2, model()));
    let agent = vehicle(&team, 0, [event.clone()]);
    assert_eq!(events(&restored(&agent, &agent.snapshot())), [event]);
}

/// A snapshot of a vehicle that saw, heard and sent something.
fn snapshot(team: &Arc<Team>) -> (VehicleId, Vec<u8>) {
    let mut agent = vehicle(team, 0, walk(0, 10, 0.0));
    sent(&mut agent, 1);
    for bytes in sent(&mut vehicle(team, 1, walk(1, 10, 0.0)), 1) {
        agent.receive(&bytes, 0.0);
    }
    (agent.id().clone(), agent.snapshot())
}

/// The snapshot with a check that fits what it says.
fn checked(mut snapshot: Vec<u8>) -> Vec<u8> {
    snapshot.truncate(snapshot.len() - 32);
    snapshot.extend(pingmap_packet::digest(&snapshot));
    snapshot
}

#[test]
fn what_is_no_snapshot_of_this_vehicle_is_refused() {
    let team = Arc::new(team(2, model()));
    let (id, good) = snapshot(&team);
    let with = |place: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[place] = byte;
        checked(bytes)
    };
    let cases = [
        (Vec::new(), "too few"),
        (b"garbage".to_vec(), "too few"),
        (good[..good.len() / 2].to_vec(), "its check does not fit"),
        (b"garbage that is long enough to have a check of its own".to_vec(), "does not begin"),
        (with(8, 9), "version 9, but this software reads version 3"),
        (with(10, 200), "makes no sense"),
        (checked([good.as_slice(), &[0]].concat()), "makes no sense"),
        (with(22, b'1'), "it is of vehicle 1"),
    ];
    for (bytes, expected) in cases {
        assert_ne!(bytes, good, "{expected}");
        let error = Agent::restore(id.clone(), team.clone(), &bytes).unwrap_err();
        assert!(matches!(error, AgentError::Snapshot { .. }) && error.to_string().contains(expected), "{error}");
    }
    assert!(Agent::restore(id, team, &good).is_ok());
}

#[test]
fn every_flipped_bit_of_a_snapshot_is_noticed() {
    for key in [None, Some(key(1))] {
        let team = Arc::new(Team { key, ..team(2, model()) });
        let (id, good) = snapshot(&team);
        for bit in 0..8 * good.len() {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(Agent::restore(id.clone(), team.clone(), &bytes).is_err(), "{bit}");
        }
    }
}

#[test]
fn a_snapshot_is_of_one_key() {
    let of = |key: Option<Key>| Arc::new(Team { key, epoch: 3, ..team(2, model()) });
    let (id, sealed) = snapshot(&of(Some(key(1))));
    for key in [None, Some(key(2))] {
        let error = Agent::restore(id.clone(), of(key), &sealed).unwrap_err();
        assert!(error.to_string().contains("another key"), "{error}");
    }
    // Whoever knows the former key keeps the events, and shares afresh.
    let agent = Agent::restore_checked_with(id, of(Some(key(2))), Some(&key(1)), &sealed).unwrap();
    assert_eq!((agent.events().len(), agent.live_packets()), (10, 0));
}

#[test]
fn a_snapshot_whose_packets_cannot_be_read_keeps_its_events() {
    let team = Arc::new(team(2, model()));
    let (id, good) = snapshot(&team);
    let packet = good.len() - 32 - 20;
    let mut damaged = good;
    damaged[packet] ^= 1;
    let agent = Agent::restore(id, team, &checked(damaged)).unwrap();
    assert_eq!(agent.events().len(), 10);
    assert_eq!((agent.live_packets(), agent.counts().other_team), (1, 1));
}
