//! Averages over the team's model and an alternative.

use std::sync::Arc;

use dgpc::Shape;
use pingmap_agent::*;
use proptest::prelude::*;

use crate::common::trip::*;
use crate::common::*;

/// Returns a model under which links at different positions are nearly independent: it learns almost nothing.
fn rough_model() -> Model {
    isotropic(Shape::Matern12, true, 3.0, 9.0)
}

/// Records events one at a time, and returns the probability of every outcome before it was recorded.
fn prequential(agent: &mut Agent, events: &[Event]) -> Vec<f64> {
    let step = |event: &Event| {
        let success = agent.probability(event.query()).unwrap();
        agent.record([event.clone()]).unwrap();
        if agent.refit_due() {
            agent.refit().unwrap();
        }
        if event.success { success } else { 1.0 - success }
    };
    events.iter().map(step).collect()
}

fn averaging(team: &Arc<Team>, alternative: Model) -> Agent {
    let mut agent = vehicle(team, 0, []);
    agent.average_with(alternative).unwrap();
    agent
}

fn log_sum(probabilities: &[f64]) -> f64 {
    probabilities.iter().map(|p| p.ln()).sum()
}

#[test]
fn the_average_is_the_bayesian_mixture_of_two_vehicles_with_one_model_each() {
    let events = walk(0, 60, 0.0);
    let [first, second] = [rough_model(), model()].map(|model| Arc::new(team(2, model)));
    let alone = [&first, &second].map(|team| log_sum(&prequential(&mut vehicle(team, 0, []), &events)));
    let mut agent = averaging(&first, model());
    let mixture = log_sum(&prequential(&mut agent, &events));
    let highest = alone[0].max(alone[1]);
    let expected = highest + (0.5 * alone.iter().map(|score| (score - highest).exp()).sum::<f64>()).ln();
    assert!((mixture - expected).abs() < 0.01, "{mixture} {expected} {alone:?}");
    assert!(mixture > highest - f64::ln(2.0) - 0.01);
    let weight = 1.0 / (1.0 + (alone[0] - alone[1]).exp());
    assert!((agent.status().alternative_weight - weight).abs() < 0.01, "{weight}");
    assert!(weight > 0.95, "the smooth model predicts better: {alone:?}");
}

#[test]
fn an_alternative_that_equals_the_team_model_changes_no_prediction() {
    let team = Arc::new(team(2, model()));
    let events = walk(0, 40, 0.3);
    let mut plain = vehicle(&team, 0, []);
    let mut average = averaging(&team, model());
    let [a, b] = [&mut plain, &mut average].map(|agent| prequential(agent, &events));
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-12));
    assert!((average.status().alternative_weight - 0.5).abs() < 1e-12);
    assert_eq!(plain.status().alternative_weight, 0.0);
    let moments = |agent: &mut Agent| agent.predict_intervals(test_links()).unwrap();
    for (a, b) in moments(&mut plain).into_iter().zip(moments(&mut average)) {
        assert!((a.variance - b.variance).abs() < 1e-9 && (a.explained - b.explained).abs() < 1e-9);
        let [a, b] = [a, b].map(|prediction| prediction.interval.unwrap());
        assert!((a.low - b.low).abs() < 1e-6 && (a.high - b.high).abs() < 1e-6);
    }
}

/// Returns the prediction of the alternative alone: at even weights it follows from the average and the first model.
fn of_alternative(average: &mut Agent, first: &mut Agent) -> Vec<f64> {
    assert_eq!(average.status().alternative_weight, 0.5);
    test_probabilities(average)
        .iter()
        .zip(test_probabilities(first))
        .map(|(average, first)| 2.0 * average - first)
        .collect()
}

#[test]
fn an_alternative_that_is_given_late_has_all_events() {
    let [first, second] = [rough_model(), model()].map(|model| Arc::new(team(2, model)));
    let events = walk(0, 40, 0.0);
    let mut plain = vehicle(&first, 0, events.clone());
    plain.refit().unwrap();
    let mut average = plain.clone();
    average.average_with(model()).unwrap();
    let mut expected = vehicle(&second, 0, events);
    expected.refit().unwrap();
    let found = of_alternative(&mut average, &mut plain);
    assert!(found.iter().zip(test_probabilities(&mut expected)).all(|(a, b)| (a - b).abs() < 1e-6));
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn the_alternative_has_the_remote_events_of_members_that_are_not_muted(
        trip in trips(), is_given_late in any::<bool>(), is_muted in any::<bool>(),
    ) {
        let smooth = trip.without_exclusion();
        let rough = smooth.with_team(|team| team.model = rough_model());
        let receive = |agent: &mut Agent, trip: &Trip| {
            receive_all(agent, &trip.reports());
            test_probabilities(agent);
            agent.set_muted(&name(1), is_muted);
            agent.rebuild().unwrap();
        };
        let mut plain = rough.vehicle(0);
        let mut average = plain.clone();
        receive(&mut plain, &rough);
        if is_given_late {
            average = plain.clone();
            average.average_with(model()).unwrap();
        } else {
            average.average_with(model()).unwrap();
            receive(&mut average, &rough);
        }
        let mut expected = smooth.vehicle(0);
        receive(&mut expected, &smooth);
        let found = of_alternative(&mut average, &mut plain);
        for (found, expected) in found.into_iter().zip(test_probabilities(&mut expected)) {
            prop_assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
    }

    #[test]
    fn the_alternative_absorbs_reports_as_a_refit_includes_them(trip in trips()) {
        let rough = trip.without_exclusion().with_team(|team| team.model = rough_model());
        let mut agent = rough.vehicle(0);
        agent.average_with(model()).unwrap();
        let [absorbed, refitted] = [false, true].map(|is_refitted| {
            let mut agent = agent.clone();
            receive_all(&mut agent, &rough.reports());
            if is_refitted {
                agent.refit().unwrap();
            }
            test_probabilities(&mut agent)
        });
        // An absorbed event keeps its first site, so both agree approximately.
        for (absorbed, refitted) in absorbed.into_iter().zip(refitted) {
            prop_assert!((absorbed - refitted).abs() < 0.1, "{absorbed} {refitted}");
        }
    }
}

#[test]
fn the_moments_of_an_average_are_those_of_the_mixture() {
    let [first, second] = [rough_model(), model()].map(|model| Arc::new(team(2, model)));
    let events = walk(0, 60, 0.0);
    let mut average = vehicle(&first, 0, events[..57].to_vec());
    average.average_with(model()).unwrap();
    prequential(&mut average, &events[57..]);
    average.rebuild().unwrap();
    let weight = average.status().alternative_weight;
    assert!((weight - 0.5).abs() > 0.02 && (0.1..0.9).contains(&weight), "{weight}");
    let mut alone = [&first, &second].map(|team| {
        let mut agent = vehicle(team, 0, events.clone());
        agent.rebuild().unwrap();
        agent.predict_intervals(test_links()).unwrap()
    });
    let [first, second] = std::mem::take(&mut alone);
    for ((found, first), second) in average.predict_intervals(test_links()).unwrap().into_iter().zip(first).zip(second)
    {
        let mean = (1.0 - weight) * first.mean + weight * second.mean;
        let square = |one: &Prediction| one.variance + one.mean * one.mean;
        let variance = (1.0 - weight) * square(&first) + weight * square(&second) - mean * mean;
        assert!((found.mean - mean).abs() < 1e-4 && (found.variance - variance).abs() < 1e-3);
        let [found_in, first, second] = [found, first, second].map(|one| one.interval.unwrap());
        let mean = (1.0 - weight) * first.mean + weight * second.mean;
        let square = |one: &Interval| one.variance + one.mean * one.mean;
        let variance = (1.0 - weight) * square(&first) + weight * square(&second) - mean * mean;
        assert!((found_in.mean - mean).abs() < 1e-3 && (found_in.variance - variance).abs() < 1e-2);
        assert!(found_in.low <= found.probability && found.probability <= found_in.high);
    }
}

#[test]
fn an_alternative_with_other_inputs_is_refused() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, []);
    let elsewhere = Chart { origin: Position::new(100.0, 0.0), ..model().chart };
    for other in [Model { chart: elsewhere, ..model() }, model().with_depths().unwrap()] {
        assert_eq!(agent.average_with(other), Err(AgentError::DifferentInputs));
    }
    assert_eq!(agent.status().alternative_weight, 0.0);
}

#[test]
fn refused_events_change_no_weight() {
    let team = Arc::new(team(2, rough_model()));
    let mut agent = averaging(&team, model());
    prequential(&mut agent, &walk(0, 20, 0.0));
    let weight = agent.status().alternative_weight;
    let wrong = Event { time_s: f64::NAN, ..walk(0, 1, 0.4).remove(0) };
    assert!(matches!(agent.record([wrong]), Err(AgentError::NoTime { .. })));
    let nowhere = event_at(0, 500.0, link([f64::NAN, 0.0, 0.0, 0.0]), true);
    assert!(matches!(agent.record([nowhere]), Err(AgentError::Nowhere { .. })));
    assert_eq!(agent.status().alternative_weight, weight);
}

#[test]
fn events_of_one_call_are_scored_by_the_probabilities_before_the_call() {
    let [first, second] = [rough_model(), model()].map(|model| Arc::new(team(2, model)));
    let events = walk(0, 40, 0.0);
    let mut average = averaging(&first, model());
    prequential(&mut average, &events[..30]);
    let scored = |team: &Arc<Team>| {
        let mut agent = vehicle(team, 0, []);
        let before = log_sum(&prequential(&mut agent, &events[..30]));
        let success = probabilities(&mut agent, events[30..].iter().map(Event::query));
        let last =
            success.iter().zip(&events[30..]).map(|(p, event)| if event.success { p.ln() } else { (1.0 - p).ln() });
        before + last.sum::<f64>()
    };
    average.record(events[30..].iter().cloned()).unwrap();
    let weight = 1.0 / (1.0 + (scored(&first) - scored(&second)).exp());
    assert!((average.status().alternative_weight - weight).abs() < 0.02, "{weight}");
}

#[test]
fn a_sparse_alternative_equals_the_map_of_a_vehicle_with_that_model() {
    let limits = Limits { dense_events_max: 20, inducing_points_max: 15, candidates_max: 60, ..Limits::default() };
    let [first, second] = [rough_model(), model()].map(|model| Arc::new(Team { limits, ..team(2, model) }));
    let events = walk(0, 120, 0.0);
    let mut plain = vehicle(&first, 0, []);
    let mut average = averaging(&first, model());
    let mut expected = vehicle(&second, 0, []);
    for agent in [&mut plain, &mut average, &mut expected] {
        prequential(agent, &events);
        agent.rebuild().unwrap();
    }
    let weight = average.status().alternative_weight;
    let [plain, average, expected] = [plain, average, expected].map(|mut agent| test_probabilities(&mut agent));
    for ((plain, average), expected) in plain.into_iter().zip(average).zip(expected) {
        assert!((average - (1.0 - weight) * plain - weight * expected).abs() < 1e-6);
    }
}

#[test]
fn forgotten_events_leave_the_alternative_too() {
    let limits = Limits { events_max: 32, ..Limits::default() };
    let rough = Arc::new(Team { limits, ..team(2, rough_model()) });
    let smooth = Arc::new(Team { limits, ..team(2, model()) });
    let [mut plain, mut expected] = [&rough, &smooth].map(|team| vehicle(team, 0, walk(0, 80, 0.0)));
    let mut average = vehicle(&rough, 0, walk(0, 80, 0.0));
    average.average_with(model()).unwrap();
    let found = of_alternative(&mut average, &mut plain);
    assert!(found.iter().zip(test_probabilities(&mut expected)).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn after_adaptation_the_average_is_with_the_own_model() {
    let rough = Arc::new(team(2, rough_model()));
    let learning = Learning { additions: Vec::new(), ..Learning::default() };
    let mut plain = vehicle(&rough, 0, walk(0, 60, 0.0));
    let mut average = plain.clone();
    average.average_with(model()).unwrap();
    let mut expected = vehicle(&Arc::new(team(2, model())), 0, walk(0, 60, 0.0));
    for agent in [&mut plain, &mut average] {
        agent.adapt(&learning).unwrap();
    }
    let found = of_alternative(&mut average, &mut plain);
    assert!(found.iter().zip(test_probabilities(&mut expected)).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn a_restored_vehicle_has_no_alternative_until_it_is_given_again() {
    let team = Arc::new(team(2, rough_model()));
    let mut average = averaging(&team, model());
    prequential(&mut average, &walk(0, 30, 0.0));
    let mut restored = restored(&average, &average.snapshot());
    assert_eq!(restored.status().alternative_weight, 0.0);
    restored.average_with(model()).unwrap();
    assert_eq!(restored.status().alternative_weight, 0.5);
}
