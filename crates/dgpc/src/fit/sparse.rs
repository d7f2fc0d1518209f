//! The Gaussian posterior of sites on M inducing points, and its update by a walk over the events, block by block
//! ([`crate::method::inference`] and [`crate::method::summaries`]).

use std::ops::Range;

use crate::cross::{Cross, Sums};
use crate::error::{Result, all_finite};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::linalg::{Cholesky, Matrix, products_and_squared_norms, squared_norm, squared_norms_of_rows};
use crate::parts::{BLOCK, blocks, on_parts};
use crate::prior::Prior;

/// Moments of f at an event, as a walk computes them.
pub(super) struct EventMoments {
    pub(super) prior_mean: f64,
    /// Posterior mean of f.
    pub(super) mean: f64,
    /// Posterior variance of the part of f that the inducing points explain.
    pub(super) explained: f64,
    /// Prior variance that the inducing points leave unexplained.
    pub(super) residual: f64,
}

impl EventMoments {
    /// Stores the posterior mean and variance of f.
    pub(super) fn store_in(&self, [mean, variance]: [&mut f64; 2]) {
        (*mean, *variance) = (self.mean, self.residual + self.explained);
    }
}

/// The new site of an event.
pub(super) struct Site {
    /// The site exp(κf − ½ωf²).
    pub(super) omega: f64,
    pub(super) kappa: f64,
    /// The event's terms of the bound E, and the change of its site or tilt.
    pub(super) bound: f64,
    pub(super) change: f64,
}

/// The result of a walk over the events.
pub(super) struct Walk {
    /// Ĝ and b̂ of the events' new sites.
    pub(super) sums: Sums,
    /// Sum of the sites' bounds, and their largest change.
    pub(super) bound: f64,
    pub(super) change: f64,
}

/// A posterior on inducing points, whitened: S = I + Ĝ and b̂, with Ĝ = ΦᵀΩΦ, b̂ = Φᵀκ̃ and Φ = K_NM L⁻ᵀ.
///
/// With S = L_S·L_Sᵀ, the features ψ = (L·L_S)⁻¹k of an event give all its moments. The posterior mean is (L_S⁻¹b̂)ᵀψ,
/// and the explained variance is ‖ψ‖². The sum Σ ωψψᵀ is the next Ĝ in the coordinates of this posterior. A walk that
/// visits every event once therefore leads from one posterior to the next, and needs no result of the walk before.
pub(super) struct Sparse<'a> {
    pub(super) points: &'a Inputs,
    pub(super) cross: Cross<'a>,
    /// K_MM = LLᵀ.
    pub(super) cholesky: Cholesky,
    /// Prior mean at the events.
    pub(super) prior_mean: Vec<f64>,
    /// Prior variance of each event that the inducing points leave unexplained.
    pub(super) residual: Vec<f64>,
    pub(super) messages: Messages,
    /// Ĝ, of events and messages.
    pub(super) precision: Matrix,
    /// L_S.
    pub(super) inner: Cholesky,
    /// L_S⁻¹b̂.
    pub(super) weights: Vec<f64>,
}

/// The messages of peers, which stay fixed.
pub(super) struct Messages {
    /// Φ of the messages' observations.
    pub(super) features: Matrix,
    /// κ̃ of the messages' observations, whose ω is 1.
    pub(super) shift: Vec<f64>,
    /// Ĝ and b̂ of the messages.
    sums: Sums,
    /// The messages' terms of E.
    pub(super) bound: f64,
}

impl Messages {
    /// Condenses the messages at `points`. `prior_mean` is the prior mean of the messages' observations.
    fn new(
        prior: &Prior,
        likelihood: &Likelihood<'_>,
        prior_mean: &[f64],
        points: &Inputs,
        cholesky: &Cholesky,
    ) -> Result<Self> {
        let mut features = likelihood.message_cross(prior.kernel(), points)?;
        cholesky.solve_rows(&mut features);
        let (mut bound, mut shift) = (0.0, Vec::with_capacity(features.rows()));
        let diagonal = likelihood.message_diagonal(prior.kernel())?;
        let unexplained =
            diagonal.into_iter().zip(squared_norms_of_rows(&features)).map(|(k, explained)| k - explained);
        for ((unexplained, kappa), mean) in unexplained.zip(likelihood.message_kappa()).zip(prior_mean) {
            shift.push(kappa - mean);
            bound += (kappa - 0.5 * mean) * mean - 0.5 * unexplained.max(0.0);
        }
        let mut sums = Sums::zeros(points.len());
        sums.add(&features, &vec![1.0; shift.len()], &shift, &mut Matrix::default());
        sums.precision.mirror_lower();
        Ok(Self { features, shift, sums, bound })
    }
}

impl<'a> Sparse<'a> {
    /// Creates the engine at the prior, without the sites of the events and the messages.
    pub(super) fn new(prior: &'a Prior, likelihood: &Likelihood<'a>, points: &'a Inputs) -> Result<Self> {
        let cholesky = Cholesky::with_jitter("K_MM", &prior.kernel().gram(points)?)?;
        let cross = Cross::new(prior.kernel(), points, likelihood.observations.inputs())?.kept()?;
        let mut prior_mean = likelihood.prior_mean(prior.mean())?;
        let of_messages = prior_mean.split_off(likelihood.events());
        let messages = Messages::new(prior, likelihood, &of_messages, points, &cholesky)?;
        let (precision, inner) = (Matrix::zeros(points.len(), points.len()), Cholesky::of_identity(points.len()));
        let (residual, weights) = (Vec::new(), vec![0.0; points.len()]);
        Ok(Self { points, cross, cholesky, prior_mean, residual, messages, precision, inner, weights })
    }

    /// Makes the first walk, from the prior: `rule` gives the ω and κ of every event. The walk also computes the
    /// variances that the inducing points leave unexplained.
    pub(super) fn begin(&mut self, prior: &Prior, rule: impl Fn(usize) -> (f64, f64) + Sync) -> Result<Walk> {
        let inputs = self.cross.inputs();
        let diagonals = on_parts(self.cross.parts(), |part| prior.kernel().diagonal(&inputs.slice(part)));
        let mut residual = diagonals.into_iter().collect::<Result<Vec<_>>>()?.concat();
        let walk = self.visit([&mut residual], |n, _, explained, [residual]| {
            *residual = (*residual - explained).max(0.0);
            let (omega, kappa) = rule(n);
            Site { omega, kappa, bound: 0.0, change: 0.0 }
        })?;
        self.residual = residual;
        Ok(walk)
    }

    /// Visits every event once and sums up the new sites. O(NM²).
    ///
    /// `rule` receives the event's index, its moments under this posterior and its entries of `state`, which it may
    /// change. It returns the event's new site.
    pub(super) fn walk<const K: usize>(
        &self,
        state: [&mut [f64]; K],
        rule: impl Fn(usize, &EventMoments, [&mut f64; K]) -> Site + Sync,
    ) -> Result<Walk> {
        self.visit(state, |n, pull, explained, state| {
            let (prior_mean, residual) = (self.prior_mean[n], self.residual[n]);
            rule(n, &EventMoments { prior_mean, mean: prior_mean + pull, explained, residual }, state)
        })
    }

    /// Visits every event as [`Sparse::walk`] does. `rule` receives only the posterior mean minus the prior mean, and
    /// the explained variance.
    fn visit<const K: usize>(
        &self,
        mut state: [&mut [f64]; K],
        rule: impl Fn(usize, f64, f64, [&mut f64; K]) -> Site + Sync,
    ) -> Result<Walk> {
        let mut shares = Vec::new();
        for part in self.cross.parts() {
            let share = state.each_mut().map(|left| left.split_off_mut(..part.len()).unwrap_or_default());
            shares.push((part, share));
        }
        let outer = self.cholesky.times(&self.inner);
        let walks = on_parts(shares, |(part, share)| self.visit_part(&outer, part, share, &rule));
        let mut total = Walk { sums: Sums::zeros(self.points.len()), bound: 0.0, change: 0.0 };
        for walk in walks {
            let walk = walk?;
            total.sums.merge(&walk.sums);
            total.bound += walk.bound;
            total.change = f64::max(total.change, walk.change);
        }
        // Transform the sums from the coordinates of this posterior to those of the prior.
        total.sums.precision.mirror_lower();
        total.sums.precision = self.inner.unwhiten(&total.sums.precision);
        total.sums.shift = self.inner.lower_times(&total.sums.shift);
        Ok(total)
    }

    fn visit_part<const K: usize>(
        &self,
        outer: &Cholesky,
        part: Range<usize>,
        mut state: [&mut [f64]; K],
        rule: &impl Fn(usize, f64, f64, [&mut f64; K]) -> Site,
    ) -> Result<Walk> {
        let (first, mut walk) = (part.start, Walk { sums: Sums::zeros(self.points.len()), bound: 0.0, change: 0.0 });
        let (mut features, mut scratch) = (Matrix::default(), Matrix::default());
        let (mut omega, mut shift) = (Vec::with_capacity(BLOCK), Vec::with_capacity(BLOCK));
        for block in blocks(part) {
            self.cross.write_features(block.clone(), outer, &mut features)?;
            let (pulls, explained) = products_and_squared_norms(&features, &self.weights);
            omega.clear();
            shift.clear();
            for (n, (pull, explained)) in block.zip(pulls.into_iter().zip(explained)) {
                let site = rule(n, pull, explained, state.each_mut().map(|column| &mut column[n - first]));
                omega.push(site.omega);
                // κ̃ = κ − ωμ₀.
                shift.push(site.kappa - site.omega * self.prior_mean[n]);
                walk.bound += site.bound;
                walk.change = f64::max(walk.change, site.change);
            }
            walk.sums.add(&features, &omega, &shift, &mut scratch);
        }
        Ok(walk)
    }

    /// Sets the posterior to that of the messages and of the events with the given sums. O(M³).
    pub(super) fn take(&mut self, sums: &Sums) -> Result<()> {
        self.precision.copy_from(&sums.precision);
        self.precision.add_scaled(1.0, &self.messages.sums.precision);
        let mut s = self.precision.clone();
        s.add_to_diagonal(1.0);
        self.inner = Cholesky::new("I + ΦᵀΩΦ", s)?;
        self.weights = sums.shift.iter().zip(&self.messages.sums.shift).map(|(own, others)| own + others).collect();
        self.inner.solve_lower(&mut self.weights);
        all_finite("whitened posterior mean", &self.weights)?;
        Ok(())
    }

    /// Returns E at the posterior and its sites. `bound` is the sum of the terms that depend on single sites.
    pub(super) fn evidence(&self, bound: f64) -> f64 {
        0.5 * squared_norm(&self.weights) - 0.5 * self.inner.log_determinant() + bound + self.messages.bound
    }
}
