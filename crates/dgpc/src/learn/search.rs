//! The search behind learning: L-BFGS over the evidence bound (section 7 of [`crate::method`]).

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient, State, TerminationReason, TerminationStatus};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use super::options::LearnOptions;
use crate::error::{Error, Place, Result};
use crate::fit::{FitOptions, MeanField, solve, solve_with_gradient};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::prior::Prior;

/// No search goes farther from the template than its start by more than so many standard deviations of the hyperprior.
const COORDINATE_MAX: f64 = 8.0;

/// Ends of searches that differ by less than this in nats and in every coordinate are one.
const SAME_OBJECTIVE: f64 = 0.05;
const SAME_COORDINATE: f64 = 0.1;

/// Fits on the way are no more careful and no less than this.
const TILT_TOLERANCES: (f64, f64) = (1e-4, 3e-3);

/// Fits need not tell steps apart that gain so small a share of what the last one did.
const GAIN_SHARE: f64 = 0.02;

/// The first step of a search changes no coordinate by more than this.
const FIRST_STEP: f64 = 0.5;

/// Nats per event that no sensible place costs.
const COST_BEYOND: f64 = 100.0;

/// Why a search ended.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stop {
    /// The gradient vanished, or E did not change any more.
    Converged,
    /// It took as many steps as it was allowed.
    IterationsMax,
    /// No step along the search direction helped, or E could not be computed there, in the optimiser's words. What was
    /// best so far is kept.
    NoProgress(String),
}

/// A maximisation of E plus the log density of the hyperprior.
pub(super) struct Search<'a> {
    likelihood: &'a Likelihood<'a>,
    points: Option<&'a Inputs>,
    template: &'a Prior,
    centre: Vec<f64>,
    /// Places of the parameters that may move, and how far each may.
    moving: Vec<(usize, f64)>,
    iterations_max: u64,
    tolerance: f64,
}

/// Where a search ended.
pub(super) struct Found {
    pub(super) prior: Prior,
    /// E plus the log density of the hyperprior.
    pub(super) objective: f64,
    /// Tilts of its fit.
    pub(super) tilts: Vec<f64>,
    pub(super) evaluations: usize,
    pub(super) stop: Stop,
}

impl<'a> Search<'a> {
    pub(super) fn new(
        template: &'a Prior,
        likelihood: &'a Likelihood<'a>,
        points: Option<&'a Inputs>,
        options: &LearnOptions<'_>,
    ) -> Self {
        let spread = options.hyper_prior.of_parameters(template);
        let moving = spread.into_iter().enumerate().filter(|&(_, spread)| spread > 0.0).collect();
        let iterations_max = options.iterations_max as u64;
        let (centre, tolerance) = (template.parameter_values(), options.tolerance);
        Self { likelihood, points, template, centre, moving, iterations_max, tolerance }
    }

    /// Of the fits on the way, where a step gained so much, in nats an event. E does not change with the tilts to first order, so
    /// that its error, a thousandth of this squared, is a tenth of what the next step should gain.
    fn tilt_tolerance(&self, gained: f64) -> f64 {
        let gain = self.tolerance.max(GAIN_SHARE * gained);
        (10.0 * gain.sqrt()).clamp(TILT_TOLERANCES.0, TILT_TOLERANCES.1)
    }

    /// How many events it looks at.
    pub(super) fn events(&self) -> usize {
        self.likelihood.events()
    }

    /// Coordinates of a prior: what moves, in units of its spread about the template.
    fn coordinates(&self, prior: &Prior) -> Vec<f64> {
        let parameters = prior.parameter_values();
        self.moving.iter().map(|&(place, spread)| (parameters[place] - self.centre[place]) / spread).collect()
    }

    /// The prior that a search from `start` begins at: what may not move is the template's.
    pub(super) fn within_reach(&self, start: &Prior) -> Result<Prior> {
        self.prior(&self.coordinates(start))
    }

    /// Log density of the hyperprior, but for a constant.
    pub(super) fn log_density(&self, prior: &Prior) -> f64 {
        -0.5 * self.coordinates(prior).iter().map(|x| x * x).sum::<f64>()
    }

    /// Whether two searches ended in one place, as far as it matters.
    pub(super) fn is_one_place(&self, a: &Found, b: &Found) -> bool {
        self.is_at(a, &self.coordinates(&b.prior), b.objective)
    }

    /// Whether a search that came to `coordinates` is where `end` is, as far as it matters.
    fn is_at(&self, end: &Found, coordinates: &[f64], objective: f64) -> bool {
        let apart = self.coordinates(&end.prior).into_iter().zip(coordinates).map(|(a, b)| (a - b).abs());
        (end.objective - objective).abs() < SAME_OBJECTIVE && apart.fold(0.0, f64::max) < SAME_COORDINATE
    }

    fn prior(&self, coordinates: &[f64]) -> Result<Prior> {
        let mut parameters = self.centre.clone();
        for (&(place, spread), coordinate) in self.moving.iter().zip(coordinates) {
            parameters[place] += spread * coordinate;
        }
        self.template.with_parameters(&parameters)
    }

    fn per_event(&self) -> f64 {
        1.0 / self.likelihood.len().max(1) as f64
    }

    /// The fit, and the gradient of E.
    fn gradient(&self, prior: &Prior, options: &FitOptions<'_>) -> Result<(MeanField, Vec<f64>)> {
        solve_with_gradient(prior, self.likelihood, self.points, options)
    }

    /// The fit alone.
    pub(super) fn fit(&self, prior: &Prior, options: &FitOptions<'_>) -> Result<MeanField> {
        solve(prior, self.likelihood, self.points, options)
    }

    /// A careful fit: E is off by 1e-13 nats an event.
    pub(super) fn careful_fit(&self, prior: &Prior, tilts: &[f64]) -> Result<MeanField> {
        self.fit(prior, &FitOptions::default().tolerance(1e-5).start(tilts))
    }

    /// From each start to the nearest maximum, or until it comes to where an earlier one ended: most starts lead to the same
    /// place, and the last steps there would say nothing new.
    pub(super) fn run(&self, starts: &[Prior]) -> Vec<Result<Found>> {
        let mut ends = Vec::with_capacity(starts.len());
        for start in starts {
            ends.push(self.run_one(start, &ends));
        }
        ends
    }

    fn run_one(&self, start: &Prior, ends: &[Result<Found>]) -> Result<Found> {
        let start = self.coordinates(start);
        let reach = start.iter().fold(0.0, |reach: f64, x| reach.max(x.abs())) + COORDINATE_MAX;
        let memory = RefCell::new(Memory { last: None, best: None, gained: f64::INFINITY, evaluations: 0 });
        let mut objective = Objective { search: self, reach, ends, scale: 1.0, memory };
        let (_, gradient) = objective.at(&start)?;
        let steepest = gradient.iter().fold(0.0, |steepest: f64, x| steepest.max(x.abs()));
        objective.scale = (FIRST_STEP / steepest).min(1.0 / self.per_event());
        let stop = if self.moving.is_empty() { Stop::Converged } else { self.maximise(&objective, start) };
        let Memory { best, evaluations, .. } = objective.memory.into_inner();
        let Some(Best { coordinates, objective, tilts }) = best else {
            return Err(Error::NotFinite { what: "evidence bound", place: Place::Alone, value: f64::NAN });
        };
        Ok(Found { prior: self.prior(&coordinates)?, objective, tilts, evaluations, stop })
    }

    /// L-BFGS. Whatever it returns, the best point it looked at is in the memory.
    fn maximise(&self, objective: &Objective<'_>, start: Vec<f64>) -> Stop {
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), 8).with_tolerance_grad(3e-4 * objective.scale);
        let solver = solver.and_then(|solver| solver.with_tolerance_cost(self.tolerance * objective.scale));
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

/// −(E + log density of the hyperprior) per event, as the optimiser sees it. It asks for cost and gradient at the same
/// place one after the other; the memory saves the second evaluation.
struct Objective<'a> {
    search: &'a Search<'a>,
    /// No place is looked at whose largest coordinate lies beyond.
    reach: f64,
    /// Where other searches ended.
    ends: &'a [Result<Found>],
    /// What the optimiser sees is so many times the cost: its first step is as long as the gradient there. One of a length that
    /// suits most searches saves the evaluations that feel for it; at most the number of events, where only the hyperprior bends.
    scale: f64,
    memory: RefCell<Memory>,
}

struct Memory {
    /// The last place, its cost and its gradient.
    last: Option<(Vec<f64>, f64, Vec<f64>)>,
    best: Option<Best>,
    /// What the best place was better than the one before, in nats an event.
    gained: f64,
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
        if coordinates.iter().any(|x| x.abs() > self.reach) {
            return Ok(self.beyond(coordinates));
        }
        let mut memory = self.memory.borrow_mut();
        if let Some((last, cost, gradient)) = &memory.last
            && last == coordinates
        {
            return Ok((*cost, gradient.clone()));
        }
        let tolerance = self.search.tilt_tolerance(memory.gained);
        let mut options = FitOptions::default().tolerance(tolerance).iterations_max(200);
        options.start = memory.best.as_ref().map(|best| best.tilts.as_slice());
        let (fit, by_parameter) = self.search.gradient(&self.search.prior(coordinates)?, &options)?;
        memory.evaluations += 1;
        let objective = fit.evidence - 0.5 * coordinates.iter().map(|x| x * x).sum::<f64>();
        let per_event = self.search.per_event();
        let slope = |(&(place, spread), x): (&(usize, f64), &f64)| -per_event * (spread * by_parameter[place] - x);
        let gradient: Vec<f64> = self.search.moving.iter().zip(coordinates).map(slope).collect();
        let gained = memory.best.as_ref().map(|best| per_event * (objective - best.objective));
        if gained.is_none_or(|gained| gained > 0.0) {
            memory.gained = gained.unwrap_or(f64::INFINITY);
            memory.best = Some(Best { coordinates: coordinates.to_vec(), objective, tilts: fit.tilts });
        }
        let cost = -per_event * objective;
        memory.last = Some((coordinates.to_vec(), cost, gradient.clone()));
        Ok((cost, gradient))
    }

    /// The same while it may still lead to a place that is not known.
    fn on_the_way(&self, coordinates: &[f64]) -> std::result::Result<(f64, Vec<f64>), argmin::core::Error> {
        let value = self.at(coordinates)?;
        let memory = self.memory.borrow();
        let is_at =
            |end| memory.best.as_ref().is_some_and(|best| self.search.is_at(end, &best.coordinates, best.objective));
        if self.ends.iter().flatten().any(is_at) {
            Err(argmin::core::Error::msg("an end that is known"))
        } else {
            Ok(value)
        }
    }

    /// Where a step went much too far, only the hyperprior counts, on top of a cost that no sensible place has.
    fn beyond(&self, coordinates: &[f64]) -> (f64, Vec<f64>) {
        let per_event = self.search.per_event();
        let spread: f64 = coordinates.iter().map(|x| 0.5 * x * x).sum();
        (COST_BEYOND + per_event * spread, coordinates.iter().map(|x| per_event * x).collect())
    }
}

impl CostFunction for &Objective<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, coordinates: &Vec<f64>) -> std::result::Result<f64, argmin::core::Error> {
        Ok(self.scale * self.on_the_way(coordinates)?.0)
    }
}

impl Gradient for &Objective<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, coordinates: &Vec<f64>) -> std::result::Result<Vec<f64>, argmin::core::Error> {
        let (_, gradient) = self.on_the_way(coordinates)?;
        Ok(gradient.into_iter().map(|slope| self.scale * slope).collect())
    }
}
