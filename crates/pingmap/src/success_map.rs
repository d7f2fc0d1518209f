//! Maps of success probability, seen from one place or from several together.

use dgpc::{Matrix, success_probability};
use pingmap_agent::{Agent, Link, LinkQuery, Position, Prediction, Time};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use schemars::JsonSchema;
use serde::Serialize;

use crate::answer::Answer;
use crate::area::Area;
use crate::cli_enums::{Join, Seen};
use crate::data_extent::DataExtent;
use crate::output::BadInput;

/// Default levels of the contours.
pub const LEVELS: [f64; 2] = [0.5, 0.9];

/// A map hatches cells whose interval is wider than this, unless an option gives another width.
pub const HATCH_WIDTH: f64 = 0.5;

/// Functions drawn to estimate the correlation between links.
const DRAWS: usize = 256;

/// Seed of these draws.
const SEED: u64 = 1;

/// The queries of a map.
pub struct MapQuery<'a> {
    /// Positions that the map is seen from.
    pub at: &'a [Position],
    pub seen: Seen,
    /// Whether all of several positions are needed, or any.
    pub join: Join,
    /// Depth of the cells.
    pub depth_m: Option<f64>,
    /// Heading of the vehicle in the cells; if not given, the mean over headings counts.
    pub heading_deg: Option<f64>,
    /// Where the data end.
    pub extent: &'a DataExtent,
    /// Returns the query for a link.
    pub attempt: &'a dyn Fn(Link) -> LinkQuery,
}

/// Prediction for a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    pub probability: f64,
    /// Ends of the 90 % interval of the probability.
    pub lower: f64,
    pub upper: f64,
    /// Share of the variance of the log-odds that the data explain.
    pub explained: f64,
}

impl Cell {
    /// Returns the width of the interval.
    pub fn width(&self) -> f64 {
        self.upper - self.lower
    }

    /// Returns the answer to the question whether the probability reaches the required one.
    pub fn answer(&self, required: f64) -> Answer {
        Answer::of((self.lower, self.upper), required)
    }
}

/// One direction of a map, cell by cell.
pub struct Side {
    pub seen: Seen,
    pub cells: Vec<Cell>,
}

impl Side {
    /// Returns one number of every cell.
    pub fn values(&self, of: impl Fn(&Cell) -> f64) -> Vec<f64> {
        self.cells.iter().map(of).collect()
    }

    /// Returns the share of the cells that satisfy a predicate.
    pub fn share(&self, holds: impl Fn(&Cell) -> bool) -> f64 {
        self.cells.iter().filter(|cell| holds(cell)).count() as f64 / self.cells.len() as f64
    }

    /// Returns the median width of the intervals.
    pub fn interval_width(&self) -> f64 {
        let mut widths = self.values(Cell::width);
        widths.sort_by(f64::total_cmp);
        widths[widths.len() / 2]
    }
}

/// Distances from the nearest of the map's positions within which a probability is reached, and beyond which it is not.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Reach {
    /// The probability.
    pub probability: f64,
    /// The lower end of the interval reaches the probability in all cells within this distance. It is at most the
    /// distance to the nearest edge of the map, and 0 if there is no such distance.
    pub yes_within_m: f64,
    /// The upper end of the interval is below the probability in all cells of the map beyond this distance. Null if it
    /// is not below it everywhere at the edges of the map.
    pub no_beyond_m: Option<f64>,
    /// Distance from a position to the nearest edge of the map; not positive outside the map.
    #[serde(skip)]
    edge_m: f64,
    /// Number of positions.
    #[serde(skip)]
    places: usize,
}

impl Reach {
    /// Returns the distances in a sentence.
    pub fn sentence(&self) -> String {
        let Self { probability, yes_within_m, no_beyond_m, edge_m, places } = *self;
        let of = if places > 1 { " of the nearest place" } else { "" };
        let edge = if yes_within_m == edge_m { ", up to its nearest edge" } else { "" };
        match (yes_within_m > 0.0, no_beyond_m) {
            (_, Some(0.0)) => format!("Heard with {probability} nowhere on this map."),
            (true, Some(no_m)) => {
                format!(
                    "Heard with {probability} on this map within {yes_within_m:.0} m{of}{edge}; nowhere beyond {no_m:.0} m."
                )
            }
            (true, None) => {
                format!("Heard with {probability} on this map within {yes_within_m:.0} m{of}{edge}; not known beyond.")
            }
            (false, Some(no_m)) => {
                format!("Heard with {probability}: range not known; on this map nowhere beyond {no_m:.0} m{of}.")
            }
            (false, None) => format!("Heard with {probability} on this map: range not known."),
        }
    }
}

/// Probabilities of success between some positions and every cell of an area.
pub struct SuccessMap {
    pub area: Area,
    pub at: Vec<Position>,
    pub join: Join,
    /// One side, or two for both directions.
    pub sides: Vec<Side>,
}

impl SuccessMap {
    /// Predicts every cell. O(cells · positions · n²) for n events.
    pub fn new(agent: &mut Agent, area: Area, query: &MapQuery) -> anyhow::Result<Self> {
        if query.at.is_empty() {
            return Err(BadInput("expected a place that the map is seen from".into()).into());
        }
        let directions = match query.seen {
            Seen::Both => vec![Seen::Tx, Seen::Rx],
            one => vec![one],
        };
        let mut sides = Vec::new();
        for seen in directions {
            let mut cells = Vec::with_capacity(area.cells());
            for row in 0..area.rows {
                let middles = (0..area.columns).map(|column| area.middle(row * area.columns + column));
                let position = |(east_m, north_m)| Position {
                    depth_m: query.depth_m,
                    heading_deg: query.heading_deg,
                    ..Position::new(east_m, north_m)
                };
                cells.extend(predicted(agent, query, seen, &middles.map(position).collect::<Vec<_>>())?);
            }
            sides.push(Side { seen, cells });
        }
        Ok(Self { area, at: query.at.to_vec(), join: query.join, sides })
    }

    /// Predicts messages from a vehicle's position at a time to typical receivers, as the vehicle itself knows them.
    pub fn of_messages(
        agent: &mut Agent,
        at: Position,
        when: Time,
        area: Area,
        extent: &DataExtent,
    ) -> anyhow::Result<Self> {
        let transmitter = agent.id().into();
        let attempt = |link| LinkQuery { transmitter, when, ..LinkQuery::from(link) };
        let (seen, join, depth_m) = (Seen::Tx, Join::All, at.depth_m);
        let query = MapQuery { at: &[at], seen, join, depth_m, heading_deg: None, extent, attempt: &attempt };
        Self::new(agent, area, &query)
    }

    /// Returns the distances from the nearest position at which cells reach the required probability.
    pub fn reach(&self, side: &Side, required: f64) -> Reach {
        // A cell extends beyond its middle.
        let half_m = self.area.cell_m * std::f64::consts::FRAC_1_SQRT_2;
        let least = |of: &dyn Fn(&Position) -> f64| self.at.iter().map(of).fold(f64::INFINITY, f64::min);
        let edge_m = least(&|at| self.area.edge_m((at.east_m, at.north_m)));
        let (mut yes_within_m, mut no_beyond_m) = (edge_m, 0.0_f64);
        let mut is_no_at_edges = true;
        for (n, cell) in side.cells.iter().enumerate() {
            let (x, y) = self.area.middle(n);
            let range_m = least(&|at| (at.east_m - x).hypot(at.north_m - y));
            let answer = cell.answer(required);
            if answer != Answer::Yes {
                yes_within_m = yes_within_m.min(range_m - half_m);
            }
            if answer != Answer::No {
                no_beyond_m = no_beyond_m.max(range_m + half_m);
                is_no_at_edges &= !self.area.is_at_edge(n);
            }
        }
        Reach {
            probability: required,
            yes_within_m: yes_within_m.max(0.0),
            no_beyond_m: Some(no_beyond_m).filter(|_| is_no_at_edges),
            edge_m,
            places: self.at.len(),
        }
    }
}

/// Predicts links between the queried positions and each of `middles`.
pub fn predicted(agent: &mut Agent, query: &MapQuery, seen: Seen, middles: &[Position]) -> anyhow::Result<Vec<Cell>> {
    let of_places = query.at.iter().map(|&at| from_one(agent, query, (seen, at), middles));
    let of_places = of_places.collect::<anyhow::Result<Vec<_>>>()?;
    all_joined(agent, query.join, &of_places)
}

/// Combines the predictions for several positions into one prediction per cell.
pub fn all_joined(agent: &mut Agent, join: Join, of_places: &[Vec<(Cell, LinkQuery)>]) -> anyhow::Result<Vec<Cell>> {
    if let [one] = of_places {
        return Ok(one.iter().map(|(cell, _)| *cell).collect());
    }
    let normals = normals(of_places.len());
    let cell = |n: usize| -> anyhow::Result<Cell> {
        let (cells, attempts): (Vec<Cell>, Vec<LinkQuery>) = of_places.iter().map(|place| place[n]).unzip();
        let draws = agent.draws(attempts, &normals)?;
        Ok(joined(join, &cells, &draws))
    };
    (0..of_places[0].len()).map(cell).collect()
}

/// Predicts links between one position and each of `middles`. Also returns the query of each prediction.
pub fn from_one(
    agent: &mut Agent,
    query: &MapQuery,
    (seen, at): (Seen, Position),
    middles: &[Position],
) -> anyhow::Result<Vec<(Cell, LinkQuery)>> {
    let mut attempts = |link: &dyn Fn(Position) -> Link| -> anyhow::Result<Vec<(Cell, LinkQuery)>> {
        let attempts: Vec<LinkQuery> = middles.iter().map(|&middle| (query.attempt)(link(middle))).collect();
        let predictions = agent.predict_intervals(attempts.iter().copied())?;
        let cell = |(Prediction { probability, explained, interval, .. }, attempt): (Prediction, LinkQuery)| {
            let ends = interval.map_or((probability, probability), |ends| (ends.low, ends.high));
            let (lower, upper) = query.extent.interval(&attempt.link, ends);
            (Cell { probability, lower, upper, explained }, attempt)
        };
        Ok(predictions.into_iter().zip(attempts).map(cell).collect())
    };
    let from = |middle| Link { transmitter: at, receiver: middle };
    let to = |middle| Link { transmitter: middle, receiver: at };
    Ok(match seen {
        Seen::Tx => attempts(&from)?,
        Seen::Rx => attempts(&to)?,
        Seen::Worst | Seen::Both => {
            let (from, to) = (attempts(&from)?, attempts(&to)?);
            let worst = |(a, b): ((Cell, LinkQuery), (Cell, LinkQuery))| {
                let (less, more) = if a.0.probability <= b.0.probability { (a, b) } else { (b, a) };
                // The smaller of two probabilities is at most as large as either.
                let (lower, upper) = (less.0.lower.min(more.0.lower), less.0.upper.min(more.0.upper));
                let explained = less.0.explained.min(more.0.explained);
                (Cell { lower, upper, explained, ..less.0 }, less.1)
            };
            from.into_iter().zip(to).map(worst).collect()
        }
    })
}

/// Returns standard normal numbers. They are equal for every cell, so that draws add no noise to the map.
pub fn normals(places: usize) -> Matrix {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let half = Matrix::from_fn(places, DRAWS / 2, |_, _| StandardNormal.sample(&mut random));
    Matrix::from_fn(places, DRAWS, |place, draw| {
        let sign = if draw < DRAWS / 2 { 1.0 } else { -1.0 };
        sign * half.column(draw % (DRAWS / 2))[place]
    })
}

/// Combines several attempts: all succeed, or any succeeds. Uncertainty that links share makes joint success more
/// probable than the product of the probabilities. The ratio is estimated from functions drawn from the posterior.
fn joined(join: Join, cells: &[Cell], draws: &Matrix) -> Cell {
    // At least one attempt succeeds if not all of them fail.
    let of = |p: f64| if join == Join::All { p } else { 1.0 - p };
    let back = of;
    let columns = draws.columns() as f64;
    let sigma = |place: usize, draw: usize| of(success_probability(draws.column(draw)[place], 0.0));
    let places = 0..cells.len();
    let together: f64 =
        (0..draws.columns()).map(|draw| places.clone().map(|place| sigma(place, draw)).product::<f64>()).sum();
    let apart: f64 =
        places.map(|place| (0..draws.columns()).map(|draw| sigma(place, draw)).sum::<f64>() / columns).product();
    let product = |number: fn(&Cell) -> f64| cells.iter().map(|cell| of(number(cell))).product::<f64>();
    let least = cells.iter().map(|cell| of(cell.probability)).fold(1.0, f64::min);
    let common = if apart > 0.0 { (together / columns / apart).max(1.0) } else { 1.0 };
    let probability = back((product(|cell| cell.probability) * common).min(least));
    // The probability of all is at most the smallest. The probability of any is at least the largest.
    let bounds = cells
        .iter()
        .fold((1.0_f64, 1.0_f64), |(lower, upper), cell| (lower.min(of(cell.lower)), upper.min(of(cell.upper))));
    let (a, b) = match join {
        Join::All => (product(|cell| cell.lower), bounds.1),
        Join::Any => (back(bounds.0), back(product(|cell| cell.upper))),
    };
    Cell {
        probability,
        lower: a.min(probability),
        upper: b.max(probability),
        explained: cells.iter().map(|cell| cell.explained).fold(1.0, f64::min),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(probability: f64) -> Cell {
        Cell { probability, lower: probability / 2.0, upper: (1.0 + probability) / 2.0, explained: 0.5 }
    }

    /// Log-odds of two attempts, normal about 0; equal or independent.
    fn draws(alike: bool) -> Matrix {
        let normals = normals(2);
        Matrix::from_fn(2, DRAWS, |place, draw| 3.0 * normals.column(draw)[if alike { 0 } else { place }])
    }

    /// Returns the reach on a map of 20 × 20 cells of 10 m. The answer is yes within `yes_m`, and no beyond `no_m`.
    fn reach(at: &[(f64, f64)], yes_m: f64, no_m: f64) -> Reach {
        let area = Area::between(Position::new(0.0, 0.0), Position::new(200.0, 200.0), Some(10.0)).unwrap();
        let at: Vec<Position> = at.iter().map(|&(x, y)| Position::new(x, y)).collect();
        let cells = (0..area.cells()).map(|n| {
            let (x, y) = area.middle(n);
            let range_m = at.iter().map(|at| (at.east_m - x).hypot(at.north_m - y)).fold(f64::INFINITY, f64::min);
            let (lower, upper) =
                if range_m < yes_m { (0.9, 1.0) } else { (0.0, if range_m > no_m { 0.5 } else { 1.0 }) };
            Cell { probability: lower, lower, upper, explained: 1.0 }
        });
        let side = Side { seen: Seen::Tx, cells: cells.collect() };
        SuccessMap { area, at, join: Join::All, sides: Vec::new() }.reach(&side, 0.9)
    }

    #[test]
    fn distances_end_at_the_edge_of_the_map() {
        let middle = reach(&[(100.0, 100.0)], 50.0, 80.0);
        assert!((40.0..=50.0).contains(&middle.yes_within_m), "{middle:?}");
        assert!((80.0..=90.0).contains(&middle.no_beyond_m.unwrap()), "{middle:?}");
        let near_edge = reach(&[(15.0, 100.0)], 50.0, 80.0);
        assert_eq!((near_edge.yes_within_m, near_edge.no_beyond_m), (15.0, None));
        assert_eq!(
            near_edge.sentence(),
            "Heard with 0.9 on this map within 15 m, up to its nearest edge; not known beyond."
        );
        let outside = reach(&[(-20.0, 100.0)], 50.0, 80.0);
        assert_eq!((outside.yes_within_m, outside.no_beyond_m), (0.0, None));
        let two = reach(&[(60.0, 100.0), (140.0, 100.0)], 20.0, 40.0).sentence();
        assert!(two.contains(" of the nearest place; nowhere beyond "), "{two}");
        assert_eq!(reach(&[(100.0, 100.0)], 0.0, 0.0).sentence(), "Heard with 0.9 nowhere on this map.");
    }

    #[test]
    fn probabilities_multiply_without_uncertainty() {
        let certain = Matrix::from_fn(2, DRAWS, |_, _| 0.0);
        let all = joined(Join::All, &[cell(0.6), cell(0.5)], &certain);
        assert!((all.probability - 0.3).abs() < 1e-12 && all.lower <= 0.3 && (0.3..=0.75).contains(&all.upper));
        let any = joined(Join::Any, &[cell(0.6), cell(0.5)], &certain);
        assert!((any.probability - 0.8).abs() < 1e-12 && any.lower <= 0.8 && any.upper >= 0.8, "{any:?}");
    }

    /// Compares E[σ(f)²] for f = 3z by numerical integration with the independent product E[σ(f)]² = 1/4.
    #[test]
    fn shared_uncertainty_makes_joint_success_more_probable() {
        let step = 0.01;
        let density = |z: f64| (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
        let square = |z: f64| success_probability(3.0 * z, 0.0).powi(2) * density(z) * step;
        let exact: f64 = (-800..=800).map(|n| square(f64::from(n) * step)).sum();
        let [alike, apart] = [true, false].map(|alike| joined(Join::All, &[cell(0.5), cell(0.5)], &draws(alike)));
        assert!((alike.probability - exact).abs() < 0.02 && exact > 0.35, "{alike:?} against {exact}");
        assert!((apart.probability - 0.25).abs() < 0.03, "{apart:?}");
        let any = joined(Join::Any, &[cell(0.5), cell(0.5)], &draws(true));
        assert!((any.probability - (1.0 - exact)).abs() < 0.02, "{any:?}");
    }
}
