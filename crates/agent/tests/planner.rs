//! What a vehicle tells: what others cannot know yet, and then nothing.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::*;
use pingmap_agent::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn there_is_an_end_to_what_a_vehicle_can_tell(model in models(), events in events_of(0, 1..40)) {
        let mut agent = vehicle(&Arc::new(team(2, model)), 0, events);
        let packets = sent(&mut agent, 64).len();
        prop_assert!(packets < 30, "{}", packets);
        let (before, counters) = (agent.snapshot(), agent.live_packets());
        for frame_bytes in [32, 64, 256] {
            prop_assert_eq!(agent.next_packet(0.0, 32).unwrap(), None, "{}", frame_bytes);
        }
        prop_assert_eq!((agent.snapshot(), agent.live_packets()), (before, counters));
    }
}

/// A vehicle that has told all it knows.
fn told_out(team: Team) -> (Agent, Vec<Vec<u8>>) {
    let mut agent = vehicle(&Arc::new(team), 0, walk(0, 40, 0.0));
    let packets = sent(&mut agent, 40);
    assert!((1..40).contains(&packets.len()), "{}", packets.len());
    (agent, packets)
}

#[test]
fn events_that_contradict_what_was_said_are_worth_a_frame() {
    let (mut agent, packets) = told_out(team(2, model()));
    let mut listener = vehicle(&Arc::new(team(2, model())), 1, []);
    packets.iter().for_each(|bytes| drop(listener.receive(bytes, 0.0)));
    // Wherever it heard somebody, it now hears nobody, and the other way round.
    let opposite = walk(0, 40, 0.0).into_iter().flat_map(|event| {
        let later = Event { time_s: event.time_s + 1000.0, success: !event.success, ..event };
        [later.clone(), later]
    });
    agent.observe_all(opposite).unwrap();
    let off = |agent: &mut Agent, listener: &mut Agent| {
        let p = [agent, listener].map(|agent| agent.probabilities(somewhere()).unwrap());
        p[0].iter().zip(&p[1]).map(|(a, b)| (a - b).abs()).sum::<f64>() / p[0].len() as f64
    };
    let before = off(&mut agent, &mut listener);
    let news = sent(&mut agent, 40);
    assert!((1..40).contains(&news.len()), "{}", news.len());
    news.iter().for_each(|bytes| drop(listener.receive(bytes, 0.0)));
    let after = off(&mut agent, &mut listener);
    assert!(before > 0.2 && after < 0.3 * before, "{before} {after}");
}

#[test]
fn more_of_what_was_said_is_hardly_worth_a_frame() {
    let (mut agent, packets) = told_out(team(2, model()));
    agent.observe(walk(0, 41, 0.0).remove(40)).unwrap();
    let more = sent(&mut agent, 40).len();
    assert!(more < packets.len(), "{more} {}", packets.len());
}

#[test]
fn events_beyond_the_grid_are_known_and_not_told() {
    let mut small = team(2, model());
    small.grid.cell_m = 1.0;
    let far = |n: usize| event_at(0, n as f64, link([300.0, n as f64, 350.0, 0.0]), false);
    let mut agent = vehicle(&Arc::new(small.clone()), 0, (0..20).map(far));
    assert_eq!(agent.next_packet(0.0, 32), Ok(None));
    assert!(agent.probability(far(3).link).unwrap() < 0.3);
    // Those within are told all the same, and nothing else is.
    let near = |n: usize| event_at(0, 100.0 + n as f64, link([n as f64, 0.0, 0.0, 5.0]), true);
    agent.observe_all((0..20).map(near)).unwrap();
    assert!(!sent(&mut agent, 5).is_empty());
    let told = told_by(&agent, 0).concat();
    assert!(told.iter().all(|link| link.transmitter.east_m.abs() < 32.0), "{told:?}");
}

#[test]
fn depth_hides_no_event_from_a_model_that_does_not_look_at_it() {
    let deep = walk(0, 20, 0.0).into_iter().map(|mut event| {
        event.link.receiver.depth_m = Some(900.0);
        event
    });
    let team = Arc::new(team(2, model()));
    let (mut deep, mut flat) = (vehicle(&team, 0, deep), vehicle(&team, 0, walk(0, 20, 0.0)));
    assert_eq!(deep.next_packet(0.0, 32), flat.next_packet(0.0, 32));
}

#[test]
fn nothing_new_is_said_again_so_often_and_no_more() {
    let repeating = |repeats_max| Team { repeats_max, ..team(2, model()) };
    let (_, expected) = told_out(repeating(0));
    for repeats_max in [1, 3] {
        let mut agent = vehicle(&Arc::new(repeating(repeats_max)), 0, walk(0, 40, 0.0));
        let all = sent(&mut agent, 200);
        let (new, again) = all.split_at(expected.len());
        assert_eq!(new, expected);
        // All in turn, as often as agreed, oldest first.
        let rounds: Vec<Vec<u8>> = (0..repeats_max).flat_map(|_| expected.clone()).collect();
        assert_eq!(again, rounds);
        assert_eq!(agent.next_packet(0.0, 32), Ok(None));

        // What is new comes first, and is said again then.
        agent.observe_all(walk(0, 40, 2.0)).unwrap();
        let more = sent(&mut agent, 200);
        let fresh = more.iter().take_while(|bytes| !expected.contains(bytes)).count();
        let new = more.iter().collect::<std::collections::BTreeSet<_>>().len();
        assert!(
            new > 0 && fresh == new * (1 + usize::from(repeats_max)) && fresh == more.len(),
            "{new} {}",
            more.len()
        );
    }
}

#[test]
fn a_prior_that_was_far_off_is_set_right() {
    // Even odds at 500 m, and next to nothing at 1.5 km: but there everything is heard.
    let Model { chart, inputs, prior, .. } = model();
    let range = inputs.range_mean(4.0, 0.008).unwrap();
    let model = Model::new(chart, inputs, dgpc::Prior::new(prior.kernel().clone(), range).unwrap());
    let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
    let names = ["a", "b"].map(VehicleId::new);
    let team = Arc::new(Team::new(names.clone(), model, reach).unwrap());
    let link = |shift: f64| Link {
        transmitter: Position::new(-750.0 + shift, 100.0),
        receiver: Position::new(750.0, -100.0 - shift),
    };
    let event = |n: usize| Event {
        time_s: 60.0 * n as f64,
        transmitter_id: names[1].clone(),
        receiver_id: names[0].clone(),
        link: link(n as f64),
        kind: None,
        success: true,
    };
    let [mut alice, mut bob] = names.clone().map(|name| Agent::new(name, team.clone()));
    alice.observe_all((0..60).map(event)).unwrap();
    while let Some(packet) = alice.next_packet(100.0, 32).unwrap() {
        assert_eq!(bob.receive(&packet, 100.0), Receipt::Accepted);
    }
    let (knows, told) = (alice.probability(link(30.0)).unwrap(), bob.probability(link(30.0)).unwrap());
    assert!(knows > 0.8 && (knows - told).abs() < 0.1, "{knows} {told}");
}

#[test]
fn thinning_spares_no_vehicle_that_sends_in_turn() {
    for senders in [3, 4] {
        let mut team = team(2, model());
        team.limits = Limits { dense_events_max: 300, candidates_max: 300, inducing_points_max: 60, ..team.limits };
        // Every sender has a corner of its own, and sends every third or fourth event.
        let event = |n: usize| {
            let corner = [[-400.0, -400.0], [400.0, -400.0], [-400.0, 400.0], [400.0, 400.0]][n % senders];
            let along = 0.1 * n as f64;
            event_at(0, n as f64, link([corner[0] + along.sin(), corner[1], 100.0 * along.cos(), 30.0]), n % 7 < 4)
        };
        for count in [301, 450, 599, 600, 900, 1201] {
            let agent = vehicle(&Arc::new(team.clone()), 0, (0..count).map(event));
            let candidates = agent.candidates();
            let of = |east_m: f64, north_m: f64| {
                let is_near = |near: &&Attempt| {
                    let end = near.link.transmitter;
                    (end.east_m - east_m).abs() < 2.0 && end.north_m == north_m
                };
                candidates.iter().filter(is_near).count()
            };
            let shares = [of(-400.0, -400.0), of(400.0, -400.0), of(-400.0, 400.0), of(400.0, 400.0)];
            let expected = 300 / senders;
            assert!(
                shares[..senders].iter().all(|share| share.abs_diff(expected) < expected / 3),
                "{count}: {shares:?}"
            );
        }
    }
}

#[test]
fn much_that_is_sharply_known_is_worth_a_frame() {
    // Heard within 700 m and missed beyond, all over a square of 2 km: what five points say surely is wrong around them.
    let chart = Chart { scale_m: 800.0, ..Chart::about([]) };
    let learning = Learning::default();
    let path = learning.structures.iter().find(|structure| structure.terms == Terms::Path).unwrap();
    let prior = learning.template(path, InputSpec::Positions, chart.scale_m).unwrap();
    let model = Model::new(chart, InputSpec::Positions, prior);
    let names = names(2);
    let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
    let team = Arc::new(Team::new(names.clone(), model, reach).unwrap());
    let mut state = 1u64;
    let mut place = || {
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            2000.0 * (state >> 11) as f64 / (1u64 << 53) as f64 - 1000.0
        };
        Position::new(next(), next())
    };
    let event = |n: usize| {
        let link = Link { transmitter: place(), receiver: place() };
        event_at(0, n as f64, link, link.range_m() < 700.0)
    };
    let mut agent = vehicle(&team, 0, (0..5000).map(event));
    let mut listener = vehicle(&team, 1, []);
    let links = agent.candidates();
    let known = agent.probabilities(&links).unwrap();
    let divergence = |listener: &mut Agent| {
        let part = |p: f64, q: f64| if p > 0.0 { p * (p / q).ln() } else { 0.0 };
        let told = listener.probabilities(&links).unwrap();
        let all = known.iter().zip(&told).map(|(&p, &q)| part(p, q) + part(1.0 - p, 1.0 - q));
        all.sum::<f64>() / known.len() as f64
    };
    let before = divergence(&mut listener);
    let mut left = before;
    for n in 0..8 {
        let packet = agent.next_packet(f64::from(n), 32).unwrap().expect("much is left to tell");
        listener.receive(&packet, 0.0);
        let now = divergence(&mut listener);
        assert!(now < left, "packet {n}: {left} to {now}");
        left = now;
    }
    assert!(left < before / 10.0, "{before} to {left}");
}
