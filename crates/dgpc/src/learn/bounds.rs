//! Bounds of the parameters that learning may change.

use super::hyper_prior::HyperPrior;
use crate::error::{Error, Result, finite, same_size};
use crate::prior::Prior;

/// The values that learning may give to one parameter of a prior.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Bounds {
    /// Every value, as far as the hyperprior permits it.
    #[default]
    Free,
    /// The value of the template.
    Fixed,
    /// Values from `lower` to `upper`: a variance, a length-scale, a reciprocity between 0 and 1, or another parameter
    /// itself, not its logarithm. The value of the template must lie between the bounds.
    Between {
        /// The smallest value.
        lower: f64,
        /// The largest value.
        upper: f64,
    },
}

/// Width of the margin in which values approach a bound: this share of the distance between the bounds, and at most
/// this number of standard deviations.
const MARGIN: f64 = 0.02;

/// A parameter that the search may change.
///
/// The optimiser moves a coordinate u without bounds. The parameter is a smooth function of u: nearly equal to u
/// between the bounds, nearly constant beyond them.
pub(super) struct Moving {
    /// Index of the parameter in [`Prior::parameter_values`].
    pub(super) place: usize,
    /// Standard deviation in the hyperprior.
    pub(super) spread: f64,
    /// The template's value, the smallest and the largest value, on the scale of [`Prior::parameter_values`].
    centre: f64,
    lower: f64,
    upper: f64,
}

impl Moving {
    /// Returns the coordinate of a parameter value: its distance from the template's value in standard deviations.
    pub(super) fn coordinate(&self, value: f64) -> f64 {
        (value - self.centre) / self.spread
    }

    /// Returns the allowed value that is nearest to `value`.
    pub(super) fn nearest(&self, value: f64) -> f64 {
        value.clamp(self.lower, self.upper)
    }

    /// Returns the allowed coordinate that belongs to the optimiser's coordinate `u`, and the derivative.
    pub(super) fn bounded(&self, u: f64) -> (f64, f64) {
        if self.lower == f64::NEG_INFINITY && self.upper == f64::INFINITY {
            return (u, 1.0);
        }
        let [lower, upper] = [self.lower, self.upper].map(|bound| self.coordinate(bound));
        let margin = (MARGIN * (upper - lower)).min(MARGIN);
        let (above, slope_above) = if lower.is_finite() { softplus(u - lower, margin) } else { (u, 1.0) };
        let raised = if lower.is_finite() { lower + above } else { u };
        let (below, slope_below) = if upper.is_finite() { softplus(upper - raised, margin) } else { (0.0, 1.0) };
        let bounded = if upper.is_finite() { upper - below } else { raised };
        (bounded.clamp(lower, upper), slope_above * slope_below)
    }
}

/// Returns w·ln(1 + exp(x/w)), a smooth version of max(x, 0), and its derivative.
fn softplus(x: f64, width: f64) -> (f64, f64) {
    let scaled = x / width;
    (width * (scaled.max(0.0) + (-scaled.abs()).exp().ln_1p()), 1.0 / (1.0 + (-scaled).exp()))
}

/// Returns the parameters that the search may change.
pub(super) fn moving(template: &Prior, hyper_prior: &HyperPrior, bounds: &[Bounds]) -> Vec<Moving> {
    let (spreads, parameters) = (hyper_prior.of_parameters(template), template.parameters());
    let all = template.parameter_values().into_iter().zip(spreads).zip(parameters).enumerate();
    let moving = all.filter_map(|(place, ((centre, spread), parameter))| {
        let (lower, upper) = match bounds.get(place).copied().unwrap_or_default() {
            Bounds::Free => (f64::NEG_INFINITY, f64::INFINITY),
            Bounds::Fixed => return None,
            Bounds::Between { lower, upper } => (parameter.learned_value(lower), parameter.learned_value(upper)),
        };
        Some(Moving { place, spread, centre, lower, upper })
    });
    moving.filter(|moving| moving.spread > 0.0).collect()
}

/// Checks that there are no bounds, or valid ones for every parameter of the template.
pub(super) fn check(template: &Prior, bounds: &[Bounds]) -> Result<()> {
    if bounds.is_empty() {
        return Ok(());
    }
    let values = template.parameter_values();
    same_size("bounds, one per parameter of the template", values.len(), bounds.len())?;
    for ((bounds, value), parameter) in bounds.iter().zip(values).zip(template.parameters()) {
        let &Bounds::Between { lower, upper } = bounds else { continue };
        let [lower, upper] = [finite("lower bound", lower)?, finite("upper bound", upper)?];
        let domain = parameter.domain();
        if !domain.contains(&lower) || !domain.contains(&upper) || lower >= upper {
            let expected = "in the domain of the parameter and below its upper bound";
            return Err(Error::OutOfRange { what: "lower bound of a parameter", expected, value: lower });
        }
        // Logarithm and exponential of a value at a bound may differ from the bound in the last digits.
        let [least, most] = [lower, upper].map(|bound| parameter.learned_value(bound));
        if value < least - ROUNDING * (1.0 + least.abs()) || value > most + ROUNDING * (1.0 + most.abs()) {
            let (what, expected) = ("template's value of a bounded parameter", "between its bounds");
            return Err(Error::OutOfRange { what, expected, value: parameter.natural_value(value) });
        }
    }
    Ok(())
}

/// Difference by which the learned value of the template may exceed a bound.
const ROUNDING: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounded_coordinates_stay_between_the_bounds_and_have_the_right_slope() {
        for (lower, upper) in [(-2.0, 3.0), (-0.1, 0.2), (f64::NEG_INFINITY, 1.0), (0.0, f64::INFINITY)] {
            let moving = Moving { place: 0, spread: 2.0, centre: 0.5, lower, upper };
            let mut before = f64::NEG_INFINITY;
            for step in -400..=400 {
                let u = f64::from(step) * 0.02;
                let (x, slope) = moving.bounded(u);
                assert!(x >= before && moving.coordinate(lower) <= x && x <= moving.coordinate(upper), "{u}: {x}");
                let difference = (moving.bounded(u + 1e-6).0 - moving.bounded(u - 1e-6).0) / 2e-6;
                assert!((slope - difference).abs() < 1e-3, "{u}: {slope} and {difference}");
                before = x;
            }
        }
        let free = Moving { place: 0, spread: 1.0, centre: 0.0, lower: f64::NEG_INFINITY, upper: f64::INFINITY };
        assert_eq!(free.bounded(-7.5), (-7.5, 1.0));
        let wide = Moving { place: 0, spread: 1.0, centre: 0.3, lower: 0.0, upper: 1000.0 };
        assert!((wide.bounded(0.0).0 - 0.0).abs() < 0.02, "a wide bound does not move the start");
        assert!(wide.bounded(-8.0).0 < -0.299, "the lower bound is within reach");
        let middle = Moving { place: 0, spread: 1.0, centre: 0.0, lower: -1.0, upper: 1.0 };
        assert!((middle.bounded(0.3).0 - 0.3).abs() < 1e-6, "values far from the bounds stay");
    }
}
