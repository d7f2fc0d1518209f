//! Published formulas of underwater acoustics: transmission loss and noise. Frequencies are in kHz.

/// Properties of water on which absorption and the speed of sound depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seawater {
    /// Temperature in degrees Celsius.
    pub temperature_c: f64,
    /// Salinity in grams per kilogram.
    pub salinity: f64,
    /// Acidity.
    pub ph: f64,
    /// Depth in metres.
    pub depth_m: f64,
}

impl Default for Seawater {
    /// Returns the water of a temperate coast in autumn.
    fn default() -> Self {
        Self { temperature_c: 10.0, salinity: 35.0, ph: 8.0, depth_m: 10.0 }
    }
}

impl Seawater {
    /// Returns the speed of sound in m/s, in the linear form of Francois and Garrison (1982).
    pub fn sound_speed_m_per_s(&self) -> f64 {
        1412.0 + 3.21 * self.temperature_c + 1.19 * self.salinity + 0.0167 * self.depth_m
    }
}

/// Returns the absorption by Thorp's formula, in dB per km. Source: W. H. Thorp, J. Acoust. Soc. Am. 42 (1967) 270, in
/// the form for kilometres of R. J. Urick, "Principles of Underwater Sound" (1983). Valid for sea water at 4 °C near
/// the surface, from 0.1 to some tens of kHz.
///
/// ```
/// let absorption = pingmap_trial::simulate::thorp_db_per_km(25.0);
/// assert!((absorption - 6.1).abs() < 0.1);
/// ```
pub fn thorp_db_per_km(frequency_khz: f64) -> f64 {
    let f2 = frequency_khz * frequency_khz;
    0.11 * f2 / (1.0 + f2) + 44.0 * f2 / (4100.0 + f2) + 2.75e-4 * f2 + 0.003
}

/// Returns the absorption by R. E. Francois and G. R. Garrison, J. Acoust. Soc. Am. 72 (1982) 896 and 1879, in dB per
/// km. The terms are relaxation of boric acid and magnesium sulphate, and the viscosity of water. Valid for sea water
/// from 0.4 to 1000 kHz. Without salt only viscosity is left.
pub fn francois_garrison_db_per_km(frequency_khz: f64, water: &Seawater) -> f64 {
    let Seawater { temperature_c: t, salinity: s, ph, depth_m: d } = *water;
    let (f2, c, kelvin) = (frequency_khz * frequency_khz, water.sound_speed_m_per_s(), 273.0 + t);
    let relaxation = |strength: f64, f0: f64| strength * f0 * f2 / (f2 + f0 * f0);

    let boric = 8.86 / c * 10f64.powf(0.78 * ph - 5.0);
    let boric_khz = 2.8 * (s / 35.0).sqrt() * 10f64.powf(4.0 - 1245.0 / kelvin);

    let sulphate = 21.44 * s / c * (1.0 + 0.025 * t) * (1.0 - 1.37e-4 * d + 6.2e-9 * d * d);
    let sulphate_khz = 8.17 * 10f64.powf(8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (s - 35.0));

    let viscosity = if t <= 20.0 {
        4.937e-4 - 2.59e-5 * t + 9.11e-7 * t * t - 1.50e-8 * t.powi(3)
    } else {
        3.964e-4 - 1.146e-5 * t + 1.45e-7 * t * t - 6.5e-10 * t.powi(3)
    };
    let pressure = 1.0 - 3.83e-5 * d + 4.9e-10 * d * d;
    relaxation(boric, boric_khz) + relaxation(sulphate, sulphate_khz) + viscosity * pressure * f2
}

/// Returns the geometric spreading loss in dB relative to 1 m: 10·k·log₁₀ r. The exponent k is 2 for a sphere and 1 for
/// a cylinder. Shallow water is often in between, at 1.5 (Urick 1983). The loss is 0 within the first metre.
pub fn spreading_loss_db(range_m: f64, exponent: f64) -> f64 {
    10.0 * exponent * range_m.max(1.0).log10()
}

/// Returns the spectrum level of ambient noise, in dB re 1 µPa²/Hz. The sources are turbulence, distant shipping (0
/// none, 1 heavy), wind on the surface and thermal noise. The formulas are from R. F. W. Coates, "Underwater Acoustic
/// Systems" (1990), who fitted the curves of G. M. Wenz, J. Acoust. Soc. Am. 34 (1962) 1936.
pub fn ambient_noise_db(frequency_khz: f64, shipping: f64, wind_m_per_s: f64) -> f64 {
    let (f, log) = (frequency_khz, frequency_khz.log10());
    let turbulence = 17.0 - 30.0 * log;
    let ships = 40.0 + 20.0 * (shipping - 0.5) + 26.0 * log - 60.0 * (f + 0.03).log10();
    let wind = 50.0 + 7.5 * wind_m_per_s.sqrt() + 20.0 * log - 40.0 * (f + 0.4).log10();
    let thermal = -15.0 + 20.0 * log;
    sum_of_levels_db(&[turbulence, ships, wind, thermal])
}

/// Returns the wind speed of a sea state in m/s: the middle of the Beaufort band of Wenz (1962), interpolated linearly.
/// Sea states are clamped to 0 to 6.
pub fn wind_of_sea_state_m_per_s(sea_state: f64) -> f64 {
    const KNOTS: [f64; 7] = [0.5, 5.0, 8.5, 13.5, 19.0, 24.5, 30.5];
    const M_PER_S: f64 = 1852.0 / 3600.0;
    let sea_state = sea_state.clamp(0.0, 6.0);
    let (below, share) = (sea_state.floor() as usize, sea_state.fract());
    let above = (below + 1).min(KNOTS.len() - 1);
    M_PER_S * (KNOTS[below] + share * (KNOTS[above] - KNOTS[below]))
}

/// Returns the level of independent sources together, in dB.
pub fn sum_of_levels_db(levels_db: &[f64]) -> f64 {
    10.0 * levels_db.iter().map(|level| 10f64.powf(level / 10.0)).sum::<f64>().log10()
}

/// Returns the loss behind a knife edge in dB, by the approximation of Recommendation ITU-R P.526 to the
/// Fresnel-Kirchhoff theory of diffraction. ν is the height of the edge above the straight line between the ends, in
/// units of [`diffraction_unit_m`]. The loss is 0 for an edge well below the line, and 6 dB for an edge on the line.
pub fn knife_edge_loss_db(nu: f64) -> f64 {
    if nu <= -0.78 {
        return 0.0;
    }
    let beyond = nu - 0.1;
    6.9 + 20.0 * ((beyond * beyond + 1.0).sqrt() + beyond).log10()
}

/// Returns the height in metres at which ν = 1, for an edge at these distances from the ends: √(λ d₁ d₂ / (2 (d₁ +
/// d₂))).
pub fn diffraction_unit_m(wavelength_m: f64, d1_m: f64, d2_m: f64) -> f64 {
    (wavelength_m * d1_m * d2_m / (2.0 * (d1_m + d2_m))).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() < tolerance, "{found}, expected {expected}");
    }

    #[test]
    fn absorption_is_as_tabulated() {
        // Usual settings of echo sounders in sea water of 10 °C at 38, 120 and 200 kHz, to two digits.
        let shelf = Seawater { depth_m: 50.0, ..Seawater::default() };
        for (f, expected) in [(38.0, 10.0), (120.0, 38.0), (200.0, 54.0)] {
            near(francois_garrison_db_per_km(f, &shelf) / expected, 1.0, 0.03);
        }
        // Thorp by hand at 1 and 10 kHz: .055 + 44/4101 + .000275 + .003 and .1089 + 4400/4200 + .0275 + .003.
        near(thorp_db_per_km(1.0), 0.055 + 44.0 / 4101.0 + 0.003275, 1e-12);
        near(thorp_db_per_km(10.0), 11.0 / 101.0 + 4400.0 / 4200.0 + 0.0305, 1e-12);
        // Both formulas agree in their common range: cold sea water near the surface, tens of kHz.
        let cold = Seawater { temperature_c: 4.0, depth_m: 0.0, ..Seawater::default() };
        for f in [5.0, 10.0, 25.0, 40.0] {
            let ratio = francois_garrison_db_per_km(f, &cold) / thorp_db_per_km(f);
            assert!((0.8..1.25).contains(&ratio), "{f} kHz: {ratio}");
        }
        // Fresh water has only viscous absorption: about 4.9e-4 f² at 0 °C.
        let lake = Seawater { temperature_c: 0.0, salinity: 0.0, depth_m: 0.0, ph: 7.0 };
        near(francois_garrison_db_per_km(100.0, &lake) / 4.937, 1.0, 0.02);
        // The two branches of the viscosity meet at 20 °C.
        let warm = |temperature_c| Seawater { temperature_c, salinity: 0.0, ..Seawater::default() };
        let (below, above) = (warm(20.0), warm(20.0 + 1e-9));
        near(francois_garrison_db_per_km(500.0, &below) / francois_garrison_db_per_km(500.0, &above), 1.0, 0.01);
    }

    #[test]
    fn noise_rises_with_wind_and_ships_and_falls_with_frequency() {
        for pair in [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0].windows(2) {
            let [calm, rough] =
                [pair[0], pair[1]].map(|state| ambient_noise_db(25.0, 0.5, wind_of_sea_state_m_per_s(state)));
            assert!(rough > calm + 1.0, "{pair:?}: {calm} {rough}");
        }
        assert!(ambient_noise_db(0.1, 1.0, 3.0) > ambient_noise_db(0.1, 0.0, 3.0) + 10.0);
        assert!(ambient_noise_db(25.0, 0.5, 7.0) < ambient_noise_db(1.0, 0.5, 7.0) - 20.0);
        // Coates's wind term alone: 50 + 7.5·√9 + 20 − 40·log₁₀ 10.4 at 10 kHz and 9 m/s. The other terms add little.
        near(ambient_noise_db(10.0, 0.0, 9.0), 72.5 + 20.0 - 40.0 * 10.4f64.log10(), 0.1);
        // Thermal noise dominates at hundreds of kHz: 20 dB per decade.
        near(ambient_noise_db(3000.0, 0.0, 1.0) - ambient_noise_db(1000.0, 0.0, 1.0), 20.0 * 3f64.log10(), 0.5);
    }

    #[test]
    fn equal_levels_add_three_decibels() {
        near(sum_of_levels_db(&[60.0, 60.0]), 60.0 + 10.0 * 2f64.log10(), 1e-12);
        near(sum_of_levels_db(&[60.0, -200.0]), 60.0, 1e-9);
    }

    #[test]
    fn edge_loss_agrees_with_fresnel_integrals() {
        // |F(ν)|² from the Fresnel integrals: 6.02 dB at ν = 0, 13.9 at 1, 19.0 at 2. The approximation is good to half
        // a dB.
        near(knife_edge_loss_db(0.0), 6.02, 0.5);
        near(knife_edge_loss_db(1.0), 13.9, 0.5);
        near(knife_edge_loss_db(2.0), 19.0, 0.5);
        assert_eq!(knife_edge_loss_db(-1.0), 0.0);
        assert!(knife_edge_loss_db(-0.77) < 0.3, "no step where it begins");
        // Far above the line the loss grows as 20 log ν.
        near(knife_edge_loss_db(100.0) - knife_edge_loss_db(10.0), 20.0, 0.1);
        near(diffraction_unit_m(0.06, 500.0, 500.0), (0.06f64 * 500.0 / 4.0).sqrt(), 1e-12);
    }

    #[test]
    fn spreading_is_a_power_of_range() {
        near(spreading_loss_db(1000.0, 2.0), 60.0, 1e-12);
        near(spreading_loss_db(100.0, 1.5), 30.0, 1e-12);
        assert_eq!(spreading_loss_db(0.0, 2.0), 0.0);
    }
}
