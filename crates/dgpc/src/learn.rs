//! Learning a prior from events: the parameters that maximise the evidence bound E (docs/method.md, section 7).

use crate::data::Data;
use crate::error::{Error, Result};
use crate::inducing::Candidates;
use crate::inputs::Inputs;
use crate::kernel::Term;
use crate::mean_field::MeanField;
use crate::prior_mean::{Prior, PriorMean};
use crate::search::{Found, Search, best_length_scale_factor};
use crate::sites::Observations;
use crate::summary::Summary;

/// How far the data may move each parameter from the template: standard deviations of independent normal distributions about
/// the template's values, of the logarithms for length-scales and variances. At 0 the parameter stays what it is.
///
/// They are weak: the default lets a length-scale move by a factor of 4.5 for half a nat. And they are strong enough that a
/// parameter of which the events say nothing stays where the template has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Of the logarithm of every length-scale.
    pub length_scale: f64,
    /// Of the logarithm of every variance.
    pub variance: f64,
    /// Of a constant prior mean, or the intercept of a range prior mean.
    pub intercept: f64,
    /// Of the slope of a range prior mean, per unit of distance.
    pub slope: f64,
}

impl Spread {
    /// The default, for inputs that typically lie `distance` apart.
    pub fn weak(distance: f64) -> Self {
        Self { length_scale: 1.5, variance: 1.5, intercept: 2.0, slope: 2.0 / distance }
    }

    /// Checks that every number is finite and not negative.
    fn check(&self) -> Result<()> {
        for value in [self.length_scale, self.variance, self.intercept, self.slope] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::OutOfRange { what: "spread", expected: "a finite number, at least 0", value });
            }
        }
        Ok(())
    }

    /// One number for every parameter of a prior, in the order of [`Prior::parameters`].
    pub(crate) fn of_parameters(&self, prior: &Prior) -> Vec<f64> {
        let of_term = |term: &Term| {
            let mut spread = vec![self.length_scale; term.parameter_count()];
            spread[0] = self.variance;
            spread
        };
        let mut spread: Vec<f64> = prior.kernel().terms().iter().flat_map(of_term).collect();
        match prior.mean() {
            PriorMean::Zero => {}
            PriorMean::Constant(_) => spread.push(self.intercept),
            PriorMean::Range { .. } => spread.extend([self.intercept, self.slope]),
        }
        spread
    }
}

/// How to search.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How far parameters may go from the template's.
    pub spread: Spread,
    /// Start here and on all events at once: an earlier [`Learned::optimum`], of the template's structure. The new optimum is never
    /// worse in E. Without it there are several starts.
    pub warm_start: Option<Prior>,
    /// How many events the starts are compared on, at most.
    pub start_events_max: usize,
    /// Up to so many events, E is that of the dense fit, O(N³) an evaluation; beyond, that of a sparse one, O(NM²).
    pub dense_events_max: usize,
    /// Inducing points M of a sparse fit, chosen greedily among the events, beside those of the messages.
    pub inducing_points_max: usize,
    /// How many steps a search takes at most.
    pub iterations_max: usize,
    /// Whether all variances are multiplied by a common factor at the end, that which maximises the corrected evidence
    /// ([`MeanField::corrected_evidence`]): the slack of E grows with the variance, so that E alone leaves it too small.
    pub calibrate: bool,
}

impl Options {
    /// The default for inputs that typically lie `distance` apart.
    pub fn new(distance: f64) -> Self {
        Self {
            spread: Spread::weak(distance),
            warm_start: None,
            start_events_max: 150,
            dense_events_max: 1000,
            inducing_points_max: 256,
            iterations_max: 60,
            calibrate: true,
        }
    }
}

/// Why a search ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Stop {
    /// The gradient vanished, or E did not change any more.
    Converged,
    /// It took as many steps as it was allowed.
    IterationsMax,
    /// No step along the search direction helped, or E could not be computed there. What was best so far is kept.
    NoProgress(String),
}

/// One of the starts.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Where it began.
    pub prior: Prior,
    /// E plus the log density of the spread where it ended, on [`Learned::start_events`] events; `None` where E could not be computed.
    pub objective: Option<f64>,
}

/// A learned prior.
#[derive(Debug, Clone)]
pub struct Learned {
    /// The prior: the optimum, its variances multiplied by `variance_factor`.
    pub prior: Prior,
    /// The fit of all events under the prior; [`MeanField::evidence`] is its E.
    pub fit: MeanField,
    /// The prior that maximises E within the spread, before its variances were calibrated.
    pub optimum: Prior,
    /// E of the optimum, in nats.
    pub optimum_evidence: f64,
    /// What the variances were multiplied by: 1 without calibration.
    pub variance_factor: f64,
    /// Inducing points of a sparse fit; `None` where it was dense.
    pub inducing_points: Option<Inputs>,
    /// What the starts came to.
    pub starts: Vec<Start>,
    /// How many events the starts were compared on.
    pub start_events: usize,
    /// How often E was computed for all events.
    pub evaluations: usize,
    /// Why the search on all events ended.
    pub stop: Stop,
}

/// Finds the parameters of `template` that maximise E plus the log density of [`Options::spread`], by L-BFGS in the logarithms of
/// length-scales and variances, then calibrates the variances. Messages of others count as in [`crate::evidence::dense`].
///
/// Several starts (the template, a third of all its length-scales, and a third of each alone) are compared on some events.
/// On all events the search begins at the best of their ends and, because few events may point elsewhere, at the template too. With
/// inducing points there is a second round, with points that suit what the first one found.
///
/// ```
/// use dgpc::{learn, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term};
///
/// // Success within a distance of 2.
/// let inputs = Inputs::new((0..60).map(|n| f64::from(n) * 0.1 - 3.0).collect(), 1)?;
/// let outcomes = inputs.rows().map(|x| x[0].abs() < 2.0).collect();
/// let events = Observations::new(inputs, outcomes)?;
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 0.1, 1)?])?;
/// let template = Prior::new(kernel, PriorMean::Zero)?;
/// let learned = learn::learn(&template, &events, &[], &learn::Options::new(1.0))?;
/// assert!(learned.prior.kernel().terms()[0].length_scales()[0] > 0.3);
/// # Ok::<(), dgpc::Error>(())
/// ```
///
/// # Errors
/// As [`crate::evidence::dense`] and [`crate::evidence::sparse`] when E cannot be computed at any start; [`Error::OutOfRange`] for
/// options that make no sense; [`Error::Different`] for a warm start of another structure than the template.
pub fn learn(
    template: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    options: &Options,
) -> Result<Learned> {
    options.spread.check()?;
    let data = Data::new(observations, messages)?;
    if let Some(start) = &options.warm_start {
        if !start.has_structure_of(template) {
            return Err(Error::Different { what: "template and warm start", of: "structures" });
        }
        let points = inducing_points(start, &data, options)?;
        return learn_from(template, std::slice::from_ref(start), &data, points, options);
    }
    let some = spread_out(data.events(), options.start_events_max);
    let few = observations.select(&some);
    let (starts, best) = compare_starts(template, &Data::new(&few, messages)?, options)?;
    let mut again = vec![best];
    if some.len() < data.events() {
        again.push(template.clone());
    }
    // Points for shorter length-scales than the start's serve them too; the other way round they would hide what is short.
    let points = inducing_points(&with_length_scales_times(&again[0], 1.0 / 3.0)?, &data, options)?;
    let is_sparse = points.is_some();
    let mut learned = learn_from(template, &again, &data, points, options)?;
    if is_sparse {
        // Once more with the points that suit what was found.
        let points = inducing_points(&learned.optimum, &data, options)?;
        let again = learn_from(template, std::slice::from_ref(&learned.optimum), &data, points, options);
        // Where this fails, the first round stands.
        if let Ok(again) = again
            && again.optimum_evidence > learned.optimum_evidence
        {
            learned = Learned { evaluations: learned.evaluations + again.evaluations, ..again };
        }
    }
    Ok(Learned { starts, start_events: some.len(), ..learned })
}

/// Searches from every start on a few events. The starts, and the best of their ends.
fn compare_starts(template: &Prior, few: &Data<'_>, options: &Options) -> Result<(Vec<Start>, Prior)> {
    let search = Search::new(template, few, None, options);
    let begin = starting_points(template, options)?;
    let ends: Vec<Result<Found>> = begin.iter().map(|prior| search.run(prior)).collect();
    let start =
        |(prior, end): (Prior, &Result<Found>)| Start { prior, objective: end.as_ref().ok().map(|end| end.objective) };
    let starts = begin.into_iter().zip(&ends).map(start).collect();
    Ok((starts, best(ends)?.prior))
}

/// The best of several ends; where all searches failed, why.
fn best(ends: Vec<Result<Found>>) -> Result<Found> {
    let better = |a: Result<Found>, b: Result<Found>| match (a, b) {
        (Ok(a), Ok(b)) => Ok(if b.objective > a.objective { b } else { a }),
        (a, b) => a.or(b),
    };
    let none = Error::OutOfRange { what: "number of starts", expected: "at least 1", value: 0.0 };
    ends.into_iter().reduce(better).unwrap_or(Err(none))
}

/// The template, a third of all its length-scales, and a third of each alone.
fn starting_points(template: &Prior, options: &Options) -> Result<Vec<Prior>> {
    if options.spread.length_scale == 0.0 {
        return Ok(vec![template.clone()]);
    }
    let parameters = template.parameters();
    let length_scales: Vec<usize> = template.kernel().length_scale_places().collect();
    let shortened = |&place: &usize| {
        let mut parameters = parameters.clone();
        parameters[place] -= 3f64.ln();
        template.with_parameters(&parameters)
    };
    let mut points = vec![template.clone(), with_length_scales_times(template, 1.0 / 3.0)?];
    if length_scales.len() > 1 {
        points.extend(length_scales.iter().map(shortened).collect::<Result<Vec<_>>>()?);
    }
    Ok(points)
}

/// Searches on all events from each of `starts`, and calibrates the best end.
fn learn_from(
    template: &Prior,
    starts: &[Prior],
    data: &Data<'_>,
    points: Option<Inputs>,
    options: &Options,
) -> Result<Learned> {
    let search = Search::new(template, data, points.as_ref(), options);
    let ends: Vec<Result<Found>> = starts.iter().map(|start| search.run(start)).collect();
    let evaluations = ends.iter().flatten().map(|end| end.evaluations).sum();
    let found = best(ends)?;
    let ended = search.careful_fit(&found.prior, &found.tilts)?;
    let (optimum, fit) = match &options.warm_start {
        // What the spread gains must not be paid for in E.
        Some(start) => {
            let start = search.within_reach(start)?;
            let begun = search.careful_fit(&start, &found.tilts)?;
            if ended.evidence >= begun.evidence { (found.prior, ended) } else { (start, begun) }
        }
        None => (found.prior, ended),
    };
    let optimum_evidence = fit.evidence;
    let calibrate = options.calibrate && options.spread.variance > 0.0;
    let variance_factor = if calibrate { search.calibrate(&optimum, &fit, options.spread.variance) } else { 1.0 };
    let prior = with_variances_times(&optimum, variance_factor)?;
    let fit = if calibrate { search.careful_fit(&prior, &fit.tilts)? } else { fit };
    let stop = found.stop;
    Ok(Learned {
        prior,
        fit,
        optimum,
        optimum_evidence,
        variance_factor,
        inducing_points: points,
        starts: Vec::new(),
        start_events: 0,
        evaluations,
        stop,
    })
}

/// The template with all its length-scales multiplied by the factor that maximises the sum of E over several sets of events:
/// independent draws of one prior, such as trials in different waters. Nothing else is learned and no spread counts. Seven factors from
/// 1/8 to 8 are compared, then the best is refined to four digits (Brent's method); the sets are fitted exactly, O(N³) each time.
///
/// # Errors
/// As [`crate::evidence::dense`].
pub fn common_length_scales(template: &Prior, sets: &[Observations]) -> Result<Prior> {
    let sets = sets.iter().map(|set| Data::new(set, &[])).collect::<Result<Vec<_>>>()?;
    let log_factor = best_length_scale_factor(template, &sets)?;
    with_length_scales_times(template, log_factor.exp())
}

/// At most `count_max` of the numbers below `count`, in ascending order: one from each of as many equal parts, at a place that looks
/// random but is always the same, so that no period of a schedule of events shows.
pub fn spread_out(count: usize, count_max: usize) -> Vec<usize> {
    if count <= count_max {
        return (0..count).collect();
    }
    let part = |i: usize| {
        let (first, end) = (i * count / count_max, (i + 1) * count / count_max);
        first + (scrambled(i as u64) % (end - first) as u64) as usize
    };
    (0..count_max).map(part).collect()
}

/// The output function of the generator SplitMix64 (Steele, Lea and Flood 2014).
fn scrambled(number: u64) -> u64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A prior with all length-scales multiplied.
pub(crate) fn with_length_scales_times(prior: &Prior, factor: f64) -> Result<Prior> {
    let mut parameters = prior.parameters();
    prior.kernel().length_scale_places().for_each(|place| parameters[place] += factor.ln());
    prior.with_parameters(&parameters)
}

/// A prior with all variances multiplied.
pub(crate) fn with_variances_times(prior: &Prior, factor: f64) -> Result<Prior> {
    let mut parameters = prior.parameters();
    prior.kernel().variance_places().for_each(|place| parameters[place] += factor.ln());
    prior.with_parameters(&parameters)
}

/// Inducing points for all events, where they are too many for a dense fit: those that suit the prior, or shorter length-scales where
/// fewer than allowed would do. A prior that is too smooth needs few, and with few no shorter length-scale could show itself.
fn inducing_points(prior: &Prior, data: &Data<'_>, options: &Options) -> Result<Option<Inputs>> {
    if data.events() <= options.dense_events_max {
        return Ok(None);
    }
    let inputs = data.observations.inputs();
    let candidates = inputs.select(&spread_out(inputs.len(), 4 * options.inducing_points_max));
    let choose = |factor: f64| {
        let kernel = with_length_scales_times(prior, factor)?;
        Ok(Candidates::new(kernel.kernel(), &candidates)?.greedy(options.inducing_points_max).indices)
    };
    let mut chosen: Vec<usize> = choose(1.0)?;
    for factor in [1.0 / 3.0, 1.0 / 9.0] {
        if chosen.len() < options.inducing_points_max {
            chosen = choose(factor)?;
        }
    }
    let mut points = candidates.select(&chosen);
    points.append(data.message_points())?;
    Ok(Some(points))
}
