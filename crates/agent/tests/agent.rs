//! The order in which events and packets arrive does not matter, and packets mean what they should.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use dgpc::Shape;
use pingmap_agent::*;
use proptest::prelude::*;

fn model() -> Arc<Model> {
    let chart = Chart::about([]);
    Arc::new(Model::isotropic(chart, InputSpec::Positions, Shape::Matern52, true, 300.0, 4.0).unwrap())
}

/// Events of one receiver on a walk, heard when the ends are close.
fn events(receiver: &str, count: usize, phase: f64) -> Vec<Event> {
    let event = |n: usize| {
        let t = n as f64 * 0.37 + phase;
        let link = Link {
            transmitter: Position::new(500.0 * t.sin(), 400.0 * (0.7 * t).cos()),
            receiver: Position::new(450.0 * (1.3 * t).cos(), 350.0 * (0.9 * t).sin()),
        };
        Event {
            time_s: 10.0 * n as f64,
            transmitter_id: VehicleId::new("other"),
            receiver_id: VehicleId::new(receiver),
            success: link.range_m() < 450.0,
            link,
        }
    };
    (0..count).map(event).collect()
}

fn agent(id: &str, events: impl IntoIterator<Item = Event>, limits: Limits) -> Agent {
    let mut agent = Agent::new(VehicleId::new(id), model(), limits);
    events.into_iter().for_each(|event| agent.observe(event));
    agent.learn().unwrap();
    agent
}

fn somewhere() -> Vec<Link> {
    events("nobody", 15, 0.21).into_iter().map(|event| event.link).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn late_and_unordered_events_end_in_the_same_map(order in Just((0..30).collect::<Vec<usize>>()).prop_shuffle()) {
        let all = events("a", 30, 0.0);
        let in_order = agent("a", all.clone(), Limits::default());
        let shuffled = agent("a", order.iter().map(|&n| all[n].clone()), Limits::default());
        prop_assert_eq!(in_order.events(), shuffled.events());
        let p = |agent: &Agent| agent.probability(&somewhere(), Fusion::Sites).unwrap();
        prop_assert_eq!(p(&in_order), p(&shuffled));
    }

    #[test]
    fn packets_in_any_order_and_more_than_once_end_in_the_same_map(
        order in Just((0..6).chain(0..6).collect::<Vec<usize>>()).prop_shuffle()
    ) {
        let senders = [agent("b", events("b", 40, 1.0), Limits::default()), agent("c", events("c", 40, 2.0), Limits::default())];
        let packets: Vec<Packet> = senders
            .iter()
            .flat_map(|sender| sender.packets(&sender.plan_packets(3, 2).unwrap(), 3, SummaryKind::Marginal).unwrap())
            .collect();
        let receiver = agent("a", events("a", 20, 0.0), Limits::default());
        let after = |order: &[usize]| {
            let mut receiver = receiver.clone();
            order.iter().for_each(|&n| receiver.receive(packets[n].clone()).unwrap());
            receiver.probability(&somewhere(), Fusion::Sites).unwrap()
        };
        prop_assert_eq!(after(&[0, 1, 2, 3, 4, 5]), after(&order));
    }
}

#[test]
fn every_event_goes_into_exactly_one_packet() {
    let sender = agent("b", events("b", 70, 1.0), Limits::default());
    let plan = sender.plan_packets(8, 3).unwrap();
    for frames in [1, 3, 8] {
        let packets = sender.packets(&plan, frames, SummaryKind::Marginal).unwrap();
        assert_eq!(packets.len(), frames);
        assert_eq!(packets.iter().map(|packet| packet.events).sum::<usize>(), 70);
    }
}

#[test]
fn a_packet_with_every_event_as_a_point_loses_nothing() {
    let theirs = events("b", 6, 1.0);
    let sender = agent("b", theirs.clone(), Limits::default());
    let packets = sender.packets(&sender.plan_packets(1, 6).unwrap(), 1, SummaryKind::Marginal).unwrap();
    let mut receiver = agent("a", events("a", 20, 0.0), Limits::default());
    packets.into_iter().for_each(|packet| receiver.receive(packet).unwrap());
    let fused = receiver.posterior(Fusion::Sites).unwrap();
    // The same raw events, at the same ω as the sender found for them.
    let model = model();
    let sites = |events: &[Event]| {
        let inputs = model.inputs(events.iter().map(|event| &event.link)).unwrap();
        let outcomes = events.iter().map(|event| event.success).collect();
        let observations = dgpc::Observations::new(inputs, outcomes).unwrap();
        let options = dgpc::mean_field::Options { tolerance: 1e-6, ..Default::default() };
        dgpc::mean_field::dense(&model.prior, &observations, &options).unwrap().sites
    };
    let mut together = sites(receiver.events());
    together.append(&sites(&theirs)).unwrap();
    let exact = dgpc::Posterior::fuse(&model.prior, &together, &[]).unwrap();
    let inputs = model.inputs(&somewhere()).unwrap();
    let (fused, exact) = (fused.latent(&inputs).unwrap(), exact.latent(&inputs).unwrap());
    for n in 0..inputs.len() {
        assert!((fused.mean[n] - exact.mean[n]).abs() < 1e-8);
        assert!((fused.variance[n] - exact.variance[n]).abs() < 1e-8);
    }
}

#[test]
fn own_packets_add_nothing_to_own_events() {
    let mut own = agent("a", events("a", 30, 0.0), Limits::default());
    let before = own.probability(&somewhere(), Fusion::Sites).unwrap();
    for packet in own.packets(&own.plan_packets(2, 4).unwrap(), 2, SummaryKind::Marginal).unwrap() {
        own.receive(packet).unwrap();
    }
    assert_eq!(own.probability(&somewhere(), Fusion::Sites).unwrap(), before);
}

#[test]
fn a_sparse_fit_sends_nearly_what_a_dense_one_does() {
    let few = Limits { dense_events_max: 50, inducing_points_max: 120, candidates_max: 1000 };
    let (dense, sparse) =
        (agent("b", events("b", 150, 1.0), Limits::default()), agent("b", events("b", 150, 1.0), few));
    assert!(dense.learns_densely() && !sparse.learns_densely());
    let heard = |sender: &Agent| {
        let mut receiver = agent("a", [], Limits::default());
        for packet in sender.packets(&sender.plan_packets(1, 6).unwrap(), 1, SummaryKind::Marginal).unwrap() {
            receiver.receive(packet).unwrap();
        }
        receiver.probability(&somewhere(), Fusion::Sites).unwrap()
    };
    for (dense, sparse) in heard(&dense).iter().zip(heard(&sparse)) {
        assert!((dense - sparse).abs() < 0.01, "{dense} {sparse}");
    }
}

#[test]
fn foreign_packets_and_unlearned_events_are_refused() {
    let chart = Chart::about([]);
    let other = Model::isotropic(chart, InputSpec::Positions, Shape::Matern52, true, 301.0, 4.0).unwrap();
    let mut foreigner = Agent::new(VehicleId::new("x"), Arc::new(other), Limits::default());
    events("x", 10, 0.0).into_iter().for_each(|event| foreigner.observe(event));
    assert_eq!(
        foreigner.posterior(Fusion::Sites).unwrap_err(),
        AgentError::NotLearned { id: VehicleId::new("x"), events: 10 }
    );
    foreigner.learn().unwrap();
    let packets = foreigner.packets(&foreigner.plan_packets(1, 2).unwrap(), 1, SummaryKind::Marginal).unwrap();
    let refused = agent("a", [], Limits::default()).receive(packets[0].clone()).unwrap_err();
    assert_eq!(refused, AgentError::ForeignPacket { id: VehicleId::new("a"), sender: VehicleId::new("x") });
}

#[test]
fn a_vehicle_without_events_predicts_even_odds_and_sends_nothing() {
    let nobody = agent("a", [], Limits::default());
    for fusion in [Fusion::Sites, Fusion::Concatenation] {
        let p = nobody.probability(&somewhere(), fusion).unwrap();
        assert!(p.iter().all(|p| (p - 0.5).abs() < 1e-12), "{p:?}");
    }
    assert!(nobody.plan_packets(5, 4).unwrap().is_empty());
}
