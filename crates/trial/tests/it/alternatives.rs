//! Alternative uses of the same bytes.

use pingmap_agent::{Event, Learning, Link, MeanStructure, Position, ReferenceSystem, Structure, VehicleId};
use pingmap_trial::{Alternative, EventLog, Mission, ModelSource, Plan, Split};

/// Returns a log in which `a` hears `b` over each of these links `repeats` times, and then `b` hears `a` over each link
/// once. The split holds out the events of `b`.
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
        has_headings: false,
        unknown_columns: Vec::new(),
        reference: ReferenceSystem::Unknown,
    };
    (log, Split { name: "b".to_owned(), held_out })
}

/// Returns parallel links.
fn links(count: usize, apart_m: f64) -> Vec<Link> {
    let place = |n: usize, north_m| Position::new(apart_m * n as f64, north_m);
    (0..count).map(|n| Link { transmitter: place(n, 0.0), receiver: place(n, 300.0) }).collect()
}

/// Returns the predictions of `b`, which has no own events, after one frame.
fn predictions_of_b(way: Alternative, links: &[Link], repeats: usize) -> Vec<f64> {
    let (log, split) = log(links, repeats);
    // All vehicles use the prior of the first structure, with even odds before any event.
    let structure = Structure { mean: MeanStructure::Zero, ..Structure::default() };
    let learning = Learning { structure, ..Learning::default() };
    let plan = Plan { model_source: ModelSource::Own, ..Plan::new(learning, 1) };
    let mission = Mission::prepare(&log, &split, &plan, 1).unwrap();
    way.predict(&mission, 1).unwrap().pop().unwrap()
}

#[test]
fn repeated_events_over_one_link_are_all_sent_up_to_the_size_of_the_frame() {
    let [once, thrice, often] =
        [1, 3, 40].map(|repeats| predictions_of_b(Alternative::RawEvents, &links(3, 100.0), repeats)[0]);
    assert!(thrice > once + 0.05, "{once} {thrice}");
    // A frame has room for nine or ten events.
    assert!(often >= thrice, "{thrice} {often}");
}

#[test]
fn every_alternative_informs_the_receiver_if_vehicles_learn_their_own_models() {
    for way in Alternative::ALL {
        let predictions = predictions_of_b(way, &links(3, 100.0), 4);
        assert!(predictions.iter().all(|p| (0.5..1.0).contains(p)), "{way:?}: {predictions:?}");
    }
}

#[test]
fn random_points_are_distinct() {
    // A frame has room for five points. The five links are so far apart that they are independent.
    let predictions = predictions_of_b(Alternative::RandomPoints, &links(5, 20_000.0), 4);
    assert!(predictions.iter().all(|&p| p > 0.7), "{predictions:?}");
}
