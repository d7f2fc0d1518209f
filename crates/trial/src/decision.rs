//! Scores predictions by their use for decisions: choosing a position from which a message is heard.

use pingmap_agent::{Event, VehicleId};
use rand::seq::index::sample;
use std::collections::BTreeMap;

use crate::streams::{self, stream};

/// Number of links in a decision.
const PLACES: usize = 10;

/// Number of decisions for each receiver.
const DECISIONS_PER_RECEIVER: usize = 200;

/// Decisions. Each chooses one of ten held-out links to one receiver.
#[derive(Debug, Clone)]
pub struct Decisions {
    /// Indices of the links of every decision.
    sets: Vec<Vec<usize>>,
    /// True probability of every held-out link.
    truth: Vec<f64>,
}

impl Decisions {
    /// Draws 200 decisions for every receiver with at least ten of these events. Returns `None` if there
    /// is none. `truth` contains the true probabilities of the events.
    pub fn draw(events: &[&Event], truth: Vec<f64>, seed: u64) -> Option<Self> {
        let mut by_receiver: BTreeMap<&VehicleId, Vec<usize>> = BTreeMap::new();
        for (n, event) in events.iter().enumerate() {
            by_receiver.entry(&event.receiver_id).or_default().push(n);
        }
        let mut rng = stream(seed, streams::DECISIONS);
        let mut sets = Vec::new();
        for own in by_receiver.values().filter(|own| own.len() >= PLACES) {
            let draw = |_| sample(&mut rng, own.len(), PLACES).iter().map(|place| own[place]).collect();
            sets.extend((0..DECISIONS_PER_RECEIVER).map(draw));
        }
        (!sets.is_empty()).then_some(Self { sets, truth })
    }

    /// Returns the mean regret over decisions: the true probability of the best link minus that of the link with the
    /// highest prediction. Several links with the highest prediction are averaged.
    pub fn regret(&self, probabilities: &[f64]) -> f64 {
        let largest = |set: &[usize], of: &[f64]| set.iter().map(|&n| of[n]).fold(f64::NEG_INFINITY, f64::max);
        let lost = |set: &Vec<usize>| {
            let (best, most_promising) = (largest(set, &self.truth), largest(set, probabilities));
            let chosen: Vec<usize> = set.iter().copied().filter(|&n| probabilities[n] >= most_promising).collect();
            chosen.iter().map(|&n| best - self.truth[n]).sum::<f64>() / chosen.len() as f64
        };
        self.sets.iter().map(lost).sum::<f64>() / self.sets.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_agent::{Link, Position};

    fn event(receiver: &str) -> Event {
        Event {
            time_s: 0.0,
            transmitter_id: VehicleId::new("t"),
            receiver_id: VehicleId::new(receiver),
            link: Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(1.0, 1.0) },
            kind: None,
            success: true,
        }
    }

    #[test]
    fn true_probabilities_have_no_regret_and_equal_ones_the_mean() {
        let events: Vec<Event> = std::iter::repeat_n("a", 10).chain(std::iter::repeat_n("b", 9)).map(event).collect();
        let truth: Vec<f64> = (0..19).map(|n| f64::from(n) / 20.0).collect();
        let decisions = Decisions::draw(&events.iter().collect::<Vec<_>>(), truth.clone(), 1).expect("ten links to a");
        assert_eq!(decisions.sets.len(), DECISIONS_PER_RECEIVER);
        assert!(decisions.sets.iter().flatten().all(|&n| n < 10));
        assert_eq!(decisions.regret(&truth), 0.0);
        // All ten links are in every decision: the best is .45, the mean .225, the worst 0.
        assert!((decisions.regret(&[0.3; 19]) - 0.225).abs() < 1e-12);
        let contrary: Vec<f64> = truth.iter().map(|p| 1.0 - p).collect();
        assert!((decisions.regret(&contrary) - 0.45).abs() < 1e-12);
        assert!(Decisions::draw(&events.iter().skip(1).collect::<Vec<_>>(), truth, 1).is_none());
    }
}
