//! Fixed point of a sparse mean field, iterated in the sums Ĝ and b̂ of its events ([`crate::method::inference`]).

use std::sync::Arc;

use super::coordinator::Coordinator;
use super::events::Walk;
use super::gradient::Slope;
use super::point_posterior::PointPosterior;
use super::shard::{Contribution, Posteriors, ShardContribution, ShardRequest, Task};
use crate::cross::Sums;
use crate::error::{Error, Result, finite};
use crate::fit::anderson::Anderson;
use crate::fit::options::FitOptions;
use crate::fit::stagnation::{FitStop, Stagnation};
use crate::likelihood::Likelihood;
use crate::linalg::Matrix;
use crate::monitor::{Monitor, Progress};
use crate::prior::Prior;

/// Moves the posterior from walk to walk until no tilt changes by more than the tolerance.
///
/// Each round is a request to all shards, and the sum of their contributions. At the end, the coordinator holds the
/// posterior of the sites of the last walk.
pub(super) struct Iteration<'a> {
    coordinator: Coordinator,
    tolerance: f64,
    iterations_max: usize,
    monitor: Monitor<'a>,
    phase: Phase,
    round: u32,
    scale: Scale,
    /// The sums of the present posterior.
    at: Sums,
    /// The plain step that an accelerated step replaced.
    plain: Option<Sums>,
    is_plain: bool,
    anderson: Anderson,
    /// The greatest E so far.
    best: f64,
    was_rejected: bool,
    stagnation: Stagnation,
    /// The posterior of the last walk, which gives the tilts of the present sites.
    before: Option<Arc<PointPosterior>>,
    end: End,
}

#[derive(Clone, Copy, PartialEq)]
enum Phase {
    Begin,
    Walk,
    /// The iteration ended, but the events still have the moments of the posterior before.
    Store,
    Done,
}

/// The end of the iteration.
pub(super) struct End {
    pub(super) evidence: f64,
    pub(super) iterations: usize,
    pub(super) change: f64,
    pub(super) stop: FitStop,
    /// The sums of the events.
    pub(super) sums: Sums,
    pub(super) jitter: f64,
}

impl<'a> Iteration<'a> {
    /// Creates the iteration before its first request.
    pub(super) fn new(coordinator: Coordinator, options: &FitOptions<'a>) -> Self {
        let none = Sums::zeros(coordinator.points.len());
        let end = End {
            evidence: f64::NEG_INFINITY,
            iterations: 0,
            change: f64::INFINITY,
            stop: FitStop::IterationsMax,
            sums: Sums::zeros(0),
            jitter: coordinator.cholesky().jitter(),
        };
        Self {
            coordinator,
            tolerance: options.tolerance,
            iterations_max: options.iterations_max,
            monitor: options.monitor,
            phase: Phase::Begin,
            round: 0,
            scale: Scale::of(&none),
            at: none,
            plain: None,
            is_plain: true,
            anderson: Anderson::new(),
            best: f64::NEG_INFINITY,
            was_rejected: false,
            stagnation: Stagnation::new(),
            before: None,
            end,
        }
    }

    /// Returns the request of the present round, or `None` at the end.
    pub(super) fn request(&self) -> Option<ShardRequest> {
        let task = match self.phase {
            Phase::Begin => Task::Begin,
            Phase::Walk => Task::Walk(self.posteriors()),
            Phase::Store => Task::Store(self.posteriors()),
            Phase::Done => return None,
        };
        Some(ShardRequest { round: self.round, task })
    }

    /// Returns the request for the gradient of E, after the end.
    pub(super) fn gradient_request(&self) -> ShardRequest {
        ShardRequest { round: self.round, task: Task::Gradient(self.posteriors()) }
    }

    fn posteriors(&self) -> Posteriors {
        Posteriors { at: Arc::clone(self.coordinator.posterior()), before: self.before.clone() }
    }

    /// Absorbs the sum of all contributions to the request of this round.
    pub(super) fn absorb(&mut self, contribution: ShardContribution) -> Result<()> {
        if contribution.round != self.round {
            return Err(Error::WrongContribution);
        }
        match (self.phase, contribution.result) {
            (Phase::Begin, Contribution::Walk(walk)) if self.has_size_of(&walk) => {
                self.coordinator.take(&walk.sums)?;
                (self.scale, self.at, self.phase) = (Scale::of(&walk.sums), walk.sums, Phase::Walk);
            }
            (Phase::Walk, Contribution::Walk(walk)) if self.has_size_of(&walk) => self.absorb_walk(walk)?,
            (Phase::Store, Contribution::Stored) => self.phase = Phase::Done,
            _ => return Err(Error::WrongContribution),
        }
        self.round += 1;
        Ok(())
    }

    fn has_size_of(&self, walk: &Walk) -> bool {
        walk.sums.shift.len() == self.coordinator.points.len()
    }

    fn absorb_walk(&mut self, walk: Walk) -> Result<()> {
        let (iterations, walked) = (self.end.iterations + 1, Arc::clone(self.coordinator.posterior()));
        self.monitor.report(Progress::Iteration { iterations, change: walk.change })?;
        let evidence = match self.coordinator.take(&walk.sums) {
            Err(_) if !self.is_plain => f64::NAN,
            taken => taken.map(|()| self.coordinator.evidence(walk.bound))?,
        };
        (self.end.iterations, self.before) = (iterations, Some(walked));
        // Plain steps never lower E. If an accelerated step lowered it, the plain step replaces it and the acceleration
        // restarts.
        let is_worse = !evidence.is_finite() || evidence < self.best - 1e-10 * self.best.abs();
        let is_plain = self.is_plain;
        if let Some(plain) = self.plain.take_if(|_| !is_plain && is_worse) {
            self.coordinator.take(&plain)?;
            (self.at, self.is_plain, self.was_rejected) = (plain, true, true);
            self.anderson.restart();
            return Ok(());
        }
        self.best = self.best.max(finite("evidence bound", evidence)?);
        // After a rejected step, the tilts changed from the point where that step led, not from the plain point.
        let has_converged = walk.change <= self.tolerance && !self.was_rejected;
        self.was_rejected = false;
        (self.end.evidence, self.end.change) = (evidence, walk.change);
        if has_converged {
            self.finish(walk.sums, FitStop::Converged);
        } else if self.stagnation.record(walk.change, evidence) {
            self.finish(walk.sums, FitStop::Stagnated);
        } else if self.end.iterations >= self.iterations_max {
            self.finish(walk.sums, FitStop::IterationsMax);
        } else {
            self.step(walk.sums)?;
        }
        Ok(())
    }

    fn finish(&mut self, sums: Sums, stop: FitStop) {
        (self.end.sums, self.end.stop) = (sums, stop);
        // The stored moments belong to the tilts, not yet to the final posterior. At convergence they agree.
        self.phase = if stop == FitStop::Converged { Phase::Done } else { Phase::Store };
    }

    /// Takes an accelerated step, or the plain step to the sums of the last walk.
    fn step(&mut self, sums: Sums) -> Result<()> {
        // The last step is plain, because no later walk could reject an accelerated step.
        let mut step = None;
        if self.end.iterations + 1 < self.iterations_max {
            let image = self.scale.coordinates(&sums);
            let next = self.anderson.propose(&self.scale.coordinates(&self.at), &image);
            step = Some(next).filter(|next| *next != image).map(|next| self.scale.sums(&next));
        }
        if let Some(next) = &step
            && self.coordinator.take(next).is_err()
        {
            self.coordinator.take(&sums)?;
            self.anderson.restart();
            step = None;
        }
        self.is_plain = step.is_none();
        self.at = step.unwrap_or_else(|| sums.clone());
        self.plain = Some(sums);
        Ok(())
    }

    /// Returns the gradient of E by all parameters of the prior: the contribution of the events, and those of the
    /// inducing points and the messages.
    pub(super) fn gradient(
        &self,
        of_events: ShardContribution,
        prior: &Prior,
        likelihood: &Likelihood<'_>,
    ) -> Result<Vec<f64>> {
        if self.phase != Phase::Done {
            return Err(Error::Unfinished);
        }
        let Contribution::Gradient(mut gradient) = of_events.result else { return Err(Error::WrongContribution) };
        if of_events.round != self.round || gradient.len() != prior.parameters().len() {
            return Err(Error::WrongContribution);
        }
        let slope = Slope::new(self.coordinator.cholesky(), self.coordinator.posterior());
        let of_others = slope.of_points_and_messages(&self.coordinator, prior, likelihood)?;
        gradient.iter_mut().zip(of_others).for_each(|(sum, other)| *sum += other);
        Ok(gradient)
    }

    /// Returns the results of the iteration.
    pub(super) fn end(&self) -> &End {
        &self.end
    }

    pub(super) fn into_end(self) -> End {
        self.end
    }
}

/// Scales Ĝ and b̂ to coordinates in which steps of different directions are comparable: units of the initial
/// precision.
struct Scale(Vec<f64>);

impl Scale {
    fn of(sums: &Sums) -> Self {
        Self(sums.precision.diagonal().into_iter().map(|precision| (1.0 + precision).sqrt().recip()).collect())
    }

    /// Returns the entries of the lower triangle, column by column, then b̂. Entries off the diagonal are scaled by √2,
    /// because they occur twice in Ĝ.
    fn coordinates(&self, sums: &Sums) -> Vec<f64> {
        let points = self.0.len();
        let entry = |row: usize, column: usize| sums.precision[(row, column)] * self.of_entry(row, column);
        let triangle = (0..points).flat_map(|column| (column..points).map(move |row| (row, column)));
        let shift = sums.shift.iter().zip(&self.0).map(|(shift, scale)| shift * scale);
        triangle.map(|(row, column)| entry(row, column)).chain(shift).collect()
    }

    fn sums(&self, coordinates: &[f64]) -> Sums {
        let points = self.0.len();
        let (triangle, shift) = coordinates.split_at(coordinates.len() - points);
        let (mut precision, mut entries) = (Matrix::zeros(points, points), triangle.iter());
        for column in 0..points {
            for (row, entry) in (column..points).zip(&mut entries) {
                precision[(row, column)] = entry / self.of_entry(row, column);
            }
        }
        precision.mirror_lower();
        Sums { precision, shift: shift.iter().zip(&self.0).map(|(shift, scale)| shift / scale).collect() }
    }

    fn of_entry(&self, row: usize, column: usize) -> f64 {
        let twice = if row == column { 1.0 } else { std::f64::consts::SQRT_2 };
        twice * self.0[row] * self.0[column]
    }
}
