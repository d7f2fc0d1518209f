//! Vehicles on survey legs.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// A track of parallel legs over a square, driven there and back.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Legs {
    /// Corners of the track, metres.
    corners: Vec<(f64, f64)>,
    length_m: f64,
    /// Distance along the track at which the vehicle starts.
    start_m: f64,
}

impl Legs {
    /// Returns the legs of a vehicle over the square from (0, 0) to (`area_m`, `area_m`). Legs of even and odd vehicles
    /// are perpendicular. Corners, spacings and distances from the border differ between the first few vehicles. The
    /// start is random.
    pub(super) fn of_vehicle(vehicle: usize, area_m: f64, rng: &mut ChaCha8Rng) -> Self {
        let inset_m = area_m * (0.04 + 0.03 * (vehicle % 5) as f64);
        let spacing_m = area_m / 6.0 * (1.0 - 0.07 * (vehicle % 4) as f64);
        let (low, high) = (inset_m, area_m - inset_m);
        let legs = ((high - low) / spacing_m).floor() as usize + 1;
        let turned =
            |along: f64, across: f64| if vehicle.is_multiple_of(2) { (across, along) } else { (along, across) };
        let (flip_east, flip_north) = (vehicle / 2 % 2 == 1, vehicle / 4 % 2 == 1);
        let mirrored = |flip: bool, x: f64| if flip { area_m - x } else { x };
        let mut corners = Vec::with_capacity(2 * legs);
        for leg in 0..legs {
            let across = low + leg as f64 * spacing_m;
            let ends = if leg.is_multiple_of(2) { [low, high] } else { [high, low] };
            for along in ends {
                let (east, north) = turned(along, across);
                corners.push((mirrored(flip_east, east), mirrored(flip_north, north)));
            }
        }
        let length_m = corners.windows(2).map(|pair| distance(pair[0], pair[1])).sum();
        Self { corners, length_m, start_m: rng.random::<f64>() * length_m }
    }

    /// Returns east and north after `travelled_m` metres.
    pub(super) fn after_m(&self, travelled_m: f64) -> (f64, f64) {
        // The distance is folded, because the track is driven there and back.
        let folded = (self.start_m + travelled_m) % (2.0 * self.length_m);
        let mut left = if folded > self.length_m { 2.0 * self.length_m - folded } else { folded };
        for pair in self.corners.windows(2) {
            let leg = distance(pair[0], pair[1]);
            if left <= leg {
                let share = left / leg;
                return (pair[0].0 + share * (pair[1].0 - pair[0].0), pair[0].1 + share * (pair[1].1 - pair[0].1));
            }
            left -= leg;
        }
        self.corners[self.corners.len() - 1]
    }
}

fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    (b.0 - a.0).hypot(b.1 - a.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::stream;

    #[test]
    fn vehicles_stay_inside_and_move_at_their_speed() {
        for vehicle in 0..12 {
            let legs = Legs::of_vehicle(vehicle, 1000.0, &mut stream(1, vehicle as u64));
            let places: Vec<(f64, f64)> = (0..4000).map(|n| legs.after_m(5.0 * f64::from(n))).collect();
            for &(east, north) in &places {
                assert!((30.0..=970.0).contains(&east) && (30.0..=970.0).contains(&north), "{vehicle}: {east} {north}");
            }
            for pair in places.windows(2) {
                // Turns cut corners, so a step is at most the travelled distance.
                assert!(distance(pair[0], pair[1]) <= 5.0 + 1e-9);
            }
            let straight = places.windows(2).filter(|pair| distance(pair[0], pair[1]) > 5.0 - 1e-9).count();
            assert!(straight > 3800, "{vehicle}: {straight}");
            let (west, east) = places.iter().fold((f64::MAX, f64::MIN), |(w, e), p| (w.min(p.0), e.max(p.0)));
            assert!(east - west > 500.0, "a survey covers its area: {west} {east}");
        }
    }
}
