//! The search behind learning: L-BFGS over the evidence bound (section 7 of [`crate::method`]).

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient, State, TerminationReason, TerminationStatus};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use super::curvature::Curvature;
use super::options::LearnOptions;
use super::paths::{Path, Paths, Step, Stop};
use crate::error::{Error, Place, Result};
use crate::fit::{FitOptions, MeanField, solve, solve_with_gradient};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::linalg::Matrix;
use crate::parts::on_parts;
use crate::prior::Prior;

/// No search goes farther from the template than its start by more than so many standard deviations of the hyperprior.
const COORDINATE_MAX: f64 = 8.0;

/// Ends of searches that differ by less than this in nats and in every coordinate are one.
const SAME_OBJECTIVE: f64 = 0.05;
const SAME_COORDINATE: f64 = 0.1;

/// A search that is so many nats below a known end, and no farther from it by what is known of how the objective bends, leads there.
const NEAR: f64 = 0.5;

/// Fewer events do not tell how an objective bends.
const CURVATURE_EVENTS_MIN: usize = 50;

/// Step of a coordinate from which differences of gradients tell how the objective bends.
const DIFFERENCE: f64 = 0.1;

/// A search ends where all that is left to gain is so many times what a step must gain.
const LEFT: f64 = 10.0;

/// Fits on the way are no more careful and no less than this.
const TILT_TOLERANCES: (f64, f64) = (1e-4, 3e-3);

/// Fits need not tell steps apart that gain so small a share of what the last one did.
const GAIN_SHARE: f64 = 0.02;

/// The first step of a search changes no coordinate by more than this.
const FIRST_STEP: f64 = 0.5;

/// Nats per event that no sensible place costs.
const COST_BEYOND: f64 = 100.0;

/// A maximisation of E plus the log density of the hyperprior.
pub(super) struct Search<'a> {
    likelihood: &'a Likelihood<'a>,
    points: Option<&'a Inputs>,
    template: &'a Prior,
    centre: Vec<f64>,
    /// Places of the parameters that may move, and how far each may.
    moving: Vec<(usize, f64)>,
    /// The same on fewer events, which tell how the objective bends.
    few: Option<&'a Search<'a>>,
    /// Where the first fit begins.
    tilts: Option<&'a [f64]>,
    iterations_max: u64,
    tolerance: f64,
}

/// Where a search ended, or came to where it leads to the end of one from an earlier start.
pub(super) struct Found {
    pub(super) prior: Prior,
    /// E plus the log density of the hyperprior.
    pub(super) objective: f64,
    /// Tilts of a fit at its end.
    pub(super) tilts: Vec<f64>,
    pub(super) evaluations: usize,
    pub(super) stop: Stop,
    /// Whether it leads to where an earlier search ended, as far as it matters.
    pub(super) is_known: bool,
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
        Self { likelihood, points, template, centre, moving, few: None, tilts: None, iterations_max, tolerance }
    }

    /// With steps that suit how the objective of `few`, the same search on fewer events, bends where this one starts; where
    /// that tells something, and costs little.
    pub(super) fn bent_as(self, few: &'a Search<'a>) -> Self {
        let pays = (CURVATURE_EVENTS_MIN..=self.likelihood.len() / 3).contains(&few.likelihood.len());
        Self { few: pays.then_some(few), ..self }
    }

    /// With the first fit beginning at the tilts of another one of the same events, if there are any.
    pub(super) fn beginning_at(self, tilts: Option<&'a [f64]>) -> Self {
        Self { tilts, ..self }
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

    /// A gradient by coordinates, from that by all parameters.
    fn by_coordinates(&self, by_parameter: &[f64]) -> Vec<f64> {
        self.moving.iter().map(|&(place, spread)| spread * by_parameter[place]).collect()
    }

    /// How −E per event changes with the coordinates, and the tilts of its fit.
    fn slope(&self, coordinates: &[f64], tilts: Option<&[f64]>) -> Result<(Vec<f64>, Vec<f64>)> {
        let mut options = FitOptions::default().tolerance(TILT_TOLERANCES.0);
        options.start = tilts;
        let (fit, by_parameter) = self.gradient(&self.prior(coordinates)?, &options)?;
        let slope = self.by_coordinates(&by_parameter).into_iter().map(|by| -self.per_event() * by);
        Ok((slope.collect(), fit.tilts))
    }

    /// How −(E + log density of the hyperprior) per event bends, by differences of what fewer events say. As dear as a fit of
    /// these for every coordinate.
    fn curvature(&self, few: &Search<'_>, place: &Prior) -> Result<Curvature> {
        let coordinates = self.coordinates(place);
        let (size, per_event) = (coordinates.len(), self.per_event());
        let (here, tilts) = few.slope(&coordinates, None)?;
        let slopes = on_parts((0..size).collect(), |along| {
            let mut moved = coordinates.clone();
            moved[along] += DIFFERENCE;
            few.slope(&moved, Some(&tilts))
        });
        let mut hessian = Matrix::from_fn(size, size, |row, column| if row == column { per_event } else { 0.0 });
        for (along, slope) in slopes.into_iter().enumerate() {
            let (there, _) = slope?;
            for (place, (there, here)) in there.iter().zip(&here).enumerate() {
                let half = 0.5 * (there - here) / DIFFERENCE;
                hessian[(along, place)] += half;
                hessian[(place, along)] += half;
            }
        }
        Curvature::of(&hessian, per_event)
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
        // How the objective bends at the first start, which is the best guess, serves all: at those far from any end, it may bend
        // any way.
        let measured = self.few.zip(starts.first()).and_then(|(few, start)| self.curvature(few, start).ok());
        let curvature = measured.unwrap_or_else(|| Curvature::alike(self.moving.len(), self.per_event()));
        let paths = Paths::new(starts.len());
        on_parts((0..starts.len()).collect(), |number| {
            paths.set(number, self.path_from(number, &starts[number], &curvature, &paths));
        });
        let found = |(path, known): (Path, Option<usize>)| self.found(path, known);
        let settled = paths.settled(|step, end| self.leads_to(&curvature, step, end));
        settled.into_iter().map(|path| path.and_then(found)).collect()
    }

    fn path_from(&self, number: usize, start: &Prior, curvature: &Curvature, paths: &Paths) -> Result<Path> {
        let start = self.coordinates(start);
        let reach = start.iter().fold(0.0, |reach: f64, x| reach.max(x.abs())) + COORDINATE_MAX;
        let mut objective =
            Objective { search: self, start, reach, number, paths, curvature, scale: 1.0, memory: RefCell::default() };
        objective.scale = objective.share_of_first_step()?;
        let stop = if self.moving.is_empty() { Stop::Converged } else { self.maximise(&objective) };
        let Memory { steps, tilts, evaluations, .. } = objective.memory.into_inner();
        if steps.is_empty() {
            return Err(Error::NotFinite { what: "evidence bound", place: Place::Alone, value: f64::NAN });
        }
        Ok(Path { steps, tilts, evaluations, stop })
    }

    /// What a path comes to, of which a step may be known to lead to another's end.
    fn found(&self, Path { mut steps, tilts, evaluations, stop }: Path, known: Option<usize>) -> Result<Found> {
        let is_known = known.is_some();
        let Step { coordinates, objective, evaluations: so_far } = steps.swap_remove(known.unwrap_or(steps.len() - 1));
        let evaluations = if is_known { so_far } else { evaluations };
        Ok(Found { prior: self.prior(&coordinates)?, objective, tilts, evaluations, stop, is_known })
    }

    /// Whether a step is at an end, or so near that the search will end there, too.
    fn leads_to(&self, curvature: &Curvature, step: &Step, end: &Step) -> bool {
        let below = end.objective - step.objective;
        let rise = || curvature.rise(&end.coordinates, &step.coordinates);
        let is_near = curvature.is_measured() && (0.0..NEAR).contains(&below) && rise() < NEAR * self.per_event();
        is_near || below.abs() < SAME_OBJECTIVE && farthest(&end.coordinates, &step.coordinates) < SAME_COORDINATE
    }

    /// L-BFGS. Whatever it returns, the best point it looked at is in the memory.
    fn maximise(&self, objective: &Objective<'_>) -> Stop {
        let start = vec![0.0; objective.start.len()];
        let steepest = (2.0 * LEFT * self.tolerance).sqrt();
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), 8).with_tolerance_grad(steepest * objective.scale);
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
    /// The optimiser's origin, in coordinates.
    start: Vec<f64>,
    /// No place is looked at whose largest coordinate lies beyond.
    reach: f64,
    /// Which path this is.
    number: usize,
    paths: &'a Paths,
    /// The optimiser goes in steps of this: then its first one, as long as the gradient, is Newton's.
    curvature: &'a Curvature,
    /// What the optimiser sees is so many times the cost: so much of its first step is taken.
    scale: f64,
    memory: RefCell<Memory>,
}

#[derive(Default)]
struct Memory {
    /// The last place, its cost and its gradient.
    last: Option<(Vec<f64>, f64, Vec<f64>)>,
    /// Places that were better than all before.
    steps: Vec<Step>,
    /// Tilts of the last of them.
    tilts: Vec<f64>,
    /// What the best place was better than the one before, in nats an event, once there are two.
    gained: Option<f64>,
    evaluations: usize,
}

impl Objective<'_> {
    /// So much of Newton's step from the start that no coordinate changes by more than [`FIRST_STEP`].
    fn share_of_first_step(&self) -> Result<f64> {
        let (_, gradient) = self.at(&self.start)?;
        let end = self.curvature.place(&self.start, &self.curvature.by_steps(&gradient));
        Ok((FIRST_STEP / farthest(&end, &self.start)).min(1.0))
    }

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
        let tolerance = self.search.tilt_tolerance(memory.gained.unwrap_or(f64::INFINITY));
        let mut options = FitOptions::default().tolerance(tolerance).iterations_max(200);
        options.start = if memory.steps.is_empty() { self.search.tilts } else { Some(&memory.tilts) };
        let (fit, by_parameter) = self.search.gradient(&self.search.prior(coordinates)?, &options)?;
        memory.evaluations += 1;
        let objective = fit.evidence - 0.5 * coordinates.iter().map(|x| x * x).sum::<f64>();
        let per_event = self.search.per_event();
        let by_coordinates = self.search.by_coordinates(&by_parameter);
        let gradient: Vec<f64> = by_coordinates.iter().zip(coordinates).map(|(by, x)| -per_event * (by - x)).collect();
        let gained = memory.steps.last().map(|best| per_event * (objective - best.objective));
        if gained.is_none_or(|gained| gained > 0.0) {
            let step = Step { coordinates: coordinates.to_vec(), objective, evaluations: memory.evaluations };
            memory.steps.push(step);
            (memory.gained, memory.tilts) = (gained, fit.tilts);
        }
        let cost = -per_event * objective;
        memory.last = Some((coordinates.to_vec(), cost, gradient.clone()));
        Ok((cost, gradient))
    }

    /// Cost and gradient after so many steps, as long as they may still lead to a place that is not known.
    fn on_the_way(&self, steps: &[f64]) -> std::result::Result<(f64, Vec<f64>), argmin::core::Error> {
        let (cost, gradient) = self.at(&self.curvature.place(&self.start, steps))?;
        if self.leads_to_known_end() {
            return Err(argmin::core::Error::msg("an end that is known"));
        }
        let gradient = self.curvature.by_steps(&gradient).into_iter().map(|slope| self.scale * slope).collect();
        Ok((self.scale * cost, gradient))
    }

    /// Whether the best place so far leads to the end of an earlier search.
    fn leads_to_known_end(&self) -> bool {
        let memory = self.memory.borrow();
        let leads_to = |step: &Step, end: &Step| self.search.leads_to(self.curvature, step, end);
        let ends = || self.paths.ends_before(self.number, leads_to);
        memory.steps.last().is_some_and(|best| ends().into_iter().any(|end| leads_to(best, end)))
    }

    /// Where a step went much too far, only the hyperprior counts, on top of a cost that no sensible place has.
    fn beyond(&self, coordinates: &[f64]) -> (f64, Vec<f64>) {
        let per_event = self.search.per_event();
        let spread: f64 = coordinates.iter().map(|x| 0.5 * x * x).sum();
        (COST_BEYOND + per_event * spread, coordinates.iter().map(|x| per_event * x).collect())
    }
}

/// How far the coordinate changes that changes most.
fn farthest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |farthest: f64, (a, b)| farthest.max((a - b).abs()))
}

impl CostFunction for &Objective<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, steps: &Vec<f64>) -> std::result::Result<f64, argmin::core::Error> {
        Ok(self.on_the_way(steps)?.0)
    }
}

impl Gradient for &Objective<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, steps: &Vec<f64>) -> std::result::Result<Vec<f64>, argmin::core::Error> {
        Ok(self.on_the_way(steps)?.1)
    }
}
