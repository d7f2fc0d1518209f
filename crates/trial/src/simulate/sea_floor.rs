//! The sea floor and its acoustic shadow.

use pingmap_agent::Position;

use super::acoustics::{diffraction_unit_m, knife_edge_loss_db};

/// Smaller rises above the flat floor cast no shadow.
const RISE_MIN_M: f64 = 0.5;

/// Step along a path, as a share of the width of ridge or mound.
const STEP_SHARE: f64 = 0.125;

/// A flat floor with a ridge and a mound of Gaussian profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeaFloor {
    /// Depth of the flat part, metres.
    pub depth_m: f64,
    /// The ridge.
    pub ridge: Ridge,
    /// The mound.
    pub mound: Mound,
}

/// A straight ridge of infinite length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ridge {
    /// Easting of a point on the crest.
    pub east_m: f64,
    /// Northing of a point on the crest.
    pub north_m: f64,
    /// Direction of the crest, radians from east towards north.
    pub direction_rad: f64,
    /// Height of the crest above the flat floor.
    pub height_m: f64,
    /// Distance from the crest at which the height has fallen to e^−½.
    pub width_m: f64,
}

/// A round mound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mound {
    /// Easting of the top.
    pub east_m: f64,
    /// Northing of the top.
    pub north_m: f64,
    /// Height of the top above the flat floor.
    pub height_m: f64,
    /// Distance from the top at which the height has fallen to e^−½.
    pub width_m: f64,
}

impl SeaFloor {
    /// Returns the depth of the floor at a position.
    pub fn depth_at_m(&self, east_m: f64, north_m: f64) -> f64 {
        self.depth_m - self.rise_at_m(east_m, north_m)
    }

    /// Returns the height above the flat floor: that of ridge or mound, whichever is higher.
    fn rise_at_m(&self, east_m: f64, north_m: f64) -> f64 {
        let Self { ridge, mound, .. } = self;
        let across = (east_m - ridge.east_m) * -ridge.direction_rad.sin()
            + (north_m - ridge.north_m) * ridge.direction_rad.cos();
        let away = (east_m - mound.east_m).hypot(north_m - mound.north_m);
        let profile = |height: f64, distance: f64, width: f64| height * (-0.5 * (distance / width).powi(2)).exp();
        let ridge = profile(ridge.height_m, across, ridge.width_m);
        ridge.max(profile(mound.height_m, away, mound.width_m))
    }

    /// Returns the loss behind the highest obstacle between two ends, in dB. Heights are relative to the straight line,
    /// in units of diffraction. Ends without a depth are at the surface. O(distance / width of ridge or mound).
    pub fn shadow_loss_db(&self, from: &Position, to: &Position, wavelength_m: f64) -> f64 {
        let (from_depth, to_depth) = (from.depth_m.unwrap_or(0.0), to.depth_m.unwrap_or(0.0));
        let length = (to.east_m - from.east_m).hypot(to.north_m - from.north_m);
        let steps = (length / (STEP_SHARE * self.ridge.width_m.min(self.mound.width_m))).ceil() as usize;
        let nu = |step: usize| {
            let share = step as f64 / steps as f64;
            let between = |a: f64, b: f64| a + share * (b - a);
            let rise_m = self.rise_at_m(between(from.east_m, to.east_m), between(from.north_m, to.north_m));
            let height_m = between(from_depth, to_depth) - (self.depth_m - rise_m);
            let unit_m = diffraction_unit_m(wavelength_m, share * length, (1.0 - share) * length);
            (rise_m >= RISE_MIN_M).then_some(height_m / unit_m)
        };
        let highest = (1..steps).filter_map(nu).fold(f64::NEG_INFINITY, f64::max);
        knife_edge_loss_db(highest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floor(ridge_m: f64) -> SeaFloor {
        let ridge = Ridge {
            east_m: 500.0,
            north_m: 0.0,
            direction_rad: std::f64::consts::FRAC_PI_2,
            height_m: ridge_m,
            width_m: 40.0,
        };
        let mound = Mound { east_m: 0.0, north_m: 5000.0, height_m: 10.0, width_m: 50.0 };
        SeaFloor { depth_m: 30.0, ridge, mound }
    }

    fn at(east_m: f64, depth_m: f64) -> Position {
        Position { depth_m: Some(depth_m), ..Position::new(east_m, 0.0) }
    }

    #[test]
    fn the_floor_is_flat_but_for_ridge_and_mound() {
        let floor = floor(20.0);
        assert!((floor.depth_at_m(500.0, 123.0) - 10.0).abs() < 1e-9, "on the crest, anywhere along it");
        assert!((floor.depth_at_m(540.0, 0.0) - (30.0 - 20.0 * (-0.5f64).exp())).abs() < 1e-9);
        assert!((floor.depth_at_m(0.0, 5000.0) - 20.0).abs() < 1e-9);
        assert!((floor.depth_at_m(-2000.0, 0.0) - 30.0).abs() < 1e-9);
    }

    #[test]
    fn only_obstacles_on_the_path_cast_shadows() {
        let wavelength = 0.06;
        let (left, right) = (at(0.0, 12.0), at(1000.0, 12.0));
        let loss = |ridge: f64| floor(ridge).shadow_loss_db(&left, &right, wavelength);
        assert_eq!(loss(5.0), 0.0);
        assert!((loss(18.0) - 6.0).abs() < 0.5, "the crest touches the line of sight: {}", loss(18.0));
        // The crest is 4 m above the line, half way: ν = 4 / √(0.06·500·500 / 2000).
        assert!((loss(22.0) - knife_edge_loss_db(4.0 / 7.5f64.sqrt())).abs() < 0.3, "{}", loss(22.0));
        assert_eq!(floor(22.0).shadow_loss_db(&left, &at(350.0, 12.0), wavelength), 0.0);
        // The flat floor casts no shadow, even for ends close to it.
        assert_eq!(floor(0.0).shadow_loss_db(&at(0.0, 29.0), &at(1000.0, 29.0), 1.5), 0.0);
        // The loss is equal in both directions, and 0 between equal positions.
        assert!((floor(22.0).shadow_loss_db(&right, &left, wavelength) - loss(22.0)).abs() < 1e-9);
        assert_eq!(floor(22.0).shadow_loss_db(&left, &left, wavelength), 0.0);
    }
}
