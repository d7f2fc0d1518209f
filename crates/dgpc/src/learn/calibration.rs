//! How much variance E leaves out, and gives back (section 7 of [`crate::method`]).

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, State};
use argmin::solver::brent::BrentOpt;

use super::search::Search;
use crate::fit::{FitOptions, MeanField, corrected_evidence};
use crate::prior::Prior;

/// The smallest and largest factor of the variances that a calibration tries.
const FACTORS: (f64, f64) = (0.25, 16.0);

/// The logarithm of the factor is found to this precision.
const TOLERANCE: f64 = 0.1;

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
/// the factor's logarithm about 0, given the fit at factor 1.
pub(super) fn calibrate(search: &Search<'_>, prior: &Prior, fit: &MeanField, spread: f64) -> Calibration {
    let problem = Problem { search, prior, tilts: RefCell::new(fit.tilts.clone()), spread };
    let (low, high) = (FACTORS.0.ln(), FACTORS.1.ln());
    let solver = BrentOpt::new(low, high).set_tolerance(0.0, TOLERANCE);
    let run = Executor::new(&problem, solver).timer(false).configure(|state| state.max_iters(10)).run();
    let result = match run {
        Ok(result) => result,
        Err(error) => return Calibration::Failed(error.to_string()),
    };
    match result.state().get_best_param().copied().filter(|_| result.state().get_best_cost().is_finite()) {
        // The solver comes near its bounds, but never meets them.
        Some(log) if log < low + 2.0 * TOLERANCE || log > high - 2.0 * TOLERANCE => Calibration::AtBound(log.exp()),
        Some(log) => Calibration::Factor(log.exp()),
        None => Calibration::Failed("the corrected evidence is not a number".to_owned()),
    }
}

/// −(corrected evidence + log density of the hyperprior) as a function of the logarithm of a common factor of all
/// variances.
struct Problem<'a> {
    search: &'a Search<'a>,
    prior: &'a Prior,
    /// Of the last fit.
    tilts: RefCell<Vec<f64>>,
    spread: f64,
}

impl CostFunction for &Problem<'_> {
    type Param = f64;
    type Output = f64;

    fn cost(&self, log_factor: &f64) -> std::result::Result<f64, argmin::core::Error> {
        let prior = self.prior.with_variances_times(log_factor.exp())?;
        let penalty = 0.5 * (log_factor / self.spread).powi(2);
        let start = self.tilts.borrow().clone();
        let fit = self.search.fit(&prior, &FitOptions::default().tolerance(TILT_TOLERANCE).start(&start))?;
        let cost = penalty - corrected_evidence(&fit);
        self.tilts.replace(fit.tilts);
        Ok(cost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;
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
        Ok(calibrate(&search, &prior(variance)?, &fit, options.hyper_prior.variance))
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
