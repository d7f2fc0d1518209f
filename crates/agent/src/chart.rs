//! The one place where metres in a log, metres about the chart origin, and latitude and longitude meet.

use crate::event::Position;

/// Semi-major axis (m) and squared eccentricity of the WGS 84 ellipsoid.
const WGS84: (f64, f64) = (6_378_137.0, 6.694_379_990_14e-3);

/// The team's common frame. The method sees metres about `origin`, never scaled column by column, so that swapping the two ends
/// of a link keeps distances; the origin only keeps numbers small (UTM northings have seven digits before the point).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chart {
    /// What the method calls (0, 0), in metres of the log.
    pub origin: Position,
    /// Latitude and longitude of (0, 0) of the log, if known.
    pub geographic: Option<Geographic>,
}

/// A point on the ellipsoid, in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geographic {
    /// Degrees north, −90 to 90.
    pub latitude_deg: f64,
    /// Degrees east, −180 to 180.
    pub longitude_deg: f64,
}

impl Chart {
    /// A chart about the mean of `positions`, rounded to 100 m so that logs of one place share an origin; (0, 0) without any.
    pub fn about(positions: impl IntoIterator<Item = Position>) -> Self {
        let (mut east, mut north, mut count) = (0.0, 0.0, 0.0);
        for position in positions {
            east += position.east_m;
            north += position.north_m;
            count += 1.0;
        }
        let round = |sum: f64| if count > 0.0 { (sum / count / 100.0).round() * 100.0 } else { 0.0 };
        Self { origin: Position::new(round(east), round(north)), geographic: None }
    }

    /// East and north of a position in metres about the origin.
    pub fn local_m(&self, position: &Position) -> (f64, f64) {
        (position.east_m - self.origin.east_m, position.north_m - self.origin.north_m)
    }

    /// Latitude and longitude of a position, where the chart knows its own: a local plane tangent to WGS 84 at the log's (0, 0).
    /// Good to about a metre within 2 km and 30 m within 15 km at middle latitudes.
    pub fn geographic(&self, position: &Position) -> Option<Geographic> {
        let Geographic { latitude_deg, longitude_deg } = self.geographic?;
        let (axis, eccentricity) = WGS84;
        let latitude = latitude_deg.to_radians();
        let slack = 1.0 - eccentricity * latitude.sin().powi(2);
        let meridian_radius_m = axis * (1.0 - eccentricity) / slack.powf(1.5);
        let parallel_radius_m = axis / slack.sqrt() * latitude.cos();
        Some(Geographic {
            latitude_deg: latitude_deg + (position.north_m / meridian_radius_m).to_degrees(),
            longitude_deg: longitude_deg + (position.east_m / parallel_radius_m).to_degrees(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_degree_of_latitude_is_110_6_to_111_7_km() {
        for (latitude_deg, north_m) in [(0.0, 110_574.0), (45.0, 111_132.0)] {
            let datum = Geographic { latitude_deg, longitude_deg: 10.0 };
            let chart = Chart { origin: Position::new(0.0, 0.0), geographic: Some(datum) };
            let found = chart.geographic(&Position::new(0.0, north_m / 100.0)).expect("a datum is given");
            assert!((found.latitude_deg - latitude_deg - 0.01).abs() < 1e-6, "{found:?}");
            assert_eq!(found.longitude_deg, 10.0);
        }
    }

    #[test]
    fn the_origin_is_round_and_central() {
        let chart = Chart::about([Position::new(431_000.0, 4_700_020.0), Position::new(431_180.0, 4_700_000.0)]);
        assert_eq!(chart.origin, Position::new(431_100.0, 4_700_000.0));
        assert_eq!(chart.local_m(&Position::new(431_110.0, 4_699_990.0)), (10.0, -10.0));
        assert_eq!(Chart::about([]).origin, Position::new(0.0, 0.0));
    }
}
