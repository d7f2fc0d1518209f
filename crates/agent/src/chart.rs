//! The one place where metres in a log and metres about the chart origin meet.

use crate::event::Position;
use crate::reference::ReferenceSystem;

/// The team's common frame. The method sees metres about `origin`, never scaled column by column, so that swapping the
/// two ends of a link keeps distances; the origin only keeps numbers small (UTM northings have seven digits before the
/// point).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chart {
    /// What the method calls (0, 0), in metres of the log.
    pub origin: Position,
    /// How far positions typically lie from the origin, in metres: what length-scales are expected to be, give or take
    /// a factor of a few, before anything is learned. Fixed with the chart, so that vehicles that never saw each
    /// other's data expect the same.
    pub scale_m: f64,
    /// What the metres of the log mean.
    pub reference: ReferenceSystem,
}

/// Scale of a chart about positions that do not tell one, in metres.
pub const SCALE_FALLBACK_M: f64 = 500.0;

/// Positions closer together than this are in one place.
const SCALE_MIN_M: f64 = 1e-3;

/// A positive number rounded to two significant digits.
fn two_digits(number: f64) -> f64 {
    let unit = 10f64.powf(number.log10().floor() - 1.0);
    (number / unit).round() * unit
}

impl Chart {
    /// A chart about the mean of `positions`, rounded to 100 m so that logs of one place share an origin; (0, 0)
    /// without any. Its scale is their root-mean-square distance from their mean to two digits; [`SCALE_FALLBACK_M`]
    /// where they are all in one place.
    pub fn about(positions: impl IntoIterator<Item = Position>) -> Self {
        let positions: Vec<Position> = positions.into_iter().collect();
        let count = positions.len().max(1) as f64;
        let east_m = positions.iter().map(|position| position.east_m / count).sum::<f64>();
        let north_m = positions.iter().map(|position| position.north_m / count).sum::<f64>();
        let square =
            |position: &Position| ((position.east_m - east_m).powi(2) + (position.north_m - north_m).powi(2)) / count;
        let spread_m = positions.iter().map(square).sum::<f64>().sqrt();
        let round = |metres: f64| (metres / 100.0).round() * 100.0;
        let scale_m = if spread_m > SCALE_MIN_M { two_digits(spread_m) } else { SCALE_FALLBACK_M };
        Self { origin: Position::new(round(east_m), round(north_m)), scale_m, reference: ReferenceSystem::Unknown }
    }

    /// East and north of a position in metres about the origin.
    pub fn local_m(&self, position: &Position) -> (f64, f64) {
        (position.east_m - self.origin.east_m, position.north_m - self.origin.north_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_origin_is_round_and_central() {
        let chart = Chart::about([Position::new(431_000.0, 4_700_020.0), Position::new(431_180.0, 4_700_000.0)]);
        assert_eq!(chart.origin, Position::new(431_100.0, 4_700_000.0));
        assert_eq!(chart.local_m(&Position::new(431_110.0, 4_699_990.0)), (10.0, -10.0));
        assert_eq!(Chart::about([]).origin, Position::new(0.0, 0.0));
    }

    #[test]
    fn the_scale_is_how_far_positions_typically_lie_from_their_middle() {
        let square = |half: f64| [(half, half), (half, -half), (-half, half), (-half, -half)];
        let chart = |half| Chart::about(square(half).map(|(east_m, north_m)| Position::new(east_m + 5e5, north_m)));
        assert_eq!(chart(500.0).scale_m, 710.0);
        assert!((chart(0.5).scale_m - 0.71).abs() < 1e-12);
        for nowhere in [Chart::about([]), chart(0.0), Chart::about([Position::new(3.0, 4.0)])] {
            assert_eq!(nowhere.scale_m, SCALE_FALLBACK_M);
        }
    }
}
