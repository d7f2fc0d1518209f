//! A common factor of all length-scales for several sets of events.

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, State};
use argmin::solver::brent::BrentOpt;

use crate::error::Result;
use crate::fit::{FitOptions, solve};
use crate::likelihood::Likelihood;
use crate::observations::Observations;
use crate::parts::on_parts;
use crate::prior::Prior;

/// Returns the template with all length-scales multiplied by the factor that maximises the sum of E over several sets
/// of events.
///
/// The sets are independent draws of one prior, such as trials in different waters. No other parameter is learned, and
/// no hyperprior is used. Seven factors from 1/8 to 8 are compared. The best factor is then refined to four digits by
/// Brent's method. Every evaluation fits all sets exactly, O(N³) each.
///
/// # Errors
/// As [`crate::fit`].
pub fn common_length_scales(template: &Prior, sets: &[Observations]) -> Result<Prior> {
    let sets = sets.iter().map(|set| Likelihood::new(set, &[])).collect::<Result<Vec<_>>>()?;
    let log_factor = best_length_scale_factor(template, &sets)?;
    template.with_length_scales_times(log_factor.exp())
}

/// Returns the logarithm of the factor of all length-scales that maximises the sum of E over `sets`.
fn best_length_scale_factor(template: &Prior, sets: &[Likelihood<'_>]) -> Result<f64> {
    let tilts = sets.iter().map(|_| None).collect();
    let problem = CommonScale { template, sets, tilts: RefCell::new(tilts) };
    let tried: Vec<f64> = (-3..=3).map(|power| f64::from(power) * LENGTH_SCALE_STEP).collect();
    let costs = tried.iter().map(|&log_factor| problem.cost_at(log_factor)).collect::<Result<Vec<f64>>>()?;
    let best = (0..tried.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).map_or(0.0, |place| tried[place]);
    let solver = BrentOpt::new(best - LENGTH_SCALE_STEP, best + LENGTH_SCALE_STEP).set_tolerance(0.0, 1e-4);
    let run = Executor::new(&problem, solver).timer(false).configure(|state| state.max_iters(40)).run();
    let refined = run.ok().and_then(|result| result.state().get_best_param().copied()).unwrap_or(best);
    // The solver may return a worse factor than the best of the seven.
    Ok(if problem.cost_at(refined)? <= problem.cost_at(best)? { refined } else { best })
}

/// Step between the compared factors, in the logarithm.
const LENGTH_SCALE_STEP: f64 = std::f64::consts::LN_2;

/// −Σ E over several sets of events as a function of the logarithm of a common factor of all length-scales.
struct CommonScale<'a> {
    template: &'a Prior,
    sets: &'a [Likelihood<'a>],
    /// Tilts of the last fit of each set.
    tilts: RefCell<Vec<Option<Vec<f64>>>>,
}

impl CommonScale<'_> {
    fn cost_at(&self, log_factor: f64) -> Result<f64> {
        let prior = self.template.with_length_scales_times(log_factor.exp())?;
        let mut tilts = self.tilts.borrow_mut();
        let fits = on_parts(self.sets.iter().zip(tilts.iter()).collect(), |(set, start)| {
            let mut options = FitOptions::default().tolerance(1e-4).iterations_max(200);
            options.start = start.as_deref();
            solve(&prior, set, None, &options)
        });
        let mut cost = 0.0;
        for (fit, start) in fits.into_iter().zip(tilts.iter_mut()) {
            let fit = fit?;
            cost -= fit.evidence;
            *start = Some(fit.tilts);
        }
        Ok(cost)
    }
}

impl CostFunction for &CommonScale<'_> {
    type Param = f64;
    type Output = f64;

    fn cost(&self, log_factor: &f64) -> std::result::Result<f64, argmin::core::Error> {
        Ok(self.cost_at(*log_factor)?)
    }
}
