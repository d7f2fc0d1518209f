//! Points in units of a correlation's length-scales.

use crate::linalg::{MultiplyAdd, Wide, widest};

/// N points with every column divided by its length-scale. They are stored coordinate by coordinate, so that vectorised
/// loops process several points at a time.
pub(super) struct Scaled {
    /// N values of the first coordinate, N values of the second …
    values: Vec<f64>,
    points: usize,
}

impl Scaled {
    /// Creates the points from N values of every coordinate.
    pub(super) fn new(values: Vec<f64>, points: usize) -> Self {
        Self { values, points }
    }

    fn coordinates(&self) -> impl Iterator<Item = &[f64]> {
        // Without points there are no values, and the iterator is empty.
        self.values.chunks_exact(self.points.max(1))
    }

    /// Writes r² between point `n` and each of `others` from `first` on.
    pub(super) fn squared_distances(&self, n: usize, (others, first): (&Scaled, usize), out: &mut [f64]) {
        widest(SquaredDistances { from: self, n, to: others, first, out });
    }

    /// Adds Σ wᵢ · (part of r² in that coordinate), over the same pairs, to the sum of every coordinate. If a weight is
    /// zero, an infinite part of r² does not count.
    pub(super) fn add_weighted_squares(
        &self,
        n: usize,
        (others, first): (&Scaled, usize),
        weights: &[f64],
        sums: &mut [f64],
    ) {
        for ((own, others), sum) in self.coordinates().zip(others.coordinates()).zip(sums) {
            *sum += widest(WeightedSquares { from: own[n], to: &others[first..first + weights.len()], weights });
        }
    }
}

struct SquaredDistances<'a> {
    from: &'a Scaled,
    n: usize,
    to: &'a Scaled,
    first: usize,
    out: &'a mut [f64],
}

impl Wide for SquaredDistances<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        let Self { from, n, to, first, out } = self;
        let (chunks, rest) = out.as_chunks_mut::<CHUNK>();
        let mut place = first;
        for chunk in chunks {
            let mut sums = [0.0; CHUNK];
            let mut own = n;
            for other in to.values.chunks_exact(to.points.max(1)) {
                let other = &other[place..place + CHUNK];
                for lane in 0..CHUNK {
                    let apart = other[lane] - from.values[own];
                    sums[lane] = M::multiply_add(apart, apart, sums[lane]);
                }
                own += from.points;
            }
            *chunk = sums;
            place += CHUNK;
        }
        for out in rest {
            let (mut sum, mut own) = (0.0, n);
            for other in to.values.chunks_exact(to.points.max(1)) {
                let apart = other[place] - from.values[own];
                sum = M::multiply_add(apart, apart, sum);
                own += from.points;
            }
            *out = sum;
            place += 1;
        }
    }
}

struct WeightedSquares<'a> {
    from: f64,
    to: &'a [f64],
    weights: &'a [f64],
}

impl Wide for WeightedSquares<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) -> f64 {
        let ((to, to_rest), (weights, weights_rest)) = (self.to.as_chunks::<SUMS>(), self.weights.as_chunks::<SUMS>());
        let mut sums = [0.0; SUMS];
        for (to, weights) in to.iter().zip(weights) {
            for place in 0..SUMS {
                sums[place] = M::multiply_add(weights[place], square(to[place] - self.from), sums[place]);
            }
        }
        for ((sum, weight), to) in sums.iter_mut().zip(weights_rest).zip(to_rest) {
            *sum = M::multiply_add(*weight, square(to - self.from), *sum);
        }
        sums.iter().sum()
    }
}

const CHUNK: usize = 16;

const SUMS: usize = 8;

/// Returns x², limited to the largest finite number. Its product with zero is therefore zero.
#[inline(always)]
fn square(x: f64) -> f64 {
    let squared = x * x;
    if squared < f64::MAX { squared } else { f64::MAX }
}
