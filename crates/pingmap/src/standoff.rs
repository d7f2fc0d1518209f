//! The range up to which messages get through, for each direction.

use pingmap_agent::{Agent, Position};

use crate::answer::Answer;
use crate::success_map::{Cell, MapQuery, predicted};

/// The range with sufficient probability on one bearing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Clockwise from the north of the log, in degrees.
    pub bearing_deg: f64,
    /// The probability is sufficient up to this range. At most the largest range that was tested.
    pub range_m: f64,
    /// The lower end of the probability's interval is sufficient up to this range: the answer is yes.
    pub range_lower_m: f64,
    /// The upper end of the interval is insufficient beyond this range: the answer is no. `None` if it is sufficient at
    /// the largest tested range.
    pub range_upper_m: Option<f64>,
    /// The answer at the shortest tested range.
    pub nearest: Answer,
    /// Distance of the farthest position with data within 15 degrees of the bearing.
    pub data_m: f64,
}

/// Number of bearings.
pub const BEARINGS: usize = 72;

/// Number of tested ranges on each bearing.
const STEPS: usize = 150;

impl Ray {
    /// Returns a ray on which no range is sufficient.
    fn none(bearing_deg: f64, data_m: f64) -> Self {
        Self { bearing_deg, range_m: 0.0, range_lower_m: 0.0, range_upper_m: Some(0.0), nearest: Answer::No, data_m }
    }

    /// Returns the position on this bearing at this range.
    pub fn place(&self, from: Position, range_m: f64) -> (f64, f64) {
        let (sin, cos) = self.bearing_deg.to_radians().sin_cos();
        (from.east_m + range_m * sin, from.north_m + range_m * cos)
    }
}

/// Returns the shortest tested range.
pub fn step_m(range_max_m: f64) -> f64 {
    range_max_m / STEPS as f64
}

/// Returns the rays from the first queried place. On each ray the probability is sufficient at all nearer ranges.
/// O(bearings · n²) for n events.
pub fn standoff(
    agent: &mut Agent,
    query: &MapQuery,
    (probability, range_max_m): (f64, f64),
) -> anyhow::Result<Vec<Ray>> {
    let step_m = step_m(range_max_m);
    let from = query.at[0];
    let mut rays = Vec::with_capacity(BEARINGS);
    for n in 0..BEARINGS {
        let bearing_deg = n as f64 * 360.0 / BEARINGS as f64;
        let data_m = query.extent.farthest_towards_m(&from, bearing_deg);
        let ray = Ray::none(bearing_deg, data_m);
        let place = |step: usize| {
            let (east_m, north_m) = ray.place(from, step as f64 * step_m);
            Position { depth_m: query.depth_m, ..Position::new(east_m, north_m) }
        };
        let places: Vec<Position> = (0..=STEPS).map(place).collect();
        let cells = predicted(agent, query, query.seen, &places)?;
        let up_to = |of: fn(&Cell) -> f64| {
            let values: Vec<f64> = cells.iter().map(of).collect();
            first_below(&values, probability) * step_m
        };
        let upper: Vec<f64> = cells.iter().map(|cell| cell.upper).collect();
        rays.push(Ray {
            range_m: up_to(|cell| cell.probability),
            range_lower_m: up_to(|cell| cell.lower),
            range_upper_m: last_above(&upper, probability).map(|steps| steps * step_m),
            nearest: cells[1].answer(probability),
            ..ray
        });
    }
    Ok(rays)
}

/// Returns the first crossing below a level, in steps; linearly interpolated.
fn first_below(values: &[f64], level: f64) -> f64 {
    match values.iter().position(|&value| value < level) {
        None => (values.len() - 1) as f64,
        Some(0) => 0.0,
        Some(n) => (n - 1) as f64 + (values[n - 1] - level) / (values[n - 1] - values[n]),
    }
}

/// Returns the last crossing below a level, in steps; 0 if no value reaches the level, and `None` if the last does.
fn last_above(values: &[f64], level: f64) -> Option<f64> {
    if values.last().is_some_and(|&last| last >= level) {
        return None;
    }
    let reversed: Vec<f64> = values.iter().rev().map(|value| -value).collect();
    Some((values.len() - 1) as f64 - first_below(&reversed, f64::next_up(-level)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_where_values_first_fall_below_the_level() {
        assert_eq!(first_below(&[0.95, 0.92, 0.88, 0.99], 0.9), 1.5);
        assert_eq!((first_below(&[0.5, 0.99], 0.9), first_below(&[0.95, 0.9], 0.9)), (0.0, 1.0));
        let last = last_above(&[0.95, 0.85, 0.92, 0.88, 0.1], 0.9).unwrap();
        assert!((last - 2.5).abs() < 1e-9, "{last}");
        assert_eq!((last_above(&[0.5, 0.4], 0.9), last_above(&[0.5, 0.9], 0.9)), (Some(0.0), None));
    }

    #[test]
    fn bearings_run_from_north_over_east() {
        let ray = |bearing_deg| Ray::none(bearing_deg, 0.0);
        let (east, north) = ray(90.0).place(Position::new(10.0, 20.0), 5.0);
        assert!((east - 15.0).abs() < 1e-12 && (north - 20.0).abs() < 1e-12);
        let (east, north) = ray(0.0).place(Position::new(10.0, 20.0), 5.0);
        assert!((east - 10.0).abs() < 1e-12 && (north - 25.0).abs() < 1e-12);
    }
}
