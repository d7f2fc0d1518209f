//! The chart: the conversion between coordinates of a log and coordinates about the chart origin.

use crate::types::event::Position;
use crate::types::reference_system::ReferenceSystem;

/// The common coordinate frame of a team.
///
/// The method uses metres about `origin`. Columns are never scaled separately, so swapping the two ends of a link
/// preserves distances. The origin only keeps numbers small: UTM northings have seven digits before the decimal point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chart {
    /// Origin of the method's coordinates, in metres of the log.
    pub origin: Position,
    /// Typical distance of positions from the origin, in metres. Learning expects length-scales of this order. The
    /// scale is fixed with the chart, so vehicles with different data have equal expectations.
    pub scale_m: f64,
    /// Reference system of the log's coordinates.
    pub reference: ReferenceSystem,
}

/// Scale of a chart whose positions do not determine one, in metres.
pub const SCALE_FALLBACK_M: f64 = 500.0;

/// Largest spread of positions that count as a single position, in metres.
const SCALE_MIN_M: f64 = 1e-3;

/// A position is far away if its distance from the median position is this multiple of the median distance, and at
/// least [`FAR_MIN_M`].
const FAR_TIMES: f64 = 30.0;

/// Smallest distance of a position that is far away, in metres.
const FAR_MIN_M: f64 = 5_000.0;

/// Far positions do not count for a chart if they are at most this fraction of all: one in twenty.
const FEW: usize = 20;

/// The area of nearly all positions of a log, without single positions far away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MainArea {
    /// The median position, coordinate by coordinate.
    pub middle: Position,
    /// Distance from the middle beyond which positions are far away, in metres.
    pub radius_m: f64,
}

impl MainArea {
    /// Returns the main area of `positions`. O(n).
    pub fn of(positions: &[Position]) -> Self {
        let coordinate = |of: fn(&Position) -> f64| median(positions.iter().map(of).collect());
        let middle = Position::new(coordinate(|position| position.east_m), coordinate(|position| position.north_m));
        let distances = positions.iter().map(|position| middle.distance_m(position)).collect();
        Self { middle, radius_m: (FAR_TIMES * median(distances)).max(FAR_MIN_M) }
    }

    /// Returns whether a position is not far away.
    pub fn contains(&self, position: &Position) -> bool {
        self.middle.distance_m(position) <= self.radius_m
    }
}

/// Returns the upper median, or 0 without values.
fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Returns a positive number rounded to two significant digits.
fn round_to_two_digits(number: f64) -> f64 {
    let unit = 10f64.powf(number.log10().floor() - 1.0);
    (number / unit).round() * unit
}

impl Chart {
    /// Returns a chart about the mean of `positions`.
    ///
    /// The origin is rounded to 100 m, so that logs of one site share it. Without positions it is (0, 0). The scale is
    /// the root-mean-square distance of the positions from their mean, rounded to two digits. It is
    /// [`SCALE_FALLBACK_M`] if all positions coincide. A few positions outside of the [`MainArea`] do not count: one of
    /// them would make all length-scales too long. If they are more than a twentieth of all, they count.
    pub fn about(positions: impl IntoIterator<Item = Position>) -> Self {
        let mut positions: Vec<Position> = positions.into_iter().collect();
        let area = MainArea::of(&positions);
        let far = positions.iter().filter(|position| !area.contains(position)).count();
        if far <= positions.len() / FEW {
            positions.retain(|position| area.contains(position));
        }
        let count = positions.len().max(1) as f64;
        let east_m = positions.iter().map(|position| position.east_m / count).sum::<f64>();
        let north_m = positions.iter().map(|position| position.north_m / count).sum::<f64>();
        let square =
            |position: &Position| ((position.east_m - east_m).powi(2) + (position.north_m - north_m).powi(2)) / count;
        let spread_m = positions.iter().map(square).sum::<f64>().sqrt();
        let round = |metres: f64| (metres / 100.0).round() * 100.0;
        let scale_m = if spread_m > SCALE_MIN_M { round_to_two_digits(spread_m) } else { SCALE_FALLBACK_M };
        Self { origin: Position::new(round(east_m), round(north_m)), scale_m, reference: ReferenceSystem::Unknown }
    }

    /// Returns the east and north coordinates of a position about the origin, in metres.
    pub fn local_m(&self, position: &Position) -> (f64, f64) {
        (position.east_m - self.origin.east_m, position.north_m - self.origin.north_m)
    }
}
