//! The formulas of shapes that loops over long slices take, several points at a time.

use crate::linalg::{MultiplyAdd, Wide, exp_of_negative};

/// Beyond this squared distance every formula here is zero, as numbers go; and no product in it is 0 · ∞.
const SQUARED_DISTANCE_MAX: f64 = 1e6;

/// Correlation at a squared scaled distance, and its derivative by it.
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
        // At distance 0 the slope is infinite, but whatever it is multiplied by there is 0.
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

/// Squared distances become correlations.
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

/// Squared distances become correlations, and the slopes are written beside them.
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

/// What is no number is far away, too.
#[inline(always)]
fn within_reach(squared_distance: f64) -> f64 {
    if squared_distance < SQUARED_DISTANCE_MAX { squared_distance } else { SQUARED_DISTANCE_MAX }
}
