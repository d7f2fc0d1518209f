//! Learning a prior from events: the parameters that maximise the evidence bound E (docs/method.md, section 7).

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient, State, TerminationReason, TerminationStatus};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use crate::data::Data;
use crate::error::{Error, Result};
use crate::evidence::{self, Evidence};
use crate::inducing::Candidates;
use crate::inputs::Inputs;
use crate::kernel::{Kernel, Term};
use crate::mean_field::{self, MeanField};
use crate::prior_mean::{Prior, PriorMean};
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
    /// Of the slope of a range prior mean, per unit of distance: a few over a typical distance is weak.
    pub slope: f64,
}

impl Spread {
    /// The default, for inputs that typically lie `distance` apart.
    pub fn weak(distance: f64) -> Self {
        Self { length_scale: 1.5, variance: 1.5, intercept: 3.0, slope: 5.0 / distance }
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
    fn of_parameters(&self, prior: &Prior) -> Vec<f64> {
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
    /// The search starts once from the template with all its length-scales multiplied by each of these, on a share of the events,
    /// and goes on from the best.
    pub length_scale_factors: Vec<f64>,
    /// Starts from here instead, on all events: an earlier optimum, of the template's structure. The result is never worse in E.
    pub warm_start: Option<Prior>,
    /// How many events the starts are compared on, at most.
    pub start_events_max: usize,
    /// Up to so many events, E is that of the dense fit, O(N³) an evaluation; beyond, that of a sparse one, O(NM²).
    pub dense_events_max: usize,
    /// Inducing points M of a sparse fit, chosen greedily among the events, beside those of the messages.
    pub inducing_points_max: usize,
    /// How many steps a search takes at most.
    pub iterations_max: usize,
}

impl Options {
    /// The default for inputs that typically lie `distance` apart: weak spread, starts at the template's length-scales, a third and
    /// thrice of them.
    pub fn new(distance: f64) -> Self {
        Self {
            spread: Spread::weak(distance),
            length_scale_factors: vec![1.0, 1.0 / 3.0, 3.0],
            warm_start: None,
            start_events_max: 250,
            dense_events_max: 1000,
            inducing_points_max: 256,
            iterations_max: 60,
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
    /// What the template's length-scales were multiplied by.
    pub length_scale_factor: f64,
    /// E plus the logarithm of the spread's density at the end of its search, on [`Learned::start_events`] events; `None` where E
    /// could not be computed.
    pub objective: Option<f64>,
}

/// A learned prior.
#[derive(Debug, Clone)]
pub struct Learned {
    /// The prior.
    pub prior: Prior,
    /// The fit of all events under it; [`MeanField::evidence`] is E.
    pub fit: MeanField,
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
/// length-scales and variances, from several starts. All events count in the result; the starts are compared on some of them.
/// Messages of others count as in [`evidence::dense`].
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
/// As [`evidence::dense`] and [`evidence::sparse`] when E cannot be computed at any start; [`Error::OutOfRange`] for options that make no sense;
/// [`Error::Different`] for a warm start of another structure than the template.
pub fn learn(
    template: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    options: &Options,
) -> Result<Learned> {
    options.spread.check()?;
    let data = Data::new(observations, messages)?;
    match &options.warm_start {
        Some(start) => {
            let points = inducing_points(start, &data, options)?;
            continue_from(template, start, &data, points, options)
        }
        None => learn_afresh(template, &data, messages, options),
    }
}

/// Several starts on some of the events, and all events from the best of them.
fn learn_afresh(template: &Prior, data: &Data<'_>, messages: &[&Summary], options: &Options) -> Result<Learned> {
    let some = spread_out(data.events(), options.start_events_max);
    let few = data.observations.select(&some);
    let few = Data::new(&few, messages)?;
    let mut starts = Vec::new();
    let mut best: Option<(f64, Prior)> = None;
    let mut failure = None;
    for &factor in &options.length_scale_factors {
        let found = scaled(template, factor).and_then(|start| Search::new(template, &few, None, options)?.run(&start));
        let objective = found.as_ref().ok().map(|found| found.objective);
        starts.push(Start { length_scale_factor: factor, objective });
        match found {
            Ok(found) if best.as_ref().is_none_or(|(objective, _)| found.objective > *objective) => {
                best = Some((found.objective, found.prior));
            }
            Ok(_) => {}
            Err(error) => failure = Some(error),
        }
    }
    let start = match (best, failure) {
        (Some((_, prior)), _) => prior,
        (None, Some(error)) => return Err(error),
        (None, None) => template.clone(),
    };
    let points = inducing_points(&start, data, options)?;
    let learned = continue_from(template, &start, data, points, options)?;
    Ok(Learned { starts, start_events: some.len(), ..learned })
}

/// One search on all events.
fn continue_from(
    template: &Prior,
    start: &Prior,
    data: &Data<'_>,
    points: Option<Inputs>,
    options: &Options,
) -> Result<Learned> {
    let search = Search::new(template, data, points.as_ref(), options)?;
    let found = search.run(start)?;
    let begun = search.evaluate(start, &found.tilts)?;
    let ended = search.evaluate(&found.prior, &found.tilts)?;
    // What the spread gains must not be paid for in E.
    let (prior, fit) = if ended.evidence >= begun.evidence { (found.prior, ended) } else { (start.clone(), begun) };
    Ok(Learned {
        prior,
        fit,
        inducing_points: points,
        starts: Vec::new(),
        start_events: 0,
        evaluations: found.evaluations,
        stop: found.stop,
    })
}

/// At most `count_max` of `count` numbers, spread evenly without any period that a schedule of events might share: multiples of
/// the golden ratio.
fn spread_out(count: usize, count_max: usize) -> Vec<usize> {
    if count <= count_max {
        return (0..count).collect();
    }
    let golden = 0.618_033_988_749_894_9;
    let mut chosen: Vec<usize> = (0..count_max).map(|i| ((i as f64 * golden).fract() * count as f64) as usize).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// The template with all length-scales multiplied.
fn scaled(template: &Prior, factor: f64) -> Result<Prior> {
    let scale = |term: &Term| {
        let mut parameters: Vec<f64> = term.log_parameters().collect();
        parameters[1..].iter_mut().for_each(|parameter| *parameter += factor.ln());
        term.with_log_parameters(&parameters)
    };
    let terms = template.kernel().terms().iter().map(scale).collect::<Result<_>>()?;
    Prior::new(Kernel::new(terms)?, template.mean().clone())
}

/// Inducing points for all events, where they are too many for a dense fit.
fn inducing_points(prior: &Prior, data: &Data<'_>, options: &Options) -> Result<Option<Inputs>> {
    if data.events() <= options.dense_events_max {
        return Ok(None);
    }
    let inputs = data.observations.inputs();
    let candidates = inputs.select(&spread_out(inputs.len(), 4 * options.inducing_points_max));
    let chosen = Candidates::new(prior.kernel(), &candidates)?.greedy(options.inducing_points_max);
    let mut points = candidates.select(&chosen.indices);
    points.append(data.message_points())?;
    Ok(Some(points))
}

/// A maximisation of E plus the log density of the spread.
struct Search<'a> {
    data: &'a Data<'a>,
    points: Option<&'a Inputs>,
    template: &'a Prior,
    centre: Vec<f64>,
    /// Places of the parameters that may move, and how far each may.
    moving: Vec<(usize, f64)>,
    iterations_max: u64,
}

/// Where a search ended.
struct Found {
    prior: Prior,
    objective: f64,
    tilts: Vec<f64>,
    evaluations: usize,
    stop: Stop,
}

impl<'a> Search<'a> {
    fn new(template: &'a Prior, data: &'a Data<'a>, points: Option<&'a Inputs>, options: &Options) -> Result<Self> {
        let spread = options.spread.of_parameters(template);
        let moving = spread.into_iter().enumerate().filter(|&(_, spread)| spread > 0.0).collect();
        let iterations_max = options.iterations_max as u64;
        Ok(Self { data, points, template, centre: template.parameters(), moving, iterations_max })
    }

    /// Coordinates of a prior: what moves, in units of its spread about the template.
    fn coordinates(&self, prior: &Prior) -> Result<Vec<f64>> {
        let parameters = prior.parameters();
        if parameters.len() != self.centre.len() {
            return Err(Error::Different { what: "template and start of a search", of: "structures" });
        }
        Ok(self.moving.iter().map(|&(place, spread)| (parameters[place] - self.centre[place]) / spread).collect())
    }

    fn prior(&self, coordinates: &[f64]) -> Result<Prior> {
        let mut parameters = self.centre.clone();
        for (&(place, spread), coordinate) in self.moving.iter().zip(coordinates) {
            parameters[place] += spread * coordinate;
        }
        self.template.with_parameters(&parameters)
    }

    fn evidence(&self, prior: &Prior, options: &mean_field::Options) -> Result<Evidence> {
        match self.points {
            Some(points) => evidence::sparse_of(prior, self.data, points, options),
            None => evidence::dense_of(prior, self.data, options),
        }
    }

    /// A fit that is done with care.
    fn evaluate(&self, prior: &Prior, tilts: &[f64]) -> Result<MeanField> {
        let options = mean_field::Options { tolerance: 1e-6, start: Some(tilts.to_vec()), ..Default::default() };
        Ok(self.evidence(prior, &options)?.fit)
    }

    fn run(&self, start: &Prior) -> Result<Found> {
        let start = self.coordinates(start)?;
        let objective = Objective { search: self, memory: RefCell::new(Memory::default()) };
        objective.at(&start)?;
        let stop = if self.moving.is_empty() { Stop::Converged } else { self.maximise(&objective, start) };
        let Memory { best, evaluations, .. } = objective.memory.into_inner();
        let Some(Best { coordinates, objective, tilts }) = best else {
            return Err(Error::NotFinite { what: "evidence bound", row: 0, column: 0, value: f64::NAN });
        };
        Ok(Found { prior: self.prior(&coordinates)?, objective, tilts, evaluations, stop })
    }

    /// L-BFGS. Whatever it returns, the best point it looked at is in the memory.
    fn maximise(&self, objective: &Objective<'_>, start: Vec<f64>) -> Stop {
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), 8).with_tolerance_grad(1e-4);
        let solver = solver.and_then(|solver| solver.with_tolerance_cost(1e-8));
        let run = solver.and_then(|solver| {
            let executor = Executor::new(objective, solver).timer(false);
            executor.configure(|state| state.param(start).max_iters(self.iterations_max)).run()
        });
        match run.as_ref().map(|result| result.state().get_termination_status()) {
            Ok(TerminationStatus::Terminated(TerminationReason::SolverConverged)) => Stop::Converged,
            Ok(TerminationStatus::Terminated(TerminationReason::MaxItersReached)) => Stop::IterationsMax,
            Ok(other) => Stop::NoProgress(other.to_string()),
            Err(error) => Stop::NoProgress(error.to_string()),
        }
    }
}

/// −(E + log density of the spread) per event, as the optimiser sees it. It asks for cost and gradient at the same place one
/// after the other; the memory saves the second evaluation.
struct Objective<'a> {
    search: &'a Search<'a>,
    memory: RefCell<Memory>,
}

#[derive(Default)]
struct Memory {
    /// The last place, its cost and its gradient.
    last: Option<(Vec<f64>, f64, Vec<f64>)>,
    best: Option<Best>,
    evaluations: usize,
}

struct Best {
    coordinates: Vec<f64>,
    objective: f64,
    tilts: Vec<f64>,
}

impl Objective<'_> {
    /// Cost and gradient.
    fn at(&self, coordinates: &[f64]) -> Result<(f64, Vec<f64>)> {
        let mut memory = self.memory.borrow_mut();
        if let Some((last, cost, gradient)) = &memory.last
            && last == coordinates
        {
            return Ok((*cost, gradient.clone()));
        }
        // E does not change with the tilts to first order: at this tolerance its error is about 1e-9 an event.
        let start = memory.best.as_ref().map(|best| best.tilts.clone());
        let options = mean_field::Options { tolerance: 1e-4, iterations_max: 200, start };
        let evidence = self.search.evidence(&self.search.prior(coordinates)?, &options)?;
        memory.evaluations += 1;
        let objective = evidence.fit.evidence - 0.5 * coordinates.iter().map(|x| x * x).sum::<f64>();
        let per_event = 1.0 / self.search.data.len().max(1) as f64;
        let slope = |(&(place, spread), x): (&(usize, f64), &f64)| -per_event * (spread * evidence.gradient[place] - x);
        let gradient: Vec<f64> = self.search.moving.iter().zip(coordinates).map(slope).collect();
        if memory.best.as_ref().is_none_or(|best| objective > best.objective) {
            memory.best = Some(Best { coordinates: coordinates.to_vec(), objective, tilts: evidence.fit.tilts });
        }
        let cost = -per_event * objective;
        memory.last = Some((coordinates.to_vec(), cost, gradient.clone()));
        Ok((cost, gradient))
    }
}

impl CostFunction for &Objective<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, coordinates: &Vec<f64>) -> std::result::Result<f64, argmin::core::Error> {
        Ok(self.at(coordinates)?.0)
    }
}

impl Gradient for &Objective<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, coordinates: &Vec<f64>) -> std::result::Result<Vec<f64>, argmin::core::Error> {
        Ok(self.at(coordinates)?.1)
    }
}
