//! Calibration of the variances, which E alone leaves too small ([`crate::method::learning`]).

use super::search::Search;
use crate::error::{Result, finite};
use crate::fit::{FitOptions, MeanField, corrected_evidence};
use crate::prior::Prior;

/// Smallest and largest factor of the variances.
const FACTORS: (f64, f64) = (0.25, 16.0);

/// Tolerance of the logarithm of the factor.
const TOLERANCE: f64 = 0.1;

/// Logarithm of the first factor that is tried. Most factors are between 1 and e.
const FIRST: f64 = 0.5;

/// Largest distance of a try from the best one so far, in the logarithm.
const STEP_MAX: f64 = 1.0;

/// Largest number of tries. Usually two or three are enough.
const TRIES_MAX: usize = 10;

/// Tolerance of the tilts in the tries. The correction of E changes with the tilts to first order.
const TILT_TOLERANCE: f64 = 1e-3;

/// The outcome of the calibration of the variances after E was maximised.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Calibration {
    /// No calibration was requested. The variances are those that maximise E.
    NotAsked,
    /// All variances that learning may change were multiplied by this factor, as far as their bounds permit it.
    Factor(f64),
    /// The variances were multiplied by this factor, which is the smallest or the largest allowed factor. The optimal
    /// factor is outside the allowed range.
    AtBound(f64),
    /// The corrected evidence could not be computed, for the given reason. The variances are those that maximise E.
    Failed(String),
}

impl Calibration {
    /// Returns the factor of all variances. It is 1 if no calibration was requested or if it failed.
    pub fn factor(&self) -> f64 {
        match self {
            Calibration::Factor(factor) | Calibration::AtBound(factor) => *factor,
            Calibration::NotAsked | Calibration::Failed(_) => 1.0,
        }
    }
}

/// Returns the factor of all variances that maximises the corrected evidence plus a normal log density of the factor's
/// logarithm about 0. `fit` is the fit at factor 1. Also returns approximate tilts of the fit at the optimal factor.
pub(super) fn calibrate(search: &Search<'_>, prior: &Prior, fit: &MeanField, spread: f64) -> (Calibration, Vec<f64>) {
    let mut tried = vec![Try { log: 0.0, cost: -corrected_evidence(fit), tilts: fit.tilts.clone() }];
    let mut next = FIRST;
    while tried.len() <= TRIES_MAX {
        match Try::at(next, search, prior, &tilts_near(&tried, next), spread) {
            Ok(new) => tried.push(new),
            Err(error) => return (Calibration::Failed(error.to_string()), fit.tilts.clone()),
        }
        tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        next = lowest(&tried).clamp(FACTORS.0.ln(), FACTORS.1.ln());
        if (next - tried[0].log).abs() < TOLERANCE {
            break;
        }
    }
    let at_bound = [FACTORS.0, FACTORS.1].into_iter().find(|bound| (next - bound.ln()).abs() < TOLERANCE);
    let calibration = at_bound.map_or(Calibration::Factor(next.exp()), Calibration::AtBound);
    (calibration, tilts_near(&tried, next))
}

/// −(corrected evidence + log density of the hyperprior) for one logarithm of the common factor of all variances.
struct Try {
    log: f64,
    cost: f64,
    tilts: Vec<f64>,
}

impl Try {
    fn at(log: f64, search: &Search<'_>, prior: &Prior, tilts: &[f64], spread: f64) -> Result<Self> {
        let prior = search.with_variances_times(prior, log.exp())?;
        let fit = search.fit(&prior, &FitOptions::default().tolerance(TILT_TOLERANCE).start(tilts))?;
        let cost = finite("corrected evidence", 0.5 * (log / spread).powi(2) - corrected_evidence(&fit))?;
        Ok(Self { log, cost, tilts: fit.tilts })
    }
}

/// Returns approximate tilts of the fit at this logarithm. The logarithms of the tilts of the two best tries are
/// interpolated linearly.
fn tilts_near(tried: &[Try], log: f64) -> Vec<f64> {
    let Some(second) = tried.get(1) else { return tried[0].tilts.clone() };
    // Limit the extrapolation, in case the two tries are close together.
    let share = ((log - tried[0].log) / (second.log - tried[0].log)).clamp(-2.0, 2.0);
    tried[0].tilts.iter().zip(&second.tilts).map(|(first, second)| first * (second / first).powf(share)).collect()
}

/// Predicts the logarithm with the lowest cost from tries that are sorted by cost. From three tries it is the minimum
/// of the parabola through them. With two tries, or a concave parabola, it is one step from the second beyond the
/// first.
fn lowest(tried: &[Try]) -> f64 {
    let [first, second, others @ ..] = tried else { return FIRST };
    let bottom = others.first().and_then(|third| {
        let slope = |a: &Try, b: &Try| (a.cost - b.cost) / (a.log - b.log);
        let bend = (slope(first, second) - slope(first, third)) / (second.log - third.log);
        let slope = slope(first, second) + bend * (first.log - second.log);
        (bend > 0.0).then(|| first.log - 0.5 * slope / bend)
    });
    let next = bottom.unwrap_or(2.0 * first.log - second.log);
    next.clamp(first.log - STEP_MAX, first.log + STEP_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::Inputs;
    use crate::kernel::{Kernel, Shape, Term};
    use crate::learn::LearnOptions;
    use crate::likelihood::Likelihood;
    use crate::observations::Observations;
    use crate::prior_mean::PriorMean;

    /// Calibrates a prior of this variance, given the fit under a prior of variance `fitted`.
    fn calibrated(variance: f64, fitted: f64) -> Result<Calibration> {
        let prior = |variance| {
            let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, variance, 1.0, 1)?])?;
            Prior::new(kernel, PriorMean::Zero)
        };
        let inputs = Inputs::new((0..60).map(|n| f64::from(n) * 0.1).collect(), 1)?;
        let outcomes = inputs.rows().map(|x| x[0].sin() > 0.0).collect();
        let events = Observations::new(inputs, outcomes)?;
        let likelihood = Likelihood::new(&events, &[])?;
        let (template, options) = (prior(fitted)?, LearnOptions::default());
        let search = Search::new(&template, &likelihood, None, &options);
        let fit = search.fit(&template, &FitOptions::default())?;
        Ok(calibrate(&search, &prior(variance)?, &fit, options.hyper_prior.variance).0)
    }

    #[test]
    fn calibration_reports_success_bounds_and_failures() -> Result<()> {
        let inside = calibrated(4.0, 4.0)?;
        assert!(matches!(inside, Calibration::Factor(factor) if (0.3..13.0).contains(&factor)), "{inside:?}");
        // With a much too small variance, the optimal factor is beyond the largest factor.
        let more = calibrated(1e-2, 1e-2)?;
        assert!(matches!(more, Calibration::AtBound(factor) if factor > 13.0), "{more:?}");
        // The variance overflows, so no fit is possible and the calibration fails.
        let failed = calibrated(1e308, 4.0)?;
        assert!(matches!(&failed, Calibration::Failed(why) if !why.is_empty()), "{failed:?}");
        assert_eq!((failed.factor(), Calibration::NotAsked.factor()), (1.0, 1.0));
        Ok(())
    }
}
