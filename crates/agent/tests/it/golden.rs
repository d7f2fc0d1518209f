//! Bytes on which all vehicles of a team must agree: packets, digests, snapshots, team files and model files.
//!
//! They consist of whole numbers and short decimals, never of the results of fits. A change of any of them raises the
//! version that it belongs to, and stands in CHANGELOG.md. `PINGMAP_WRITE_GOLDEN=1 cargo nextest run -p pingmap-agent
//! golden` writes the files in `tests/golden` again.

use std::path::Path;
use std::sync::Arc;

use crate::common::{key, reports_alone};
use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};
use pingmap_agent::*;
use pingmap_packet::{Block, Cell, Layout, MapMessage, Outcome, Point, Report, Waypoint, to_hex};

/// Compares a text with a golden file, or writes the file if the environment variable `PINGMAP_WRITE_GOLDEN` is set.
fn check(name: &str, found: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if std::env::var_os("PINGMAP_WRITE_GOLDEN").is_some() {
        std::fs::write(&path, found).unwrap();
        return;
    }
    let expected = std::fs::read_to_string(&path).unwrap();
    assert!(found == expected, "{name} has changed; it is now\n{found}");
}

fn names() -> [VehicleId; 3] {
    ["ada", "bob", "eve"].map(VehicleId::new)
}

/// A model with most kinds of terms.
fn model(inputs: InputSpec) -> Model {
    let columns: Vec<usize> = inputs.link_coordinates().collect();
    let path = Correlation::isotropic(Shape::Matern32, &columns, 400.0).unwrap();
    let path = Term::of(2.5, path).unwrap().partly_reciprocal(inputs.swap_ends().unwrap(), 0.75).unwrap();
    let ends: Vec<usize> = inputs.receiver().take(2).collect();
    let receiver = Correlation::new(Shape::RationalQuadratic { alpha: 1.5 }, &ends, &[300.0, 250.0]).unwrap();
    let range = Correlation::isotropic(Shape::SquaredExponential, &[inputs.range()], 600.0).unwrap();
    let receiver = Term::of(0.5, receiver).unwrap().times(range).unwrap();
    let mean = inputs.range_mean(2.0, 0.004).unwrap();
    let chart = Chart {
        origin: Position::new(500_000.0, 4_900_000.0),
        scale_m: 500.0,
        reference: ReferenceSystem::About(Geographic { latitude_deg: 44.25, longitude_deg: 9.5 }),
    };
    Model::new(chart, inputs, Prior::new(Kernel::new(vec![path, receiver]).unwrap(), mean).unwrap())
}

fn plain() -> Team {
    let corner = |sign: f64| Position::new(500_000.0 + 640.0 * sign, 4_900_000.0 + 320.0 * sign);
    Team::new(names(), model(InputSpec::Positions), [corner(-1.0), corner(1.0)]).unwrap()
}

fn authenticated() -> Team {
    let order = vec![names()[2].clone(), names()[0].clone()];
    Team {
        model: model(InputSpec::PositionsAndDepths),
        grid: Grid { cell_m: 25.0, depth_cell_m: 2.5, start_s: -60.0, time_cell_s: 45.5 },
        frame_bytes: 64,
        slots: Slots { start_s: 3.0, ..Slots::cycle(7.5, order) },
        key: Some(key(1)),
        epoch: 12,
        packets_per_sender_max: 9,
        ..plain()
    }
}

/// A team with the simplest model, without a reference system.
fn simple() -> Team {
    let mut model = model(InputSpec::Positions);
    let term = Term::isotropic(Shape::Matern52, 4.0, 250.0, 4).unwrap();
    model.prior = Prior::new(Kernel::new(vec![term]).unwrap(), PriorMean::Zero).unwrap();
    model.chart.reference = ReferenceSystem::Unknown;
    Team { model, ..plain() }
}

/// A summary message of whole numbers.
fn summary(layout: &Layout, sender: u8, counter: u16) -> MapMessage {
    let point = |n: u8| Point {
        transmitter: Cell { east: 3 + 7 * n, north: 60 - 5 * n, depth: if layout.has_depth { n } else { 0 } },
        receiver: Cell { east: 55 - 11 * n, north: 2 + 9 * n, depth: if layout.has_depth { 31 - n } else { 0 } },
        information: 4 + 5 * n,
        mean: 3 * n as i8 - 5,
    };
    let block = |n: usize| Block {
        time: (29 * n + 17) as u8 % 64,
        points: (0..layout.points as u8).map(point).collect(),
        correlations: (0..layout.correlations()).map(|n| (n % 7) as i8 - 3).collect(),
    };
    MapMessage { sender, counter, model: 0, blocks: (0..layout.blocks).map(block).collect() }
}

/// A report of whole numbers, with or without unreported outcomes and own slots.
fn report(team: &Team, includes_own_slots: bool) -> Report {
    let outcome = |n: usize| match n % 4 {
        0 => Outcome::Missed,
        3 if includes_own_slots => Outcome::Unreported,
        _ => Outcome::Heard,
    };
    let depth = |n: u8| if team.model.inputs.has_depths() { 5 * n } else { 0 };
    let waypoint = |n: u8| Waypoint { slots: 2 + 7 * n, east: 100 + 9 * n, north: 200 - 17 * n, depth: depth(n) };
    Report {
        sender: 1,
        model: 0,
        first: 1234,
        includes_own_slots,
        outcomes: (0..25).map(outcome).collect(),
        waypoints: (0..3).map(waypoint).collect(),
    }
}

/// A snapshot of a vehicle that recorded, received and sent something. One packet is in conflict with another, one is
/// unconfirmed, and one member is muted.
fn snapshot(team: Team) -> Vec<u8> {
    let has_depth = team.model.inputs.has_depths();
    let [ada, bob, eve] = names();
    let mut agent = Agent::new(ada.clone(), Arc::new(team), AgentOptions::default());
    let layout = agent.team().layout(agent.team().frame_bytes).unwrap();
    for n in 0..5u8 {
        let place = |east: u8, north: u8| Position {
            depth_m: has_depth.then_some(f64::from(n)),
            heading_deg: (n == 2).then_some(f64::from(east)),
            ..Position::new(500_000.0 + f64::from(east), 4_900_000.0 + f64::from(north))
        };
        let link = Link { transmitter: place(10 * n, 7), receiver: place(50, 20 * n) };
        let kind = (n == 3).then(|| MessageKind::new("fast"));
        let (time_s, success) = (10.5 * f64::from(n), n % 2 == 0);
        agent
            .record([Event { time_s, transmitter_id: bob.clone(), receiver_id: ada.clone(), link, kind, success }])
            .unwrap();
    }
    let place = Position { depth_m: has_depth.then_some(1.5), ..Position::new(500_010.0, 4_900_020.0) };
    agent.record_positions([(3.0, place), (75.0, place)]).unwrap();
    let mut reporter = agent.clone();
    reporter.options = reports_alone();
    let own_report = reporter.next_frame(None, 32).unwrap().map(|frame| frame.bytes);
    let frame = |sender, counter, shift: i8| {
        let mut message = summary(layout, sender, counter);
        message.blocks[0].points[0].mean += shift;
        agent.codec().write(layout, &message).unwrap()
    };
    let received = [frame(1, 0, 0), frame(1, 1, 0), frame(1, 1, 1), frame(2, 5000, 0), frame(0, 3, 0)];
    let sent = [frame(0, 4, 0), frame(0, 5, 0), frame(0, 4, 0)];
    let reports = [false, true].map(|own| agent.codec().write_report(&report(agent.team(), own)).unwrap());
    for bytes in received.into_iter().chain(reports) {
        agent.apply(Entry::Received { time_s: None, bytes }).unwrap();
    }
    for (number, bytes) in (0_u32..).zip(sent.into_iter().chain(own_report)) {
        let slot = number.is_multiple_of(2).then_some(40 + number);
        let states = [FrameState::Proposed, FrameState::Dropped, FrameState::Departed];
        let state = states[number as usize % 3];
        agent.apply(Entry::Sent { number: number.into(), state, slot, bytes }).unwrap();
    }
    agent.apply(Entry::Outcome { time_s: 33.0, transmitter_id: bob.clone(), success: false }).unwrap();
    let (member, is_independent) = (bob.clone(), true);
    agent.apply(Entry::PeerPosition { member, time_s: 30.0, position: place, is_independent }).unwrap();
    agent.apply(Entry::UnusedSlot { sender: eve.clone(), slot: 2 }).unwrap();
    agent.apply(Entry::Piggyback { sender: eve.clone(), newest: 4, outcomes: vec![true, false] }).unwrap();
    agent.set_muted(&eve, true);
    let status = agent.status();
    assert_eq!((status.live_packets, status.members[&bob].conflicts), (2, 1));
    agent.snapshot()
}

fn model_file() -> String {
    ModelFile { model: authenticated().model, learned: None, site_log_digests: Vec::new() }.write().unwrap()
}

fn team_file() -> String {
    TeamFile::write(&authenticated(), "model.toml", Some("key.hex"), None).unwrap()
}

#[test]
fn packets_keep_their_bytes() {
    let mut found = String::new();
    for (name, team) in [("plain", plain()), ("authenticated", authenticated())] {
        let agent = Agent::new(names()[0].clone(), Arc::new(team), AgentOptions::default());
        let (codec, team) = (agent.codec(), agent.team());
        let layout = team.layout(team.frame_bytes).unwrap();
        let packets = [
            ("summary", codec.write(layout, &summary(layout, 1, 700)).unwrap()),
            ("report", codec.write_report(&report(team, false)).unwrap()),
            ("report with own slots", codec.write_report(&report(team, true)).unwrap()),
        ];
        found += &packets.map(|(kind, bytes)| format!("{name} {kind}: {}\n", to_hex(&bytes))).concat();
    }
    check("packets.txt", &found);
}

#[test]
fn digests_of_teams_keep_their_values() {
    let lines = [("plain", plain()), ("authenticated", authenticated()), ("simple", simple())];
    let found: String = lines.map(|(name, team)| format!("{name} {}\n", to_hex(&team.digest()))).concat();
    check("digests.txt", &found);
}

#[test]
fn the_canonical_form_of_a_team_keeps_its_bytes() {
    check("configuration.hex", &(to_hex(&authenticated().canonical_bytes()) + "\n"));
}

#[test]
fn snapshots_keep_their_bytes() {
    check("plain.hex", &(to_hex(&snapshot(plain())) + "\n"));
    check("authenticated.hex", &(to_hex(&snapshot(authenticated())) + "\n"));
}

#[test]
fn files_keep_their_text() {
    check("model.toml", &model_file());
    check("team.toml", &team_file());
}

#[test]
fn comments_of_a_model_file_do_not_change_the_digest() {
    let text = model_file();
    let line = |line: &str| format!("{} # another comment\n", line.split('#').next().unwrap());
    let reworded: String = text.lines().map(line).collect();
    assert_ne!(reworded, text);
    let model = ModelFile::parse(&reworded).unwrap().model;
    assert_eq!(Team { model, ..authenticated() }.digest(), authenticated().digest());
}

/// A file with one changed bit is refused, gives the same team, or gives another digest. Values that members need not
/// agree on may change.
#[test]
fn no_changed_bit_of_a_file_gives_another_team_with_the_same_digest() {
    let (model, team) = (model_file(), team_file());
    let read = |model: &str, team: &str| {
        let model = ModelFile::parse(model).ok()?.model;
        TeamFile::parse(team).ok()?.team(model, Some(key(1))).ok()
    };
    let changed = |text: &str, bit: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        String::from_utf8(bytes).ok()
    };
    let expected = authenticated();
    let check = |team: Option<Team>, bit: usize| {
        let Some(team) = team.filter(|team| team.digest() == expected.digest()) else { return 0 };
        let meaning = |team: &Team| (team.model.inputs, team.model.prior.clone(), team.grid, team.members.clone());
        assert_eq!(meaning(&team), meaning(&expected), "{bit}");
        let slots = |team: &Team| (team.slots.clone(), team.frame_bytes, team.epoch, team.packets_per_sender_max);
        assert_eq!(slots(&team), slots(&expected), "{bit}");
        1
    };
    let same_models: usize =
        (0..8 * model.len()).map(|bit| check(changed(&model, bit).and_then(|model| read(&model, &team)), bit)).sum();
    let same_teams: usize =
        (0..8 * team.len()).map(|bit| check(changed(&team, bit).and_then(|team| read(&model, &team)), bit)).sum();
    // Comments may contain any text.
    assert!(same_models > 100 && same_teams < 400, "{same_models} {same_teams}");
}
