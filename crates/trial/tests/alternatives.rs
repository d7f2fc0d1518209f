//! Other uses of the same bytes say what they are said to say.

#![allow(clippy::unwrap_used)]

use pingmap_agent::{Event, Given, Learning, Link, MeanStructure, Position, ReferenceSystem, VehicleId};
use pingmap_trial::{Alternative, EventLog, Learners, Mission, Plan, Split};

/// What `a` heard `repeats` times over each of these links, from `b`; and what `b` then heard once, which is held out.
fn log(links: &[Link], repeats: usize) -> (EventLog, Split) {
    let event = |n: usize, receiver: &str, transmitter: &str, link: Link| Event {
        time_s: 60.0 * n as f64,
        transmitter_id: VehicleId::new(transmitter),
        receiver_id: VehicleId::new(receiver),
        link,
        kind: None,
        success: true,
    };
    let mut events: Vec<Event> =
        (0..repeats * links.len()).map(|n| event(n, "a", "b", links[n % links.len()])).collect();
    events.extend(links.iter().enumerate().map(|(n, link)| event(1000 + n, "b", "a", *link)));
    let held_out = events.iter().map(|event| event.receiver_id.as_str() == "b").collect();
    let log = EventLog {
        events,
        true_probability: None,
        has_depths: false,
        unknown_columns: Vec::new(),
        reference: ReferenceSystem::Unknown,
    };
    (log, Split { name: "b".to_owned(), held_out })
}

/// Links side by side.
fn links(count: usize, apart_m: f64) -> Vec<Link> {
    let place = |n: usize, north_m| Position::new(apart_m * n as f64, north_m);
    (0..count).map(|n| Link { transmitter: place(n, 0.0), receiver: place(n, 300.0) }).collect()
}

/// What `b`, who saw nothing, makes of one frame.
fn heard_by_b(way: Alternative, links: &[Link], repeats: usize) -> Vec<f64> {
    let (log, split) = log(links, repeats);
    // The model is what is expected before any event, so that it is the same for all, and even odds are expected.
    let structures = Given { mean: Some(MeanStructure::Zero), ..Given::default() }.few();
    let learning = Learning { structures, ..Learning::default() };
    let plan = Plan { learners: Learners::Own, ..Plan::new(learning, 1) };
    let mission = Mission::prepare(&log, &split, &plan, 1).unwrap();
    way.predict(&mission, 1).unwrap().pop().unwrap()
}

#[test]
fn raw_events_over_one_link_are_told_as_often_as_they_happened() {
    let [once, thrice, often] =
        [1, 3, 40].map(|repeats| heard_by_b(Alternative::RawEvents, &links(3, 100.0), repeats)[0]);
    assert!(thrice > once + 0.05, "{once} {thrice}");
    // A frame holds nine or ten of them: more is not told, and not less either.
    assert!(often >= thrice, "{thrice} {often}");
}

#[test]
fn every_way_works_where_vehicles_learn_by_themselves() {
    for way in Alternative::ALL {
        let told = heard_by_b(way, &links(3, 100.0), 4);
        assert!(told.iter().all(|p| (0.5..1.0).contains(p)), "{way:?}: {told:?}");
    }
}

#[test]
fn random_points_are_different_points() {
    // A frame holds five points, and there are five links so far apart that one says nothing of another.
    let told = heard_by_b(Alternative::RandomPoints, &links(5, 20_000.0), 4);
    assert!(told.iter().all(|&p| p > 0.7), "{told:?}");
}
