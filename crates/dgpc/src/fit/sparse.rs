//! The Gaussian posterior of sites on M inducing points: what a walk over the events makes of it, block by block
//! (sections 2 and 3 of [`crate::method`]).

use std::ops::Range;

use crate::cross::{Cross, Sums};
use crate::error::{Result, all_finite};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::linalg::{Cholesky, Matrix, products_and_squared_norms, squared_norm, squared_norms_of_rows};
use crate::parts::{BLOCK, blocks, on_parts};
use crate::prior::Prior;

/// An event as a walk finds it.
pub(super) struct Seen {
    pub(super) prior_mean: f64,
    /// Posterior mean of f.
    pub(super) mean: f64,
    /// Posterior variance of what inducing points explain of f.
    pub(super) explained: f64,
    /// Prior variance that inducing points leave unexplained.
    pub(super) residual: f64,
}

impl Seen {
    /// Posterior mean and variance of f.
    pub(super) fn note_moments(&self, [mean, variance]: [&mut f64; 2]) {
        (*mean, *variance) = (self.mean, self.residual + self.explained);
    }
}

/// What is made of it.
pub(super) struct Site {
    /// The site exp(κf − ½ωf²).
    pub(super) omega: f64,
    pub(super) kappa: f64,
    /// A term of a sum, and how large the change is.
    pub(super) bound: f64,
    pub(super) change: f64,
}

/// What a walk over the events found.
pub(super) struct Walk {
    /// Ĝ and b̂ of the events' new sites.
    pub(super) said: Sums,
    /// Sum of what the rule said, and the largest change.
    pub(super) bound: f64,
    pub(super) change: f64,
}

/// A posterior is S = I + Ĝ and b̂ in whitened form, Ĝ = ΦᵀΩΦ, b̂ = Φᵀκ̃, Φ = K_NM L⁻ᵀ.
///
/// With S = L_S·L_Sᵀ the features ψ = (L·L_S)⁻¹k of an event have all that is asked for: its posterior mean is (L_S⁻¹b̂)ᵀψ, its explained
/// variance ‖ψ‖², and Σ ωψψᵀ is the next Ĝ seen from this posterior. So a walk that looks at every event once goes from one
/// posterior to the next, and needs nothing of the walk before.
pub(super) struct Sparse<'a> {
    pub(super) points: &'a Inputs,
    pub(super) cross: Cross<'a>,
    /// K_MM = LLᵀ.
    pub(super) cholesky: Cholesky,
    /// At the events.
    pub(super) prior_mean: Vec<f64>,
    /// Prior variance of each event that inducing points leave unexplained.
    pub(super) residual: Vec<f64>,
    pub(super) messages: Messages,
    /// Ĝ, of events and messages.
    pub(super) precision: Matrix,
    /// L_S.
    pub(super) inner: Cholesky,
    /// L_S⁻¹b̂.
    pub(super) weights: Vec<f64>,
}

/// What others said, which stays as it is.
pub(super) struct Messages {
    /// Φ of what they observed.
    pub(super) features: Matrix,
    /// κ̃ of it; ω is 1.
    pub(super) shift: Vec<f64>,
    /// Ĝ and b̂.
    said: Sums,
    /// Its terms of E.
    pub(super) bound: f64,
}

impl Messages {
    /// `prior_mean` of what they observed.
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
        let mut said = Sums::zeros(points.len());
        said.add(&features, &vec![1.0; shift.len()], &shift, &mut Matrix::default());
        said.precision.mirror_lower();
        Ok(Self { features, shift, said, bound })
    }
}

impl<'a> Sparse<'a> {
    /// Nothing said yet of the events, nothing heard.
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

    /// The first walk, from the prior: every event has the ω and κ that `rule` says. Finds what inducing points leave unexplained.
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

    /// Looks at every event once: `rule` gets its number, what this posterior says of it, and its numbers of `state`, which it may
    /// change, and says its site. O(NM²).
    pub(super) fn walk<const K: usize>(
        &self,
        state: [&mut [f64]; K],
        rule: impl Fn(usize, &Seen, [&mut f64; K]) -> Site + Sync,
    ) -> Result<Walk> {
        self.visit(state, |n, pull, explained, state| {
            let (prior_mean, residual) = (self.prior_mean[n], self.residual[n]);
            rule(n, &Seen { prior_mean, mean: prior_mean + pull, explained, residual }, state)
        })
    }

    /// The same by the posterior mean about the prior mean and the explained variance alone.
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
        let mut total = Walk { said: Sums::zeros(self.points.len()), bound: 0.0, change: 0.0 };
        for walk in walks {
            let walk = walk?;
            total.said.merge(&walk.said);
            total.bound += walk.bound;
            total.change = f64::max(total.change, walk.change);
        }
        // From this posterior's point of view to the prior's.
        total.said.precision.mirror_lower();
        total.said.precision = self.inner.unwhiten(&total.said.precision);
        total.said.shift = self.inner.lower_times(&total.said.shift);
        Ok(total)
    }

    fn visit_part<const K: usize>(
        &self,
        outer: &Cholesky,
        part: Range<usize>,
        mut state: [&mut [f64]; K],
        rule: &impl Fn(usize, f64, f64, [&mut f64; K]) -> Site,
    ) -> Result<Walk> {
        let (first, mut walk) = (part.start, Walk { said: Sums::zeros(self.points.len()), bound: 0.0, change: 0.0 });
        let (mut features, mut room) = (Matrix::default(), Matrix::default());
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
            walk.said.add(&features, &omega, &shift, &mut room);
        }
        Ok(walk)
    }

    /// Takes the posterior of what events and messages say, `said` being the events' part. O(M³).
    pub(super) fn take(&mut self, said: &Sums) -> Result<()> {
        self.precision.copy_from(&said.precision);
        self.precision.add_scaled(1.0, &self.messages.said.precision);
        let mut s = self.precision.clone();
        s.add_to_diagonal(1.0);
        self.inner = Cholesky::new("I + ΦᵀΩΦ", s)?;
        self.weights = said.shift.iter().zip(&self.messages.said.shift).map(|(own, others)| own + others).collect();
        self.inner.solve_lower(&mut self.weights);
        all_finite("whitened posterior mean", &self.weights)?;
        Ok(())
    }

    /// E of the posterior and the sites that it is of, with `bound` the sum over these of what depends on each alone.
    pub(super) fn evidence(&self, bound: f64) -> f64 {
        0.5 * squared_norm(&self.weights) - 0.5 * self.inner.log_determinant() + bound + self.messages.bound
    }
}
