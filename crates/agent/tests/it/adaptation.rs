//! Adaptation: a vehicle learns a model of its own under way.

use std::sync::Arc;

use crate::common::{largest_difference, link, probabilities, receive_all};
use dgpc::Prior;
use pingmap_agent::*;

/// Events of one receiver, which hears transmitters within 450 m.
fn events(receiver: &str, count: usize, phase: f64) -> Vec<Event> {
    let event = |n: usize| {
        let t = n as f64 * 0.37 + phase;
        let link = link([500.0 * t.sin(), 400.0 * (0.7 * t).cos(), 450.0 * (1.3 * t).cos(), 350.0 * (0.9 * t).sin()]);
        let (transmitter_id, receiver_id) = (VehicleId::new("other"), VehicleId::new(receiver));
        let (time_s, success) = (10.0 * n as f64, link.range_m() < 450.0);
        Event { time_s, transmitter_id, receiver_id, kind: None, success, link }
    };
    (0..count).map(event).collect()
}

fn links_of(events: &[Event]) -> Vec<Link> {
    events.iter().map(|event| event.link).collect()
}

fn team() -> Arc<Team> {
    let structure = Structure::default();
    let prior: Prior = structure.template(InputSpec::Positions, 500.0).unwrap();
    let chart = Chart { scale_m: 500.0, ..Chart::about([]) };
    let reach = [Position::new(-500.0, -500.0), Position::new(500.0, 500.0)];
    let names = ["a", "b"].map(VehicleId::new);
    Arc::new(Team::new(names, Model::new(chart, InputSpec::Positions, prior), reach).unwrap())
}

fn vehicle(team: &Arc<Team>, name: &str, events: Vec<Event>) -> Agent {
    let mut agent = Agent::new(VehicleId::new(name), team.clone(), AgentOptions::default());
    agent.record(events).unwrap();
    agent.refit().unwrap();
    agent
}

#[test]
fn an_adapted_vehicle_predicts_better_and_continues_from_its_last_optimum() {
    let team = team();
    let mut agent = vehicle(&team, "a", events("a", 80, 0.0));
    let elsewhere = events("a", 200, 0.19);
    let links = links_of(&elsewhere);
    let loss = |agent: &mut Agent| {
        let p = probabilities(agent, &links);
        let ln = |(p, event): (&f64, &Event)| if event.success { p.ln() } else { (1.0 - p).ln() };
        -p.iter().zip(&elsewhere).map(ln).sum::<f64>() / p.len() as f64
    };
    let before = loss(&mut agent);
    let first = agent.adapt(&Learning::default()).unwrap().clone();
    let after = loss(&mut agent);
    assert!(after < before, "{after} {before}");
    assert_eq!(agent.team().model.prior, team.model.prior);

    // New events are absorbed under its own model until it adapts again.
    agent.record(events("a", 100, 0.0).into_iter().skip(80)).unwrap();
    assert_eq!(agent.posterior(Which::Fused).unwrap().prior(), &first.model.prior);
    assert_eq!(agent.posterior(Which::Own).unwrap().prior(), &team.model.prior);
    let absorbed = probabilities(&mut agent, &links);
    agent.rebuild().unwrap();
    assert_eq!(agent.posterior(Which::Fused).unwrap().prior(), &first.model.prior, "a rebuild learns nothing");
    let moved = largest_difference(&absorbed, &probabilities(&mut agent, &links));
    assert!(moved < 0.08, "{moved}");
    let second = agent.adapt(&Learning::default()).unwrap().clone();
    assert_eq!((second.structure, second.events_used), (first.structure, 100));
    assert!(second.learned.starts.is_empty(), "a warm start is the only one");
    let observations = team.model.observations(agent.events()).unwrap();
    let begin = dgpc::fit(&first.learned.optimum, &observations, &Default::default()).unwrap().evidence();
    assert!(second.evidence() >= begin - 1e-6, "{} {begin}", second.evidence());
}

#[test]
fn adaptation_learns_from_received_packets_too() {
    let team = team();
    let mut sender = vehicle(&team, "b", events("b", 100, 0.5));
    let packets: Vec<Vec<u8>> =
        (0..5).map_while(|_| sender.next_frame(None, 32).unwrap().map(|frame| frame.bytes)).collect();
    let fresh = || vehicle(&team, "a", events("a", 12, 0.0));
    let (mut alone, mut informed) = (fresh(), fresh());
    // A mean that falls with range would explain nearly everything here without any packet.
    let structure = Structure { mean: MeanStructure::Zero, ..Structure::default() };
    let learning = Learning { structure, ..Learning::default() };
    let learned_alone = alone.adapt(&learning).unwrap().model.prior.clone();
    packets.iter().for_each(|bytes| assert_eq!(informed.receive(bytes, None).receipt, Receipt::Accepted));
    assert_ne!(learned_alone, informed.adapt(&learning).unwrap().model.prior);
    let elsewhere = events("b", 200, 0.61);
    let right = |agent: &mut Agent| {
        let p = probabilities(agent, links_of(&elsewhere));
        p.iter().zip(&elsewhere).filter(|(p, event)| (**p > 0.5) == event.success).count()
    };
    let (informed, alone) = (right(&mut informed), right(&mut alone));
    assert!(informed > alone, "{informed} {alone}");
}

#[test]
fn packets_after_adaptation_are_absorbed_under_the_learned_model() {
    let team = team();
    let mut sender = vehicle(&team, "b", events("b", 100, 0.5));
    let packets: Vec<Vec<u8>> = (0..3).map(|_| sender.next_frame(None, 32).unwrap().unwrap().bytes).collect();
    let links = links_of(&events("b", 30, 0.61));
    let mut agents = [1, 3].map(|at_once| {
        let mut agent = vehicle(&team, "a", events("a", 60, 0.0));
        agent.adapt(&Learning::default()).unwrap();
        if at_once == 3 {
            agent.rebuild().unwrap();
        }
        for some in packets.chunks(at_once) {
            receive_all(&mut agent, some);
            agent.posterior(Which::Fused).unwrap();
        }
        agent
    });
    let [absorbed, at_once] = agents.each_mut().map(|agent| probabilities(agent, &links));
    assert!(largest_difference(&absorbed, &at_once) < 1e-9, "{absorbed:?} {at_once:?}");
    // A fit under its own model takes the packets as messages.
    let rebuilt = agents.each_mut().map(|agent| {
        agent.rebuild().unwrap();
        probabilities(agent, &links)
    });
    assert_eq!(rebuilt[0], rebuilt[1]);
    let moved = largest_difference(&rebuilt[0], &absorbed);
    assert!(moved > 0.0 && moved < 0.08, "{moved}");
    let [mut agent, _] = agents;
    // Its packets stay under the team's model, because no other member has its own model.
    let mut plain = vehicle(&team, "a", events("a", 60, 0.0));
    assert_eq!(agent.next_frame(Some(9.0), 32), plain.next_frame(Some(9.0), 32));
}
