//! Choice of the inducing points that summarise a region best ([`crate::method::inducing_points`]).
//!
//! All policies use one number: tr K̃, the prior variance at the candidates that the chosen points leave unexplained.
//! It bounds the KL divergence from the full posterior (see [`crate::Certificate`]).

use rand::{Rng, RngExt};

use crate::error::{Error, Result, same_size};
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::linalg::{Cholesky, Matrix, MultiplyAdd, Wide, add_scaled, add_symmetric_product, widest};
use crate::posterior::Posterior;
use crate::remainder::{Reductions, Remainder};

/// Smallest share of the prior variance that a candidate must keep, given the chosen points, to be distinct from them.
pub const DISTINCT_SHARE: f64 = 1e-4;

/// Below this share of the prior variance, the remaining variance is a rounding error.
const ROUNDING_SHARE: f64 = 1e-12;

/// Chosen candidates.
#[derive(Debug, Clone, PartialEq)]
#[must_use]
pub struct Selection {
    /// Their indices, in the order of choice. Fewer than requested if candidates coincide.
    pub indices: Vec<usize>,
    /// tr K̃ over all candidates, given these points and those on which the candidates were conditioned.
    pub trace: f64,
}

/// Direction of the optimisation of tr K̃.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Aim {
    /// Smallest trace: the policy.
    Small,
    /// Largest trace: the worst choice, for comparison.
    Large,
}

/// N candidate points and their covariance, given the points that are known already.
#[derive(Debug, Clone)]
pub struct Candidates {
    /// Conditional covariance, N×N.
    gram: Matrix,
    /// Prior variances k(z, z), N.
    variance: Vec<f64>,
    /// Variance that remains at a candidate after it is chosen, N. It is 0 if f is then taken as known there.
    floor: Vec<f64>,
    /// The features of the candidates under the public posterior of [`Candidates::towards`], N×n for its n rows that
    /// the covariance includes.
    features: Matrix,
    jitter: f64,
}

impl Candidates {
    /// Creates candidates without known points. O(N²d), N² memory.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`] if the kernel uses a column that the inputs do not have.
    pub fn new(kernel: &Kernel, inputs: &Inputs) -> Result<Self> {
        let variance = kernel.diagonal(inputs)?;
        let (floor, features) = (vec![0.0; variance.len()], Matrix::zeros(variance.len(), 0));
        Ok(Self { gram: kernel.gram(inputs)?, floor, variance, features, jitter: 0.0 })
    }

    /// Creates candidates given f at the points `known`. No choice is then spent on variance that these explain.
    /// O(N²M).
    ///
    /// # Errors
    /// As [`Candidates::new`]; [`crate::Error::NotPositiveDefinite`] if known points coincide too closely for any small
    /// jitter.
    pub fn given(kernel: &Kernel, inputs: &Inputs, known: &Inputs) -> Result<Self> {
        let mut candidates = Self::new(kernel, inputs)?;
        if !known.is_empty() {
            let cholesky = Cholesky::with_jitter("K at the known points", &kernel.gram(known)?)?;
            let mut features = kernel.cross(known, inputs)?;
            cholesky.solve_lower_matrix(&mut features);
            candidates.jitter = cholesky.jitter();
            add_symmetric_product(-1.0, features.t(), &mut candidates.gram);
        }
        Ok(candidates)
    }

    /// Creates candidates for the residual of `own` beyond `public` ([`Posterior::residual`]). O(n²N + N²n).
    ///
    /// Choosing a candidate reduces the variance there to that of `own`. The choice is greedy for the largest reduction
    /// of `public`'s total variance at all candidates.
    ///
    /// # Errors
    /// [`Error::DifferentPriors`], and as [`Posterior::latent`].
    pub fn for_residual(public: &Posterior, own: &Posterior, inputs: &Inputs) -> Result<Self> {
        if public.prior() != own.prior() {
            return Err(Error::DifferentPriors { what: "two posteriors" });
        }
        Self::towards(public, &own.latent(inputs)?.variance, inputs)
    }

    /// Creates candidates as [`Candidates::for_residual`] does, from the known `variance` of the sender's own posterior
    /// at the candidates, N. O(n²N + N²n) for n rows of `public`.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the numbers of variances and candidates differ, and as [`Posterior::latent`].
    pub fn towards(public: &Posterior, variance: &[f64], inputs: &Inputs) -> Result<Self> {
        same_size("variances, one per candidate", inputs.len(), variance.len())?;
        let mut candidates = Self { floor: variance.to_vec(), ..Self::new(public.prior().kernel(), inputs)? };
        candidates.follow(public, inputs)?;
        Ok(candidates)
    }

    /// Updates the covariance by the evidence that the `public` of [`Candidates::towards`] has absorbed since. O(nmN +
    /// N²m) for m new rows of its n rows.
    ///
    /// `inputs` are those of the candidates. The candidates must not have been conditioned on any point.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the numbers of inputs and candidates differ, and as [`Posterior::latent`].
    pub fn follow(&mut self, public: &Posterior, inputs: &Inputs) -> Result<()> {
        same_size("inputs, one per candidate", self.len(), inputs.len())?;
        let first = self.features.columns();
        if first == public.len() {
            return Ok(());
        }
        public.append_features(inputs, &mut self.features)?;
        let new = self.features.view().subcols(first, public.len() - first);
        add_symmetric_product(-1.0, new, &mut self.gram);
        self.jitter = public.jitter();
        Ok(())
    }

    /// Returns the indices of the distinct candidates, in order. Given the distinct ones before it, a distinct
    /// candidate keeps at least the share `share_min` of its prior variance, such as [`DISTINCT_SHARE`]. O(N²) for each
    /// distinct candidate.
    pub fn distinct(&self, share_min: f64) -> Vec<usize> {
        let mut remaining = Remainder::new(&self.gram);
        let mut kept = Vec::new();
        for candidate in 0..self.len() {
            let variance = remaining.variance()[candidate];
            if variance >= share_min * self.variance[candidate] {
                remaining.take(candidate, self.share_gone(candidate, variance));
                kept.push(candidate);
            }
        }
        kept
    }

    /// Returns the jitter that was added to the diagonal of K at the known points (ordinarily 0).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Returns the number of candidates N.
    pub fn len(&self) -> usize {
        self.variance.len()
    }

    /// Returns whether there are no candidates.
    pub fn is_empty(&self) -> bool {
        self.variance.is_empty()
    }

    /// Returns tr K̃ before any choice.
    pub fn trace(&self) -> f64 {
        (0..self.len()).map(|n| self.gram[(n, n)].max(0.0)).sum()
    }

    /// Conditions on f at the candidates at `indices`. For [`Candidates::for_residual`], their variance becomes that of
    /// `own` instead of 0. O(N²) each.
    pub fn condition_on(&mut self, indices: &[usize]) {
        let mut pivot_column = vec![0.0; self.len()];
        for &pivot in indices {
            let pivot_variance = self.gram[(pivot, pivot)];
            if !self.is_distinct(pivot, pivot_variance) {
                continue;
            }
            pivot_column.copy_from_slice(self.gram.column(pivot));
            let share = self.share_gone(pivot, pivot_variance);
            for column in 0..self.len() {
                let factor = share * (pivot_column[column] / pivot_variance);
                add_scaled(-factor, &pivot_column, self.gram.column_mut(column));
            }
        }
    }

    /// Returns the `points` candidates with the smallest tr K̃ (the paper's *good* points).
    ///
    /// The choice is exact for one and two points. More points are chosen greedily and then exchanged until no single
    /// swap reduces the trace. O(N²) for one point, O(N³) for two. More points cost O(N³), plus O(N·points²·log points)
    /// for each round of exchange.
    pub fn minimise_trace(&self, points: usize) -> Selection {
        self.choose(points, Aim::Small)
    }

    /// Returns the `points` candidates with the largest tr K̃ (the paper's *bad* points). The search is that of
    /// [`Candidates::minimise_trace`].
    pub fn maximise_trace(&self, points: usize) -> Selection {
        self.choose(points, Aim::Large)
    }

    /// Returns `points` distinct candidates, drawn uniformly. O(N·points²).
    pub fn random<R: Rng + ?Sized>(&self, points: usize, rng: &mut R) -> Selection {
        let mut order: Vec<usize> = (0..self.len()).collect();
        let mut remaining = Remainder::new(&self.gram);
        let mut indices = Vec::with_capacity(points.min(self.len()));
        while indices.len() < points && !order.is_empty() {
            let candidate = order.swap_remove(rng.random_range(0..order.len()));
            let variance = remaining.variance()[candidate];
            if self.is_distinct(candidate, variance) {
                remaining.take(candidate, self.share_gone(candidate, variance));
                indices.push(candidate);
            }
        }
        Selection { indices, trace: remaining.trace() }
    }

    /// Returns the `points` candidates of the greedy choice, in the order of choice. Prefixes of the result are the
    /// greedy choices of fewer points. O(N²·points), or O(N³ + N·points²) if that is less.
    pub fn greedy(&self, points: usize) -> Selection {
        self.greedy_towards(points, Aim::Small)
    }

    fn choose(&self, points: usize, aim: Aim) -> Selection {
        match points {
            _ if self.floor.iter().any(|&floor| floor > 0.0) => self.greedy_towards(points, aim),
            2 => self.best_pair(aim).unwrap_or_else(|| self.greedy_towards(1, aim)),
            0 | 1 => self.greedy_towards(points, aim),
            _ => self.exchanged(points, aim),
        }
    }

    fn greedy_towards(&self, points: usize, aim: Aim) -> Selection {
        // K² costs about N/16 products of K and a vector.
        let squared = (points.saturating_mul(16) > self.len()).then(|| self.squared());
        self.greedy_from(Reductions::new(&self.gram, squared.as_ref()), points, aim)
    }

    fn greedy_from(&self, mut remaining: Reductions<'_>, points: usize, aim: Aim) -> Selection {
        let mut indices = Vec::with_capacity(points.min(self.len()));
        while indices.len() < points {
            let Some((candidate, reduction)) = self.best(&remaining, aim) else { break };
            indices.push(candidate);
            if indices.len() == points {
                // Nothing is chosen after the last point.
                return Selection { indices, trace: (remaining.trace() - reduction).max(0.0) };
            }
            self.take(&mut remaining, candidate, DISTINCT_SHARE);
        }
        Selection { indices, trace: remaining.trace() }
    }

    /// Chooses greedily, then replaces one point at a time by the best point for its place, until nothing changes.
    fn exchanged(&self, points: usize, aim: Aim) -> Selection {
        let squared = self.squared();
        let mut remaining = Reductions::new(&self.gram, Some(&squared));
        let mut selection = self.greedy_from(remaining.clone(), points, aim);
        let places = selection.indices.len();
        while self.exchange(&mut remaining, &mut selection, 0..places, aim) {}
        selection
    }

    /// Tries an exchange at each of the given places of a selection, in order. Returns whether anything changed.
    /// `remaining` must be conditioned on the points at all other places.
    ///
    /// The places are halved recursively. A round then conditions on O(points · log points) points instead of
    /// O(points²).
    fn exchange(
        &self,
        remaining: &mut Reductions<'_>,
        selection: &mut Selection,
        places: std::ops::Range<usize>,
        aim: Aim,
    ) -> bool {
        match places.len() {
            0 => return false,
            1 => return self.exchange_one(remaining, selection, places.start, aim),
            _ => {}
        }
        let middle = places.start.midpoint(places.end);
        let (first, second, mark) = (places.start..middle, middle..places.end, remaining.mark());
        // An exchange may have brought two points close to each other. Such points still count as chosen.
        second.clone().for_each(|place| self.take(remaining, selection.indices[place], ROUNDING_SHARE));
        let in_first = self.exchange(remaining, selection, first.clone(), aim);
        remaining.back_to(&mark);
        first.for_each(|place| self.take(remaining, selection.indices[place], ROUNDING_SHARE));
        let in_second = self.exchange(remaining, selection, second, aim);
        remaining.back_to(&mark);
        in_first || in_second
    }

    /// Replaces the point at one place by the best point, if that is better. Returns whether it was.
    fn exchange_one(&self, remaining: &Reductions<'_>, selection: &mut Selection, place: usize, aim: Aim) -> bool {
        let Some((candidate, reduction)) = self.best(remaining, aim) else { return false };
        let trace = remaining.trace() - reduction;
        let tolerance = 1e-12 * self.trace();
        let better = match aim {
            Aim::Small => trace < selection.trace - tolerance,
            Aim::Large => trace > selection.trace + tolerance,
        };
        if better {
            selection.indices[place] = candidate;
            selection.trace = trace;
        }
        better
    }

    /// Conditions on a candidate if it keeps at least `share_min` of its prior variance.
    fn take(&self, remaining: &mut Reductions<'_>, candidate: usize, share_min: f64) {
        let variance = remaining.variance()[candidate];
        if variance >= share_min * self.variance[candidate] {
            remaining.take(candidate, self.share_gone(candidate, variance));
        }
    }

    /// Returns the best single candidate and its reduction of the trace, Σ_n k(x_n, z)²/k(z, z).
    fn best(&self, remaining: &Reductions<'_>, aim: Aim) -> Option<(usize, f64)> {
        let reductions = remaining
            .variance()
            .iter()
            .enumerate()
            .filter(|&(candidate, &variance)| self.is_distinct(candidate, variance))
            .map(|(candidate, &variance)| {
                (candidate, remaining.reduction(candidate) * self.share_gone(candidate, variance))
            });
        best_of(reductions.filter(|&(_, reduction)| reduction > 0.0), aim)
    }

    /// Returns C = K².
    fn squared(&self) -> Matrix {
        let mut squared = Matrix::zeros(self.len(), self.len());
        add_symmetric_product(1.0, self.gram.view(), &mut squared);
        squared
    }

    /// Returns the best of all pairs, from one symmetric product C = K².
    fn best_pair(&self, aim: Aim) -> Option<Selection> {
        let squared = self.squared();
        let (variance, explained) = (self.gram.diagonal(), squared.diagonal());
        let sign = if aim == Aim::Small { 1.0 } else { -1.0 };
        let (mut merits, mut best) = (vec![0.0; self.len()], None);
        for j in (1..self.len()).filter(|&j| self.is_distinct(j, variance[j])) {
            let pairs = Pairs {
                sign,
                second: [variance[j], explained[j], DISTINCT_SHARE * self.variance[j]],
                between: [self.gram.column(j), squared.column(j)],
                first: [&variance, &explained, &self.variance],
                merits: &mut merits[..j],
            };
            let most = widest(pairs);
            if most > best.map_or(f64::NEG_INFINITY, |(_, most)| most)
                && let Some(i) = merits.iter().position(|&merit| merit == most)
            {
                best = Some(((i, j), most));
            }
        }
        best.map(|((i, j), most)| Selection { indices: vec![i, j], trace: self.trace() - sign * most })
    }

    /// Returns the share of a candidate's conditional variance that its choice removes.
    fn share_gone(&self, candidate: usize, conditional_variance: f64) -> f64 {
        (1.0 - self.floor[candidate] / conditional_variance).max(0.0)
    }

    /// Returns whether a candidate of this conditional variance is distinct from the known points.
    fn is_distinct(&self, candidate: usize, conditional_variance: f64) -> bool {
        conditional_variance >= DISTINCT_SHARE * self.variance[candidate]
    }
}

/// The reduction of the trace by each pair {i, j} with one j, times a sign:
/// [C_ii k_jj + C_jj k_ii − 2 k_ij C_ij] / (k_ii k_jj − k_ij²). It is −∞ if the points are not distinct.
struct Pairs<'a> {
    sign: f64,
    /// k_jj, C_jj, and the smallest variance that j must keep.
    second: [f64; 3],
    /// k_ij and C_ij for every i.
    between: [&'a [f64]; 2],
    /// k_ii, C_ii and the prior variance for every i.
    first: [&'a [f64]; 3],
    merits: &'a mut [f64],
}

impl Wide for Pairs<'_> {
    /// The largest of the reductions.
    type Output = f64;

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) -> f64 {
        let ([k_jj, c_jj, least], [k_j, c_j], [k, c, prior]) = (self.second, self.between, self.first);
        let size = self.merits.len();
        let (k_j, c_j, k, c, prior) = (&k_j[..size], &c_j[..size], &k[..size], &c[..size], &prior[..size]);
        for i in 0..size {
            let determinant = M::multiply_add(k[i], k_jj, -(k_j[i] * k_j[i]));
            let of_first = DISTINCT_SHARE * prior[i];
            let distinct = (k[i] >= of_first) & (determinant >= least * k[i]) & (determinant >= of_first * k_jj);
            let gain = M::multiply_add(c[i], k_jj, M::multiply_add(c_jj, k[i], -2.0 * (k_j[i] * c_j[i])));
            self.merits[i] = if distinct { self.sign * (gain / determinant) } else { f64::NEG_INFINITY };
        }
        let (chunks, rest) = self.merits.as_chunks::<8>();
        let mut most = [f64::NEG_INFINITY; 8];
        for chunk in chunks {
            for (most, merit) in most.iter_mut().zip(chunk) {
                *most = if *merit > *most { *merit } else { *most };
            }
        }
        let mut largest = f64::NEG_INFINITY;
        for merit in most.iter().chain(rest) {
            largest = if *merit > largest { *merit } else { largest };
        }
        largest
    }
}

/// Returns the best choice for the aim by its reduction of the trace; the first of equals.
fn best_of<T: Copy>(reductions: impl Iterator<Item = (T, f64)>, aim: Aim) -> Option<(T, f64)> {
    reductions.reduce(|best, next| {
        let better = match aim {
            Aim::Small => next.1 > best.1,
            Aim::Large => next.1 < best.1,
        };
        if better { next } else { best }
    })
}
