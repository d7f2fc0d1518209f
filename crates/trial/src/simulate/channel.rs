//! Probability that a message over a link is received.

use pingmap_agent::Link;

use super::acoustics::{
    Seawater, ambient_noise_db, francois_garrison_db_per_km, spreading_loss_db, sum_of_levels_db, thorp_db_per_km,
    wind_of_sea_state_m_per_s,
};
use super::error::{SimulationError, within};
use super::sea_floor::SeaFloor;

/// Formula of absorption.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Absorption {
    /// [`thorp_db_per_km`].
    Thorp,
    /// [`francois_garrison_db_per_km`].
    FrancoisGarrison,
}

/// Properties of source, water and receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sound {
    /// Source level, dB re 1 µPa at 1 m.
    pub source_level_db: f64,
    /// Centre of the band, kHz.
    pub frequency_khz: f64,
    /// Width of the band, kHz.
    pub bandwidth_khz: f64,
    /// Exponent of spreading, 1 (cylinder) to 2 (sphere).
    pub spreading: f64,
    /// Formula of absorption.
    pub absorption: Absorption,
    /// The water.
    pub water: Seawater,
    /// Wind, m/s.
    pub wind_m_per_s: f64,
    /// Distant shipping, 0 to 1.
    pub shipping: f64,
    /// Signal-to-noise ratio at which half of the messages are received, dB.
    pub threshold_db: f64,
    /// Standard deviation of the level about its mean, dB. Fading is log-normal, as P. Qarabaqi and M. Stojanovic, IEEE
    /// J. Oceanic Eng. 38 (2013) 701, found for slow variations. Messages fade independently here; in the sea, fading
    /// is correlated in time.
    pub fading_db: f64,
    /// Loss of a message that travels against [`Sound::favoured_bearing_deg`], dB: 0 where both directions are equal.
    /// Between the two bearings the loss follows the cosine of the angle.
    pub direction_loss_db: f64,
    /// Bearing of propagation without that loss, in degrees clockwise from north.
    pub favoured_bearing_deg: f64,
    /// Amplitude of a slow change of the noise in dB: a sine over time about the mean noise; 0 for constant noise.
    pub noise_swing_db: f64,
    /// Period of that change, seconds.
    pub noise_period_s: f64,
}

impl Default for Sound {
    /// Returns a modem around 25 kHz at low power in sea state 3. Half of the messages are received at about a
    /// kilometre.
    fn default() -> Self {
        Self {
            source_level_db: 162.0,
            frequency_khz: 25.0,
            bandwidth_khz: 4.0,
            spreading: 2.0,
            absorption: Absorption::FrancoisGarrison,
            water: Seawater::default(),
            wind_m_per_s: wind_of_sea_state_m_per_s(3.0),
            shipping: 0.5,
            threshold_db: 12.0,
            fading_db: 6.0,
            direction_loss_db: 0.0,
            favoured_bearing_deg: 0.0,
            noise_swing_db: 0.0,
            noise_period_s: 3600.0,
        }
    }
}

impl Sound {
    /// Refuses physically impossible numbers.
    pub(super) fn check(&self) -> Result<(), SimulationError> {
        let Seawater { temperature_c, salinity, ph, depth_m } = self.water;
        within("source level (dB)", self.source_level_db, 0.0, 300.0)?;
        within("frequency (kHz)", self.frequency_khz, 0.4, 1000.0)?;
        within("bandwidth (kHz)", self.bandwidth_khz, 1e-3, 2.0 * self.frequency_khz)?;
        within("exponent of spreading", self.spreading, 1.0, 2.0)?;
        within("temperature (°C)", temperature_c, -2.0, 40.0)?;
        within("salinity (g/kg)", salinity, 0.0, 45.0)?;
        within("acidity (pH)", ph, 5.0, 10.0)?;
        within("depth of the water that absorbs (m)", depth_m, 0.0, 11_000.0)?;
        within("wind (m/s)", self.wind_m_per_s, 0.0, 60.0)?;
        within("shipping", self.shipping, 0.0, 1.0)?;
        within("threshold (dB)", self.threshold_db, -100.0, 200.0)?;
        within("fading (dB)", self.fading_db, 1e-6, 100.0)?;
        within("loss by direction (dB)", self.direction_loss_db, 0.0, 100.0)?;
        within("favoured bearing (°)", self.favoured_bearing_deg, -360.0, 360.0)?;
        within("swing of the noise (dB)", self.noise_swing_db, 0.0, 50.0)?;
        within("period of the noise (s)", self.noise_period_s, 1.0, 1e7)
    }
}

/// An acoustic channel by the sonar equation (Urick 1983). Signal-to-noise ratio = source level − spreading −
/// absorption − shadow − noise in the band. The model has no refraction, multipath or Doppler.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Channel {
    /// Source, water and receiver.
    pub sound: Sound,
    /// The sea floor.
    pub floor: SeaFloor,
}

impl Channel {
    /// Returns the transmission loss of a link, in dB.
    pub fn transmission_loss_db(&self, link: &Link) -> f64 {
        let depth = |depth_m: Option<f64>| depth_m.unwrap_or(0.0);
        let rise_m = depth(link.transmitter.depth_m) - depth(link.receiver.depth_m);
        let (from, to) = (link.transmitter, link.receiver);
        let range_m = (to.east_m - from.east_m).hypot(to.north_m - from.north_m).hypot(rise_m);
        let bottom_loss_db = self.floor.shadow_loss_db(&from, &to, self.wavelength_m());
        self.open_water_loss_db(range_m) + bottom_loss_db + self.direction_loss_db(link)
    }

    fn direction_loss_db(&self, link: &Link) -> f64 {
        let (east_m, north_m) =
            (link.receiver.east_m - link.transmitter.east_m, link.receiver.north_m - link.transmitter.north_m);
        let off_axis_rad = east_m.atan2(north_m) - self.sound.favoured_bearing_deg.to_radians();
        self.sound.direction_loss_db * 0.5 * (1.0 - off_axis_rad.cos())
    }

    fn open_water_loss_db(&self, range_m: f64) -> f64 {
        let absorption_db_per_km = match self.sound.absorption {
            Absorption::Thorp => thorp_db_per_km(self.sound.frequency_khz),
            Absorption::FrancoisGarrison => francois_garrison_db_per_km(self.sound.frequency_khz, &self.sound.water),
        };
        spreading_loss_db(range_m, self.sound.spreading) + absorption_db_per_km * range_m / 1000.0
    }

    fn wavelength_m(&self) -> f64 {
        self.sound.water.sound_speed_m_per_s() / (1000.0 * self.sound.frequency_khz)
    }

    /// Returns the noise in the band in dB, at a receiver whose own noise has the spectrum level `self_noise_db`.
    pub fn noise_db(&self, self_noise_db: f64) -> f64 {
        let ambient = ambient_noise_db(self.sound.frequency_khz, self.sound.shipping, self.sound.wind_m_per_s);
        sum_of_levels_db(&[ambient, self_noise_db]) + 10.0 * (1000.0 * self.sound.bandwidth_khz).log10()
    }

    /// Returns the probability that a receiver with this own noise hears a message: Φ((ratio − threshold) / fading).
    /// The noise is the mean over time.
    pub fn probability(&self, link: &Link, self_noise_db: f64) -> f64 {
        self.probability_at(self.sound.source_level_db - self.transmission_loss_db(link) - self.noise_db(self_noise_db))
    }

    /// Returns the probability as [`Channel::probability`], with the noise at a time.
    pub fn probability_at_time(&self, link: &Link, self_noise_db: f64, time_s: f64) -> f64 {
        let swing_db = self.sound.noise_swing_db * (std::f64::consts::TAU * time_s / self.sound.noise_period_s).sin();
        let noise_db = self.noise_db(self_noise_db) + swing_db;
        self.probability_at(self.sound.source_level_db - self.transmission_loss_db(link) - noise_db)
    }

    fn probability_at(&self, ratio_db: f64) -> f64 {
        let excess = (ratio_db - self.sound.threshold_db) / self.sound.fading_db;
        0.5 * libm::erfc(-excess / std::f64::consts::SQRT_2)
    }

    /// Returns the range in metres at which half of the messages are received without shadow; at most 1000 km.
    pub fn even_odds_range_m(&self, self_noise_db: f64) -> f64 {
        let allowed_db = self.sound.source_level_db - self.noise_db(self_noise_db) - self.sound.threshold_db;
        // The loss grows with range, so bisection finds the range.
        let (mut near, mut far) = (0.0, 1e6);
        for _ in 0..60 {
            let middle = 0.5 * (near + far);
            if self.open_water_loss_db(middle) < allowed_db { near = middle } else { far = middle }
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use pingmap_agent::Position;

    use super::super::sea_floor::{Mound, Ridge};
    use super::*;

    fn channel(ridge_m: f64) -> Channel {
        let (east_m, north_m) = (500.0, 0.0);
        let ridge =
            Ridge { east_m, north_m, direction_rad: std::f64::consts::FRAC_PI_2, height_m: ridge_m, width_m: 40.0 };
        let mound = Mound { east_m, north_m, height_m: 0.0, width_m: 40.0 };
        Channel { sound: Sound::default(), floor: SeaFloor { depth_m: 30.0, ridge, mound } }
    }

    fn link(range_m: f64) -> Link {
        let at = |east_m| Position { depth_m: Some(10.0), ..Position::new(east_m, 0.0) };
        Link { transmitter: at(0.0), receiver: at(range_m) }
    }

    #[test]
    fn the_sonar_equation_holds_term_by_term() {
        let channel = channel(0.0);
        let sound = channel.sound;
        let loss_db = 20.0 * 800f64.log10() + 0.8 * francois_garrison_db_per_km(25.0, &sound.water);
        let ambient_db = ambient_noise_db(25.0, 0.5, sound.wind_m_per_s);
        let noise_db = 10.0 * ((10f64.powf(ambient_db / 10.0) + 10f64.powf(4.5)) * 4000.0).log10();
        let expected_db = 162.0 - loss_db - noise_db;
        // Φ of that ratio by a series: Φ(x) = ½ + φ(x)(x + x³/3 + x⁵/15 + …).
        let x: f64 = (expected_db - 12.0) / 6.0;
        let (mut term, mut sum) = (x, x);
        for n in 1..60 {
            term *= x * x / f64::from(2 * n + 1);
            sum += term;
        }
        let expected = 0.5 + sum * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
        let found = channel.probability(&link(800.0), 45.0);
        assert!((found - expected).abs() < 1e-9, "{found}, expected {expected}");
    }

    #[test]
    fn half_of_the_messages_are_received_at_the_even_odds_range() {
        let channel = channel(0.0);
        for noise_db in [40.0, 55.0, 70.0] {
            let range_m = channel.even_odds_range_m(noise_db);
            assert!((channel.probability(&link(range_m), noise_db) - 0.5).abs() < 1e-6, "{noise_db} dB: {range_m} m");
        }
        assert!(channel.even_odds_range_m(40.0) > channel.even_odds_range_m(70.0));
    }

    #[test]
    fn loss_and_noise_lower_the_probability() {
        let channel = channel(0.0);
        let at = |channel: Channel, range_m: f64, noise_db: f64| channel.probability(&link(range_m), noise_db);
        let reference = at(channel, 900.0, 45.0);
        assert!((0.05..0.95).contains(&reference), "{reference}");
        assert!(at(channel, 1000.0, 45.0) < reference);
        assert!(at(channel, 900.0, 50.0) < reference);
        assert!(at(self::channel(26.0), 900.0, 45.0) < reference - 0.2, "a ridge between the ends");
        let with = |change: fn(&mut Sound)| {
            let mut sound = channel.sound;
            change(&mut sound);
            at(Channel { sound, ..channel }, 900.0, 45.0)
        };
        assert!(with(|sound| sound.wind_m_per_s = 20.0) < reference);
        assert!(with(|sound| sound.frequency_khz = 40.0) < reference);
        assert!(with(|sound| sound.source_level_db = 158.0) < reference);
        assert!(with(|sound| sound.water.salinity = 0.0) > reference, "a lake absorbs less");
    }

    #[test]
    fn a_swing_of_the_noise_acts_as_a_change_of_the_source_level() {
        let mut channel = channel(0.0);
        let link = link(900.0);
        let mut at_level = |level_db: f64| {
            channel.sound.source_level_db = level_db;
            channel.probability(&link, 45.0)
        };
        let [loud, mean, quiet] = [158.0, 162.0, 166.0].map(&mut at_level);
        channel.sound = Sound { source_level_db: 162.0, noise_swing_db: 4.0, noise_period_s: 1200.0, ..channel.sound };
        for (time_s, expected) in [(0.0, mean), (300.0, loud), (900.0, quiet), (1500.0, loud)] {
            assert!((channel.probability_at_time(&link, 45.0, time_s) - expected).abs() < 1e-9, "{time_s} s");
        }
    }

    #[test]
    fn loss_by_direction_is_zero_along_the_favoured_bearing_and_full_against_it() {
        let mut channel = channel(0.0);
        // This link points east.
        let (east, none_db) = (link(900.0), channel.transmission_loss_db(&link(900.0)));
        let west = Link { transmitter: east.receiver, receiver: east.transmitter };
        channel.sound.direction_loss_db = 8.0;
        for (bearing_deg, [eastward_db, westward_db]) in [(90.0, [0.0, 8.0]), (-90.0, [8.0, 0.0]), (0.0, [4.0, 4.0])] {
            channel.sound.favoured_bearing_deg = bearing_deg;
            let more_db = [east, west].map(|link| channel.transmission_loss_db(&link) - none_db);
            assert!((more_db[0] - eastward_db).abs() < 1e-9 && (more_db[1] - westward_db).abs() < 1e-9, "{more_db:?}");
        }
    }
}
