//! Trust in the map: its predictions of own events before they were learned, next to those by range alone.

use std::collections::VecDeque;

use pingmap_agent::{CONSERVATIVE_LOSS, Link, Position, VehicleId};
use pingmap_trial::DistanceOnly;
use serde::{Deserialize, Serialize};

use crate::protocol::output::Trust;

/// Events that are compared.
const EVENTS_MAX: usize = 200;

/// Events without which the map is not trusted, and range alone is not fitted.
const EVENTS_MIN: usize = 20;

/// Events from which the model of range alone is fitted.
const RANGE_EVENTS_MAX: usize = 2000;

/// Smallest probability of a scored outcome. It bounds the effect of one event on the weight.
const PROBABILITY_MIN: f64 = 1e-6;

/// Predictions of one event before it was learned, and its range.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Score {
    pub(crate) from: VehicleId,
    /// Begin of the slot.
    pub(crate) time_s: f64,
    pub(crate) map: f64,
    pub(crate) by_range: f64,
    pub(crate) range_m: f64,
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
pub(crate) struct Scores {
    latest: VecDeque<Score>,
    /// Number of changes so far.
    #[serde(skip)]
    version: u64,
}

impl Scores {
    pub(crate) fn add(&mut self, score: Score) {
        self.version += 1;
        self.latest.push_back(score);
        if self.latest.len() > RANGE_EVENTS_MAX {
            self.latest.pop_front();
        }
    }

    /// Removes the scores of slots in which nothing was transmitted: the report of the sender may arrive after the slot
    /// was counted. `has_transmitted` takes a sender and a time.
    pub(crate) fn retain(&mut self, has_transmitted: impl Fn(&VehicleId, f64) -> bool) {
        let before = self.latest.len();
        self.latest.retain(|score| score.heard || has_transmitted(&score.from, score.time_s));
        self.version += u64::from(self.latest.len() < before);
    }

    /// Returns the posterior mean of the share heard, under a uniform prior.
    fn share_heard(&self) -> f64 {
        let heard = self.latest.iter().filter(|score| score.heard).count();
        (heard as f64 + 1.0) / (self.latest.len() as f64 + 2.0)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.latest.is_empty()
    }

    /// Returns the comparison of the map with range alone.
    ///
    /// The weight of the map is its posterior probability in a mixture in which both had the weight one half before
    /// these events.
    pub(crate) fn trust(&self) -> Trust {
        let compared = || self.latest.iter().rev().take(EVENTS_MAX);
        let events = compared().len();
        let sum = |of: fn(&Score) -> f64| compared().map(|score| Score::nll(of(score), score.heard)).sum::<f64>();
        let (map, by_range) = (sum(|score| score.map), sum(|score| score.by_range));
        let mean = |sum: f64| (events > 0).then(|| sum / events as f64);
        let map_weight = 1.0 / (1.0 + (map - by_range).exp());
        Trust { events, map_weight, map_nll: mean(map), range_nll: mean(by_range) }
    }
}

/// Returns why the map deserves no trust; `None` if it does.
pub(crate) fn distrust(trust: &Trust) -> Option<String> {
    if trust.events < EVENTS_MIN {
        return Some(format!("{} of {EVENTS_MIN} events were compared with the map so far", trust.events));
    }
    (trust.map_weight < 0.5).then(|| {
        let [map, range] = [trust.map_nll, trust.range_nll].map(Option::unwrap_or_default);
        format!("range alone predicted the last {} events better ({range:.3} against {map:.3} nats)", trust.events)
    })
}

/// Probabilities by range alone: logistic regression on the scored events. It is fitted again after a change.
#[derive(Debug, Clone, Default)]
pub(crate) struct RangeModel {
    fitted: Option<(u64, DistanceOnly)>,
}

impl RangeModel {
    /// Returns the probability of a link. With few events it is one half at the conservative range if there is one, and
    /// else the share heard, which begins at one half.
    /// O(N) after a change, for the latest 2000 events.
    pub(crate) fn probability(&mut self, scores: &Scores, conservative_range_m: Option<f64>, link: &Link) -> f64 {
        if scores.latest.len() < EVENTS_MIN {
            let Some(range_m) = conservative_range_m else { return scores.share_heard() };
            let log_odds = CONSERVATIVE_LOSS * (1.0 - link.range_m() / range_m);
            return 1.0 / (1.0 + (-log_odds).exp());
        }
        let fitted = match self.fitted {
            Some((version, fitted)) if version == scores.version => fitted,
            _ => {
                let (links, outcomes): (Vec<Link>, Vec<bool>) =
                    scores.latest.iter().map(|score| (link_of(score.range_m), score.heard)).unzip();
                let fitted = DistanceOnly::fit(&links, &outcomes);
                self.fitted = Some((scores.version, fitted));
                fitted
            }
        };
        fitted.probability(link)
    }
}

/// Returns a link of this length.
fn link_of(range_m: f64) -> Link {
    Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(range_m, 0.0) }
}
