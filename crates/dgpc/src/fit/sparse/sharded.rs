//! A sparse fit whose events lie in shards, in other processes or on other machines.

use super::coordinator::Coordinator;
use super::iteration::Iteration;
use super::shard::{ShardContribution, ShardRequest};
use crate::error::{Error, Result};
use crate::fit::options::FitOptions;
use crate::fit::posterior::posterior_of;
use crate::fit::stagnation::FitStop;
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// A sparse fit of events that lie in several shards, none of which sees the events of another.
///
/// In each round, every shard receives the same [`ShardRequest`] and answers it with a [`ShardContribution`]. A request
/// has at most M² + 3M + 4 numbers and a contribution M(M + 3)/2 + 5 numbers, for M inducing points. The result equals
/// that of [`crate::fit`] for all events, up to the convergence error.
///
/// ```
/// use std::borrow::Cow;
///
/// use dgpc::{
///     FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Shard, ShardContribution, ShardedFit, Term,
/// };
///
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 1.0, 1)?])?;
/// let prior = Prior::new(kernel, PriorMean::Zero)?;
/// let points = Inputs::from_rows(&[[0.0], [1.0], [2.0], [3.0]])?;
/// let one = Observations::new(Inputs::from_rows(&[[0.1], [0.9]])?, vec![true, true])?;
/// let other = Observations::new(Inputs::from_rows(&[[2.1], [2.9], [3.1]])?, vec![false, false, true])?;
///
/// // The shards would run on workers, which receive requests and send contributions as lists of numbers.
/// let mut shards = [Shard::new(&prior, Cow::Owned(one), &points)?, Shard::new(&prior, Cow::Owned(other), &points)?];
/// let mut fit = ShardedFit::new(&prior, &FitOptions::default().inducing_points(&points))?;
/// while let Some(request) = fit.request() {
///     let contributions = shards.iter_mut().map(|shard| shard.contribute(&request)).collect::<Result<Vec<_>, _>>()?;
///     fit.absorb(ShardContribution::sum(contributions)?)?;
/// }
/// let probability = fit.posterior()?.probability(&Inputs::from_rows(&[[0.5], [2.5]])?)?;
/// assert!(probability[0] > 0.5 && probability[1] < 0.5);
/// # Ok::<(), dgpc::Error>(())
/// ```
pub struct ShardedFit {
    prior: Prior,
    points: Inputs,
    messages: Vec<Summary>,
    iteration: Iteration<'static>,
}

impl ShardedFit {
    /// Creates the fit before its first request. The options must contain inducing points, and no tilts to start from.
    /// The inducing points of the messages are added to the inducing points, so that shards must be created with
    /// [`ShardedFit::inducing_points`]. The monitor of the options is not called, because the caller sees every round.
    /// O(M³).
    ///
    /// # Errors
    /// As [`crate::fit`]; [`Error::OutOfRange`] without inducing points.
    pub fn new(prior: &Prior, options: &FitOptions<'_>) -> Result<Self> {
        options.check(0)?;
        let none = Error::OutOfRange { what: "number of inducing points", expected: "at least 1", value: 0.0 };
        let points = options.support()?.filter(|points| !points.is_empty()).ok_or(none)?;
        let events = no_events(&points)?;
        let coordinator = Coordinator::new(prior, &Likelihood::new(&events, options.messages)?, &points)?;
        let rule = FitOptions::default().tolerance(options.tolerance).iterations_max(options.iterations_max);
        let messages = options.messages.iter().map(|&message| message.clone()).collect();
        Ok(Self { prior: prior.clone(), points, messages, iteration: Iteration::new(coordinator, &rule) })
    }

    /// Returns the inducing points, with those of the messages.
    pub fn inducing_points(&self) -> &Inputs {
        &self.points
    }

    /// Returns the next request to all shards, or `None` at the end of the fit.
    pub fn request(&self) -> Option<ShardRequest> {
        self.iteration.request()
    }

    /// Absorbs the sum of all contributions to the present request ([`ShardContribution::sum`]). O(M³).
    ///
    /// # Errors
    /// As [`crate::fit`]; [`Error::WrongContribution`] for the answer to another request.
    pub fn absorb(&mut self, sum: ShardContribution) -> Result<()> {
        self.iteration.absorb(sum)
    }

    /// Returns the request for the gradient of E at the end of the fit.
    pub fn gradient_request(&self) -> ShardRequest {
        self.iteration.gradient_request()
    }

    /// Returns ∂E/∂θ for every θ of [`Prior::parameter_values`], from the sum of the contributions to
    /// [`ShardedFit::gradient_request`]. O(M³).
    ///
    /// # Errors
    /// [`Error::Unfinished`] before the end of the fit; [`Error::WrongContribution`] for the answer to another request.
    pub fn gradient(&self, sum: ShardContribution) -> Result<Vec<f64>> {
        let events = no_events(&self.points)?;
        self.iteration.gradient(sum, &self.prior, &Likelihood::new(&events, &self.messages())?)
    }

    /// Returns the summary of the events at the inducing points, after the end of the fit.
    ///
    /// # Errors
    /// [`Error::Unfinished`] before the end of the fit; as [`Posterior::fuse`].
    pub fn summary(&self) -> Result<Summary> {
        if self.request().is_some() {
            return Err(Error::Unfinished);
        }
        let sums = &self.iteration.end().sums;
        Summary::from_whitened(&self.prior, &self.points, sums.precision.clone(), sums.shift.clone())
    }

    /// Returns the posterior of the events and the messages, after the end of the fit.
    ///
    /// # Errors
    /// As [`ShardedFit::summary`].
    pub fn posterior(&self) -> Result<Posterior> {
        let no_sites = Sites::empty(self.points.dimension());
        posterior_of(&self.prior, &no_sites, Some(&self.summary()?), &self.messages())
    }

    fn messages(&self) -> Vec<&Summary> {
        self.messages.iter().collect()
    }

    /// Returns the evidence bound E after the last walk, in nats.
    pub fn evidence(&self) -> f64 {
        self.iteration.end().evidence
    }

    /// Returns the number of iterations.
    pub fn iterations(&self) -> usize {
        self.iteration.end().iterations
    }

    /// Returns the largest change of a tilt in the last iteration.
    pub fn change(&self) -> f64 {
        self.iteration.end().change
    }

    /// Returns the reason why the iteration ended, or `None` before its end.
    pub fn stop(&self) -> Option<FitStop> {
        self.request().is_none().then(|| self.iteration.end().stop)
    }

    /// Returns the jitter on the diagonal of K_MM.
    pub fn jitter(&self) -> f64 {
        self.iteration.end().jitter
    }
}

fn no_events(points: &Inputs) -> Result<Observations> {
    Observations::new(Inputs::empty(points.dimension()), Vec::new())
}
