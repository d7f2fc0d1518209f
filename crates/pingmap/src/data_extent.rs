//! Where the data of a map end.

use pingmap_agent::{Event, Link, Position};

use crate::grid::Point;

/// Half of the angle in which positions count as lying in a direction, in degrees.
const SECTOR_HALF_DEG: f64 = 15.0;

/// Positions of both ends of all links with data.
pub struct DataExtent {
    ends: Vec<Point>,
    /// Western, southern, eastern and northern edge of these positions.
    edges: [f64; 4],
    /// Length of the longest link.
    longest_m: f64,
}

impl DataExtent {
    /// Returns the extent of the events, and of the links of a site prior.
    pub fn of<'a>(events: &'a [Event], site: impl IntoIterator<Item = &'a Link>) -> Self {
        let links: Vec<&Link> = events.iter().map(|event| &event.link).chain(site).collect();
        let ends: Vec<Point> = links.iter().flat_map(|link| link.ends()).map(|end| (end.east_m, end.north_m)).collect();
        let none = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let edges = ends
            .iter()
            .fold(none, |[west, south, east, north], &(x, y)| [west.min(x), south.min(y), east.max(x), north.max(y)]);
        let longest_m = links.iter().map(|link| link.range_m()).fold(0.0, f64::max);
        Self { ends, edges, longest_m }
    }

    /// Returns true if a position is farther from the rectangle around all data than the longest link. Nothing is known
    /// about links to such a position.
    pub fn is_far(&self, at: &Position) -> bool {
        let [west, south, east, north] = self.edges;
        let away = |value: f64, low: f64, high: f64| (low - value).max(value - high).max(0.0);
        away(at.east_m, west, east).hypot(away(at.north_m, south, north)) > self.longest_m
    }

    /// Returns the ends of the interval of a link: 0 and 1 if one of its ends is far from all data.
    pub fn interval(&self, link: &Link, ends: (f64, f64)) -> (f64, f64) {
        if link.ends().iter().any(|end| self.is_far(end)) { (0.0, 1.0) } else { ends }
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
        self.ends.iter().map(move |end| {
            let (east_m, north_m) = (end.0 - x, end.1 - y);
            (east_m.hypot(north_m), east_m.atan2(north_m).to_degrees())
        })
    }

    /// States where the data end, seen from a place.
    pub fn sentence(&self, at: &Position) -> String {
        let place = format!("({:.0}, {:.0})", at.east_m, at.north_m);
        let (nearest_m, farthest_m, longest_m) = (self.nearest_m(at), self.farthest_m(at), self.longest_m);
        if self.is_far(at) {
            return format!(
                "Not known: {place} is {nearest_m:.0} m from the nearest position of the log, farther than its longest link \
                 ({longest_m:.0} m)."
            );
        }
        format!(
            "No data beyond {farthest_m:.0} m from {place}; the nearest position of the log is {nearest_m:.0} m away."
        )
    }

    /// States how far a track leads away from the data.
    pub fn track_sentence(&self, track: impl IntoIterator<Item = Position>) -> String {
        let farthest_m = track.into_iter().map(|at| self.nearest_m(&at)).fold(0.0, f64::max);
        format!("The track is up to {farthest_m:.0} m from the nearest position of the log.")
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
        assert!(!extent.is_far(&Position::new(599.0, 50.0)) && extent.is_far(&Position::new(601.0, 50.0)));
        let (near, far) = (link((0.0, 0.0), (10.0, 0.0)), link((0.0, 0.0), (9000.0, 0.0)));
        assert_eq!(extent.interval(&near, (0.3, 0.4)), (0.3, 0.4));
        assert_eq!(extent.interval(&far, (0.3, 0.4)), (0.0, 1.0));
        assert!(extent.sentence(&Position::new(0.0, 9000.0)).starts_with("Not known: (0, 9000) is 8900 m"));
    }

    #[test]
    fn data_end_at_the_farthest_position_in_a_direction() {
        let (extent, at) = (extent(), Position::new(0.0, 0.0));
        assert_eq!(extent.farthest_towards_m(&at, 90.0), 300.0);
        assert_eq!(extent.farthest_towards_m(&at, 350.0), 100.0);
        assert_eq!(extent.farthest_towards_m(&at, 225.0), 0.0);
        let expected = "No data beyond 300 m from (0, 0); the nearest position of the log is 0 m away.";
        assert_eq!(extent.sentence(&at), expected);
        assert_eq!(
            extent.track_sentence([at, Position::new(340.0, 30.0)]),
            "The track is up to 50 m from the nearest position of the log."
        );
    }
}
