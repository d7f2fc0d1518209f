//! Which of the candidate points summarise a region best (section 5 of [`crate::method`]).
//!
//! All policies look at one number: tr K̃, the prior variance at the candidates that the chosen points leave
//! unexplained, which bounds the KL divergence from the full posterior (see [`crate::Certificate`]).

use rand::{Rng, RngExt};

use crate::error::{Error, Result};
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::linalg::{Cholesky, Matrix, add_symmetric_product, product, squared_norm};
use crate::posterior::Posterior;

/// A candidate whose variance given the points already chosen is below this share of its prior variance is one of them.
pub const DISTINCT_SHARE: f64 = 1e-4;

/// What is left of a prior variance below this share is rounding.
const ROUNDING_SHARE: f64 = 1e-12;

/// Chosen candidates.
#[derive(Debug, Clone, PartialEq)]
#[must_use]
pub struct Selection {
    /// Their indices, in the order of choice. Fewer than asked for where candidates coincide.
    pub indices: Vec<usize>,
    /// tr K̃ over all candidates, given these points and what the candidates were conditioned on.
    pub trace: f64,
}

/// Which end of tr K̃ to look for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Aim {
    /// As small as possible: the policy.
    Small,
    /// As large as possible: the worst choice, to compare with.
    Large,
}

/// N candidate points and their covariance, given the points that are known already.
#[derive(Debug, Clone)]
pub struct Candidates {
    /// Conditional covariance, N×N.
    gram: Matrix,
    /// Prior variances k(z, z), N.
    variance: Vec<f64>,
    /// Variance that is left at a candidate once it is chosen, N: 0 where f is taken as known there.
    floor: Vec<f64>,
    jitter: f64,
}

impl Candidates {
    /// Candidates of which nothing is known yet. O(N²d), N² memory.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`] when the kernel looks at a column that the inputs do not have.
    pub fn new(kernel: &Kernel, inputs: &Inputs) -> Result<Self> {
        let variance = kernel.diagonal(inputs)?;
        Ok(Self { gram: kernel.gram(inputs)?, floor: vec![0.0; variance.len()], variance, jitter: 0.0 })
    }

    /// Candidates given f at `known` points, so that no choice is spent on what those already tell. O(N²M).
    ///
    /// # Errors
    /// As [`Candidates::new`]; [`crate::Error::NotPositiveDefinite`] when known points coincide too closely for any
    /// small jitter.
    pub fn given(kernel: &Kernel, inputs: &Inputs, known: &Inputs) -> Result<Self> {
        let mut candidates = Self::new(kernel, inputs)?;
        if !known.is_empty() {
            let cholesky = Cholesky::with_jitter("K at the known points", &kernel.gram(known)?)?;
            let mut features = kernel.cross(known, inputs)?;
            cholesky.solve_lower_matrix(&mut features);
            candidates.jitter = cholesky.jitter();
            candidates.gram.add_scaled(-1.0, &product(features.t(), features.view()));
        }
        Ok(candidates)
    }

    /// Candidates for the residual of `own` beyond `public` ([`Posterior::residual`]): choosing one makes the variance
    /// there `own`'s, and the choice is greedy for the largest drop of the variance that `public` has at all
    /// candidates. O(n²N + N²n).
    ///
    /// # Errors
    /// [`Error::DifferentPriors`], and as [`Posterior::latent`].
    pub fn for_residual(public: &Posterior, own: &Posterior, inputs: &Inputs) -> Result<Self> {
        if public.prior() != own.prior() {
            return Err(Error::DifferentPriors { what: "two posteriors" });
        }
        let variance = own.prior().kernel().diagonal(inputs)?;
        let (_, gram) = public.joint(inputs)?;
        Ok(Self { gram, variance, floor: own.latent(inputs)?.variance, jitter: public.jitter() })
    }

    /// The candidates that are points of their own, in order: those whose variance given the ones before is not below
    /// this share of their prior variance, such as [`DISTINCT_SHARE`]. O(N³).
    pub fn distinct(&self, share_min: f64) -> Vec<usize> {
        let mut left = self.clone();
        let mut kept = Vec::new();
        for candidate in 0..self.len() {
            if left.gram[(candidate, candidate)] >= share_min * self.variance[candidate] {
                left.condition_on_those(&[candidate], share_min);
                kept.push(candidate);
            }
        }
        kept
    }

    /// What was added to the diagonal of K at the known points to factorise it (0 in the ordinary case).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Number of candidates N.
    pub fn len(&self) -> usize {
        self.variance.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.variance.is_empty()
    }

    /// tr K̃ before anything is chosen.
    pub fn trace(&self) -> f64 {
        (0..self.len()).map(|n| self.gram[(n, n)].max(0.0)).sum()
    }

    /// Counts the candidates at `indices` as known from now on (or as certain as `own`, see
    /// [`Candidates::for_residual`]). O(N²) each.
    pub fn condition_on(&mut self, indices: &[usize]) {
        self.condition_on_those(indices, DISTINCT_SHARE);
    }

    /// Conditions on those of `indices` that keep at least `share_min` of their prior variance when their turn comes.
    fn condition_on_those(&mut self, indices: &[usize], share_min: f64) {
        let mut pivot_column = vec![0.0; self.len()];
        for &pivot in indices {
            let pivot_variance = self.gram[(pivot, pivot)];
            if pivot_variance < share_min * self.variance[pivot] {
                continue;
            }
            pivot_column.copy_from_slice(self.gram.column(pivot));
            let share = self.share_gone(pivot);
            for column in 0..self.len() {
                let factor = share * (pivot_column[column] / pivot_variance);
                let entries = self.gram.column_mut(column).iter_mut().zip(&pivot_column);
                entries.for_each(|(entry, pivot)| *entry -= factor * pivot);
            }
        }
    }

    /// The `points` candidates with the smallest tr K̃ (the paper's *good* points): exact for one and two, beyond that
    /// greedy, then exchanged until no single swap helps. O(N²) for one point, O(N³) for two, O(N²·points²) a round of
    /// exchange beyond.
    pub fn minimise_trace(&self, points: usize) -> Selection {
        self.choose(points, Aim::Small)
    }

    /// The `points` candidates with the largest tr K̃ (the paper's *bad* points), found as in
    /// [`Candidates::minimise_trace`].
    pub fn maximise_trace(&self, points: usize) -> Selection {
        self.choose(points, Aim::Large)
    }

    /// `points` distinct candidates, uniformly. O(N²·points).
    pub fn random<R: Rng + ?Sized>(&self, points: usize, rng: &mut R) -> Selection {
        let mut order: Vec<usize> = (0..self.len()).collect();
        let mut left = self.clone();
        let mut indices = Vec::with_capacity(points.min(self.len()));
        while indices.len() < points && !order.is_empty() {
            let candidate = order.swap_remove(rng.random_range(0..order.len()));
            if left.is_distinct(candidate, left.gram[(candidate, candidate)]) {
                left.condition_on(&[candidate]);
                indices.push(candidate);
            }
        }
        Selection { indices, trace: left.trace() }
    }

    /// The `points` candidates that greedy choice takes, one after the other; their prefixes are the choices of fewer
    /// points. O(N²·points): for hundreds of points, where [`Candidates::minimise_trace`] would take long.
    pub fn greedy(&self, points: usize) -> Selection {
        self.greedy_towards(points, Aim::Small)
    }

    fn choose(&self, points: usize, aim: Aim) -> Selection {
        match points {
            _ if self.floor.iter().any(|&floor| floor > 0.0) => self.greedy_towards(points, aim),
            2 => self.best_pair(aim).unwrap_or_else(|| self.greedy_towards(1, aim)),
            0 | 1 => self.greedy_towards(points, aim),
            _ => self.exchange(self.greedy_towards(points, aim), aim),
        }
    }

    fn greedy_towards(&self, points: usize, aim: Aim) -> Selection {
        let mut left = self.clone();
        let mut indices = Vec::with_capacity(points.min(self.len()));
        while indices.len() < points {
            let Some((candidate, _)) = left.best(aim) else { break };
            left.condition_on(&[candidate]);
            indices.push(candidate);
        }
        Selection { indices, trace: left.trace() }
    }

    /// Replaces one chosen point at a time by the best for its place, until nothing changes.
    fn exchange(&self, mut selection: Selection, aim: Aim) -> Selection {
        let mut changed = true;
        while changed {
            changed = false;
            for place in 0..selection.indices.len() {
                let mut others = selection.indices.clone();
                others.remove(place);
                let mut left = self.clone();
                // A swap may have brought two of them close; they are chosen all the same.
                left.condition_on_those(&others, ROUNDING_SHARE);
                let Some((candidate, reduction)) = left.best(aim) else { continue };
                let trace = left.trace() - reduction;
                let tolerance = 1e-12 * self.trace();
                let better = match aim {
                    Aim::Small => trace < selection.trace - tolerance,
                    Aim::Large => trace > selection.trace + tolerance,
                };
                if better {
                    selection.indices[place] = candidate;
                    selection.trace = trace;
                    changed = true;
                }
            }
        }
        selection
    }

    /// The best single candidate and by how much it reduces the trace: Σ_n k(x_n, z)²/k(z, z).
    fn best(&self, aim: Aim) -> Option<(usize, f64)> {
        let reductions = (0..self.len())
            .map(|candidate| (candidate, self.gram[(candidate, candidate)]))
            .filter(|&(candidate, variance)| self.is_distinct(candidate, variance))
            .map(|(candidate, variance)| {
                let explained = squared_norm(self.gram.column(candidate)) / variance;
                (candidate, explained * self.share_gone(candidate))
            });
        best_of(reductions.filter(|&(_, reduction)| reduction > 0.0), aim)
    }

    /// The best pair, over all of them, from one symmetric product C = K²: the reduction by {i, j} is
    /// [C_ii k_jj + C_jj k_ii − 2 k_ij C_ij] / (k_ii k_jj − k_ij²).
    fn best_pair(&self, aim: Aim) -> Option<Selection> {
        let mut squared = Matrix::zeros(self.len(), self.len());
        add_symmetric_product(1.0, self.gram.view(), &mut squared);
        let (k, c) = (&self.gram, &squared);
        let mut best: Option<((usize, usize), f64)> = None;
        for j in 1..self.len() {
            let (kj, cj) = (k.column(j), c.column(j));
            let (kjj, cjj) = (kj[j], cj[j]);
            let reductions = (0..j).filter_map(|i| {
                let (kii, cii) = (k[(i, i)], c[(i, i)]);
                let determinant = kii * kjj - kj[i] * kj[i];
                let distinct = self.is_distinct(i, kii)
                    && self.is_distinct(j, kjj)
                    && determinant >= DISTINCT_SHARE * self.variance[j] * kii
                    && determinant >= DISTINCT_SHARE * self.variance[i] * kjj;
                distinct.then(|| ((i, j), (cii * kjj + cjj * kii - 2.0 * kj[i] * cj[i]) / determinant))
            });
            best = best_of(best.into_iter().chain(reductions), aim);
        }
        best.map(|((i, j), reduction)| Selection { indices: vec![i, j], trace: self.trace() - reduction })
    }

    /// The share of a candidate's variance that goes once it is chosen.
    fn share_gone(&self, candidate: usize) -> f64 {
        let variance = self.gram[(candidate, candidate)];
        (1.0 - self.floor[candidate] / variance).max(0.0)
    }

    /// Whether a candidate of this conditional variance is not one of the known points.
    fn is_distinct(&self, candidate: usize, conditional_variance: f64) -> bool {
        conditional_variance >= DISTINCT_SHARE * self.variance[candidate]
    }
}

/// The choice whose reduction of the trace suits the aim best; the first of equals.
fn best_of<T: Copy>(reductions: impl Iterator<Item = (T, f64)>, aim: Aim) -> Option<(T, f64)> {
    reductions.reduce(|best, next| {
        let better = match aim {
            Aim::Small => next.1 > best.1,
            Aim::Large => next.1 < best.1,
        };
        if better { next } else { best }
    })
}
