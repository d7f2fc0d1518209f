//! The events of one shard, and its contributions to a sparse fit.

use std::borrow::Cow;
use std::sync::Arc;

use super::events::{EventCovariances, EventMoments, Site, Walk};
use super::gradient::Slope;
use super::point_posterior::PointPosterior;
use crate::cross::kept_max;
use crate::error::{Error, Result, same_size};
use crate::fit::mean_field::{TILT_MIN, TILT_START, omega, omega_and_ln_2_cosh};
use crate::inputs::Inputs;
use crate::linalg::Cholesky;
use crate::observations::Observations;
use crate::prior::Prior;
use crate::sites::Sites;

/// Some of the events of a sparse fit. Its [`crate::ShardedFit`] needs only sums over them.
///
/// A shard keeps the moments of its events between requests. They save work, but no result depends on them: a new
/// shard with the same events gives the same contribution to the same request, to the bit. Memory is O(N + M²) for N
/// events and M inducing points, plus at most 59 MB of covariances ([`Shard::with_memory`]).
pub struct Shard<'a> {
    observations: Cow<'a, Observations>,
    covariances: EventCovariances,
    /// Initial tilts.
    start: Option<&'a [f64]>,
    mean: Vec<f64>,
    variance: Vec<f64>,
    /// The posterior of `mean` and `variance`; `None` if they have the initial tilts.
    moments_at: Option<Arc<PointPosterior>>,
    /// The tilts of the sites, if `mean` and `variance` have others.
    tilts: Option<Vec<f64>>,
}

/// A request of a [`crate::ShardedFit`] to each of its shards.
#[derive(Debug, Clone)]
pub struct ShardRequest {
    /// Number of earlier requests of the fit.
    pub(super) round: u32,
    pub(super) task: Task,
}

/// The task of a request.
#[derive(Debug, Clone)]
pub(super) enum Task {
    /// Sum up the sites at the initial tilts.
    Begin,
    /// Sum up the sites at a posterior, and compare their tilts with those of the posterior before.
    Walk(Posteriors),
    /// Compute the moments of the events at the last posterior. The tilts of the sites stay.
    Store(Posteriors),
    /// Compute the gradient of E at the last posterior. The tilts are those of the posterior before.
    Gradient(Posteriors),
}

/// The posterior of a request, and the posterior before it.
#[derive(Debug, Clone)]
pub(super) struct Posteriors {
    pub(super) at: Arc<PointPosterior>,
    /// The posterior that gave the tilts; `None` for the initial tilts.
    pub(super) before: Option<Arc<PointPosterior>>,
}

/// The answer of one shard, or of several shards together, to a [`ShardRequest`].
#[derive(Debug, Clone)]
pub struct ShardContribution {
    pub(super) round: u32,
    pub(super) result: Contribution,
}

#[derive(Debug, Clone)]
pub(super) enum Contribution {
    Walk(Walk),
    /// ∂E/∂(log parameters of the kernel, parameters of the prior mean).
    Gradient(Vec<f64>),
    /// The moments were computed; no sums are needed.
    Stored,
}

impl ShardContribution {
    /// Adds up the contributions of all shards, in pairs of neighbours. The order of the shards changes the last digits
    /// of the sum, and must therefore stay the same.
    ///
    /// # Errors
    /// * [`Error::OutOfRange`] without contributions.
    /// * [`Error::WrongContribution`] if they answer different requests, or belong to different numbers of inducing
    ///   points.
    pub fn sum(contributions: Vec<ShardContribution>) -> Result<ShardContribution> {
        let mut level = contributions;
        while level.len() > 1 {
            let mut next = Vec::with_capacity(level.len().div_ceil(2));
            let mut pairs = level.into_iter();
            while let Some(mut first) = pairs.next() {
                if let Some(second) = pairs.next() {
                    first.add(&second)?;
                }
                next.push(first);
            }
            level = next;
        }
        level.pop().ok_or(Error::OutOfRange { what: "number of contributions", expected: "at least 1", value: 0.0 })
    }

    fn add(&mut self, other: &ShardContribution) -> Result<()> {
        if self.round != other.round {
            return Err(Error::WrongContribution);
        }
        match (&mut self.result, &other.result) {
            (Contribution::Walk(sum), Contribution::Walk(other)) if sum.sums.shift.len() == other.sums.shift.len() => {
                sum.merge(other);
            }
            (Contribution::Gradient(sum), Contribution::Gradient(other)) if sum.len() == other.len() => {
                sum.iter_mut().zip(other).for_each(|(sum, other)| *sum += other);
            }
            (Contribution::Stored, Contribution::Stored) => {}
            _ => return Err(Error::WrongContribution),
        }
        Ok(())
    }
}

/// The results of a fit at its events.
pub(super) struct FittedEvents {
    pub(super) sites: Sites,
    pub(super) mean: Vec<f64>,
    pub(super) variance: Vec<f64>,
    pub(super) residual: Vec<f64>,
    pub(super) tilts: Vec<f64>,
    pub(super) weights: Vec<f64>,
}

impl<'a> Shard<'a> {
    /// Creates the shard of some events, for a fit under a prior on the given inducing points. O(NMd + M³).
    ///
    /// # Errors
    /// [`Error::BadColumn`] if the prior needs columns that the events do not have; [`Error::SizeMismatch`] if events
    /// and inducing points have different dimensions; [`Error::NotPositiveDefinite`] if inducing points coincide too
    /// closely for any small jitter.
    pub fn new(prior: &Prior, observations: Cow<'a, Observations>, inducing_points: &Inputs) -> Result<Self> {
        let covariances_max = kept_max(observations.len());
        Self::with_memory(prior, observations, inducing_points, covariances_max)
    }

    /// Creates a shard that keeps at most `covariances_max` covariances in memory, 8 bytes each. Other covariances are
    /// computed again for every request. This bounds the memory of a process with many shards; the contributions have
    /// the same bits.
    ///
    /// # Errors
    /// As [`Shard::new`].
    pub fn with_memory(
        prior: &Prior,
        observations: Cow<'a, Observations>,
        inducing_points: &Inputs,
        covariances_max: usize,
    ) -> Result<Self> {
        same_size("input dimension", inducing_points.dimension(), observations.inputs().dimension())?;
        let cholesky = Cholesky::with_jitter("K_MM", &prior.kernel().gram(inducing_points)?)?;
        let (inputs, cholesky) = (observations.inputs(), Arc::new(cholesky));
        let covariances = EventCovariances::new(prior, inputs, inducing_points, cholesky, covariances_max)?;
        Ok(Self::of_covariances(observations, covariances, None))
    }

    pub(super) fn of_covariances(
        observations: Cow<'a, Observations>,
        covariances: EventCovariances,
        start: Option<&'a [f64]>,
    ) -> Self {
        let mut shard = Self {
            observations,
            covariances,
            start,
            mean: Vec::new(),
            variance: Vec::new(),
            moments_at: None,
            tilts: None,
        };
        shard.set_initial_tilts();
        shard
    }

    /// Returns the contribution of this shard to the sum over all shards. O(NM²).
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for a request of a fit with another number of inducing points.
    pub fn contribute(&mut self, request: &ShardRequest) -> Result<ShardContribution> {
        let result = match &request.task {
            Task::Begin => {
                // A new shard has the initial tilts.
                if self.moments_at.is_some() {
                    self.set_initial_tilts();
                }
                Contribution::Walk(self.begin()?)
            }
            Task::Walk(posteriors) => {
                self.move_to(posteriors)?;
                let walk = self.walk(&posteriors.at, true)?;
                self.moments_at = Some(Arc::clone(&posteriors.at));
                Contribution::Walk(walk)
            }
            Task::Store(posteriors) => {
                self.move_to(posteriors)?;
                self.tilts = Some(self.tilts_of_moments());
                self.walk(&posteriors.at, false)?;
                self.moments_at = Some(Arc::clone(&posteriors.at));
                Contribution::Stored
            }
            Task::Gradient(posteriors) => {
                let is_stored = self.moments_at.as_ref().is_some_and(|found| found.is_same_as(&posteriors.at));
                if !(is_stored && self.tilts.is_some()) {
                    self.move_to(posteriors)?;
                }
                let slope = Slope::new(&self.covariances.cholesky, &posteriors.at);
                let tilts = self.tilts_of_sites();
                Contribution::Gradient(slope.of_events(&self.covariances, &self.observations, &tilts)?)
            }
        };
        Ok(ShardContribution { round: request.round, result })
    }

    /// Returns the number of events of the shard.
    pub fn len(&self) -> usize {
        self.observations.len()
    }

    /// Returns whether the shard has no events.
    pub fn is_empty(&self) -> bool {
        self.observations.is_empty()
    }

    /// Returns the posterior means of f at the events, N, after the last request.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Returns the posterior variances of f at the events, N, after the last request.
    pub fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// Returns the Gaussian sites of the events after the last request.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if the latent function is so far from zero that ω vanishes.
    pub fn sites(&self) -> Result<Sites> {
        sites_at(&self.observations, &self.tilts_of_sites())
    }

    /// Converts the shard to its results. Covariances are dropped first, because they need more memory than the
    /// results.
    pub(super) fn into_events(self) -> Result<FittedEvents> {
        let tilts = self.tilts_of_sites().into_owned();
        let Self { observations, covariances, mean, variance, .. } = self;
        let residual = covariances.into_residual();
        let (sites, weights) = (sites_at(&observations, &tilts)?, observations.weights().to_vec());
        Ok(FittedEvents { sites, mean, variance, residual, tilts, weights })
    }

    fn tilts_of_sites(&self) -> Cow<'_, [f64]> {
        self.tilts.as_deref().map_or_else(|| Cow::Owned(self.tilts_of_moments()), Cow::Borrowed)
    }

    fn set_initial_tilts(&mut self) {
        self.mean = self.start.map_or_else(|| vec![TILT_START; self.len()], <[f64]>::to_vec);
        self.variance = vec![0.0; self.len()];
        (self.moments_at, self.tilts) = (None, None);
    }

    fn tilts_of_moments(&self) -> Vec<f64> {
        self.mean.iter().zip(&self.variance).map(|(&mean, &variance)| tilt(mean, variance)).collect()
    }

    /// Makes the first walk: the sites at the initial tilts.
    fn begin(&mut self) -> Result<Walk> {
        let (observations, start) = (&self.observations, self.start);
        let tilt = |n: usize| start.map_or(TILT_START, |start| start[n]).max(TILT_MIN);
        let rule = |n: usize| (omega(observations.weights()[n], tilt(n)), observations.kappa_of(n));
        self.covariances.begin(observations.inputs(), rule)
    }

    /// Computes the moments at the posterior before a request, unless the last request has left them.
    fn move_to(&mut self, Posteriors { at, before }: &Posteriors) -> Result<()> {
        same_size("inducing points of the request", self.covariances.points.len(), at.weights.len())?;
        if !self.covariances.has_begun() {
            self.begin()?;
        }
        let has_moments = match (&self.moments_at, before) {
            (None, None) => true,
            (Some(found), Some(before)) => found.is_same_as(before),
            _ => false,
        };
        if has_moments && self.tilts.is_none() {
            return Ok(());
        }
        self.set_initial_tilts();
        if let Some(before) = before {
            same_size("inducing points of the request", self.covariances.points.len(), before.weights.len())?;
            self.walk(before, false)?;
            self.moments_at = Some(Arc::clone(before));
        }
        Ok(())
    }

    /// Computes the moments of all events at a posterior, and the sums of their sites if `has_sites`.
    fn walk(&mut self, at: &PointPosterior, has_sites: bool) -> Result<Walk> {
        let (observations, state) = (&self.observations, [&mut self.mean[..], &mut self.variance[..]]);
        self.covariances.walk(observations.inputs(), at, state, |n, event, moments| {
            if has_sites {
                return move_site(observations, n, event, moments);
            }
            event.store_in(moments);
            Site { omega: 0.0, kappa: 0.0, bound: 0.0, change: 0.0 }
        })
    }
}

/// Returns the sites of events at their tilts.
fn sites_at(observations: &Observations, tilts: &[f64]) -> Result<Sites> {
    let weights = observations.weights().iter();
    Sites::new(observations, weights.zip(tilts).map(|(&weight, &tilt)| omega(weight, tilt)).collect())
}

/// Returns the tilt c = √E\[f²\].
fn tilt(mean: f64, variance: f64) -> f64 {
    (mean * mean + variance).sqrt().max(TILT_MIN)
}

/// Returns the site of an event at its posterior moments, with its terms of E and the change of its tilt.
fn move_site(observations: &Observations, n: usize, event: &EventMoments, [mean, variance]: [&mut f64; 2]) -> Site {
    let before = tilt(*mean, *variance);
    event.store_in([&mut *mean, &mut *variance]);
    let after = tilt(*mean, *variance);
    let (weight, kappa) = (observations.weights()[n], observations.kappa_of(n));
    let (omega, ln_2_cosh) = omega_and_ln_2_cosh(weight, after);
    let tilted = 0.5 * omega * (after * after - event.residual) - weight * ln_2_cosh;
    let about_mean = (kappa - 0.5 * omega * event.prior_mean) * event.prior_mean;
    Site { omega, kappa, bound: tilted + about_mean, change: (after - before).abs() }
}
