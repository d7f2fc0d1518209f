//! Predictions of links: caps beyond the longest observed link, intervals, and draws.

use std::sync::Arc;

use crate::common::*;
use dgpc::Matrix;
use pingmap_agent::*;
use proptest::prelude::*;

/// Ends of the interval of a prediction.
fn ends(prediction: &Prediction) -> (f64, f64) {
    let Interval { low, high, .. } = prediction.interval.unwrap();
    (low, high)
}

/// Predicted intervals of some links.
fn intervals(agent: &mut Agent, links: impl IntoIterator<Item = Link>) -> Vec<(f64, f64)> {
    let predictions = agent.predict_intervals(links).unwrap();
    predictions.into_iter().map(|prediction| ends(&prediction)).collect()
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_link_beyond_the_longest_observed_one_is_not_predicted_better_than_its_parts(
        fleet in fleets(), ends in prop::array::uniform4(-4.0 * REACH_M..4.0 * REACH_M), beyond in 1.0..50.0f64,
    ) {
        let mut agent = fleet.vehicle(0);
        let own_m = fleet.events[0].iter().map(|event| event.link.range_m()).fold(0.0, f64::max);
        prop_assert_eq!(agent.status().longest_link_m, Some(own_m));
        receive_all(&mut agent, &fleet.packets(2));
        let longest_m = agent.status().longest_link_m.unwrap();
        let received = agent.links_of_packets().into_iter().flat_map(|(_, _, links)| links);
        prop_assert_eq!(longest_m, received.map(|link| link.range_m()).fold(own_m, f64::max));
        let link = link(ends);
        let share = longest_m * beyond / link.range_m();
        let longer = Position {
            east_m: ends[0] + share * (ends[2] - ends[0]),
            north_m: ends[1] + share * (ends[3] - ends[1]),
            ..Position::new(0.0, 0.0)
        };
        let longer = Link { receiver: longer, ..link };
        let part = longer.shortened_to(longest_m);
        prop_assert!((part.range_m() - longest_m).abs() < 1e-6 && part.transmitter == link.transmitter);
        let back = longer.swapped().shortened_to(longest_m).swapped();
        prop_assert!(back.receiver == longer.receiver);
        let p = probabilities(&mut agent, [longer, part, back]);
        prop_assert!(p[0] <= p[1] + 1e-12 && p[0] <= p[2] + 1e-12, "{:?}", p);
    }

    #[test]
    fn intervals_contain_the_predicted_probability(
        fleet in fleets(), fitted in 0..40usize, places in prop::collection::vec(links(), 8),
    ) {
        let mut agent = vehicle(&fleet.team, 0, fleet.events[0].iter().take(fitted).cloned());
        agent.refit().unwrap();
        // The others come after the fit.
        agent.record(fleet.events[0].iter().skip(fitted).cloned()).unwrap();
        receive_all(&mut agent, &fleet.packets(2));
        let plain = agent.predict(&places, Which::Fused).unwrap();
        let with_intervals = agent.predict_intervals(&places).unwrap();
        for (plain, prediction) in plain.into_iter().zip(with_intervals) {
            prop_assert_eq!(plain, Prediction { interval: None, ..prediction });
            let (low, high) = ends(&prediction);
            let p = prediction.probability;
            prop_assert!(0.0 <= low && low <= p && p <= high && high <= 1.0, "{} {} {}", low, p, high);
        }
    }

    #[test]
    fn predictions_from_a_given_posterior_equal_those_of_the_agent(fleet in fleets(), places in prop::collection::vec(links(), 8)) {
        let mut agent = fleet.vehicle(0);
        let own = agent.predict(&places, Which::Own).unwrap();
        prop_assert_eq!(&own, &agent.predict(&places, Which::Fused).unwrap(), "nothing was received yet");
        receive_all(&mut agent, &fleet.packets(2));
        prop_assert_eq!(&agent.predict(&places, Which::Own).unwrap(), &own);
        let fused = agent.predict(&places, Which::Fused).unwrap();
        let posterior = agent.posterior(Which::Fused).unwrap().clone();
        prop_assert_eq!(&agent.predict(&places, Which::Given(&posterior)).unwrap(), &fused);
        for (place, prediction) in places.iter().zip(&fused) {
            prop_assert!((0.0..=1.0).contains(&prediction.explained), "{prediction:?}");
            prop_assert!((agent.probability(place).unwrap() - prediction.probability).abs() < 1e-12);
        }
    }
}

#[test]
fn the_prediction_returns_to_even_odds_beyond_all_data_only_if_allowed() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 60, 0.0));
    agent.refit().unwrap();
    let longest_m = agent.status().longest_link_m.unwrap();
    let [part, far] = [longest_m, 30.0 * longest_m].map(|range_m| link([0.0, 0.0, range_m, 0.0]));
    let capped = agent.probability(far).unwrap();
    assert_eq!(capped.to_bits(), agent.probability(part).unwrap().to_bits());
    // A reciprocal kernel predicts the same for both directions. The lower end of the interval is that of the whole
    // link.
    assert!((agent.probability(far.swapped()).unwrap() - capped).abs() < 1e-9);
    let [near, beyond] = [part, far].map(|link| intervals(&mut agent, [link])[0]);
    assert!(beyond.0 <= near.0 && beyond.1 == near.1, "{near:?} {beyond:?}");
    agent.options.allow_extrapolated_increase = true;
    let allowed = agent.probability(far).unwrap();
    assert!(capped < 0.48 && (allowed - 0.5).abs() < 0.01, "{capped} {allowed}");
}

#[test]
fn intervals_are_wide_far_from_all_data() {
    let heard = walk(0, 60, 0.0).into_iter().filter(|event| event.success);
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, heard);
    agent.refit().unwrap();
    let near: Vec<Link> = agent.events().map(|event| event.link).collect();
    let far = link([60_000.0, 60_000.0, 60_100.0, 60_000.0]);
    let width = |(low, high): &(f64, f64)| high - low;
    let far = width(&intervals(&mut agent, [far])[0]);
    let widths: Vec<f64> = intervals(&mut agent, near).iter().map(width).collect();
    let near = widths.iter().sum::<f64>() / widths.len() as f64;
    assert!(far > 0.95 && near < far - 0.15, "{far} {near}");
}

#[test]
fn the_interval_posterior_follows_new_data() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 30, 0.0));
    let place = test_links()[0];
    let before = intervals(&mut agent, [place]);
    assert_eq!(intervals(&mut agent, [place]), before);
    agent.record((0..5).map(|n| event_at(0, 500.0 + f64::from(n), place, true))).unwrap();
    let after = intervals(&mut agent, [place]);
    assert!(after[0].0 > before[0].0, "{before:?} {after:?}");
    let mut restored = restored(&agent, &agent.snapshot());
    restored.rebuild().unwrap();
    agent.rebuild().unwrap();
    assert_eq!(intervals(&mut agent, [place]), intervals(&mut restored, [place]));
}

#[test]
fn events_explain_nearby_links_and_draws_spread_as_intervals_do() {
    let team = Arc::new(team(2, model()));
    let places =
        [[0.0, 0.0, 100.0, 0.0], [300.0, 0.0, 350.0, 40.0], [60_000.0, 60_000.0, 60_100.0, 60_000.0]].map(link);
    let explained = |agent: &mut Agent, links: &[Link]| {
        let predictions = agent.predict(links, Which::Fused).unwrap();
        predictions.iter().map(|prediction| prediction.explained).collect::<Vec<f64>>()
    };
    // Without events nothing is explained.
    let none = explained(&mut vehicle(&team, 0, []), &places);
    assert!(none.iter().all(|share| share.abs() < 1e-9), "{none:?}");
    let mut agent = vehicle(&team, 0, walk(0, 60, 0.0));
    agent.refit().unwrap();
    let own: Vec<Link> = agent.events().map(|event| event.link).collect();
    let near = explained(&mut agent, &own);
    let far = explained(&mut agent, &places[2..])[0];
    assert!(near.iter().all(|share| (0.0..=1.0).contains(share) && *share > far + 0.1) && far < 0.05, "{near:?} {far}");
    // Draws have the mean and the variance of each query alone, and interval draws have the widened variance.
    let unit = Matrix::from_fn(3, 4, |row, draw| f64::from(u8::from(row + 1 == draw)));
    let widened = Matrix::from_fn(3, 4, |row, draw| INTERVAL_WIDENING * unit.column(draw)[row]);
    let [plain, wider] = [&unit, &widened].map(|normals| agent.draws(places, normals).unwrap());
    let predicted = agent.predict_intervals(places).unwrap();
    for (place, prediction) in predicted.into_iter().enumerate() {
        let interval = prediction.interval.unwrap();
        let mean = plain.column(0)[place];
        assert!((mean - interval.mean).abs() < 1e-9 && (wider.column(0)[place] - mean).abs() < 1e-9);
        let spread = |draws: &Matrix| (1..4).map(|draw| (draws.column(draw)[place] - mean).powi(2)).sum::<f64>();
        assert!((spread(&wider) / interval.variance - 1.0).abs() < 1e-6, "{place}");
        assert!((spread(&wider) / spread(&plain) - INTERVAL_WIDENING.powi(2)).abs() < 1e-6, "{place}");
    }
}
