//! Trust in the map: its predictions of own events before they were learned, next to those by range alone.

use std::collections::VecDeque;

use pingmap_agent::{Event, Link};
use pingmap_trial::DistanceOnly;
use serde::{Deserialize, Serialize};

use crate::protocol::output::Trust;

/// Events that are compared.
const EVENTS_MAX: usize = 200;

/// Events from which the model of range alone is fitted.
const RANGE_EVENTS_MAX: usize = 2000;

/// Smallest probability of a scored outcome. It bounds the effect of one event on the weight.
const PROBABILITY_MIN: f64 = 1e-6;

/// Predictions of one event before it was learned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Score {
    pub(crate) map: f64,
    pub(crate) by_range: f64,
    pub(crate) heard: bool,
}

impl Score {
    fn nll(probability: f64, heard: bool) -> f64 {
        let p = if heard { probability } else { 1.0 - probability };
        -p.max(PROBABILITY_MIN).ln()
    }
}

/// The latest scores.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Scores(VecDeque<Score>);

impl Scores {
    pub(crate) fn add(&mut self, score: Score) {
        self.0.push_back(score);
        if self.0.len() > EVENTS_MAX {
            self.0.pop_front();
        }
    }

    /// Returns the comparison of the map with range alone.
    ///
    /// The weight of the map is its posterior probability in a mixture in which both had the weight one half before
    /// these events.
    pub(crate) fn trust(&self) -> Trust {
        let events = self.0.len();
        let sum = |of: fn(&Score) -> f64| self.0.iter().map(|score| Score::nll(of(score), score.heard)).sum::<f64>();
        let (map, by_range) = (sum(|score| score.map), sum(|score| score.by_range));
        let mean = |sum: f64| (events > 0).then(|| sum / events as f64);
        let map_weight = 1.0 / (1.0 + (map - by_range).exp());
        Trust { events, map_weight, map_nll: mean(map), range_nll: mean(by_range) }
    }
}

/// Returns why the map deserves no trust; `None` if it does.
pub(crate) fn distrust(trust: &Trust) -> Option<String> {
    if trust.events == 0 {
        return Some("no event was compared with the map yet".into());
    }
    (trust.map_weight < 0.5).then(|| {
        let [map, range] = [trust.map_nll, trust.range_nll].map(Option::unwrap_or_default);
        format!("range alone predicted the last {} events better ({range:.3} against {map:.3} nats)", trust.events)
    })
}

/// Probabilities by range alone, from own events. Fitted again when asked after a change.
#[derive(Debug, Clone, Default)]
pub(crate) struct RangeModel {
    fitted: Option<(usize, DistanceOnly)>,
}

impl RangeModel {
    /// Returns the probability of a link. `count` is the number of `events`, by which a change is noticed. O(N) after a
    /// change, for the latest 2000 events.
    pub(crate) fn probability<'a>(
        &mut self,
        count: usize,
        events: impl DoubleEndedIterator<Item = &'a Event>,
        link: &Link,
    ) -> f64 {
        let fitted = match self.fitted {
            Some((fitted_count, fitted)) if fitted_count == count => fitted,
            _ => {
                let (links, outcomes): (Vec<Link>, Vec<bool>) =
                    events.rev().take(RANGE_EVENTS_MAX).map(|event| (event.link, event.success)).unzip();
                let fitted = DistanceOnly::fit(&links, &outcomes);
                self.fitted = Some((count, fitted));
                fitted
            }
        };
        fitted.probability(link)
    }
}
