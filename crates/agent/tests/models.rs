//! Columns of a link, structures, model files, and learning on board.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use dgpc::{Prior, Shape};
use pingmap_agent::*;

fn link(ends: [f64; 4]) -> Link {
    let [a, b, c, d] = ends;
    Link { transmitter: Position::new(a, b), receiver: Position::new(c, d) }
}

fn swapped(Link { transmitter, receiver }: Link) -> Link {
    Link { transmitter: receiver, receiver: transmitter }
}

/// Every structure, with its template on a chart of 500 m.
fn all_templates() -> Vec<(Structure, Model)> {
    let mut all = Given::default().many();
    all.push(Structure { mean: MeanStructure::Conservative { range_m: 400.0, slope_per_m: 0.01 }, ..all[0] });
    let template = |structure: Structure| {
        let prior = structure.template(InputSpec::Positions, 500.0).unwrap();
        (structure, Model::new(Chart::about([]), InputSpec::Positions, prior))
    };
    all.into_iter().map(template).collect()
}

#[test]
fn columns_follow_from_the_ends() {
    let deep = |east_m, north_m, depth_m| Position { depth_m: Some(depth_m), ..Position::new(east_m, north_m) };
    let link = Link { transmitter: deep(3.0, 0.0, 12.0), receiver: deep(0.0, 4.0, 0.0) };
    let spec = InputSpec::PositionsAndDepths;
    let prior = Given::default().few()[0].template(spec, 10.0).unwrap();
    let inputs = Model::new(Chart::about([]), spec, prior).inputs([&link]).unwrap();
    assert_eq!(spec.column_names().len(), inputs.dimension());
    assert_eq!(inputs.row(0)[spec.ends()], [3.0, 0.0, 12.0, 0.0, 4.0, 0.0]);
    assert_eq!(inputs.row(0)[spec.range()], 13.0);
    let half = 0.5f64.sqrt();
    let expected = [3.0, 4.0, 12.0, 3.0, -4.0, 12.0].map(|value| value * half);
    for (found, expected) in inputs.row(0)[spec.link_coordinates()].iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}

#[test]
fn reciprocal_paths_are_the_same_both_ways_and_one_way_paths_are_not() {
    let somewhere = link([10.0, 200.0, 430.0, -50.0]);
    let elsewhere = link([-100.0, 250.0, 300.0, 90.0]);
    for (structure, model) in all_templates() {
        let inputs = model.inputs([&somewhere, &swapped(somewhere), &elsewhere]).unwrap();
        // The path term alone: noise at the receiver knows which end it is at.
        let path = dgpc::Kernel::new(model.prior.kernel().terms()[..1].to_vec()).unwrap();
        let gram = path.gram(&inputs).unwrap();
        assert_eq!((gram[(0, 2)] - gram[(1, 2)]).abs() < 1e-12, structure.reciprocal, "{structure}");
    }
}

#[test]
fn model_files_read_back_to_the_same_model() {
    for (structure, model) in all_templates() {
        let learned = Provenance {
            log_digest: Some("c0ffee".to_owned()),
            from: "a \"log\".csv".to_owned(),
            structure: structure.to_string(),
            events: 10,
            events_used: 9,
            evidence: -1.25,
            leave_one_out: -0.5,
            variance_factor: 1.5,
            stop: "converged".to_owned(),
        };
        let file = ModelFile { model, learned: Some(learned), place_log_digests: Vec::new() };
        assert_eq!(ModelFile::parse(&file.write().unwrap()).unwrap(), file, "{structure}");
    }
    // With depths and a place on Earth.
    let prior = Given::default().few()[0].template(InputSpec::PositionsAndDepths, 77.0).unwrap();
    let place = Geographic { latitude_deg: 42.5, longitude_deg: -70.25 };
    for reference in [ReferenceSystem::Unknown, ReferenceSystem::About(place), ReferenceSystem::Epsg(32_619)] {
        let chart = Chart { reference, ..Chart::about([Position::new(431_234.0, 4_700_001.0)]) };
        let model = Model::new(chart, InputSpec::PositionsAndDepths, prior.clone());
        let file = ModelFile { model, learned: None, place_log_digests: Vec::new() };
        assert_eq!(ModelFile::parse(&file.write().unwrap()).unwrap(), file);
    }
}

#[test]
fn a_conservative_range_has_even_odds_there() {
    let mean = MeanStructure::Conservative { range_m: 500.0, slope_per_m: 0.008 };
    let structure = Structure { mean, ..Given::default().few()[0] };
    let model =
        Model::new(Chart::about([]), InputSpec::Positions, structure.template(InputSpec::Positions, 300.0).unwrap());
    let links = [link([0.0, 0.0, 300.0, 400.0]), link([0.0, 0.0, 0.0, 250.0])];
    let mean = model.prior.mean().values(&model.inputs(links).unwrap()).unwrap();
    assert!(mean[0].abs() < 1e-12 && (mean[1] - 2.0).abs() < 1e-12, "{mean:?}");
}

/// Events of one receiver: heard within 450 m.
fn events(receiver: &str, count: usize, phase: f64) -> Vec<Event> {
    let event = |n: usize| {
        let t = n as f64 * 0.37 + phase;
        let link = link([500.0 * t.sin(), 400.0 * (0.7 * t).cos(), 450.0 * (1.3 * t).cos(), 350.0 * (0.9 * t).sin()]);
        let (transmitter_id, receiver_id) = (VehicleId::new("other"), VehicleId::new(receiver));
        Event {
            time_s: 10.0 * n as f64,
            transmitter_id,
            receiver_id,
            kind: None,
            success: link.range_m() < 450.0,
            link,
        }
    };
    (0..count).map(event).collect()
}

fn team() -> Arc<Team> {
    let prior: Prior = Given::default().few()[0].template(InputSpec::Positions, 500.0).unwrap();
    let chart = Chart { scale_m: 500.0, ..Chart::about([]) };
    let reach = [Position::new(-500.0, -500.0), Position::new(500.0, 500.0)];
    let names = ["a", "b"].map(VehicleId::new);
    Arc::new(Team::new(names, Model::new(chart, InputSpec::Positions, prior), reach).unwrap())
}

fn vehicle(team: &Arc<Team>, name: &str, events: Vec<Event>) -> Agent {
    let mut agent = Agent::new(VehicleId::new(name), team.clone());
    agent.observe_all(events).unwrap();
    agent.refit().unwrap();
    agent
}

#[test]
fn an_agent_that_learns_by_itself_predicts_better_and_goes_on_from_there() {
    let team = team();
    let mut agent = vehicle(&team, "a", events("a", 80, 0.0));
    let elsewhere = events("a", 200, 0.19);
    let links: Vec<Link> = elsewhere.iter().map(|event| event.link).collect();
    let nll = |agent: &mut Agent| {
        let p = agent.probabilities(&links).unwrap();
        let ln = |(p, event): (&f64, &Event)| if event.success { p.ln() } else { (1.0 - p).ln() };
        -p.iter().zip(&elsewhere).map(ln).sum::<f64>() / p.len() as f64
    };
    let before = nll(&mut agent);
    let first = agent.adapt(&Learning::default()).unwrap().clone();
    let after = nll(&mut agent);
    assert!(after < before, "{after} {before}");
    assert_eq!(agent.model().prior, team.model.prior);

    // New events are read under its own model, until it goes on learning from where it was.
    agent.observe_all(events("a", 100, 0.0).into_iter().skip(80)).unwrap();
    assert_eq!(agent.posterior().unwrap().prior(), &first.model.prior);
    assert_eq!(agent.own_posterior().unwrap().prior(), &team.model.prior);
    let beside = agent.probabilities(&links).unwrap();
    agent.rebuild_posteriors().unwrap();
    assert_eq!(agent.own_model().unwrap().events, 80);
    let fitted = agent.probabilities(&links).unwrap();
    let moved = beside.iter().zip(&fitted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(moved < 0.08, "{moved}");
    let second = agent.adapt(&Learning::default()).unwrap().clone();
    assert_eq!((second.structure, second.events_used), (first.structure, 100));
    assert!(second.learned.starts.is_empty(), "a warm start is the only one");
    let observations = team.model.observations(agent.events()).unwrap();
    let begin = dgpc::fit(&first.learned.optimum, &observations, &Default::default()).unwrap().evidence();
    assert!(second.evidence() >= begin - 1e-6, "{} {begin}", second.evidence());
}

#[test]
fn what_others_say_is_learned_from_too() {
    let team = team();
    let mut sender = vehicle(&team, "b", events("b", 100, 0.5));
    let packets: Vec<Vec<u8>> = (0..5).map_while(|_| sender.next_packet(0.0, 32).unwrap()).collect();
    let fresh = || vehicle(&team, "a", events("a", 12, 0.0));
    let (mut alone, mut told) = (fresh(), fresh());
    // Without odds that fall with range, which would tell a vehicle alone nearly everything here.
    let zero = Given { mean: Some(MeanStructure::Zero), ..Given::default() };
    let learning = Learning { structures: zero.few(), ..Learning::default() };
    alone.adapt(&learning).unwrap();
    packets.iter().for_each(|bytes| assert_eq!(told.receive(bytes, 0.0), Receipt::Accepted));
    told.adapt(&learning).unwrap();
    assert_ne!(alone.own_model().unwrap().model.prior, told.own_model().unwrap().model.prior);
    let elsewhere = events("b", 200, 0.61);
    let links: Vec<Link> = elsewhere.iter().map(|event| event.link).collect();
    let right = |agent: &mut Agent| {
        let p = agent.probabilities(&links).unwrap();
        p.iter().zip(&elsewhere).filter(|(p, event)| (**p > 0.5) == event.success).count()
    };
    let (told, alone) = (right(&mut told), right(&mut alone));
    assert!(told > alone, "{told} {alone}");
}

#[test]
fn given_parts_are_kept() {
    let given = Given { shape: Some(Shape::SquaredExponential), terms: Some(Terms::Path), ..Given::default() };
    assert_eq!(given.few().len(), 1);
    assert!(given.many().iter().all(|s| s.shape == Shape::SquaredExponential && s.terms == Terms::Path));
    assert_eq!(given.many().len(), 3);
    let learning = Learning { variance: Some(3.0), length_scale_m: Some(250.0), ..Learning::default() };
    let fit = learning
        .fit(&learning.structures[0], Chart::about([]), InputSpec::Positions, &events("a", 60, 0.0), &[], None)
        .unwrap();
    let term = &fit.model.prior.kernel().terms()[0];
    assert!(
        (term.variance() - 3.0).abs() < 1e-12
            && term.correlations()[0].length_scales().iter().all(|l| (l - 250.0).abs() < 1e-9)
    );
}

#[test]
fn what_is_heard_after_learning_is_read_under_the_learned_model() {
    let team = team();
    let mut sender = vehicle(&team, "b", events("b", 100, 0.5));
    let packets: Vec<Vec<u8>> = (0..3).map(|n| sender.next_packet(f64::from(n), 32).unwrap().unwrap()).collect();
    let links: Vec<Link> = events("b", 30, 0.61).into_iter().map(|event| event.link).collect();
    let mut heard = [1, 3].map(|at_once| {
        let mut agent = vehicle(&team, "a", events("a", 60, 0.0));
        agent.adapt(&Learning::default()).unwrap();
        // Put together before anything was heard, or not.
        if at_once == 3 {
            agent.rebuild_posteriors().unwrap();
        }
        for some in packets.chunks(at_once) {
            some.iter().for_each(|packet| assert_eq!(agent.receive(packet, 0.0), Receipt::Accepted));
            agent.posterior().unwrap();
        }
        agent
    });
    let [absorbed, at_once] = heard.each_mut().map(|agent| agent.probabilities(&links).unwrap());
    for (absorbed, at_once) in absorbed.iter().zip(at_once) {
        assert!((absorbed - at_once).abs() < 1e-9, "{absorbed} {at_once}");
    }
    // A fit under its own model is one beside what was heard.
    let rebuilt = heard.each_mut().map(|agent| {
        agent.rebuild_posteriors().unwrap();
        agent.probabilities(&links).unwrap()
    });
    assert_eq!(rebuilt[0], rebuilt[1]);
    let moved = rebuilt[0].iter().zip(&absorbed).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(moved > 0.0 && moved < 0.08, "{moved}");
    let [mut agent, _] = heard;
    // What it sends stays under the team's model: others know nothing of its own.
    let mut plain = vehicle(&team, "a", events("a", 60, 0.0));
    assert_eq!(agent.next_packet(9.0, 32), plain.next_packet(9.0, 32));
}

/// A term that is a product, with a shape that has a parameter, is written and read back; models without one are
/// written as ever.
#[test]
fn products_and_shapes_with_parameters_go_into_a_file() {
    let shape = dgpc::Shape::RationalQuadratic { alpha: 1.5 };
    let (inputs, chart) = (InputSpec::Positions, Chart::about([]));
    let path = dgpc::Correlation::isotropic(dgpc::Shape::Matern32, &[0, 1, 2, 3], 300.0).unwrap();
    let range = dgpc::Correlation::new(shape, &[8], &[150.0]).unwrap();
    let term =
        dgpc::Term::of(2.0, path).unwrap().times(range).unwrap().reciprocal(inputs.swap_ends().unwrap()).unwrap();
    let prior = dgpc::Prior::new(dgpc::Kernel::new(vec![term]).unwrap(), dgpc::PriorMean::Zero).unwrap();
    let file = ModelFile { model: Model::new(chart, inputs, prior), learned: None, place_log_digests: Vec::new() };
    let text = file.write().unwrap();
    assert!(text.contains("[[kernel.times]]") && text.contains("\"rational-quadratic:1.5\""), "{text}");
    assert_eq!(ModelFile::parse(&text).unwrap(), file);
    let refused = ModelFile::parse(&text.replace("rational-quadratic:1.5", "rational-cubic")).unwrap_err().to_string();
    assert!(refused.contains("rational-cubic") && refused.contains("matern32"), "{refused}");
    let refused = ModelFile::parse(&text.replace("150.0", "1e300")).unwrap_err().to_string();
    assert!(refused.contains("kernel term 1: length-scale"), "{refused}");
}

/// A block that a program put together wrongly is refused, not read past its end.
#[test]
fn blocks_of_the_wrong_size_are_refused() {
    let model =
        Model::isotropic(Chart::about([]), InputSpec::Positions, dgpc::Shape::Matern32, true, 300.0, 4.0).unwrap();
    let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
    let team = Team::new([VehicleId::new("a")], model, reach).unwrap();
    let layout = team.layout(32).unwrap();
    let mut block = pingmap_packet::Block::silent(layout);
    for (n, point) in block.points.iter_mut().enumerate() {
        point.transmitter.east = 7 * n as u8;
        point.information = 5;
    }
    assert!(team.wire().decode(&block).is_ok());
    let with = |change: &dyn Fn(&mut pingmap_packet::Block)| {
        let mut block = block.clone();
        change(&mut block);
        team.wire().decode(&block).unwrap_err()
    };
    let few = with(&|block| block.correlations.truncate(9));
    assert!(matches!(few, dgpc::Error::SizeMismatch { expected: 10, found: 9, .. }), "{few}");
    for refused in [
        with(&|block| block.correlations[3] = 8),
        with(&|block| block.correlations[3] = i8::MIN),
        with(&|block| block.points[1].information = 32),
        with(&|block| block.points[1].mean = -16),
    ] {
        assert!(matches!(refused, dgpc::Error::OutOfRange { .. }), "{refused}");
    }
}
