//! Fixed point of a dense mean field, iterated in its tilts ([`crate::method::inference`]).

use super::anderson::Anderson;
use super::dense::Dense;
use super::mean_field::{MeanField, TILT_MIN};
use super::options::FitOptions;
use super::pass::Pass;
use super::stagnation::{FitStop, Stagnation};
use crate::error::{Result, finite};
use crate::likelihood::Likelihood;
use crate::monitor::Progress;
use crate::prior::Prior;
use crate::sites::Sites;

/// Returns the fixed point c_n² = E_q\[f_n²\]. On return, the engine holds the factors of the last pass.
pub(super) fn iterate(
    engine: &mut Dense,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<MeanField> {
    options.check(likelihood.events())?;
    let mut pass = Pass::new(prior, likelihood, options)?;
    // The iteration runs in ln c, where no step leaves the domain.
    let mut log_tilts: Vec<f64> = pass.tilts.iter().map(|tilt| tilt.max(TILT_MIN).ln()).collect();
    let mut plain_step = log_tilts.clone();
    let mut anderson = Anderson::new();
    let (mut evidence, mut best) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let (mut change, mut iterations) = (f64::INFINITY, 0);
    let (mut stop, mut stagnation) = (FitStop::IterationsMax, Stagnation::new());
    while iterations < options.iterations_max && stop == FitStop::IterationsMax {
        iterations += 1;
        let is_plain = log_tilts == plain_step;
        pass.set_sites(&log_tilts);
        let covariance_terms = engine.pass(&pass.omega, &pass.shift, &mut pass.mean, &mut pass.variance);
        evidence = match covariance_terms {
            Err(_) if !is_plain => f64::NAN,
            terms => terms? + pass.sum_terms(),
        };
        change = pass.set_images();
        options.monitor.report(Progress::Iteration { iterations, change })?;
        // Plain steps never lower E. If another step lowered it or overflowed, the plain step replaces it and the
        // acceleration restarts.
        if !is_plain && (evidence.is_nan() || evidence < best - 1e-10 * best.abs()) {
            log_tilts.copy_from_slice(&plain_step);
            anderson.restart();
            change = f64::INFINITY;
            continue;
        }
        best = best.max(finite("evidence bound", evidence)?);
        plain_step.copy_from_slice(&pass.images);
        if change <= options.tolerance {
            stop = FitStop::Converged;
        } else if stagnation.record(change, evidence) {
            stop = FitStop::Stagnated;
        }
        // The last iteration takes the plain step, because no later pass could reject another step.
        let goes_on = stop == FitStop::IterationsMax && iterations + 1 < options.iterations_max;
        let step = if goes_on { engine.newton(&pass, &log_tilts) } else { Some(plain_step.clone()) };
        log_tilts = step.unwrap_or_else(|| anderson.propose(&log_tilts, &pass.images));
    }
    let Pass { mut omega, mut mean, mut variance, tilts, .. } = pass;
    let events = likelihood.events();
    omega.truncate(events);
    mean.truncate(events);
    variance.truncate(events);
    Ok(MeanField {
        sites: Sites::new(likelihood.observations, omega)?,
        mean,
        variance,
        residual: vec![0.0; events],
        tilts,
        evidence,
        iterations,
        change,
        stop,
        // Only I + Ω^½KΩ^½ is factorised, without jitter.
        jitter: 0.0,
        weights: likelihood.observations.weights().to_vec(),
        condensed: None,
    })
}
