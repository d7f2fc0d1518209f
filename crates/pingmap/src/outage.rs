//! The longest outages on a planned track: periods in which no message is received.

use dgpc::rand::RngExt;
use dgpc::{Matrix, success_probability};
use pingmap_agent::{Agent, INTERVAL_WIDENING, LinkQuery};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::cli_enums::Join;
use crate::route::{Route, Sending};
use crate::success_map::{MapQuery, normals};

/// The longest time between received messages. The start and the end of the track count as received messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outage {
    /// Median over missions.
    pub median_s: f64,
    /// The 90 % quantile over missions.
    pub likely_s: f64,
}

/// The longest outages on the whole track and on each leg.
pub struct Outages {
    pub whole: Outage,
    pub legs: Vec<Outage>,
}

/// Largest number of messages at which functions are drawn. Log-odds are interpolated linearly between these nodes.
const NODES_MAX: usize = 600;

/// Simulated missions per drawn function.
const MISSIONS: usize = 4;

/// Functions of the log-odds of every message to each of several places, drawn from the posterior with the width of the
/// intervals. Uncertainty that messages share is therefore the same for all messages of one function.
pub struct SampledFunctions {
    /// For each place a matrix with a row per node and a column per function.
    places: Vec<Matrix>,
    /// Indices of the messages that are nodes, in rising order.
    nodes: Vec<usize>,
}

impl SampledFunctions {
    /// Draws functions at these attempts, given as one list of equal length per place. O(n²) per node for n events,
    /// O(M³) for the M nodes of all places together.
    pub fn new(agent: &mut Agent, attempts: &[Vec<LinkQuery>]) -> anyhow::Result<Self> {
        let length = attempts[0].len();
        let wanted = (NODES_MAX / attempts.len()).clamp(2, length.max(2));
        let nodes: Vec<usize> = match length {
            0 | 1 => (0..length).collect(),
            _ => {
                let step = (length - 1) as f64 / (wanted.min(length) - 1) as f64;
                (0..wanted.min(length)).map(|n| (n as f64 * step).round() as usize).collect()
            }
        };
        let query: Vec<LinkQuery> = attempts.iter().flat_map(|place| nodes.iter().map(|&node| place[node])).collect();
        let normals = normals(query.len());
        let wider = Matrix::from_fn(normals.rows(), normals.columns(), |row, draw| {
            INTERVAL_WIDENING * normals.column(draw)[row]
        });
        let drawn = agent.draws(query.iter().copied(), &wider)?;
        let of = |place: usize| {
            Matrix::from_fn(nodes.len(), drawn.columns(), |node, draw| drawn.column(draw)[place * nodes.len() + node])
        };
        Ok(Self { places: (0..attempts.len()).map(of).collect(), nodes })
    }

    /// Returns the number of functions.
    pub fn functions(&self) -> usize {
        self.places[0].columns()
    }

    /// Returns the probabilities of all messages to a place under one function.
    pub fn probabilities(&self, place: usize, function: usize) -> Vec<f64> {
        let log_odds = self.places[place].column(function);
        let mut probabilities = Vec::with_capacity(self.nodes.last().map_or(0, |last| last + 1));
        probabilities.extend(log_odds.first().map(|&first| success_probability(first, 0.0)));
        for (n, pair) in self.nodes.windows(2).enumerate() {
            let between = (pair[0] + 1..=pair[1]).map(|message| {
                let share = (message - pair[0]) as f64 / (pair[1] - pair[0]) as f64;
                success_probability(log_odds[n] + (log_odds[n + 1] - log_odds[n]) * share, 0.0)
            });
            probabilities.extend(between);
        }
        probabilities
    }
}

impl Outages {
    /// Simulates missions on the track. Each mission uses one function, and outcomes are independent given that
    /// function. `query` states whether all places or any place must receive a message.
    pub fn new(drawn: &SampledFunctions, query: &MapQuery, route: &Route, sendings: &[Sending], seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut longest: Vec<Vec<f64>> = vec![Vec::new(); route.legs() + 1];
        for function in 0..drawn.functions() {
            let places: Vec<Vec<f64>> = (0..query.at.len()).map(|place| drawn.probabilities(place, function)).collect();
            let joined = |n: usize| {
                let of = |p: f64| if query.join == Join::All { p } else { 1.0 - p };
                of(places.iter().map(|place| of(place[n])).product())
            };
            let probabilities: Vec<f64> = (0..sendings.len()).map(joined).collect();
            for _ in 0..MISSIONS {
                let heard = |(sending, p): (&Sending, &f64)| (random.random::<f64>() < *p).then_some(sending.time_s);
                let received: Vec<f64> = sendings.iter().zip(&probabilities).filter_map(heard).collect();
                longest[0].push(longest_gap_s(&received, route.waypoints[0].0, route.waypoints[route.legs()].0));
                for leg in 0..route.legs() {
                    let (from_s, to_s) = (route.waypoints[leg].0, route.waypoints[leg + 1].0);
                    let first = received.partition_point(|time_s| *time_s < from_s);
                    let end = received.partition_point(|time_s| *time_s <= to_s);
                    longest[leg + 1].push(longest_gap_s(&received[first..end], from_s, to_s));
                }
            }
        }
        let mut outages = longest.into_iter().map(Outage::of);
        let whole = outages.next().unwrap_or(Outage { median_s: 0.0, likely_s: 0.0 });
        Self { whole, legs: outages.collect() }
    }
}

impl Outage {
    fn of(mut longest_s: Vec<f64>) -> Self {
        longest_s.sort_by(f64::total_cmp);
        let quantile = |share: f64| longest_s[((longest_s.len() as f64 * share) as usize).min(longest_s.len() - 1)];
        Self { median_s: quantile(0.5), likely_s: quantile(0.9) }
    }
}

/// Returns the longest interval without any of the rising times `received_s`, between two moments.
pub fn longest_gap_s(received_s: &[f64], from_s: f64, to_s: f64) -> f64 {
    let mut last_s = from_s;
    let mut longest_s = 0.0_f64;
    for &time_s in received_s.iter().chain([&to_s]) {
        longest_s = longest_s.max(time_s - last_s);
        last_s = time_s;
    }
    longest_s
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_agent::Position;

    fn drawn(log_odds: &[f64], nodes: &[usize]) -> SampledFunctions {
        let row = |node: usize, _: usize| log_odds[node];
        SampledFunctions { places: vec![Matrix::from_fn(nodes.len(), 256, row)], nodes: nodes.to_vec() }
    }

    #[test]
    fn gaps_count_from_the_first_to_the_last_moment() {
        assert_eq!(longest_gap_s(&[], 10.0, 70.0), 60.0);
        assert_eq!(longest_gap_s(&[10.0, 20.0, 50.0, 60.0], 10.0, 70.0), 30.0);
        assert_eq!(longest_gap_s(&[40.0], 10.0, 70.0), 30.0);
    }

    #[test]
    fn log_odds_are_straight_between_nodes() {
        let between = drawn(&[0.0, 2.0, -2.0], &[0, 4, 6]).probabilities(0, 0);
        let expected = [0.0, 0.5, 1.0, 1.5, 2.0, 0.0, -2.0].map(|log_odds| success_probability(log_odds, 0.0));
        assert!(between.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12) && between.len() == 7, "{between:?}");
    }

    /// Compares with the exact distribution of the longest run of misses under a constant probability.
    #[test]
    fn silences_are_those_of_runs_of_misses() {
        let messages = 51;
        let place = |n: usize| (10.0 * n as f64, Position::new(10.0 * n as f64, 0.0));
        let route = Route { waypoints: vec![place(0), place(messages - 1)], names: vec![None, None] };
        let sendings = route.sendings(10.0).unwrap();
        let p = 0.3_f64;
        let at = [Position::new(0.0, 0.0)];
        let attempt = |link| LinkQuery::from(link);
        let extent = &crate::data_extent::DataExtent::of(&[], []);
        let query = MapQuery {
            extent,
            at: &at,
            seen: crate::cli_enums::Seen::Rx,
            join: Join::All,
            depth_m: None,
            heading_deg: None,
            attempt: &attempt,
        };
        let log_odds = (p / (1.0 - p)).ln();
        let nodes: Vec<usize> = (0..messages).collect();
        let found = Outages::new(&drawn(&vec![log_odds; messages], &nodes), &query, &route, &sendings, 1);
        // P(no run of more than k misses), by recursion over the messages. The state is the number of misses since the
        // last reception. A run of k misses makes a gap of k intervals at either end of the track, and of k + 1 within
        // it.
        let shorter = |gap: usize| {
            let mut since = vec![0.0; gap + 1];
            (since[0], since[1.min(gap)]) = (p, if gap >= 1 { 1.0 - p } else { 0.0 });
            for n in 1..messages {
                let mut next = vec![0.0; gap + 1];
                for (missed, chance) in since.iter().enumerate() {
                    let is_rim = missed == n;
                    let gap_if_heard = if is_rim { missed } else { missed + 1 };
                    if gap_if_heard <= gap {
                        next[0] += chance * p;
                    }
                    if missed < gap {
                        next[missed + 1] += chance * (1.0 - p);
                    }
                }
                since = next;
            }
            // Misses at the end of the track count up to the last message, which is the end itself.
            since.iter().sum::<f64>()
        };
        let quantile = |share: f64| (0..messages).find(|&gap| shorter(gap) >= share).unwrap() as f64 * 10.0;
        let near = |found: f64, exact: f64| (found - exact).abs() <= 10.0;
        assert!(near(found.whole.median_s, quantile(0.5)), "{:?} {}", found.whole, quantile(0.5));
        assert!(near(found.whole.likely_s, quantile(0.9)), "{:?} {}", found.whole, quantile(0.9));
        assert_eq!(found.legs[0], found.whole);
    }
}
