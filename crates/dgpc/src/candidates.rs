//! Which of the candidate points summarise a region best (section 5 of [`crate::method`]).
//!
//! All policies look at one number: tr K̃, the prior variance at the candidates that the chosen points leave
//! unexplained, which bounds the KL divergence from the full posterior (see [`crate::Certificate`]).

use rand::{Rng, RngExt};

use crate::error::{Error, Result, same_size};
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::linalg::{Cholesky, Matrix, MultiplyAdd, Wide, add_scaled, add_symmetric_product, widest};
use crate::posterior::Posterior;
use crate::remainder::{Reductions, Remainder};

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
    /// How many points of a posterior that was told something are in the covariance.
    told: usize,
    jitter: f64,
}

impl Candidates {
    /// Candidates of which nothing is known yet. O(N²d), N² memory.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`] when the kernel looks at a column that the inputs do not have.
    pub fn new(kernel: &Kernel, inputs: &Inputs) -> Result<Self> {
        let variance = kernel.diagonal(inputs)?;
        Ok(Self { gram: kernel.gram(inputs)?, floor: vec![0.0; variance.len()], variance, told: 0, jitter: 0.0 })
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
            add_symmetric_product(-1.0, features.t(), &mut candidates.gram);
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
        Self::towards(public, &own.latent(inputs)?.variance, inputs)
    }

    /// The same for whoever knows already which `variance` its own posterior has at the candidates, N. O(n²N + N²n) for n
    /// of `public`.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for another number of variances than candidates, and as [`Posterior::latent`].
    pub fn towards(public: &Posterior, variance: &[f64], inputs: &Inputs) -> Result<Self> {
        same_size("variances, one per candidate", inputs.len(), variance.len())?;
        let (_, gram) = public.joint(inputs)?;
        let prior_variance = public.prior().kernel().diagonal(inputs)?;
        let (floor, told) = (variance.to_vec(), public.len());
        Ok(Self { gram, variance: prior_variance, floor, told, jitter: public.jitter() })
    }

    /// Takes in what the `public` of [`Candidates::towards`] was told since. `inputs` are those of the candidates, none of which
    /// was conditioned on. O(n²N + N²m) for m of its n points that are new.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for another number of inputs, and as [`Posterior::latent`].
    pub fn follow(&mut self, public: &Posterior, inputs: &Inputs) -> Result<()> {
        same_size("inputs, one per candidate", self.len(), inputs.len())?;
        public.take_explained(inputs, self.told, &mut self.gram)?;
        (self.told, self.jitter) = (public.len(), public.jitter());
        Ok(())
    }

    /// The candidates that are points of their own, in order: those whose variance given the ones before is not below
    /// this share of their prior variance, such as [`DISTINCT_SHARE`]. O(N²) for each that is.
    pub fn distinct(&self, share_min: f64) -> Vec<usize> {
        let mut left = Remainder::new(&self.gram);
        let mut kept = Vec::new();
        for candidate in 0..self.len() {
            let variance = left.variance()[candidate];
            if variance >= share_min * self.variance[candidate] {
                left.take(candidate, self.share_gone(candidate, variance));
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

    /// The `points` candidates with the smallest tr K̃ (the paper's *good* points): exact for one and two, beyond that
    /// greedy, then exchanged until no single swap helps. O(N²) for one point, O(N³) for two; beyond, the same and
    /// O(N·points²·log points) a round of exchange.
    pub fn minimise_trace(&self, points: usize) -> Selection {
        self.choose(points, Aim::Small)
    }

    /// The `points` candidates with the largest tr K̃ (the paper's *bad* points), found as in
    /// [`Candidates::minimise_trace`].
    pub fn maximise_trace(&self, points: usize) -> Selection {
        self.choose(points, Aim::Large)
    }

    /// `points` distinct candidates, uniformly. O(N·points²).
    pub fn random<R: Rng + ?Sized>(&self, points: usize, rng: &mut R) -> Selection {
        let mut order: Vec<usize> = (0..self.len()).collect();
        let mut left = Remainder::new(&self.gram);
        let mut indices = Vec::with_capacity(points.min(self.len()));
        while indices.len() < points && !order.is_empty() {
            let candidate = order.swap_remove(rng.random_range(0..order.len()));
            let variance = left.variance()[candidate];
            if self.is_distinct(candidate, variance) {
                left.take(candidate, self.share_gone(candidate, variance));
                indices.push(candidate);
            }
        }
        Selection { indices, trace: left.trace() }
    }

    /// The `points` candidates that greedy choice takes, one after the other; their prefixes are the choices of fewer
    /// points. O(N²·points), or O(N³ + N·points²) where that is less.
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
        // K² is as dear as some N/16 products of K and a vector.
        let squared = (points.saturating_mul(16) > self.len()).then(|| self.squared());
        self.greedy_from(Reductions::new(&self.gram, squared.as_ref()), points, aim)
    }

    fn greedy_from(&self, mut left: Reductions<'_>, points: usize, aim: Aim) -> Selection {
        let mut indices = Vec::with_capacity(points.min(self.len()));
        while indices.len() < points {
            let Some((candidate, _)) = self.best(&left, aim) else { break };
            self.take(&mut left, candidate, DISTINCT_SHARE);
            indices.push(candidate);
        }
        Selection { indices, trace: left.trace() }
    }

    /// Greedily, then exchanged one at a time by the best for its place, until nothing changes.
    fn exchanged(&self, points: usize, aim: Aim) -> Selection {
        let squared = self.squared();
        let mut left = Reductions::new(&self.gram, Some(&squared));
        let mut selection = self.greedy_from(left.clone(), points, aim);
        let places = selection.indices.len();
        while self.exchange(&mut left, &mut selection, 0..places, aim) {}
        selection
    }

    /// One look at each of these places of a selection, in order, where `left` knows all points at the others; whether
    /// anything changed. By halves, so that a round takes O(points · log points) points instead of their square.
    fn exchange(
        &self,
        left: &mut Reductions<'_>,
        selection: &mut Selection,
        places: std::ops::Range<usize>,
        aim: Aim,
    ) -> bool {
        match places.len() {
            0 => return false,
            1 => return self.exchange_one(left, selection, places.start, aim),
            _ => {}
        }
        let middle = places.start.midpoint(places.end);
        let (first, second, mark) = (places.start..middle, middle..places.end, left.mark());
        // A swap may have brought two of them close; they are chosen all the same.
        second.clone().for_each(|place| self.take(left, selection.indices[place], ROUNDING_SHARE));
        let in_first = self.exchange(left, selection, first.clone(), aim);
        left.back_to(&mark);
        first.for_each(|place| self.take(left, selection.indices[place], ROUNDING_SHARE));
        let in_second = self.exchange(left, selection, second, aim);
        left.back_to(&mark);
        in_first || in_second
    }

    /// The best point for one place, if it is better than what is there.
    fn exchange_one(&self, left: &Reductions<'_>, selection: &mut Selection, place: usize, aim: Aim) -> bool {
        let Some((candidate, reduction)) = self.best(left, aim) else { return false };
        let trace = left.trace() - reduction;
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

    /// Takes a candidate that keeps at least `share_min` of its prior variance.
    fn take(&self, left: &mut Reductions<'_>, candidate: usize, share_min: f64) {
        let variance = left.variance()[candidate];
        if variance >= share_min * self.variance[candidate] {
            left.take(candidate, self.share_gone(candidate, variance));
        }
    }

    /// The best single candidate and by how much it reduces the trace: Σ_n k(x_n, z)²/k(z, z).
    fn best(&self, left: &Reductions<'_>, aim: Aim) -> Option<(usize, f64)> {
        let reductions = left
            .variance()
            .iter()
            .enumerate()
            .filter(|&(candidate, &variance)| self.is_distinct(candidate, variance))
            .map(|(candidate, &variance)| {
                (candidate, left.reduction(candidate) * self.share_gone(candidate, variance))
            });
        best_of(reductions.filter(|&(_, reduction)| reduction > 0.0), aim)
    }

    /// C = K².
    fn squared(&self) -> Matrix {
        let mut squared = Matrix::zeros(self.len(), self.len());
        add_symmetric_product(1.0, self.gram.view(), &mut squared);
        squared
    }

    /// The best pair, over all of them, from one symmetric product C = K².
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

    /// The share of a candidate's conditional variance that goes once it is chosen.
    fn share_gone(&self, candidate: usize, conditional_variance: f64) -> f64 {
        (1.0 - self.floor[candidate] / conditional_variance).max(0.0)
    }

    /// Whether a candidate of this conditional variance is not one of the known points.
    fn is_distinct(&self, candidate: usize, conditional_variance: f64) -> bool {
        conditional_variance >= DISTINCT_SHARE * self.variance[candidate]
    }
}

/// By how much each pair {i, j} with one j lowers the trace, times a sign:
/// [C_ii k_jj + C_jj k_ii − 2 k_ij C_ij] / (k_ii k_jj − k_ij²); −∞ where one of them tells the other.
struct Pairs<'a> {
    sign: f64,
    /// k_jj, C_jj, and the least variance that j must keep.
    second: [f64; 3],
    /// k_ij and C_ij for every i.
    between: [&'a [f64]; 2],
    /// k_ii, C_ii and the prior variance for every i.
    first: [&'a [f64]; 3],
    merits: &'a mut [f64],
}

impl Wide for Pairs<'_> {
    /// The largest of them.
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
