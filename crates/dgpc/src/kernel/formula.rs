//! Formulas of shapes for vectorised loops over several points.

use crate::linalg::{MultiplyAdd, Wide, exp_of_negative};

/// Largest squared distance for the formulas. Beyond it they all underflow to zero, and a product could become 0 · ∞.
const SQUARED_DISTANCE_MAX: f64 = 1e6;

/// A formula for the correlation at a squared scaled distance, and for its derivative by that squared distance.
pub(super) trait Formula {
    fn of<M: MultiplyAdd>(squared_distance: f64) -> (f64, f64);
}

/// exp(−r²/2).
pub(super) struct SquaredExponential;

impl Formula for SquaredExponential {
    #[inline(always)]
    fn of<M: MultiplyAdd>(squared_distance: f64) -> (f64, f64) {
        let correlation = exp_of_negative::<M>(-0.5 * squared_distance);
        (correlation, -0.5 * correlation)
    }
}

/// exp(−r).
pub(super) struct Matern12;

impl Formula for Matern12 {
    #[inline(always)]
    fn of<M: MultiplyAdd>(squared_distance: f64) -> (f64, f64) {
        let r = squared_distance.sqrt();
        let correlation = exp_of_negative::<M>(-r);
        // At distance 0 the derivative is infinite, but its factor in every use is 0 there.
        (correlation, if r > 0.0 { -0.5 * correlation / r } else { 0.0 })
    }
}

/// (1 + √3 r) exp(−√3 r).
pub(super) struct Matern32;

impl Formula for Matern32 {
    #[inline(always)]
    fn of<M: MultiplyAdd>(squared_distance: f64) -> (f64, f64) {
        let r = (3.0 * squared_distance).sqrt();
        let decay = exp_of_negative::<M>(-r);
        (M::multiply_add(r, decay, decay), -1.5 * decay)
    }
}

/// (1 + √5 r + 5r²/3) exp(−√5 r).
pub(super) struct Matern52;

impl Formula for Matern52 {
    #[inline(always)]
    fn of<M: MultiplyAdd>(squared_distance: f64) -> (f64, f64) {
        let r = (5.0 * squared_distance).sqrt();
        let decay = exp_of_negative::<M>(-r);
        let linear = M::multiply_add(r, decay, decay);
        (M::multiply_add(r * decay, r * (1.0 / 3.0), linear), -5.0 / 6.0 * linear)
    }
}

/// Replaces squared distances by correlations.
pub(super) struct Correlations<'a, F>(pub(super) &'a mut [f64], pub(super) F);

impl<F: Formula> Wide for Correlations<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        for value in self.0 {
            *value = F::of::<M>(within_reach(*value)).0;
        }
    }
}

/// Replaces squared distances by correlations, and writes the derivatives to a second slice.
pub(super) struct CorrelationsAndSlopes<'a, F>(pub(super) &'a mut [f64], pub(super) &'a mut [f64], pub(super) F);

impl<F: Formula> Wide for CorrelationsAndSlopes<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        for (value, slope) in self.0.iter_mut().zip(self.1) {
            (*value, *slope) = F::of::<M>(within_reach(*value));
        }
    }
}

/// Limits a squared distance to [`SQUARED_DISTANCE_MAX`]. A NaN counts as far away, too.
#[inline(always)]
fn within_reach(squared_distance: f64) -> f64 {
    if squared_distance < SQUARED_DISTANCE_MAX { squared_distance } else { SQUARED_DISTANCE_MAX }
}
