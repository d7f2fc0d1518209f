//! How much variance E leaves out, and gives back (section 7 of [`crate::method`]).

use super::search::Search;
use crate::error::{Result, finite};
use crate::fit::{FitOptions, MeanField, corrected_evidence};
use crate::prior::Prior;

/// The smallest and largest factor of the variances that a calibration tries.
const FACTORS: (f64, f64) = (0.25, 16.0);

/// The logarithm of the factor is found to this precision.
const TOLERANCE: f64 = 0.1;

/// Most factors lie between 1 and e, so that this is tried first.
const FIRST: f64 = 0.5;

/// No try is farther than this from the best so far.
const STEP_MAX: f64 = 1.0;

/// So many tries; mostly two or three are enough.
const TRIES_MAX: usize = 10;

/// Of the fits on the way. What corrects E changes with the tilts in first order.
const TILT_TOLERANCE: f64 = 1e-3;

/// What became of the variances after E was maximised.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Calibration {
    /// It was not asked for: variances are those that maximise E.
    NotAsked,
    /// All variances were multiplied by this factor.
    Factor(f64),
    /// All variances were multiplied by this factor, which is the smallest or the largest that is tried: the data ask
    /// for more.
    AtBound(f64),
    /// The corrected evidence could not be computed, for this reason: variances are those that maximise E.
    Failed(String),
}

impl Calibration {
    /// What all variances were multiplied by: 1 where there was no calibration or where it failed.
    pub fn factor(&self) -> f64 {
        match self {
            Calibration::Factor(factor) | Calibration::AtBound(factor) => *factor,
            Calibration::NotAsked | Calibration::Failed(_) => 1.0,
        }
    }
}

/// The factor of all variances that maximises the corrected evidence plus the log density of a normal distribution of
/// the factor's logarithm about 0, given the fit at factor 1; and nearly the tilts of a fit at that factor.
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

/// −(corrected evidence + log density of the hyperprior) at the logarithm of a common factor of all variances.
struct Try {
    log: f64,
    cost: f64,
    tilts: Vec<f64>,
}

impl Try {
    fn at(log: f64, search: &Search<'_>, prior: &Prior, tilts: &[f64], spread: f64) -> Result<Self> {
        let prior = prior.with_variances_times(log.exp())?;
        let fit = search.fit(&prior, &FitOptions::default().tolerance(TILT_TOLERANCE).start(tilts))?;
        let cost = finite("corrected evidence", 0.5 * (log / spread).powi(2) - corrected_evidence(&fit))?;
        Ok(Self { log, cost, tilts: fit.tilts })
    }
}

/// Nearly the tilts of a fit at this logarithm, on a line through the logarithms of those of the two lowest tries.
fn tilts_near(tried: &[Try], log: f64) -> Vec<f64> {
    let Some(second) = tried.get(1) else { return tried[0].tilts.clone() };
    // Not far beyond either, if they happen to be close together.
    let share = ((log - tried[0].log) / (second.log - tried[0].log)).clamp(-2.0, 2.0);
    tried[0].tilts.iter().zip(&second.tilts).map(|(first, second)| first * (second / first).powf(share)).collect()
}

/// Where the cost is lowest, as tries say that come lowest first: of three, the bottom of the parabola through them; with two, or
/// where they bend down, on from the second beyond the first.
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

    /// What becomes of a prior of this variance, calibrated about the fit under another one.
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
    fn it_says_how_it_went() -> Result<()> {
        let inside = calibrated(4.0, 4.0)?;
        assert!(matches!(inside, Calibration::Factor(factor) if (0.3..13.0).contains(&factor)), "{inside:?}");
        // Far too small a variance asks for more than is tried.
        let more = calibrated(1e-2, 1e-2)?;
        assert!(matches!(more, Calibration::AtBound(factor) if factor > 13.0), "{more:?}");
        // Where no fit is possible there is nothing to multiply by.
        let failed = calibrated(1e308, 4.0)?;
        assert!(matches!(&failed, Calibration::Failed(why) if !why.is_empty()), "{failed:?}");
        assert_eq!((failed.factor(), Calibration::NotAsked.factor()), (1.0, 1.0));
        Ok(())
    }
}
