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
    /// [`SCALE_FALLBACK_M`] if all positions coincide.
    pub fn about(positions: impl IntoIterator<Item = Position>) -> Self {
        let positions: Vec<Position> = positions.into_iter().collect();
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
