//! The search for the optimal prior: L-BFGS over the evidence bound ([`crate::method::learning`]).

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient, State, TerminationReason, TerminationStatus};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use super::bounds::{self, Moving};
use super::curvature::Curvature;
use super::options::LearnOptions;
use super::paths::{Path, Paths, Step, Stop};
use crate::error::{Error, Place, Result};
use crate::fit::{DenseEngines, FitOptions, MeanField, solve_with, solve_with_gradient};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::linalg::Matrix;
use crate::monitor::{Monitor, Progress};
use crate::parameter::Parameter;
use crate::parts::on_parts;
use crate::prior::Prior;

/// Largest distance of a search beyond its start, in standard deviations of the hyperprior.
const COORDINATE_MAX: f64 = 8.0;

/// Ends of searches that differ by less than this in nats, and by less than [`SAME_COORDINATE`], count as one.
const SAME_OBJECTIVE: f64 = 0.05;
/// Largest difference of a coordinate between ends that count as one.
const SAME_COORDINATE: f64 = 0.1;

/// Largest difference, in nats, between a known end and a search that leads to it. The difference that the curvature
/// predicts from their distance must be smaller than this, too.
const NEAR: f64 = 0.5;

/// Smallest number of events from which the curvature of the objective can be computed.
const CURVATURE_EVENTS_MIN: usize = 50;

/// Step of a coordinate for the differences of gradients that give the curvature.
const DIFFERENCE: f64 = 0.1;

/// A search ends when the predicted remaining gain is below this multiple of the gain that a step must have.
const LEFT: f64 = 10.0;

/// Smallest and largest tolerance of the fits during a search.
const TILT_TOLERANCES: (f64, f64) = (1e-4, 3e-3);

/// Share of the last step's gain that the fits of the next step must resolve.
const GAIN_SHARE: f64 = 0.02;

/// The first step of a search changes no coordinate by more than this.
const FIRST_STEP: f64 = 0.5;

/// Cost in nats per event that exceeds the cost of every sensible place.
const COST_BEYOND: f64 = 100.0;

/// A maximisation of E plus the log density of the hyperprior.
pub(super) struct Search<'a> {
    likelihood: &'a Likelihood<'a>,
    points: Option<&'a Inputs>,
    template: &'a Prior,
    centre: Vec<f64>,
    moving: Vec<Moving>,
    /// This search on fewer events, from which the curvature of the objective is computed.
    few: Option<&'a Search<'a>>,
    /// Initial tilts of the first fit.
    tilts: Option<&'a [f64]>,
    iterations_max: u64,
    tolerance: f64,
    monitor: Monitor<'a>,
    engines: DenseEngines,
}

/// The end of a search, or the place from which it leads to the end of an earlier search.
pub(super) struct SearchEnd {
    pub(super) prior: Prior,
    /// E plus the log density of the hyperprior.
    pub(super) objective: f64,
    /// E at the start of the search. Its error is that of [`TILT_TOLERANCES`]: 1e-8 nats an event.
    pub(super) start_evidence: f64,
    /// Tilts of a fit at the end of the search.
    pub(super) tilts: Vec<f64>,
    pub(super) evaluations: usize,
    pub(super) stop: Stop,
    /// Whether the search leads to the end of an earlier search.
    pub(super) is_known: bool,
}

impl<'a> Search<'a> {
    pub(super) fn new(
        template: &'a Prior,
        likelihood: &'a Likelihood<'a>,
        points: Option<&'a Inputs>,
        options: &LearnOptions<'a>,
    ) -> Self {
        let moving = bounds::moving(template, &options.hyper_prior, options.bounds);
        let iterations_max = options.iterations_max as u64;
        let (centre, tolerance, monitor) = (template.parameter_values(), options.tolerance, options.monitor);
        Self {
            likelihood,
            points,
            template,
            centre,
            moving,
            few: None,
            tilts: None,
            iterations_max,
            tolerance,
            monitor,
            engines: DenseEngines::default(),
        }
    }

    /// Scales the steps by the curvature of the objective at the first start. The curvature is computed from `few`, the
    /// same search on fewer events. It is not used if `few` has too few events to be accurate, or too many to be cheap.
    pub(super) fn scaled_by_curvature_of(self, few: &'a Search<'a>) -> Self {
        let pays = (CURVATURE_EVENTS_MIN..=self.likelihood.len() / 3).contains(&few.likelihood.len());
        Self { few: pays.then_some(few), ..self }
    }

    /// Starts the first fit at the given tilts, from another fit of the same events.
    pub(super) fn starting_at_tilts(self, tilts: Option<&'a [f64]>) -> Self {
        Self { tilts, ..self }
    }

    /// Returns the tolerance of the next fit, from the gain of the last step, in nats an event.
    ///
    /// E does not change with the tilts to first order. Its error is a thousandth of the squared tolerance, which is a
    /// tenth of the gain that the next step should have.
    fn tilt_tolerance(&self, gained: f64) -> f64 {
        let gain = self.tolerance.max(GAIN_SHARE * gained);
        (10.0 * gain.sqrt()).clamp(TILT_TOLERANCES.0, TILT_TOLERANCES.1)
    }

    /// Returns the number of events in the search.
    pub(super) fn events(&self) -> usize {
        self.likelihood.events()
    }

    /// Returns the coordinates of a prior: its moving parameters minus the template's, in units of their standard
    /// deviations.
    fn coordinates(&self, prior: &Prior) -> Vec<f64> {
        let parameters = prior.parameter_values();
        self.moving.iter().map(|moving| moving.coordinate(parameters[moving.place])).collect()
    }

    /// Returns the coordinates from which a search with this start begins: the nearest ones within the bounds.
    fn nearest_coordinates(&self, start: &Prior) -> Vec<f64> {
        let parameters = start.parameter_values();
        self.moving.iter().map(|moving| moving.coordinate(moving.nearest(parameters[moving.place]))).collect()
    }

    /// Returns the prior from which a search with this start begins. Fixed parameters are those of the template.
    pub(super) fn within_reach(&self, start: &Prior) -> Result<Prior> {
        self.prior(&self.nearest_coordinates(start))
    }

    /// Returns whether the search may change a variance.
    pub(super) fn moves_a_variance(&self) -> bool {
        let parameters = self.template.parameters();
        self.moving.iter().any(|moving| parameters[moving.place] == Parameter::Variance)
    }

    /// Returns a prior with the variances that may change multiplied by a factor, as far as their bounds permit it.
    pub(super) fn with_variances_times(&self, prior: &Prior, factor: f64) -> Result<Prior> {
        let (mut values, parameters) = (prior.parameter_values(), self.template.parameters());
        for moving in self.moving.iter().filter(|moving| parameters[moving.place] == Parameter::Variance) {
            values[moving.place] = moving.nearest(values[moving.place] + factor.ln());
        }
        prior.with_parameters(&values)
    }

    /// Returns the log density of the hyperprior, up to a constant.
    pub(super) fn log_density(&self, prior: &Prior) -> f64 {
        -0.5 * self.coordinates(prior).iter().map(|x| x * x).sum::<f64>()
    }

    fn prior(&self, coordinates: &[f64]) -> Result<Prior> {
        let mut parameters = self.centre.clone();
        for (moving, coordinate) in self.moving.iter().zip(coordinates) {
            parameters[moving.place] = moving.nearest(parameters[moving.place] + moving.spread * coordinate);
        }
        self.template.with_parameters(&parameters)
    }

    /// Returns the coordinates within the bounds that belong to the optimiser's coordinates, and their derivatives.
    fn bounded(&self, unbounded: &[f64]) -> (Vec<f64>, Vec<f64>) {
        self.moving.iter().zip(unbounded).map(|(moving, &u)| moving.bounded(u)).unzip()
    }

    fn per_event(&self) -> f64 {
        1.0 / self.likelihood.len().max(1) as f64
    }

    /// Returns the fit and the gradient of E.
    fn gradient(&self, prior: &Prior, options: &FitOptions<'_>) -> Result<(MeanField, Vec<f64>)> {
        let options = FitOptions { monitor: self.monitor, ..*options };
        solve_with_gradient(&self.engines, prior, self.likelihood, self.points, &options)
    }

    /// Converts a gradient by all parameters to a gradient by coordinates.
    fn by_coordinates(&self, by_parameter: &[f64]) -> Vec<f64> {
        self.moving.iter().map(|moving| moving.spread * by_parameter[moving.place]).collect()
    }

    /// Returns the gradient of −E per event by the coordinates, and the tilts of the fit.
    fn slope(&self, coordinates: &[f64], tilts: Option<&[f64]>) -> Result<(Vec<f64>, Vec<f64>)> {
        let mut options = FitOptions::default().tolerance(TILT_TOLERANCES.0);
        options.start = tilts;
        let (fit, by_parameter) = self.gradient(&self.prior(coordinates)?, &options)?;
        let slope = self.by_coordinates(&by_parameter).into_iter().map(|by| -self.per_event() * by);
        Ok((slope.collect(), fit.tilts))
    }

    /// Returns the curvature of −(E + log density of the hyperprior) per event at a prior. It is computed by
    /// differences of gradients on fewer events, which takes one fit of these for every coordinate.
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

    /// Returns the fit without a gradient.
    pub(super) fn fit(&self, prior: &Prior, options: &FitOptions<'_>) -> Result<MeanField> {
        solve_with(
            &self.engines,
            prior,
            self.likelihood,
            self.points,
            &FitOptions { monitor: self.monitor, ..*options },
        )
    }

    /// Returns an accurate fit, whose error of E is 1e-13 nats an event.
    pub(super) fn careful_fit(&self, prior: &Prior, tilts: &[f64]) -> Result<MeanField> {
        self.fit(prior, &FitOptions::default().tolerance(1e-5).start(tilts))
    }

    /// Searches from each start to the nearest maximum, or until the search leads to the end of an earlier one. Most
    /// starts lead to the same maximum, and the last steps to it would give no new information.
    pub(super) fn run(&self, starts: &[Prior]) -> Vec<Result<SearchEnd>> {
        // The curvature at the first start, which is the best guess, serves all starts. Far from the optimum,
        // curvatures differ too much to be useful anyway.
        let measured = self.few.zip(starts.first()).and_then(|(few, start)| self.curvature(few, start).ok());
        let curvature = measured.unwrap_or_else(|| Curvature::isotropic(self.moving.len(), self.per_event()));
        let paths = Paths::new(starts.len());
        on_parts((0..starts.len()).collect(), |number| {
            paths.set(number, self.path_from(number, &starts[number], &curvature, &paths));
        });
        let found = |(path, known): (Path, Option<usize>)| self.found(path, known);
        let settled = paths.settled(|step, end| self.leads_to(&curvature, step, end));
        settled.into_iter().map(|path| path.and_then(found)).collect()
    }

    fn path_from(&self, number: usize, start: &Prior, curvature: &Curvature, paths: &Paths) -> Result<Path> {
        let start = self.nearest_coordinates(start);
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

    /// Converts a path to its result. `known` is the index of the step that leads to another path's end, if there is
    /// one.
    fn found(&self, Path { mut steps, tilts, evaluations, stop }: Path, known: Option<usize>) -> Result<SearchEnd> {
        let is_known = known.is_some();
        let start_evidence = steps[0].objective + 0.5 * steps[0].coordinates.iter().map(|x| x * x).sum::<f64>();
        let Step { coordinates, objective, evaluations: so_far } = steps.swap_remove(known.unwrap_or(steps.len() - 1));
        let evaluations = if is_known { so_far } else { evaluations };
        let prior = self.prior(&coordinates)?;
        Ok(SearchEnd { prior, objective, start_evidence, tilts, evaluations, stop, is_known })
    }

    /// Returns whether a step is at an end, or so close to it that the search would end there, too.
    fn leads_to(&self, curvature: &Curvature, step: &Step, end: &Step) -> bool {
        let below = end.objective - step.objective;
        let rise = || curvature.rise(&end.coordinates, &step.coordinates);
        let is_near = curvature.is_measured() && (0.0..NEAR).contains(&below) && rise() < NEAR * self.per_event();
        is_near || below.abs() < SAME_OBJECTIVE && farthest(&end.coordinates, &step.coordinates) < SAME_COORDINATE
    }

    /// Runs L-BFGS. The best evaluated place is in the memory of the objective, whatever the optimiser returns.
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

/// −(E + log density of the hyperprior) per event, the cost of the optimiser. The optimiser requests cost and gradient
/// at the same place one after the other. The memory avoids the second evaluation.
struct Objective<'a> {
    search: &'a Search<'a>,
    /// Origin of the optimiser, in coordinates.
    start: Vec<f64>,
    /// Largest coordinate of a place that is evaluated.
    reach: f64,
    /// Index of the path.
    number: usize,
    paths: &'a Paths,
    /// The optimiser's unit of steps. With this unit, its first step, the negative gradient, is Newton's step.
    curvature: &'a Curvature,
    /// Factor of the cost that the optimiser sees. It shortens the optimiser's first step by the same factor.
    scale: f64,
    memory: RefCell<Memory>,
}

#[derive(Default)]
struct Memory {
    /// The last place, with its cost and gradient.
    last: Option<(Vec<f64>, f64, Vec<f64>)>,
    /// Places that were better than all before them.
    steps: Vec<Step>,
    /// Tilts of the fit at the last of these places.
    tilts: Vec<f64>,
    /// Gain of the best place over the best place before it, in nats an event. `None` for fewer than two places.
    gained: Option<f64>,
    evaluations: usize,
}

impl Objective<'_> {
    /// Returns the share of Newton's step from the start that changes no coordinate by more than [`FIRST_STEP`].
    fn share_of_first_step(&self) -> Result<f64> {
        let (_, gradient) = self.at(&self.start)?;
        let end = self.curvature.place(&self.start, &self.curvature.by_steps(&gradient));
        Ok((FIRST_STEP / farthest(&end, &self.start)).min(1.0))
    }

    /// Returns cost and gradient at the given coordinates of the optimiser.
    fn at(&self, unbounded: &[f64]) -> Result<(f64, Vec<f64>)> {
        if unbounded.iter().any(|x| x.abs() > self.reach) {
            return Ok(self.beyond(unbounded));
        }
        let mut memory = self.memory.borrow_mut();
        if let Some((last, cost, gradient)) = &memory.last
            && last == unbounded
        {
            return Ok((*cost, gradient.clone()));
        }
        let (coordinates, slopes) = self.search.bounded(unbounded);
        let tolerance = self.search.tilt_tolerance(memory.gained.unwrap_or(f64::INFINITY));
        let mut options = FitOptions::default().tolerance(tolerance).iterations_max(200);
        options.start = if memory.steps.is_empty() { self.search.tilts } else { Some(&memory.tilts) };
        let (fit, by_parameter) = self.search.gradient(&self.search.prior(&coordinates)?, &options)?;
        memory.evaluations += 1;
        let objective = fit.evidence - 0.5 * coordinates.iter().map(|x| x * x).sum::<f64>();
        self.search.monitor.report(Progress::Evaluation { objective })?;
        let per_event = self.search.per_event();
        let by_coordinates = self.search.by_coordinates(&by_parameter);
        let by_coordinates = by_coordinates.iter().zip(&coordinates).zip(slopes);
        let gradient: Vec<f64> = by_coordinates.map(|((by, x), slope)| -per_event * (by - x) * slope).collect();
        let gained = memory.steps.last().map(|best| per_event * (objective - best.objective));
        if gained.is_none_or(|gained| gained > 0.0) {
            let step = Step { coordinates, objective, evaluations: memory.evaluations };
            memory.steps.push(step);
            (memory.gained, memory.tilts) = (gained, fit.tilts);
        }
        let cost = -per_event * objective;
        memory.last = Some((unbounded.to_vec(), cost, gradient.clone()));
        Ok((cost, gradient))
    }

    /// Returns cost and gradient after the given steps. Fails if the best place so far leads to a known end, which
    /// stops the optimiser.
    fn on_the_way(&self, steps: &[f64]) -> std::result::Result<(f64, Vec<f64>), argmin::core::Error> {
        let (cost, gradient) = self.at(&self.curvature.place(&self.start, steps))?;
        if self.leads_to_known_end() {
            return Err(argmin::core::Error::msg("an end that is known"));
        }
        let gradient = self.curvature.by_steps(&gradient).into_iter().map(|slope| self.scale * slope).collect();
        Ok((self.scale * cost, gradient))
    }

    /// Returns whether the best place so far leads to the end of an earlier search.
    fn leads_to_known_end(&self) -> bool {
        let memory = self.memory.borrow();
        let leads_to = |step: &Step, end: &Step| self.search.leads_to(self.curvature, step, end);
        let ends = || self.paths.ends_before(self.number, leads_to);
        memory.steps.last().is_some_and(|best| ends().into_iter().any(|end| leads_to(best, end)))
    }

    /// Returns cost and gradient at a place that is much too far away: the hyperprior, plus a cost above all sensible
    /// costs.
    fn beyond(&self, coordinates: &[f64]) -> (f64, Vec<f64>) {
        let per_event = self.search.per_event();
        let spread: f64 = coordinates.iter().map(|x| 0.5 * x * x).sum();
        (COST_BEYOND + per_event * spread, coordinates.iter().map(|x| per_event * x).collect())
    }
}

/// Returns the largest change of a coordinate.
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
