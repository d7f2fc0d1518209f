//! Missions in the order of time.

use std::path::Path;

use dgpc::Shape;
use pingmap_agent::*;
use pingmap_trial::{
    DistanceOnly, EventLog, Observer, Online, Plan, Preshared, Step, TrafficPlan, Vehicles, online, online_observed,
};

/// Returns the first third of a log with three vehicles.
fn log() -> EventLog {
    let mut log = EventLog::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("data/bay3.csv")).unwrap();
    log.events.truncate(log.events.len() / 3);
    log
}

fn replayed(log: &EventLog, preshared: Preshared) -> Online {
    let plan = Plan { preshared, ..Plan::new(Learning::default(), 1) };
    online(log, &plan, TrafficPlan { slot_every: Some(10), piggyback_bytes: 0 }, &|| ()).unwrap()
}

fn total(online: &Online, of: fn(&Step) -> f64) -> f64 {
    online.steps.iter().map(of).sum()
}

#[test]
fn a_model_from_other_water_costs_each_vehicle_at_most_ln_2_nats() {
    let log = log();
    let useless = Model::isotropic(log.chart(), log.inputs(), Shape::Matern12, true, 1.0, 25.0).unwrap();
    let [with, without] = [Preshared::Model(useless), Preshared::Nothing].map(|given| replayed(&log, given));
    let vehicles = log.vehicles().len() as f64;
    // Without sharing both runs have the same data, so the bound holds for every vehicle up to the tolerance of fits.
    // The centralised vehicle predicts all events of a transmission with equal weights, so the bound is approximate.
    assert!(total(&with, |step| step.own) < total(&without, |step| step.own) + vehicles * f64::ln(2.0) + 0.05);
    assert!(total(&with, |step| step.centralised) < total(&without, |step| step.centralised) + 2.0);
    assert_eq!(with.model_weights.len(), log.vehicles().len());
    assert!(with.model_weights.values().all(|&weight| weight < 1e-3), "{:?}", with.model_weights);
    assert!(without.model_weights.is_empty());
}

#[test]
fn range_only_is_fitted_to_earlier_events_of_the_receiver() {
    let log = log();
    let online = replayed(&log, Preshared::Nothing);
    let place = online.steps.len() - 1;
    let last = log.events.iter().max_by(|a, b| a.canonical_order(b)).unwrap();
    let earlier = log.events.iter().filter(|event| event.receiver_id == last.receiver_id && *event != last);
    let (links, outcomes): (Vec<Link>, Vec<bool>) = earlier.map(|event| (event.link, event.success)).unzip();
    let success = DistanceOnly::fit(&links, &outcomes).probability(&last.link);
    let step = &online.steps[place];
    assert_eq!(step.earlier, links.len());
    assert!((step.range_only + (if last.success { success } else { 1.0 - success }).ln()).abs() < 1e-9);
    assert_eq!(online.steps.iter().filter(|step| step.earlier == 0).count(), log.vehicles().len());
}

#[test]
fn an_observer_sees_every_event_up_to_its_times_and_changes_no_score() {
    let log = log();
    let (plan, traffic) = (Plan::new(Learning::default(), 1), TrafficPlan { slot_every: Some(10), piggyback_bytes: 2 });
    let mut times: Vec<f64> = log.events.iter().map(|event| event.time_s).collect();
    times.sort_by(f64::total_cmp);
    // Before the first event, at an event, between two events, and after the last.
    let middle = times[times.len() / 2];
    let times_s = [times[0] - 1.0, middle, middle + 1e-3, times[times.len() - 1] + 1.0];
    let mut seen = Vec::new();
    let mut observe = |time_s, vehicles: &Vehicles| {
        for (id, agent) in vehicles {
            let expected = log.events.iter().filter(|event| event.receiver_id == *id && event.time_s <= time_s);
            assert_eq!(agent.events().len(), expected.count(), "{id} at {time_s} s");
            agent.clone().predict_intervals([log.events[0].query()])?;
        }
        seen.push(time_s);
        Ok::<(), AgentError>(())
    };
    let observer = Observer { times_s: &times_s, observe: &mut observe };
    let observed = online_observed(&log, &plan, traffic, &|| (), observer).unwrap();
    assert_eq!(seen, times_s);
    assert_eq!(observed.steps, online(&log, &plan, traffic, &|| ()).unwrap().steps);
}
