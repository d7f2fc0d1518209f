//! Where the data of a map end.

use std::collections::BTreeMap;

use pingmap_agent::{Event, Link, Position};

use crate::grid::Point;

/// Half of the angle in which positions count as lying in a direction, in degrees.
const SECTOR_HALF_DEG: f64 = 15.0;

/// Side of a square of positions, as a share of the longest link.
const SQUARE_SHARE: f64 = 0.125;

/// Positions of both ends of all links with data.
pub struct DataExtent {
    /// Positions by the square of a grid in which they lie.
    squares: BTreeMap<(i64, i64), Vec<Point>>,
    /// Side of a square.
    side_m: f64,
    /// Length of the longest link with data.
    pub longest_m: f64,
}

impl DataExtent {
    /// Returns the extent of the events, and of the links of a site prior.
    pub fn of<'a>(events: &'a [Event], site: impl IntoIterator<Item = &'a Link>) -> Self {
        let links: Vec<&Link> = events.iter().map(|event| &event.link).chain(site).collect();
        let longest_m = links.iter().map(|link| link.range_m()).fold(0.0, f64::max);
        let side_m = (SQUARE_SHARE * longest_m).max(1.0);
        let mut squares: BTreeMap<(i64, i64), Vec<Point>> = BTreeMap::new();
        for end in links.iter().flat_map(|link| link.ends()) {
            let square = [end.east_m, end.north_m].map(|value_m| (value_m / side_m).floor() as i64);
            squares.entry(square.into()).or_default().push((end.east_m, end.north_m));
        }
        Self { squares, side_m, longest_m }
    }

    /// Returns true if the nearest position with data is farther away than the longest link with data. Links to such a
    /// position have the interval from 0 to 1. Positions of squares that are far as a whole are not compared.
    pub fn is_far(&self, at: &Position) -> bool {
        let (x, y) = (at.east_m, at.north_m);
        let away_m = |value_m: f64, square: i64| {
            let low_m = square as f64 * self.side_m;
            (low_m - value_m).max(value_m - low_m - self.side_m).max(0.0)
        };
        let is_near = |(&(column, row), ends): (&(i64, i64), &Vec<Point>)| {
            away_m(x, column).hypot(away_m(y, row)) <= self.longest_m
                && ends.iter().any(|end| (end.0 - x).hypot(end.1 - y) <= self.longest_m)
        };
        !self.squares.iter().any(is_near)
    }

    /// Returns true if an end of a link is far from all data.
    pub fn has_far_end(&self, link: &Link) -> bool {
        link.ends().iter().any(|end| self.is_far(end))
    }

    /// Returns the ends of the interval of a link: 0 and 1 if one of its ends is far from all data.
    pub fn interval(&self, link: &Link, ends: (f64, f64)) -> (f64, f64) {
        if self.has_far_end(link) { (0.0, 1.0) } else { ends }
    }

    /// Returns the distance to the nearest position with data.
    pub fn nearest_m(&self, at: &Position) -> f64 {
        self.distances(at).map(|(range_m, _)| range_m).fold(f64::INFINITY, f64::min)
    }

    /// Returns the distance of the farthest position with data.
    pub fn farthest_m(&self, at: &Position) -> f64 {
        self.distances(at).map(|(range_m, _)| range_m).fold(0.0, f64::max)
    }

    /// Returns the distance of the farthest position with data within 15 degrees of a bearing; 0 if there is none.
    pub fn farthest_towards_m(&self, at: &Position, bearing_deg: f64) -> f64 {
        let is_towards = |deg: f64| ((deg - bearing_deg + 180.0).rem_euclid(360.0) - 180.0).abs() <= SECTOR_HALF_DEG;
        self.distances(at).filter(|(_, deg)| is_towards(*deg)).map(|(range_m, _)| range_m).fold(0.0, f64::max)
    }

    /// Returns distance and bearing in degrees of each position with data.
    fn distances(&self, at: &Position) -> impl Iterator<Item = (f64, f64)> {
        let (x, y) = (at.east_m, at.north_m);
        self.squares.values().flatten().map(move |end| {
            let (east_m, north_m) = (end.0 - x, end.1 - y);
            (east_m.hypot(north_m), east_m.atan2(north_m).to_degrees())
        })
    }

    /// States where the data end, seen from a place.
    pub fn sentence(&self, at: &Position) -> String {
        let place = format!("({:.0}, {:.0})", at.east_m, at.north_m);
        let (nearest_m, longest_m) = (self.nearest_m(at), self.longest_m);
        if nearest_m > longest_m {
            return format!(
                "Not known: {place} is {nearest_m:.0} m from the nearest position with data, farther than the longest link \
                 with data ({longest_m:.0} m)."
            );
        }
        let farthest_m = self.farthest_m(at);
        format!(
            "No data beyond {farthest_m:.0} m from {place}; the nearest position with data is {nearest_m:.0} m away."
        )
    }

    /// States how far a track leads away from the data, given the positions of its messages.
    pub fn track_sentence(&self, track: &[Position]) -> String {
        let nearest_m: Vec<f64> = track.iter().map(|at| self.nearest_m(at)).collect();
        let farthest_m = nearest_m.iter().copied().fold(0.0, f64::max);
        let far = nearest_m.iter().filter(|&&nearest_m| nearest_m > self.longest_m).count();
        let percent = (100.0 * far as f64 / track.len() as f64).ceil();
        let far = if far > 0 {
            &*format!(
                " {percent:.0} % of the messages are sent or received far from all data; their probability is not known."
            )
        } else {
            ""
        };
        format!("The track is up to {farthest_m:.0} m from the nearest position with data.{far}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(from: Point, to: Point) -> Link {
        Link { transmitter: Position::new(from.0, from.1), receiver: Position::new(to.0, to.1) }
    }

    fn extent() -> DataExtent {
        DataExtent::of(&[], &[link((0.0, 0.0), (300.0, 0.0)), link((0.0, 100.0), (0.0, 0.0))])
    }

    #[test]
    fn a_place_is_far_beyond_the_longest_link() {
        let extent = extent();
        assert!(!extent.is_far(&Position::new(599.0, 0.0)) && extent.is_far(&Position::new(601.0, 0.0)));
        let (near, far) = (link((0.0, 0.0), (10.0, 0.0)), link((0.0, 0.0), (9000.0, 0.0)));
        assert_eq!(extent.interval(&near, (0.3, 0.4)), (0.3, 0.4));
        assert_eq!(extent.interval(&far, (0.3, 0.4)), (0.0, 1.0));
        assert!(extent.sentence(&Position::new(0.0, 9000.0)).starts_with("Not known: (0, 9000) is 8900 m"));
    }

    /// Two arms of a log leave a corner of the rectangle around it without data.
    #[test]
    fn a_place_between_the_arms_of_a_log_is_far() {
        let links = (0..10).flat_map(|n| {
            let (from_m, to_m) = (f64::from(n) * 100.0, f64::from(n + 1) * 100.0);
            [link((from_m, 0.0), (to_m, 0.0)), link((0.0, -from_m), (0.0, -to_m))]
        });
        let extent = DataExtent::of(&[], &links.collect::<Vec<_>>());
        assert!(extent.is_far(&Position::new(900.0, -900.0)) && !extent.is_far(&Position::new(60.0, -60.0)));
        // The squares change nothing.
        for n in 0..400 {
            let at = Position::new(f64::from(n % 20) * 71.0 - 200.0, 200.0 - f64::from(n / 20) * 71.0);
            assert_eq!(extent.is_far(&at), extent.nearest_m(&at) > extent.longest_m, "{at:?}");
        }
    }

    #[test]
    fn data_end_at_the_farthest_position_in_a_direction() {
        let (extent, at) = (extent(), Position::new(0.0, 0.0));
        assert_eq!(extent.farthest_towards_m(&at, 90.0), 300.0);
        assert_eq!(extent.farthest_towards_m(&at, 350.0), 100.0);
        assert_eq!(extent.farthest_towards_m(&at, 225.0), 0.0);
        let expected = "No data beyond 300 m from (0, 0); the nearest position with data is 0 m away.";
        assert_eq!(extent.sentence(&at), expected);
        assert_eq!(
            extent.track_sentence(&[at, Position::new(340.0, 30.0)]),
            "The track is up to 50 m from the nearest position with data."
        );
        let far = extent.track_sentence(&[at, at, Position::new(1300.0, 0.0)]);
        assert!(
            far.ends_with(
                "34 % of the messages are sent or received far from all data; their probability is not known."
            )
        );
    }
}
