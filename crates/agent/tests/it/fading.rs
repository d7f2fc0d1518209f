//! Weights of repeated events.

use pingmap_agent::*;

fn event(time_s: f64, receiver: &str, east_m: f64) -> Event {
    let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(east_m, 0.0) };
    let (transmitter_id, receiver_id) = (VehicleId::new("auv1"), VehicleId::new(receiver));
    Event { time_s, transmitter_id, receiver_id, link, kind: None, success: true }
}

#[test]
fn only_earlier_nearby_outcomes_of_the_same_pair_reduce_the_weight() {
    let fading = Fading { correlation: 0.5, memory_s: 10.0, drift_m_per_s: 0.4 };
    let events = [
        event(5.0, "auv2", 2.0),
        event(0.0, "auv2", 0.0),
        event(6.0, "auv3", 0.0),
        event(7.0, "auv2", 1000.0),
        event(900.0, "auv2", 0.0),
    ];
    let weights = fading.weights(&events.iter().collect::<Vec<_>>());
    let correlation = 0.5 * f64::exp(-0.5 - 1.0);
    for (found, expected) in weights.iter().zip([1.0 / (1.0 + 2.0 * correlation), 1.0, 1.0, 1.0, 1.0]) {
        assert!((found - expected).abs() < 1e-12, "{weights:?}");
    }
    assert_eq!(Fading::NONE.weights(&events.iter().collect::<Vec<_>>()), [1.0; 5]);
}

#[test]
fn weights_of_steady_repetitions_add_up_to_the_effective_sample_size() {
    let fading = Fading::default();
    let events: Vec<Event> = (0..3000).map(|n| event(f64::from(n), "auv2", 0.0)).collect();
    let weight_sum: f64 = fading.weights(&events.iter().collect::<Vec<_>>()).iter().sum();
    // N times the variance of the mean of N outcomes of unit variance.
    let correlation = |lag: i32| if lag <= 30 { fading.correlation * f64::from(-lag).exp().powf(0.1) } else { 0.0 };
    let variance: f64 =
        1.0 + 2.0 * (1..3000).map(|lag| (1.0 - f64::from(lag) / 3000.0) * correlation(lag)).sum::<f64>();
    assert!((weight_sum * variance / 3000.0 - 1.0).abs() < 0.01, "{weight_sum} {variance}");
}
