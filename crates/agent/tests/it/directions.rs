//! Terms that depend on directions: aspects of both ends, and the difference between both directions of a path.

use crate::common::*;
use pingmap_agent::*;

const SPEC: InputSpec = InputSpec::Positions;

fn structure(additions: &[OptionalTerm]) -> Structure {
    additions.iter().fold(Structure::default(), |all, &term| all.with(term))
}

fn template(additions: &[OptionalTerm]) -> Model {
    Model::new(Chart::about([]), SPEC, structure(additions).template(SPEC, 500.0).unwrap())
}

fn heading(end: Position, heading_deg: f64) -> Position {
    Position { heading_deg: Some(heading_deg), ..end }
}

/// Returns the link with a heading of each end.
fn heading_link(ends: [f64; 4], [transmitter_deg, receiver_deg]: [f64; 2]) -> Link {
    let Link { transmitter, receiver } = link(ends);
    Link { transmitter: heading(transmitter, transmitter_deg), receiver: heading(receiver, receiver_deg) }
}

#[test]
fn an_aspect_is_the_bearing_of_the_other_end_from_the_bow() {
    // The receiver is 100 m east of the transmitter.
    let east = [0.0, 0.0, 100.0, 0.0];
    for (headings, expected) in [
        ([90.0, 0.0], [1.0, 0.0, 0.0, -1.0]),
        ([0.0, 270.0], [0.0, 1.0, 1.0, 0.0]),
        ([180.0, 180.0], [0.0, -1.0, 0.0, 1.0]),
        ([-270.0, 360.0], [1.0, 0.0, 0.0, -1.0]),
    ] {
        let inputs = template(&[]).inputs([heading_link(east, headings)]).unwrap();
        let row = inputs.row(0);
        let found = [End::Transmitter, End::Receiver].map(|end| &row[SPEC.aspect(end)]).concat();
        let is_near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12);
        assert!(is_near, "{headings:?}: {found:?}");
    }
}

#[test]
fn an_aspect_term_is_unchanged_by_a_rotation_of_the_whole_team() {
    let aspects = [OptionalTerm::TransmitterAspect, OptionalTerm::ReceiverAspect];
    let rotated = |angle_deg: f64| {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let turn = |e: f64, n: f64| [e * cos + n * sin, n * cos - e * sin];
        let link = |[a, b, c, d]: [f64; 4], headings: [f64; 2]| {
            let ([a, b], [c, d]) = (turn(a, b), turn(c, d));
            heading_link([a, b, c, d], headings.map(|deg| deg + angle_deg))
        };
        let model = template(&aspects);
        let links = [link([10.0, 20.0, 300.0, -40.0], [15.0, 80.0]), link([0.0, 90.0, -200.0, 400.0], [200.0, -30.0])];
        let terms = model.prior.kernel().terms()[1..].to_vec();
        dgpc::Kernel::new(terms).unwrap().gram(&model.inputs(links).unwrap()).unwrap()[(0, 1)]
    };
    assert!((rotated(0.0) - rotated(73.0)).abs() < 1e-12);
    assert!(rotated(0.0) > 0.01);
}

#[test]
fn an_aspect_term_says_nothing_of_an_end_without_a_heading() {
    let known = heading_link([0.0, 0.0, 100.0, 50.0], [30.0, 60.0]);
    let unknown = Link { receiver: known.receiver.without_heading(), ..known };
    let model = template(&[OptionalTerm::ReceiverAspect]);
    let aspect = dgpc::Kernel::new(model.prior.kernel().terms()[1..].to_vec()).unwrap();
    let gram = aspect.gram(&model.inputs([known, unknown]).unwrap()).unwrap();
    assert_eq!([gram[(0, 0)], gram[(0, 1)], gram[(1, 1)]], [1.0, 0.0, 0.0]);
}

/// Events on random links that are heard if `hears` returns true.
fn events(count: usize, hears: impl Fn(&Link) -> bool) -> Vec<Event> {
    let mut random = fastrand(7);
    let mut number = move || 800.0 * random();
    let event = |n: usize| {
        let ends = [number(), number(), number(), number()];
        let link = heading_link(ends, [number() * 0.45, number() * 0.45]);
        Event {
            time_s: n as f64,
            transmitter_id: VehicleId::new("a"),
            receiver_id: VehicleId::new("b"),
            link,
            kind: None,
            success: hears(&link),
        }
    };
    (0..count).map(event).collect()
}

/// A linear congruential generator of numbers from 0 to 1.
fn fastrand(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn learned(events: &[Event], additions: &[OptionalTerm]) -> LearnedModel {
    let learning = Learning { additions: additions.to_vec(), ..Learning::default() };
    learning.best(Chart::about([]), SPEC, events, &[]).unwrap()
}

#[test]
fn a_one_way_path_is_learned_where_the_direction_decides() {
    // Sound carries westwards only.
    let events = events(250, |link| link.transmitter.east_m > link.receiver.east_m);
    let [both, one] = [&[][..], &[OptionalTerm::OneWay]].map(|additions| learned(&events, additions));
    assert!(one.structure.additions.has(OptionalTerm::OneWay));
    assert!(one.leave_one_out() > both.leave_one_out() + 0.1);
    assert!(one.model.prior.kernel().terms()[0].reciprocity() < 0.5);
}

#[test]
fn a_one_way_path_is_not_learned_where_both_directions_are_equal() {
    let events = events(250, |link| link.transmitter.east_m + link.receiver.east_m > 800.0);
    let model = learned(&events, &[OptionalTerm::OneWay]);
    assert!(!model.structure.additions.has(OptionalTerm::OneWay));
    assert_eq!(model.model.prior.kernel().terms()[0].reciprocity(), 1.0);
}

#[test]
fn a_receiver_aspect_is_learned_where_the_stern_is_deaf() {
    let ahead = |link: &Link| template(&[]).inputs([link]).unwrap().row(0)[SPEC.aspect(End::Receiver).start];
    let events = events(250, |link| ahead(link) > -0.3);
    let tried = [OptionalTerm::TransmitterAspect, OptionalTerm::ReceiverAspect];
    let model = learned(&events, &tried);
    assert_eq!(tried.map(|term| model.structure.additions.has(term)), [false, true]);
    assert!(model.leave_one_out() > -0.25);
}

#[test]
fn a_prediction_without_a_heading_is_the_mean_over_headings() {
    let ahead = |link: &Link| template(&[]).inputs([link]).unwrap().row(0)[SPEC.aspect(End::Receiver).start];
    let model = template(&[OptionalTerm::ReceiverAspect]);
    let area = [Position::new(0.0, 0.0), Position::new(800.0, 800.0)];
    let team = Team::new(["a", "b"].map(VehicleId::new), model, area).unwrap();
    let mut agent = Agent::new(VehicleId::new("b"), std::sync::Arc::new(team), AgentOptions::default());
    agent.record(events(150, |link| ahead(link) > 0.0)).unwrap();
    agent.refit().unwrap();
    let unknown = link([100.0, 200.0, 400.0, 350.0]);
    let known = |heading_deg| Link { receiver: heading(unknown.receiver, heading_deg), ..unknown };
    let each = agent.predict_intervals((0..8).map(|n| known(45.0 * f64::from(n)))).unwrap();
    let average = |of: fn(&Prediction) -> f64| each.iter().map(of).sum::<f64>() / 8.0;
    let found = agent.predict_intervals([unknown]).unwrap()[0];
    // The ends differ by much more than the tolerance.
    let probabilities = each.iter().map(|one| one.probability);
    assert!(probabilities.clone().fold(0.0, f64::max) > probabilities.fold(1.0, f64::min) + 0.3);
    assert!((found.probability - average(|one| one.probability)).abs() < 1e-12);
    assert!((found.mean - average(|one| one.mean)).abs() < 1e-12);
    // The variance includes that of the mean over headings.
    let squared = average(|one| one.variance + one.mean * one.mean);
    assert!((found.variance - (squared - found.mean * found.mean)).abs() < 1e-9);
    let Interval { low, high, .. } = found.interval.unwrap();
    assert!(low < found.probability && found.probability < high);
}

#[test]
fn headings_are_averaged_under_a_model_that_the_vehicle_learned_itself() {
    let ahead = |link: &Link| template(&[]).inputs([link]).unwrap().row(0)[SPEC.aspect(End::Receiver).start];
    let area = [Position::new(0.0, 0.0), Position::new(800.0, 800.0)];
    let team = Team::new(["a", "b"].map(VehicleId::new), template(&[]), area).unwrap();
    let mut agent = Agent::new(VehicleId::new("b"), std::sync::Arc::new(team), AgentOptions::default());
    agent.record(events(250, |link| ahead(link) > -0.3)).unwrap();
    let learning = Learning { additions: vec![OptionalTerm::ReceiverAspect], ..Learning::default() };
    let learned = agent.adapt(&learning).unwrap();
    assert!(learned.structure.additions.has(OptionalTerm::ReceiverAspect));
    let unknown = link([100.0, 200.0, 400.0, 350.0]);
    let known = |n: u8| Link { receiver: heading(unknown.receiver, 45.0 * f64::from(n)), ..unknown };
    let each: Vec<f64> = (0..8).map(|n| agent.probability(known(n)).unwrap()).collect();
    let average = each.iter().sum::<f64>() / 8.0;
    assert!((agent.probability(unknown).unwrap() - average).abs() < 1e-12);
}

#[test]
fn an_event_without_a_heading_is_predicted_without_the_aspect_term() {
    let team = Team::new(
        ["a", "b"].map(VehicleId::new),
        template(&[OptionalTerm::ReceiverAspect]),
        [Position::new(0.0, 0.0), Position::new(800.0, 800.0)],
    );
    let mut agent = Agent::new(VehicleId::new("b"), std::sync::Arc::new(team.unwrap()), AgentOptions::default());
    let mut all = events(60, |link| link.range_m() < 400.0);
    let event = Event { link: link([100.0, 200.0, 400.0, 350.0]), ..all.pop().unwrap() };
    agent.record(all).unwrap();
    agent.refit().unwrap();
    let inputs = agent.team().model.inputs([event.query()]).unwrap();
    let direct = agent.posterior(Which::Fused).unwrap().latent(&inputs).unwrap();
    let found = agent.predict([event.query()], Which::Fused).unwrap()[0];
    assert_eq!([found.mean, found.variance], [direct.mean[0], direct.variance[0]]);
    // The mean over headings is another prediction.
    let averaged = LinkQuery { unknown_heading: UnknownHeading::Averaged, ..event.query() };
    let averaged = agent.predict([averaged], Which::Fused).unwrap()[0];
    assert!((averaged.variance - found.variance).abs() > 1e-3);
}
