//! Learning a prior from events: the parameters that maximise the evidence bound E ([`crate::method::learning`]).
//!
//! No other folder uses the optimiser crate.

mod bounds;
mod calibration;
mod common;
mod curvature;
mod hyper_prior;
mod latch;
mod options;
mod paths;
mod search;

pub use bounds::Bounds;
pub use calibration::Calibration;
pub use common::common_length_scales;
pub use hyper_prior::HyperPrior;
pub use options::LearnOptions;
pub use paths::Stop;

use crate::candidates::Candidates;
use crate::error::{Error, Result};
use crate::fit::{Fit, FitOptions, solve};
use crate::inputs::{Inputs, spread_out};
use crate::likelihood::Likelihood;
use crate::monitor::Monitor;
use crate::observations::Observations;
use crate::parameter::Parameter;
use crate::parts::on_parts;
use crate::prior::Prior;
use latch::Latch;
use search::{Search, SearchEnd};

/// A start of the search.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Start {
    /// The prior from which the search started.
    pub prior: Prior,
    /// E plus the log density of the hyperprior at the end, on [`Learned::start_events`] events. `None` if E could not
    /// be computed.
    pub objective: Option<f64>,
}

/// A learned prior.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Learned {
    /// The learned prior: the optimum with calibrated variances.
    pub prior: Prior,
    /// The fit of all events under the prior; [`Fit::evidence`] is its E.
    pub fit: Fit,
    /// The prior that maximises E within the hyperprior, before its variances were calibrated.
    pub optimum: Prior,
    /// E of the optimum, in nats, over the events of the search.
    pub optimum_evidence: f64,
    /// The calibration of the variances of the optimum: the factor, and whether it succeeded.
    pub calibration: Calibration,
    /// The starts and their results.
    pub starts: Vec<Start>,
    /// Number of events on which the starts were compared.
    pub start_events: usize,
    /// Number of events in the search: all, or [`LearnOptions::search_events_max`] of them.
    pub searched_events: usize,
    /// Number of evaluations of E on these events.
    pub evaluations: usize,
    /// The reason why the search on these events ended.
    pub stop: Stop,
}

/// Tolerance of the tilts when more events are fitted than were searched. The error of E is then 1e-11 nats an event.
const ALL_TOLERANCE: f64 = 1e-4;

/// Smallest tolerance of a search on some of the events, in nats an event.
const ROUGH_TOLERANCE: f64 = 1e-6;

/// Largest number of events from which the curvature is computed, in addition to the limit of a third of the events.
const CURVATURE_EVENTS_MAX: usize = 150;

/// Gain of a search over its start, in nats an event, above which the start needs no accurate fit for a comparison.
const CLEAR_GAIN: f64 = 1e-6;

/// A start loses the race if it ends more than this below the best, in nats.
const RACE_MARGIN: f64 = 5.0;

/// Finds the parameters of `template` that maximise E plus the log density of [`LearnOptions::hyper_prior`], then
/// calibrates the variances.
///
/// The optimiser is L-BFGS in the logarithms of length-scales and variances. Messages of peers count as in
/// [`crate::fit`]. The search has several stages:
///
/// 1. *Starts.* The template, a third of all its length-scales, and a third of each alone are compared on few events.
/// 2. *Race.* The best end of these races against the template and [`LearnOptions::further_starts`] on more events,
///    because few events may favour another optimum. A start is dropped if it leads to the same optimum as an earlier
///    one, or to one that is clearly worse than the best.
/// 3. *Search.* There is a search on all events from each remaining start, and each end is calibrated. The result is
///    the end of the greatest corrected evidence ([`Fit::corrected_evidence`]) after calibration.
/// 4. *Second round.* A sparse search is repeated with inducing points that suit the prior from the first round, unless
///    [`LearnOptions::inducing_points`] gives the points.
///
/// The search uses at most [`LearnOptions::search_events_max`] events. [`Learned::fit`] is the fit of all events.
///
/// ```
/// use dgpc::{Inputs, Kernel, LearnOptions, Observations, Prior, PriorMean, Shape, Term, learn};
///
/// // Successes within a distance of 2.
/// let inputs = Inputs::new((0..60).map(|n| f64::from(n) * 0.1 - 3.0).collect(), 1)?;
/// let outcomes = inputs.rows().map(|x| x[0].abs() < 2.0).collect();
/// let events = Observations::new(inputs, outcomes)?;
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 0.1, 1)?])?;
/// let template = Prior::new(kernel, PriorMean::Zero)?;
/// let learned = learn(&template, &events, &LearnOptions::default())?;
/// assert!(learned.prior.kernel().terms()[0].correlations()[0].length_scales()[0] > 0.3);
/// # Ok::<(), dgpc::Error>(())
/// ```
///
/// # Errors
/// * As [`crate::fit`] if E cannot be computed at any start.
/// * [`Error::OutOfRange`] for invalid options, or bounds that the template does not keep.
/// * [`Error::DifferentStructures`] for a start of another structure than the template.
/// * [`Error::SizeMismatch`] if the tilts are not one per event, or the bounds not one per parameter.
/// * [`Error::Stopped`] if the monitor asks to stop.
pub fn learn(template: &Prior, observations: &Observations, options: &LearnOptions<'_>) -> Result<Learned> {
    options.check(template, observations.len())?;
    if !options.warm_start.iter().copied().chain(options.further_starts).all(|start| start.has_structure_of(template)) {
        return Err(Error::DifferentStructures);
    }
    // A search may go on although one of its evaluations failed, so the request to stop is remembered.
    let latch = Latch::new(options.monitor);
    let report = |progress| latch.report(progress);
    let learned = learn_from_some(template, observations, &LearnOptions { monitor: Monitor::new(&report), ..*options });
    latch.check().and(learned)
}

/// Learns as [`learn`] does, with at most [`LearnOptions::search_events_max`] events in the search.
fn learn_from_some(template: &Prior, observations: &Observations, options: &LearnOptions<'_>) -> Result<Learned> {
    let searched = spread_out(observations.len(), options.search_events_max);
    if searched.len() == observations.len() {
        return learn_from_all(template, observations, options);
    }
    let tilts = options.tilts.map(|tilts| searched.iter().map(|&n| tilts[n]).collect::<Vec<f64>>());
    let some = LearnOptions { tilts: tilts.as_deref(), ..*options };
    let learned = learn_from_all(template, &observations.select(&searched), &some)?;
    let likelihood = Likelihood::new(observations, options.messages)?;
    let points = inducing_points(&learned.prior, &likelihood, options)?;
    let fit_options = FitOptions { monitor: options.monitor, ..FitOptions::default().tolerance(ALL_TOLERANCE) };
    let fit = solve(&learned.prior, &likelihood, points.as_ref(), &fit_options)?;
    let fit = Fit::new(&learned.prior, fit, points.as_ref(), options.messages)?;
    Ok(Learned { fit, searched_events: searched.len(), ..learned })
}

/// Learns as [`learn`] does, with all events in the search.
fn learn_from_all(template: &Prior, observations: &Observations, options: &LearnOptions<'_>) -> Result<Learned> {
    let likelihood = Likelihood::new(observations, options.messages)?;
    if let Some(start) = options.warm_start {
        let points = inducing_points(start, &likelihood, options)?;
        let starts = [std::slice::from_ref(start), options.further_starts].concat();
        return learn_from(template, &starts, &likelihood, points, options);
    }
    let some = spread_out(likelihood.events(), options.start_events_max);
    let few = observations.select(&some);
    let (starts, best) = compare_starts(template, &Likelihood::new(&few, options.messages)?, options)?;
    let mut again = vec![best];
    if some.len() < likelihood.events() {
        again.push(template.clone());
    }
    again.extend_from_slice(options.further_starts);
    let again = race(template, again, observations, options)?;
    // Points for length-scales shorter than the start's also serve the start's. Points for long length-scales would
    // hide short ones.
    let points = inducing_points(&again[0].with_length_scales_times(1.0 / 3.0)?, &likelihood, options)?;
    let is_sparse = points.is_some();
    let mut learned = learn_from(template, &again, &likelihood, points, options)?;
    if is_sparse && options.inducing_points.is_none() {
        // Repeat the search with points that suit the learned prior.
        let points = inducing_points(&learned.optimum, &likelihood, options)?;
        let again = learn_from(template, std::slice::from_ref(&learned.optimum), &likelihood, points, options);
        // If the second round fails, the result of the first round stays.
        if let Ok(again) = again
            && again.optimum_evidence > learned.optimum_evidence
        {
            learned = Learned { evaluations: learned.evaluations + again.evaluations, ..again };
        }
    }
    Ok(Learned { starts, start_events: some.len(), ..learned })
}

/// Searches from every start on a few events. Returns the starts with their results, and the best end.
fn compare_starts(template: &Prior, few: &Likelihood<'_>, options: &LearnOptions<'_>) -> Result<(Vec<Start>, Prior)> {
    let rough = rough(options);
    let search = Search::new(template, few, None, &rough);
    let begin = starting_points(template, options)?;
    let ends = search.run(&begin);
    // The search keeps fixed parameters and bounds, also at its starts.
    let start = |(prior, end): (Prior, &Result<SearchEnd>)| Start {
        prior: search.within_reach(&prior).unwrap_or(prior),
        objective: end.as_ref().ok().map(|end| end.objective),
    };
    let starts = begin.into_iter().zip(&ends).map(start).collect();
    Ok((starts, best(ends)?.prior))
}

/// Returns the priors from which a search on all events is worthwhile.
///
/// The starts are compared by searches on fewer events. A start is dropped if it leads to the end of an earlier start,
/// or to one that is clearly worse than the best. The first start comes from an earlier search and is replaced by its
/// end in the race. The others stay where they are, because fewer events may lead them elsewhere than all events do.
fn race(
    template: &Prior,
    starts: Vec<Prior>,
    observations: &Observations,
    options: &LearnOptions<'_>,
) -> Result<Vec<Prior>> {
    let racers = options.race_events_max.min(options.dense_events_max);
    if racers == 0 || observations.len() < 2 * racers || starts.len() == 1 {
        return Ok(starts);
    }
    let some = observations.select(&spread_out(observations.len(), racers));
    let likelihood = Likelihood::new(&some, options.messages)?;
    let (rough, fewer) = (rough(options), curvature_events(&some));
    let few = Likelihood::new(&fewer, options.messages)?;
    let few = Search::new(template, &few, None, &rough);
    let search = Search::new(template, &likelihood, None, &rough).scaled_by_curvature_of(&few);
    let Ok(ends) = search.run(&starts).into_iter().collect::<Result<Vec<SearchEnd>>>() else {
        // If one of the searches fails on few events, all events decide about the starts.
        return Ok(starts);
    };
    let most = ends.iter().map(|end| end.objective).fold(f64::NEG_INFINITY, f64::max);
    let mut kept: Vec<usize> = vec![0];
    for (place, end) in ends.iter().enumerate().skip(1) {
        if !end.is_known && end.objective > most - RACE_MARGIN {
            kept.push(place);
        }
    }
    let mut kept: Vec<Prior> = kept.into_iter().map(|place| starts[place].clone()).collect();
    kept[0].clone_from(&ends[0].prior);
    Ok(kept)
}

/// Returns a subset of the events that is large enough for the curvature of the objective and small enough to be cheap.
fn curvature_events(observations: &Observations) -> Observations {
    observations.select(&spread_out(observations.len(), (observations.len() / 3).min(CURVATURE_EVENTS_MAX)))
}

/// Returns the options of a search whose end is only the start of another search.
fn rough<'a>(options: &LearnOptions<'a>) -> LearnOptions<'a> {
    LearnOptions { tolerance: options.tolerance.max(ROUGH_TOLERANCE), ..*options }
}

/// Returns the best of several ends, or an error if all searches failed.
fn best(ends: Vec<Result<SearchEnd>>) -> Result<SearchEnd> {
    let better = |a: Result<SearchEnd>, b: Result<SearchEnd>| match (a, b) {
        (Ok(a), Ok(b)) => Ok(if b.objective > a.objective { b } else { a }),
        (a, b) => a.or(b),
    };
    let none = Error::OutOfRange { what: "number of starts", expected: "at least 1", value: 0.0 };
    ends.into_iter().reduce(better).unwrap_or(Err(none))
}

/// Returns the starts: the template, a third of all its length-scales, and a third of each alone.
fn starting_points(template: &Prior, options: &LearnOptions<'_>) -> Result<Vec<Prior>> {
    let (parameters, kinds) = (template.parameter_values(), template.parameters());
    let moving = bounds::moving(template, &options.hyper_prior, options.bounds).into_iter().map(|moving| moving.place);
    let length_scales: Vec<usize> = moving.filter(|&place| kinds[place] == Parameter::LengthScale).collect();
    if length_scales.is_empty() {
        return Ok(vec![template.clone()]);
    }
    let shortened = |&place: &usize| {
        let mut parameters = parameters.clone();
        parameters[place] -= 3f64.ln();
        template.with_parameters(&parameters)
    };
    let mut points = vec![template.clone(), template.with_length_scales_times(1.0 / 3.0)?];
    if length_scales.len() > 1 {
        points.extend(length_scales.iter().map(shortened).collect::<Result<Vec<_>>>()?);
    }
    Ok(points)
}

/// Searches on all events from each of `starts`, calibrates every end, and returns the best of them.
fn learn_from(
    template: &Prior,
    starts: &[Prior],
    likelihood: &Likelihood<'_>,
    points: Option<Inputs>,
    options: &LearnOptions<'_>,
) -> Result<Learned> {
    let few = curvature_events(likelihood.observations);
    let few = Likelihood::new(&few, options.messages)?;
    let few = Search::new(template, &few, None, options);
    let search = Search::new(template, likelihood, points.as_ref(), options)
        .scaled_by_curvature_of(&few)
        .starting_at_tilts(options.tilts);
    let (mut ends, mut failure) = (Vec::<SearchEnd>::new(), None);
    let mut evaluations = 0;
    let found = search.run(starts);
    // With bounds, a search may begin near its start instead of at it.
    let first = found.first().and_then(|first| first.as_ref().ok()).filter(|_| options.bounds.is_empty());
    let start_evidence = first.map_or(f64::INFINITY, |first| first.start_evidence);
    for end in found {
        match end {
            Ok(end) => {
                evaluations += end.evaluations;
                ends.extend((!end.is_known).then_some(end));
            }
            Err(error) => failure = Some(error),
        }
    }
    let learned = on_parts(ends, |end| finish(&search, end, start_evidence, points.as_ref(), options));
    let best = learned.into_iter().reduce(|best, next| match (best, next) {
        (Ok(best), Ok(next)) => Ok(if next.merit > best.merit { next } else { best }),
        (best, next) => best.or(next),
    });
    let none = Error::OutOfRange { what: "number of starts", expected: "at least 1", value: 0.0 };
    let best = best.unwrap_or_else(|| Err(failure.unwrap_or(none)))?;
    Ok(Learned { evaluations, ..best.learned })
}

/// The calibrated end of one search.
struct End {
    learned: Learned,
    /// The corrected evidence plus the log density of the hyperprior.
    merit: f64,
}

/// Fits the end of a search accurately, and calibrates the variances there. `start_evidence` is E at the first start,
/// up to 1e-8 nats an event.
fn finish(
    search: &Search<'_>,
    found: SearchEnd,
    start_evidence: f64,
    points: Option<&Inputs>,
    options: &LearnOptions<'_>,
) -> Result<End> {
    let at_end = search.careful_fit(&found.prior, &found.tilts)?;
    let gained = at_end.evidence - start_evidence;
    let (optimum, fit) = match options.warm_start {
        // A gain in the hyperprior's density must not cost evidence.
        Some(start) if gained <= CLEAR_GAIN * search.events() as f64 => {
            let start = search.within_reach(start)?;
            let at_start = search.careful_fit(&start, &found.tilts)?;
            if at_end.evidence >= at_start.evidence { (found.prior, at_end) } else { (start, at_start) }
        }
        _ => (found.prior, at_end),
    };
    let optimum_evidence = fit.evidence;
    let calibrate = options.calibrate && search.moves_a_variance();
    let (prior, fit, calibration) = if calibrate {
        let (calibration, tilts) = calibration::calibrate(search, &optimum, &fit, options.hyper_prior.variance);
        let prior = search.with_variances_times(&optimum, calibration.factor())?;
        let fit = search.careful_fit(&prior, &tilts)?;
        (prior, fit, calibration)
    } else {
        (optimum.clone(), fit, Calibration::NotAsked)
    };
    let fit = Fit::new(&prior, fit, points, options.messages)?;
    let merit = fit.corrected_evidence() + search.log_density(&prior);
    let stop = found.stop;
    let learned = Learned {
        prior,
        fit,
        optimum,
        optimum_evidence,
        calibration,
        starts: Vec::new(),
        start_events: 0,
        searched_events: search.events(),
        evaluations: 0,
        stop,
    };
    Ok(End { learned, merit })
}

/// Returns the given inducing points or chosen ones, followed by those of the messages. Returns `None` if none are
/// given and a dense fit is possible.
fn inducing_points(prior: &Prior, likelihood: &Likelihood<'_>, options: &LearnOptions<'_>) -> Result<Option<Inputs>> {
    let mut points = match options.inducing_points {
        Some(points) => points.clone(),
        None if likelihood.events() <= options.dense_events_max => return Ok(None),
        None => chosen_points(prior, likelihood, options)?,
    };
    options.messages.iter().try_for_each(|message| points.append(message.inducing_points()))?;
    Ok(Some(points))
}

/// Chooses inducing points among the events.
///
/// The points suit the prior. If it needs fewer points than allowed, the points suit shorter length-scales instead. A
/// prior that is too smooth needs few points, and with few points shorter length-scales could not be found.
fn chosen_points(prior: &Prior, likelihood: &Likelihood<'_>, options: &LearnOptions<'_>) -> Result<Inputs> {
    let inputs = likelihood.observations.inputs();
    let candidates = inputs.select(&spread_out(inputs.len(), options.inducing_points_max.saturating_mul(4)));
    let choose = |factor: f64| -> Result<Vec<usize>> {
        let kernel = prior.with_length_scales_times(factor)?;
        Ok(Candidates::new(kernel.kernel(), &candidates)?.greedy(options.inducing_points_max).indices)
    };
    let mut chosen: Vec<usize> = choose(1.0)?;
    for factor in [1.0 / 3.0, 1.0 / 9.0] {
        if chosen.len() < options.inducing_points_max {
            chosen = choose(factor)?;
        }
    }
    Ok(candidates.select(&chosen))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Kernel, Shape, Term};
    use crate::prior_mean::PriorMean;

    #[test]
    fn curvature_from_few_events_saves_evaluations_and_leads_to_the_same_end() -> Result<()> {
        // The waves get shorter from axis to axis, and the last axis has no influence.
        let along = |n: u32, step: f64| (f64::from(n) * step).fract() * 4.0;
        let points: Vec<[f64; 4]> = (0..300).map(|n| [0.618, 0.414, 0.732, 0.236].map(|step| along(n, step))).collect();
        let outcomes = points.iter().map(|x| (0.5 * x[0]).sin() + x[1].sin() + (2.0 * x[2]).sin() > 0.8).collect();
        let events = Observations::new(Inputs::from_rows(&points)?, outcomes)?;
        let kernel = Kernel::new(vec![
            Term::new(Shape::Matern52, 4.0, &[0, 1, 2, 3], &[1.0; 4])?,
            Term::isotropic(Shape::Matern32, 4.0, 1.0, 1)?,
        ])?;
        let template = Prior::new(kernel, PriorMean::Constant(0.0))?;
        let fewer = events.select(&(0..300).step_by(3).collect::<Vec<_>>());
        let [all, fewer] = [Likelihood::new(&events, &[])?, Likelihood::new(&fewer, &[])?];
        let options = LearnOptions::default();
        let search = || Search::new(&template, &all, None, &options);
        let few = Search::new(&template, &fewer, None, &options);
        let starts = [0.5, 1.0, 2.0].map(|factor| template.with_length_scales_times(factor));
        let starts = starts.into_iter().collect::<Result<Vec<_>>>()?;
        let (mut with, mut without) = (0, 0);
        for start in &starts {
            let start = std::slice::from_ref(start);
            let (scaled, plain) =
                (search().scaled_by_curvature_of(&few).run(start).remove(0)?, search().run(start).remove(0)?);
            assert!((scaled.objective - plain.objective).abs() < 1e-2, "{} and {}", scaled.objective, plain.objective);
            with += scaled.evaluations;
            without += plain.evaluations;
        }
        assert!(10 * with <= 9 * without, "{with} evaluations instead of {without}");
        Ok(())
    }
}
