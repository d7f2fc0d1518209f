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

/// What is known and said of one event.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    pub(super) prior_mean: f64,
    /// Prior variance that inducing points leave unexplained.
    pub(super) residual: f64,
    /// Posterior moments of f.
    pub(super) mean: f64,
    pub(super) variance: f64,
    /// The site exp(κf − ½ωf²).
    pub(super) omega: f64,
    pub(super) kappa: f64,
}

impl Site {
    /// κ̃ = κ − ωμ₀.
    pub(super) fn shift(&self) -> f64 {
        self.kappa - self.omega * self.prior_mean
    }
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
    pub(super) sites: Vec<Site>,
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
    fn new(prior: &Prior, likelihood: &Likelihood<'_>, points: &Inputs, cholesky: &Cholesky) -> Result<Self> {
        let mut features = likelihood.message_cross(prior.kernel(), points)?;
        cholesky.solve_rows(&mut features);
        let (kappa, mean) = (likelihood.kappa(), likelihood.prior_mean(prior.mean())?);
        let (mut bound, mut shift) = (0.0, Vec::with_capacity(features.rows()));
        let diagonal = likelihood.message_diagonal(prior.kernel())?;
        let explained = squared_norms_of_rows(&features);
        for (row, (diagonal, explained)) in diagonal.into_iter().zip(explained).enumerate() {
            let (kappa, mean) = (kappa[likelihood.events() + row], mean[likelihood.events() + row]);
            shift.push(kappa - mean);
            bound += (kappa - 0.5 * mean) * mean - 0.5 * (diagonal - explained).max(0.0);
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
        let messages = Messages::new(prior, likelihood, points, &cholesky)?;
        let (kappa, prior_mean) = (likelihood.kappa(), likelihood.prior_mean(prior.mean())?);
        let site = |n: usize| {
            let (kappa, prior_mean) = (kappa[n], prior_mean[n]);
            Site { prior_mean, residual: 0.0, mean: prior_mean, variance: 0.0, omega: 0.0, kappa }
        };
        let sites = (0..likelihood.events()).map(site).collect();
        let (precision, inner) = (Matrix::zeros(points.len(), points.len()), Cholesky::of_identity(points.len()));
        let weights = vec![0.0; points.len()];
        Ok(Self { points, cross, cholesky, sites, messages, precision, inner, weights })
    }

    /// The first walk, from the prior: every site is what `rule` makes of it. Says what inducing points leave unexplained.
    pub(super) fn begin(&mut self, prior: &Prior, rule: impl Fn(usize, &mut Site) + Sync) -> Result<Walk> {
        let inputs = self.cross.inputs();
        let diagonals = on_parts(self.cross.parts(), |part| prior.kernel().diagonal(&inputs.slice(part)));
        let diagonal = diagonals.into_iter().collect::<Result<Vec<_>>>()?.concat();
        self.walk(|n, site, _, explained| {
            site.residual = (diagonal[n] - explained).max(0.0);
            rule(n, site);
            (0.0, 0.0)
        })
    }

    /// Looks at every event once: `rule` gets its number, its site, and its posterior mean about the prior mean and explained
    /// variance, moves the site, and says a term of a sum and how large the change is. O(NM²).
    pub(super) fn walk(&mut self, rule: impl Fn(usize, &mut Site, f64, f64) -> (f64, f64) + Sync) -> Result<Walk> {
        let mut sites = std::mem::take(&mut self.sites);
        let (mut left, mut shares) = (sites.as_mut_slice(), Vec::new());
        for part in self.cross.parts() {
            let (own, others) = left.split_at_mut(part.len());
            shares.push((part, own));
            left = others;
        }
        let outer = self.cholesky.times(&self.inner);
        let walks = on_parts(shares, |(part, sites)| self.walk_part(&outer, part, sites, &rule));
        let mut total = Walk { said: Sums::zeros(self.points.len()), bound: 0.0, change: 0.0 };
        for walk in walks {
            let walk = walk?;
            total.said.merge(&walk.said);
            total.bound += walk.bound;
            total.change = f64::max(total.change, walk.change);
        }
        self.sites = sites;
        // From this posterior's point of view to the prior's.
        total.said.precision.mirror_lower();
        total.said.precision = self.inner.unwhiten(&total.said.precision);
        total.said.shift = self.inner.lower_times(&total.said.shift);
        Ok(total)
    }

    fn walk_part(
        &self,
        outer: &Cholesky,
        part: Range<usize>,
        sites: &mut [Site],
        rule: &impl Fn(usize, &mut Site, f64, f64) -> (f64, f64),
    ) -> Result<Walk> {
        let mut walk = Walk { said: Sums::zeros(self.points.len()), bound: 0.0, change: 0.0 };
        let (mut features, mut room) = (Matrix::default(), Matrix::default());
        for (block, sites) in blocks(part).zip(sites.chunks_mut(BLOCK)) {
            self.cross.write_features(block.clone(), outer, &mut features)?;
            let (pulls, explained) = products_and_squared_norms(&features, &self.weights);
            for ((n, site), (pull, explained)) in block.zip(&mut *sites).zip(pulls.into_iter().zip(explained)) {
                let (bound, change) = rule(n, site, pull, explained);
                walk.bound += bound;
                walk.change = f64::max(walk.change, change);
            }
            let (omega, shift): (Vec<_>, Vec<_>) = sites.iter().map(|site| (site.omega, site.shift())).unzip();
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
