//! Walks over events at the inducing points of a sparse fit, block by block.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use super::point_posterior::PointPosterior;
use crate::cross::{Cross, Sums};
use crate::error::Result;
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, products_and_squared_norms};
use crate::parts::{BLOCK, blocks, on_parts};
use crate::prior::Prior;

/// Moments of f at an event, as a walk computes them.
pub(crate) struct EventMoments {
    pub(crate) prior_mean: f64,
    /// Posterior mean of f.
    pub(crate) mean: f64,
    /// Posterior variance of the part of f that the inducing points explain.
    pub(crate) explained: f64,
    /// Prior variance that the inducing points leave unexplained.
    pub(crate) residual: f64,
}

impl EventMoments {
    /// Stores the posterior mean and variance of f.
    pub(super) fn store_in(&self, [mean, variance]: [&mut f64; 2]) {
        (*mean, *variance) = (self.mean, self.residual + self.explained);
    }
}

/// The new site of an event.
pub(crate) struct Site {
    /// The site exp(κf − ½ωf²).
    pub(crate) omega: f64,
    pub(crate) kappa: f64,
    /// The event's terms of the bound E, and the change of its site or tilt.
    pub(crate) bound: f64,
    pub(crate) change: f64,
}

/// The result of a walk over the events.
#[derive(Debug, Clone)]
pub(crate) struct Walk {
    /// Ĝ and b̂ of the events' new sites.
    pub(crate) sums: Sums,
    /// Sum of the sites' bounds, and their largest change.
    pub(crate) bound: f64,
    pub(crate) change: f64,
}

impl Walk {
    pub(super) fn of_no_events(points: usize) -> Self {
        Self { sums: Sums::zeros(points), bound: 0.0, change: 0.0 }
    }

    /// Adds the result of a walk over other events.
    pub(super) fn merge(&mut self, other: &Walk) {
        self.sums.merge(&other.sums);
        self.bound += other.bound;
        self.change = f64::max(self.change, other.change);
    }
}

/// The prior moments of events, and their covariances with the inducing points.
pub(crate) struct EventCovariances {
    pub(super) prior: Prior,
    pub(super) points: Inputs,
    /// K_MM = LLᵀ.
    pub(super) cholesky: Arc<Cholesky>,
    /// The first blocks of K_NM.
    kept: Vec<Matrix>,
    /// Prior mean at the events.
    pub(super) prior_mean: Vec<f64>,
    /// Prior variance of each event that the inducing points leave unexplained; empty before the first walk.
    residual: Vec<f64>,
}

impl EventCovariances {
    /// Computes the prior means, and the covariances that are kept in memory: at most `kept_max` numbers. O(NMd).
    pub(crate) fn new(
        prior: &Prior,
        inputs: &Inputs,
        points: &Inputs,
        cholesky: Arc<Cholesky>,
        kept_max: usize,
    ) -> Result<Self> {
        let kept = Cross::new(prior.kernel(), points, inputs)?.kept(kept_max)?.into_kept();
        let prior_mean = prior.mean().values(inputs)?;
        Ok(Self { prior: prior.clone(), points: points.clone(), cholesky, kept, prior_mean, residual: Vec::new() })
    }

    /// Returns the covariances of the events at `inputs`, for which this was created.
    pub(super) fn cross<'a>(&'a self, inputs: &'a Inputs) -> Cross<'a> {
        Cross::of_kept(self.prior.kernel(), &self.points, inputs, Cow::Borrowed(&self.kept))
    }

    /// Returns whether the first walk was made.
    pub(super) fn has_begun(&self) -> bool {
        self.residual.len() == self.prior_mean.len()
    }

    pub(super) fn into_residual(self) -> Vec<f64> {
        self.residual
    }

    /// Makes the first walk, from the prior: `rule` gives the ω and κ of every event. The walk also computes the
    /// variances that the inducing points leave unexplained.
    pub(crate) fn begin(&mut self, inputs: &Inputs, rule: impl Fn(usize) -> (f64, f64) + Sync) -> Result<Walk> {
        let parts = self.cross(inputs).parts();
        let diagonals = on_parts(parts, |part| self.prior.kernel().diagonal(&inputs.slice(part)));
        let mut residual = diagonals.into_iter().collect::<Result<Vec<_>>>()?.concat();
        let from = PointPosterior::prior(self.points.len());
        let walk = self.visit(inputs, &from, [&mut residual], |n, _, explained, [residual]| {
            *residual = (*residual - explained).max(0.0);
            let (omega, kappa) = rule(n);
            Site { omega, kappa, bound: 0.0, change: 0.0 }
        })?;
        self.residual = residual;
        Ok(walk)
    }

    /// Visits every event once, and sums up the new sites. The first walk must have been made. O(NM²).
    ///
    /// `rule` receives the event's index, its moments under the posterior and its entries of `state`, which it may
    /// change. It returns the event's new site.
    pub(crate) fn walk<const K: usize>(
        &self,
        inputs: &Inputs,
        posterior: &PointPosterior,
        state: [&mut [f64]; K],
        rule: impl Fn(usize, &EventMoments, [&mut f64; K]) -> Site + Sync,
    ) -> Result<Walk> {
        self.visit(inputs, posterior, state, |n, pull, explained, state| {
            let (prior_mean, residual) = (self.prior_mean[n], self.residual[n]);
            rule(n, &EventMoments { prior_mean, mean: prior_mean + pull, explained, residual }, state)
        })
    }

    /// Visits every event as [`EventCovariances::walk`] does. `rule` receives only the posterior mean minus the prior
    /// mean, and the explained variance.
    fn visit<const K: usize>(
        &self,
        inputs: &Inputs,
        posterior: &PointPosterior,
        mut state: [&mut [f64]; K],
        rule: impl Fn(usize, f64, f64, [&mut f64; K]) -> Site + Sync,
    ) -> Result<Walk> {
        let (cross, mut shares) = (self.cross(inputs), Vec::new());
        for part in cross.parts() {
            let share = state.each_mut().map(|left| left.split_off_mut(..part.len()).unwrap_or_default());
            shares.push((part, share));
        }
        let walker = Walker { covariances: self, cross, posterior, outer: self.cholesky.times(&posterior.inner) };
        let walks = on_parts(shares, |(part, share)| walker.visit_part(part, share, &rule));
        let mut total = Walk::of_no_events(self.points.len());
        for walk in walks {
            total.merge(&walk?);
        }
        // Transform the sums from the coordinates of this posterior to those of the prior.
        total.sums.precision.mirror_lower();
        total.sums.precision = posterior.inner.unwhiten(&total.sums.precision);
        total.sums.shift = posterior.inner.lower_times(&total.sums.shift);
        Ok(total)
    }
}

/// A walk under one posterior.
struct Walker<'a> {
    covariances: &'a EventCovariances,
    cross: Cross<'a>,
    posterior: &'a PointPosterior,
    /// L·L_S.
    outer: Cholesky,
}

impl Walker<'_> {
    fn visit_part<const K: usize>(
        &self,
        part: Range<usize>,
        mut state: [&mut [f64]; K],
        rule: &impl Fn(usize, f64, f64, [&mut f64; K]) -> Site,
    ) -> Result<Walk> {
        let (first, mut walk) = (part.start, Walk::of_no_events(self.posterior.weights.len()));
        let (mut features, mut scratch) = (Matrix::default(), Matrix::default());
        let (mut omega, mut shift) = (Vec::with_capacity(BLOCK), Vec::with_capacity(BLOCK));
        for block in blocks(part) {
            self.cross.write_features(block.clone(), &self.outer, &mut features)?;
            let (pulls, explained) = products_and_squared_norms(&features, &self.posterior.weights);
            omega.clear();
            shift.clear();
            for (n, (pull, explained)) in block.zip(pulls.into_iter().zip(explained)) {
                let site = rule(n, pull, explained, state.each_mut().map(|column| &mut column[n - first]));
                omega.push(site.omega);
                // κ̃ = κ − ωμ₀.
                shift.push(site.kappa - site.omega * self.covariances.prior_mean[n]);
                walk.bound += site.bound;
                walk.change = f64::max(walk.change, site.change);
            }
            walk.sums.add(&features, &omega, &shift, &mut scratch);
        }
        Ok(walk)
    }
}
