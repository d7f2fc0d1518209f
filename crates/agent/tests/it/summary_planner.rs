//! The choice of summaries: they hold what listeners cannot know yet, and end when nothing more is worth a frame.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_vehicle_stops_sending_after_a_bounded_number_of_packets(model in models(), events in events_of(0, 1..40)) {
        let mut agent = vehicle(&Arc::new(team(2, model)), 0, events);
        let packets = frames(&mut agent, 64).len();
        prop_assert!(packets < 30, "{}", packets);
        let before = (agent.snapshot(), agent.status());
        for frame_bytes in [32, 64, 256] {
            prop_assert_eq!(agent.next_frame(None, frame_bytes).unwrap(), None, "{}", frame_bytes);
        }
        prop_assert_eq!((agent.snapshot(), agent.status()), before);
    }
}

/// A vehicle that has sent everything that is worth a frame.
fn exhausted(team: Team) -> (Agent, Vec<Vec<u8>>) {
    let mut agent = vehicle(&Arc::new(team), 0, walk(0, 40, 0.0));
    let packets = frames(&mut agent, 40);
    assert!((1..40).contains(&packets.len()), "{}", packets.len());
    (agent, packets)
}

#[test]
fn events_that_contradict_sent_packets_are_worth_frames() {
    let (mut agent, packets) = exhausted(team(2, model()));
    let mut listener = vehicle(&Arc::new(team(2, model())), 1, []);
    receive_all(&mut listener, &packets);
    // Two later events with the opposite outcome for each of the first events.
    let opposite = walk(0, 40, 0.0).into_iter().flat_map(|event| {
        let later = Event { time_s: event.time_s + 1000.0, success: !event.success, ..event };
        [later.clone(), later]
    });
    agent.record(opposite).unwrap();
    let error = |agent: &mut Agent, listener: &mut Agent| {
        let p = [agent, listener].map(test_probabilities);
        p[0].iter().zip(&p[1]).map(|(a, b)| (a - b).abs()).sum::<f64>() / p[0].len() as f64
    };
    let before = error(&mut agent, &mut listener);
    let news = frames(&mut agent, 40);
    assert!((1..40).contains(&news.len()), "{}", news.len());
    receive_all(&mut listener, &news);
    let after = error(&mut agent, &mut listener);
    assert!(before > 0.2 && after < 0.3 * before, "{before} {after}");
}

#[test]
fn one_more_similar_event_is_worth_few_frames() {
    let (mut agent, packets) = exhausted(team(2, model()));
    agent.record([walk(0, 41, 0.0).remove(40)]).unwrap();
    let more = frames(&mut agent, 40).len();
    assert!(more < packets.len(), "{more} {}", packets.len());
}

#[test]
fn events_beyond_the_grid_change_predictions_and_are_not_sent() {
    let mut small = team(2, model());
    small.grid.cell_m = 1.0;
    let far = |n: usize| event_at(0, n as f64, link([300.0, n as f64, 350.0, 0.0]), false);
    let mut agent = vehicle(&Arc::new(small), 0, (0..20).map(far));
    assert_eq!(agent.next_frame(None, 32), Ok(None));
    assert!(agent.probability(far(3).link).unwrap() < 0.3);
    // Events within the grid are sent, and nothing else is.
    let near = |n: usize| event_at(0, 100.0 + n as f64, link([n as f64, 0.0, 0.0, 5.0]), true);
    agent.record((0..20).map(near)).unwrap();
    assert!(!frames(&mut agent, 5).is_empty());
    let sent = summarised_links(&agent, 0).concat();
    assert!(sent.iter().all(|link| link.transmitter.east_m.abs() < 32.0), "{sent:?}");
}

#[test]
fn depths_do_not_matter_to_a_model_without_depths() {
    let deep = walk(0, 20, 0.0).into_iter().map(|mut event| {
        event.link.receiver.depth_m = Some(900.0);
        event
    });
    let team = Arc::new(team(2, model()));
    let (mut deep, mut flat) = (vehicle(&team, 0, deep), vehicle(&team, 0, walk(0, 20, 0.0)));
    assert_eq!(deep.next_frame(None, 32), flat.next_frame(None, 32));
}

#[test]
fn packets_correct_a_prior_that_is_far_off() {
    // The prior has even odds at 500 m and odds of 1 to 3000 at 1.5 km. But at 1.5 km everything is heard.
    let Model { chart, inputs, prior, .. } = model();
    let range = inputs.range_mean(4.0, 0.008).unwrap();
    let model = Model::new(chart, inputs, dgpc::Prior::new(prior.kernel().clone(), range).unwrap());
    let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
    let team = Arc::new(Team::new(names(2), model, reach).unwrap());
    let link = |shift: f64| Link {
        transmitter: Position::new(-750.0 + shift, 100.0),
        receiver: Position::new(750.0, -100.0 - shift),
    };
    let event = |n: usize| event_at(0, 60.0 * n as f64, link(n as f64), true);
    let [mut sender, mut listener] =
        [0, 1].map(|number| Agent::new(name(number), team.clone(), AgentOptions::default()));
    sender.record((0..60).map(event)).unwrap();
    while let Some(packet) = sender.next_frame(None, 32).unwrap().map(|frame| frame.bytes) {
        assert_eq!(listener.receive(&packet, None).receipt, Receipt::Accepted);
    }
    let [of_sender, of_listener] = [&mut sender, &mut listener].map(|agent| agent.probability(link(30.0)).unwrap());
    assert!(of_sender > 0.8 && (of_sender - of_listener).abs() < 0.1, "{of_sender} {of_listener}");
}

#[test]
fn thinned_candidates_come_from_every_transmitter() {
    for senders in [3, 4] {
        let mut team = team(2, model());
        team.limits = Limits { dense_events_max: 300, candidates_max: 300, inducing_points_max: 60, ..team.limits };
        // Every transmitter has a corner of its own, and transmits every third or fourth event.
        let event = |n: usize| {
            let corner = [[-400.0, -400.0], [400.0, -400.0], [-400.0, 400.0], [400.0, 400.0]][n % senders];
            let along = 0.1 * n as f64;
            event_at(0, n as f64, link([corner[0] + along.sin(), corner[1], 100.0 * along.cos(), 30.0]), n % 7 < 4)
        };
        for count in [301, 450, 599, 600, 900, 1201] {
            let agent = vehicle(&Arc::new(team.clone()), 0, (0..count).map(event));
            let candidates = agent.team().candidates(agent.events());
            let of = |east_m: f64, north_m: f64| {
                let is_near = |near: &&LinkQuery| {
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
fn many_certain_events_with_a_sharp_edge_are_worth_frames() {
    // Links are heard within 700 m and missed beyond, in a square of 2 km. Five certain points are wrong around
    // themselves.
    let chart = Chart { scale_m: 800.0, ..Chart::about([]) };
    let learning = Learning::default();
    let prior = learning.template(&learning.structure, InputSpec::Positions, chart.scale_m).unwrap();
    let model = Model::new(chart, InputSpec::Positions, prior);
    let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
    let team = Arc::new(Team::new(names(2), model, reach).unwrap());
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
    let links = agent.team().candidates(agent.events());
    let expected = probabilities(&mut agent, &links);
    let divergence = |listener: &mut Agent| {
        let part = |p: f64, q: f64| if p > 0.0 { p * (p / q).ln() } else { 0.0 };
        let predicted = probabilities(listener, &links);
        let all = expected.iter().zip(&predicted).map(|(&p, &q)| part(p, q) + part(1.0 - p, 1.0 - q));
        all.sum::<f64>() / expected.len() as f64
    };
    let before = divergence(&mut listener);
    let mut left = before;
    for n in 0..8 {
        let packet = agent.next_frame(None, 32).unwrap().expect("the listener lacks much").bytes;
        listener.receive(&packet, None);
        let now = divergence(&mut listener);
        assert!(now < left, "packet {n}: {left} to {now}");
        left = now;
    }
    assert!(left < before / 10.0, "{before} to {left}");
}
