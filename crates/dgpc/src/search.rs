//! The searches behind learning: L-BFGS over the evidence bound, and a line search for the variance (docs/method.md, section 7).

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient, State, TerminationReason, TerminationStatus};
use argmin::solver::brent::BrentOpt;
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use crate::data::Data;
use crate::error::{Error, Result};
use crate::evidence::{self, Evidence};
use crate::inputs::Inputs;
use crate::learn::{Options, Stop, with_length_scales_times, with_variances_times};
use crate::mean_field::{self, MeanField};
use crate::prior_mean::Prior;

/// No search goes farther from the template than its start by more than so many standard deviations of the spread.
const COORDINATE_MAX: f64 = 8.0;

/// Nats per event that no sensible place costs.
const COST_BEYOND: f64 = 100.0;

/// The smallest and largest factor of the variances that a calibration tries.
const CALIBRATION: (f64, f64) = (0.25, 16.0);

/// A maximisation of E plus the log density of the spread.
pub(crate) struct Search<'a> {
    data: &'a Data<'a>,
    points: Option<&'a Inputs>,
    template: &'a Prior,
    centre: Vec<f64>,
    /// Places of the parameters that may move, and how far each may.
    moving: Vec<(usize, f64)>,
    iterations_max: u64,
}

/// Where a search ended.
pub(crate) struct Found {
    pub(crate) prior: Prior,
    /// E plus the log density of the spread.
    pub(crate) objective: f64,
    /// Tilts of its fit.
    pub(crate) tilts: Vec<f64>,
    pub(crate) evaluations: usize,
    pub(crate) stop: Stop,
}

impl<'a> Search<'a> {
    pub(crate) fn new(template: &'a Prior, data: &'a Data<'a>, points: Option<&'a Inputs>, options: &Options) -> Self {
        let spread = options.spread.of_parameters(template);
        let moving = spread.into_iter().enumerate().filter(|&(_, spread)| spread > 0.0).collect();
        let iterations_max = options.iterations_max as u64;
        Self { data, points, template, centre: template.parameters(), moving, iterations_max }
    }

    /// Coordinates of a prior: what moves, in units of its spread about the template.
    fn coordinates(&self, prior: &Prior) -> Vec<f64> {
        let parameters = prior.parameters();
        self.moving.iter().map(|&(place, spread)| (parameters[place] - self.centre[place]) / spread).collect()
    }

    /// The prior that a search from `start` begins at: what may not move is the template's.
    pub(crate) fn within_reach(&self, start: &Prior) -> Result<Prior> {
        self.prior(&self.coordinates(start))
    }

    fn prior(&self, coordinates: &[f64]) -> Result<Prior> {
        let mut parameters = self.centre.clone();
        for (&(place, spread), coordinate) in self.moving.iter().zip(coordinates) {
            parameters[place] += spread * coordinate;
        }
        self.template.with_parameters(&parameters)
    }

    fn per_event(&self) -> f64 {
        1.0 / self.data.len().max(1) as f64
    }

    fn evidence(&self, prior: &Prior, options: &mean_field::Options) -> Result<Evidence> {
        match self.points {
            Some(points) => evidence::sparse_of(prior, self.data, points, options),
            None => evidence::dense_of(prior, self.data, options),
        }
    }

    /// The fit alone, without its gradient.
    pub(crate) fn fit(&self, prior: &Prior, options: &mean_field::Options) -> Result<MeanField> {
        match self.points {
            Some(points) => evidence::sparse_fit(prior, self.data, points, options),
            None => evidence::dense_fit(prior, self.data, options),
        }
    }

    /// A careful fit.
    pub(crate) fn careful_fit(&self, prior: &Prior, tilts: &[f64]) -> Result<MeanField> {
        self.fit(prior, &mean_field::Options { tolerance: 1e-6, start: Some(tilts.to_vec()), ..Default::default() })
    }

    /// From `start` to the nearest maximum.
    pub(crate) fn run(&self, start: &Prior) -> Result<Found> {
        let start = self.coordinates(start);
        let reach = start.iter().fold(0.0, |reach: f64, x| reach.max(x.abs())) + COORDINATE_MAX;
        let objective = Objective { search: self, reach, memory: RefCell::new(Memory::default()) };
        objective.at(&start)?;
        let stop = if self.moving.is_empty() { Stop::Converged } else { self.maximise(&objective, start) };
        let Memory { best, evaluations, .. } = objective.memory.into_inner();
        let Some(Best { coordinates, objective, tilts }) = best else {
            return Err(Error::NotFinite { what: "evidence bound", row: 0, column: 0, value: f64::NAN });
        };
        Ok(Found { prior: self.prior(&coordinates)?, objective, tilts, evaluations, stop })
    }

    /// The factor of all variances that maximises the corrected evidence plus the log density of a normal distribution of the
    /// factor's logarithm about 0, given the fit at factor 1.
    pub(crate) fn calibrate(&self, prior: &Prior, fit: &MeanField, spread: f64) -> f64 {
        let problem = Calibration { search: self, prior, tilts: RefCell::new(fit.tilts.clone()), spread };
        let (low, high) = CALIBRATION;
        let solver = BrentOpt::new(low.ln(), high.ln()).set_tolerance(0.0, 0.1);
        let run = Executor::new(&problem, solver).timer(false).configure(|state| state.max_iters(10)).run();
        let best = run.ok().and_then(|result| result.state().get_best_param().copied());
        best.map_or(1.0, f64::exp)
    }

    /// L-BFGS. Whatever it returns, the best point it looked at is in the memory.
    fn maximise(&self, objective: &Objective<'_>, start: Vec<f64>) -> Stop {
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), 8).with_tolerance_grad(3e-4);
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

/// −(corrected evidence + log density of the spread) as a function of the logarithm of a common factor of all variances.
struct Calibration<'a> {
    search: &'a Search<'a>,
    prior: &'a Prior,
    /// Of the last fit.
    tilts: RefCell<Vec<f64>>,
    spread: f64,
}

impl CostFunction for &Calibration<'_> {
    type Param = f64;
    type Output = f64;

    fn cost(&self, log_factor: &f64) -> std::result::Result<f64, argmin::core::Error> {
        let prior = with_variances_times(self.prior, log_factor.exp())?;
        let spread = 0.5 * (log_factor / self.spread).powi(2);
        let start = Some(self.tilts.borrow().clone());
        let options = mean_field::Options { tolerance: 1e-3, start, ..Default::default() };
        let fit = self.search.fit(&prior, &options)?;
        self.tilts.replace(fit.tilts.clone());
        Ok(spread - fit.corrected_evidence())
    }
}

/// The logarithm of the factor of all length-scales that maximises the sum of E over `sets`.
pub(crate) fn best_length_scale_factor(template: &Prior, sets: &[Data<'_>]) -> Result<f64> {
    let tilts = sets.iter().map(|_| None).collect();
    let problem = CommonScale { template, sets, tilts: RefCell::new(tilts) };
    let tried: Vec<f64> = (-3..=3).map(|power| f64::from(power) * LENGTH_SCALE_STEP).collect();
    let costs = tried.iter().map(|&log_factor| problem.cost_at(log_factor)).collect::<Result<Vec<f64>>>()?;
    let best = (0..tried.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).map_or(0.0, |place| tried[place]);
    let solver = BrentOpt::new(best - LENGTH_SCALE_STEP, best + LENGTH_SCALE_STEP).set_tolerance(0.0, 1e-4);
    let run = Executor::new(&problem, solver).timer(false).configure(|state| state.max_iters(40)).run();
    let refined = run.ok().and_then(|result| result.state().get_best_param().copied()).unwrap_or(best);
    // Whatever the solver returns, the best place looked at is kept.
    Ok(if problem.cost_at(refined)? <= problem.cost_at(best)? { refined } else { best })
}

/// Steps of the logarithm of a common factor of all length-scales.
const LENGTH_SCALE_STEP: f64 = std::f64::consts::LN_2;

/// −Σ E over several sets of events as a function of the logarithm of a common factor of all length-scales.
struct CommonScale<'a> {
    template: &'a Prior,
    sets: &'a [Data<'a>],
    /// Of the last fit of each set.
    tilts: RefCell<Vec<Option<Vec<f64>>>>,
}

impl CommonScale<'_> {
    fn cost_at(&self, log_factor: f64) -> Result<f64> {
        let prior = with_length_scales_times(self.template, log_factor.exp())?;
        let mut cost = 0.0;
        for (set, start) in self.sets.iter().zip(self.tilts.borrow_mut().iter_mut()) {
            let options = mean_field::Options { tolerance: 1e-4, iterations_max: 200, start: start.take() };
            let fit = evidence::dense_fit(&prior, set, &options)?;
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

/// −(E + log density of the spread) per event, as the optimiser sees it. It asks for cost and gradient at the same place one
/// after the other; the memory saves the second evaluation.
struct Objective<'a> {
    search: &'a Search<'a>,
    /// No place is looked at whose largest coordinate lies beyond.
    reach: f64,
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
        if coordinates.iter().any(|x| x.abs() > self.reach) {
            return Ok(self.beyond(coordinates));
        }
        let mut memory = self.memory.borrow_mut();
        if let Some((last, cost, gradient)) = &memory.last
            && last == coordinates
        {
            return Ok((*cost, gradient.clone()));
        }
        // E does not change with the tilts to first order: at this tolerance its error is about 1e-9 an event.
        let start = memory.best.as_ref().map(|best| best.tilts.clone());
        let options = mean_field::Options { tolerance: 1e-3, iterations_max: 200, start };
        let evidence = self.search.evidence(&self.search.prior(coordinates)?, &options)?;
        memory.evaluations += 1;
        let objective = evidence.fit.evidence - 0.5 * coordinates.iter().map(|x| x * x).sum::<f64>();
        let per_event = self.search.per_event();
        let slope = |(&(place, spread), x): (&(usize, f64), &f64)| -per_event * (spread * evidence.gradient[place] - x);
        let gradient: Vec<f64> = self.search.moving.iter().zip(coordinates).map(slope).collect();
        if memory.best.as_ref().is_none_or(|best| objective > best.objective) {
            memory.best = Some(Best { coordinates: coordinates.to_vec(), objective, tilts: evidence.fit.tilts });
        }
        let cost = -per_event * objective;
        memory.last = Some((coordinates.to_vec(), cost, gradient.clone()));
        Ok((cost, gradient))
    }

    /// Where a step went much too far, only the spread counts, on top of a cost that no sensible place has.
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
