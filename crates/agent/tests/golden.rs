//! Bytes that vehicles of one team must agree on to the bit, written down: digests, snapshots, team and model files. All
//! of them are made of whole numbers and plain decimals, never of fits. Whoever changes one of them on purpose raises the
//! version that it belongs to, says so in CHANGELOG.md, and takes over what the test prints.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::key;
use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};
use pingmap_agent::*;
use pingmap_packet::{Block, Cell, Layout, MapMessage, Point, to_hex};

fn names() -> [VehicleId; 3] {
    ["ada", "bob", "eve"].map(VehicleId::new)
}

/// A model with a bit of everything that models can have.
fn model(inputs: InputSpec) -> Model {
    let columns: Vec<usize> = inputs.link_coordinates().collect();
    let path = Correlation::isotropic(Shape::Matern32, &columns, 400.0).unwrap();
    let path = Term::of(2.5, path).unwrap().reciprocal(inputs.swap_ends().unwrap()).unwrap();
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

fn open() -> Team {
    let corner = |sign: f64| Position::new(500_000.0 + 640.0 * sign, 4_900_000.0 + 320.0 * sign);
    Team::new(names(), model(InputSpec::Positions), [corner(-1.0), corner(1.0)]).unwrap()
}

fn sealed() -> Team {
    let order = vec![names()[2].clone(), names()[0].clone()];
    Team {
        model: model(InputSpec::PositionsAndDepths),
        grid: Grid { cell_m: 25.0, depth_cell_m: 2.5, start_s: -60.0, time_cell_s: 45.5 },
        frame_bytes: 64,
        slots: Slots { start_s: 3.0, ..Slots::in_turn(7.5, order) },
        key: Some(key(1)),
        epoch: 12,
        packets_per_sender_max: 9,
        ..open()
    }
}

fn plain() -> Team {
    let mut model = model(InputSpec::Positions);
    let term = Term::isotropic(Shape::Matern52, 4.0, 250.0, 4).unwrap();
    model.prior = Prior::new(Kernel::new(vec![term]).unwrap(), PriorMean::Zero).unwrap();
    model.chart.reference = ReferenceSystem::Unknown;
    Team { model, ..open() }
}

/// A message of whole numbers.
fn message(layout: &Layout, sender: u8, counter: u16) -> MapMessage {
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

/// What a vehicle remembers that saw, heard and sent something; one packet is in conflict with another one, and one waits.
fn snapshot(team: Team) -> Vec<u8> {
    let has_depth = team.model.inputs.has_depths();
    let mut agent = Agent::new(names()[0].clone(), Arc::new(team));
    let layout = agent.team().layout(agent.team().frame_bytes).unwrap();
    for n in 0..5u8 {
        let place = |east: u8, north: u8| Position {
            depth_m: has_depth.then_some(f64::from(n)),
            ..Position::new(500_000.0 + f64::from(east), 4_900_000.0 + f64::from(north))
        };
        let link = Link { transmitter: place(10 * n, 7), receiver: place(50, 20 * n) };
        let [receiver_id, transmitter_id, _] = names();
        let event =
            Event { time_s: 10.5 * f64::from(n), transmitter_id, receiver_id, link, kind: None, success: n % 2 == 0 };
        agent.observe(event).unwrap();
    }
    let place = Position { depth_m: has_depth.then_some(1.5), ..Position::new(500_010.0, 4_900_020.0) };
    agent.navigate([(3.0, place), (75.0, place)]).unwrap();
    let report = agent.clone().telling(Telling { points: false, reports: true }).next_packet(0.0, 32).unwrap();
    let frame = |sender, counter, shift: i8| {
        let mut message = message(layout, sender, counter);
        message.blocks[0].points[0].mean += shift;
        agent.write(layout, &message).unwrap()
    };
    let heard = [frame(1, 0, 0), frame(1, 1, 0), frame(1, 1, 1), frame(2, 5000, 0), frame(0, 3, 0)];
    let sent = [frame(0, 4, 0), frame(0, 5, 0), frame(0, 4, 0)];
    for bytes in heard {
        agent.apply(Entry::Heard { bytes }).unwrap();
    }
    for (number, bytes) in (0_u32..).zip(sent.into_iter().chain(report)) {
        let slot = number.is_multiple_of(2).then_some(40 + number);
        agent.apply(Entry::Sent { number: number.into(), slot, bytes }).unwrap();
    }
    assert_eq!((agent.live_packets(), agent.conflicts(&names()[1])), (3, 1));
    agent.snapshot()
}

/// Compares a text with what is written down, and prints it where it differs.
fn check(name: &str, found: &str, expected: &str) {
    assert!(found == expected, "{name} has changed; it is now\n{found}");
}

#[test]
fn digests_do_not_drift() {
    let lines = [("open", open()), ("sealed", sealed()), ("plain", plain())];
    let found: String = lines.map(|(name, team)| format!("{name} {}\n", to_hex(&team.digest()))).concat();
    check("digests.txt", &found, include_str!("golden/digests.txt"));
}

#[test]
fn what_a_digest_is_of_does_not_drift() {
    check("agreement.hex", &(to_hex(&sealed().canonical_bytes()) + "\n"), include_str!("golden/agreement.hex"));
}

#[test]
fn snapshots_do_not_drift() {
    check("open.hex", &(to_hex(&snapshot(open())) + "\n"), include_str!("golden/open.hex"));
    check("sealed.hex", &(to_hex(&snapshot(sealed())) + "\n"), include_str!("golden/sealed.hex"));
}

#[test]
fn files_do_not_drift_and_their_comments_mean_nothing() {
    let file = ModelFile { model: sealed().model, learned: None, place_log_digests: Vec::new() };
    let text = file.write().unwrap();
    check("model.toml", &text, include_str!("golden/model.toml"));
    let team = TeamFile::write(&sealed(), "model.toml", Some("key.hex"), None).unwrap();
    check("team.toml", &team, include_str!("golden/team.toml"));
    let reworded: String =
        text.lines().map(|line| format!("{} # said otherwise\n", line.split('#').next().unwrap())).collect();
    assert_ne!(reworded, text);
    let model = ModelFile::parse(&reworded).unwrap().model;
    assert_eq!(Team { model, ..sealed() }.digest(), sealed().digest());
}

/// Every flipped bit of a file is refused, gives the same team, or another digest; what a vehicle decides for itself may
/// differ.
#[test]
fn no_flipped_bit_of_a_file_passes_for_the_agreement_and_means_another() {
    let (model, team) = (include_str!("golden/model.toml"), include_str!("golden/team.toml"));
    let read = |model: &str, team: &str| {
        let model = ModelFile::parse(model).ok()?.model;
        TeamFile::parse(team).ok()?.team(model, Some(key(1))).ok()
    };
    let flipped = |text: &str, bit: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        String::from_utf8(bytes).ok()
    };
    let expected = sealed();
    let check = |team: Option<Team>, bit: usize| {
        let Some(team) = team.filter(|team| team.digest() == expected.digest()) else { return 0 };
        let meaning = |team: &Team| (team.model.inputs, team.model.prior.clone(), team.grid, team.members.clone());
        assert_eq!(meaning(&team), meaning(&expected), "{bit}");
        let slots = |team: &Team| (team.slots.clone(), team.frame_bytes, team.epoch, team.packets_per_sender_max);
        assert_eq!(slots(&team), slots(&expected), "{bit}");
        1
    };
    let same_models: usize =
        (0..8 * model.len()).map(|bit| check(flipped(model, bit).and_then(|model| read(&model, team)), bit)).sum();
    let same_teams: usize =
        (0..8 * team.len()).map(|bit| check(flipped(team, bit).and_then(|team| read(model, &team)), bit)).sum();
    // Comments may say anything.
    assert!(same_models > 100 && same_teams < 400, "{same_models} {same_teams}");
}
