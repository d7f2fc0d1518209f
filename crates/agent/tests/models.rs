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
    all.push(Structure { expectation: Expectation::Conservative { range_m: 400.0, slope_per_m: 0.01 }, ..all[0] });
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
            from: "a \"log\".csv".to_owned(),
            structure: structure.to_string(),
            events: 10,
            events_used: 9,
            evidence: -1.25,
            leave_one_out: -0.5,
            variance_factor: 1.5,
            stop: "converged".to_owned(),
        };
        let file = ModelFile { model, learned: Some(learned) };
        assert_eq!(ModelFile::parse(&file.to_toml()).unwrap(), file, "{structure}");
    }
    // With depths and a place on Earth.
    let prior = Given::default().few()[0].template(InputSpec::PositionsAndDepths, 77.0).unwrap();
    let geographic = Some(Geographic { latitude_deg: 42.5, longitude_deg: -70.25 });
    let chart = Chart { geographic, ..Chart::about([Position::new(431_234.0, 4_700_001.0)]) };
    let file = ModelFile { model: Model::new(chart, InputSpec::PositionsAndDepths, prior), learned: None };
    assert_eq!(ModelFile::parse(&file.to_toml()).unwrap(), file);
}

#[test]
fn a_conservative_range_has_even_odds_there() {
    let expectation = Expectation::Conservative { range_m: 500.0, slope_per_m: 0.008 };
    let structure = Structure { expectation, ..Given::default().few()[0] };
    let model =
        Model::new(Chart::about([]), InputSpec::Positions, structure.template(InputSpec::Positions, 300.0).unwrap());
    let links = [link([0.0, 0.0, 300.0, 400.0]), link([0.0, 0.0, 0.0, 250.0])];
    let mean = model.prior.mean().values(&model.inputs(&links).unwrap()).unwrap();
    assert!(mean[0].abs() < 1e-12 && (mean[1] - 2.0).abs() < 1e-12, "{mean:?}");
}

/// Events of one receiver: heard within 450 m.
fn events(receiver: &str, count: usize, phase: f64) -> Vec<Event> {
    let event = |n: usize| {
        let t = n as f64 * 0.37 + phase;
        let link = link([500.0 * t.sin(), 400.0 * (0.7 * t).cos(), 450.0 * (1.3 * t).cos(), 350.0 * (0.9 * t).sin()]);
        let (transmitter_id, receiver_id) = (VehicleId::new("other"), VehicleId::new(receiver));
        Event { time_s: 10.0 * n as f64, transmitter_id, receiver_id, success: link.range_m() < 450.0, link }
    };
    (0..count).map(event).collect()
}

fn team_model() -> Arc<Model> {
    let prior: Prior = Given::default().few()[0].template(InputSpec::Positions, 500.0).unwrap();
    let chart = Chart { scale_m: 500.0, ..Chart::about([]) };
    Arc::new(Model::new(chart, InputSpec::Positions, prior))
}

#[test]
fn an_agent_that_learns_by_itself_predicts_better_and_goes_on_from_there() {
    let mut agent = Agent::new(VehicleId::new("a"), team_model(), Limits::default());
    agent.observe_all(events("a", 80, 0.0));
    agent.learn().unwrap();
    let elsewhere = events("a", 200, 0.19);
    let links: Vec<Link> = elsewhere.iter().map(|event| event.link).collect();
    let nll = |agent: &Agent| {
        let p = agent.probability(&links, Fusion::Sites).unwrap();
        let ln = |(p, event): (&f64, &Event)| if event.success { p.ln() } else { (1.0 - p).ln() };
        -p.iter().zip(&elsewhere).map(ln).sum::<f64>() / p.len() as f64
    };
    let before = nll(&agent);
    let first = agent.adapt(&Learning::default()).unwrap().clone();
    assert!(nll(&agent) < before, "{} {before}", nll(&agent));
    assert_eq!(agent.model().prior, team_model().prior);

    // New events make its own model stale, until it goes on from where it was.
    let new = events("a", 100, 0.0).into_iter().skip(80);
    agent.observe_all(new);
    agent.learn().unwrap();
    assert!(matches!(agent.probability(&links, Fusion::Sites), Err(AgentError::NotLearned { events: 100, .. })));
    let second = agent.adapt(&Learning::default()).unwrap().clone();
    assert_eq!((second.structure, second.events_used), (first.structure, 100));
    assert!(second.learned.starts.is_empty(), "a warm start is the only one");
    let observations = team_model().observations(agent.events()).unwrap();
    let begin = dgpc::mean_field::dense(&first.learned.optimum, &observations, &Default::default()).unwrap().evidence;
    assert!(second.evidence() >= begin - 1e-6, "{} {begin}", second.evidence());
}

#[test]
fn what_others_say_is_learned_from_too() {
    let mut sender = Agent::new(VehicleId::new("b"), team_model(), Limits::default());
    sender.observe_all(events("b", 100, 0.5));
    sender.learn().unwrap();
    let plan = sender.plan_packets(5, 4).unwrap();
    let packets = sender.packets(&plan, 5, SummaryKind::Marginal).unwrap();

    let fresh = || {
        let mut agent = Agent::new(VehicleId::new("a"), team_model(), Limits::default());
        agent.observe_all(events("a", 12, 0.0));
        agent.learn().unwrap();
        agent
    };
    let (mut alone, mut told) = (fresh(), fresh());
    alone.adapt(&Learning::default()).unwrap();
    packets.into_iter().for_each(|packet| told.receive(packet).unwrap());
    told.adapt(&Learning::default()).unwrap();
    assert_ne!(alone.own_fit().unwrap().model.prior, told.own_fit().unwrap().model.prior);
    let elsewhere = events("b", 200, 0.61);
    let links: Vec<Link> = elsewhere.iter().map(|event| event.link).collect();
    let right = |agent: &Agent| {
        let p = agent.probability(&links, Fusion::Sites).unwrap();
        p.iter().zip(&elsewhere).filter(|(p, event)| (**p > 0.5) == event.success).count()
    };
    assert!(right(&told) > right(&alone), "{} {}", right(&told), right(&alone));
}

#[test]
fn given_parts_are_kept() {
    let given = Given { shape: Some(Shape::SquaredExponential), terms: Some(Terms::Path), ..Given::default() };
    assert_eq!(given.few().len(), 1);
    assert!(given.many().iter().all(|s| s.shape == Shape::SquaredExponential && s.terms == Terms::Path));
    assert_eq!(given.many().len(), 3 + 2 + 2);
    let learning = Learning { variance: Some(3.0), length_scale_m: Some(250.0), ..Learning::default() };
    let fit = learning
        .fit(&learning.structures[1], Chart::about([]), InputSpec::Positions, &events("a", 60, 0.0), &[], None)
        .unwrap();
    let term = &fit.model.prior.kernel().terms()[0];
    assert!((term.variance() - 3.0).abs() < 1e-12 && term.length_scales().iter().all(|l| (l - 250.0).abs() < 1e-9));
}
