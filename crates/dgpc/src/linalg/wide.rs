//! Vectorised loops over long slices.
//!
//! A [`Wide`] is a plain loop that the compiler turns into vector instructions. It is compiled once for each kind of
//! processor, and the best version is chosen at run time. Results differ in the last bits between processors with and
//! without fused multiply-add. On one processor they are always the same.

/// A way to compute a multiply-add.
pub(crate) trait MultiplyAdd {
    /// Returns a·b + c.
    fn multiply_add(a: f64, b: f64, c: f64) -> f64;
}

/// Multiply-add in one instruction, rounded once.
struct Fused;

impl MultiplyAdd for Fused {
    #[inline(always)]
    fn multiply_add(a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

/// Multiply-add in two instructions, for processors on which a fused multiply-add is a function call.
pub(crate) struct Unfused;

impl MultiplyAdd for Unfused {
    #[inline(always)]
    fn multiply_add(a: f64, b: f64, c: f64) -> f64 {
        a * b + c
    }
}

/// A vectorised loop. `run` and all functions that it calls must be `#[inline(always)]`. Functions that are not inlined
/// are compiled for the oldest processor.
pub(crate) trait Wide {
    type Output;

    fn run<M: MultiplyAdd>(self) -> Self::Output;
}

/// Runs a loop with the widest instructions of the processor.
pub(crate) fn widest<W: Wide>(work: W) -> W::Output {
    pulp::Arch::new().dispatch(OnArch(work))
}

struct OnArch<W>(W);

impl<W: Wide> pulp::WithSimd for OnArch<W> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> W::Output {
        // Every processor with vectors of several f64 also has fused multiply-add.
        if S::F64_LANES > 1 { self.0.run::<Fused>() } else { self.0.run::<Unfused>() }
    }
}

/// Below this x, e^x is not a normal number and is replaced by zero.
const LOG_SMALLEST: f64 = -708.0;

/// Adding this constant rounds to a whole number, which then is in the lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// ln 2 in two parts. The product of the first part with a whole number up to 2¹¹ is exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];

/// 1/k! for k = 13 down to 2.
const RECIPROCAL_FACTORIALS: [f64; 12] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
];

/// Returns e^x for x ≤ 0, with a relative error of at most 1e-15, and zero below −708.
///
/// The argument is reduced to x = n ln 2 + r with |r| ≤ ½ ln 2. Then n is added to the exponent of e^r. The series of
/// e^r has a first omitted term below 5e-18. The function has no branch, so that loops over it are vectorised.
#[inline(always)]
pub(crate) fn exp_of_negative<M: MultiplyAdd>(x: f64) -> f64 {
    let shifted = M::multiply_add(x, std::f64::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = M::multiply_add(n, -LN_2[1], M::multiply_add(n, -LN_2[0], x));
    let mut series = RECIPROCAL_FACTORIALS[0];
    for coefficient in &RECIPROCAL_FACTORIALS[1..] {
        series = M::multiply_add(series, r, *coefficient);
    }
    let power = M::multiply_add(series * r, r, r) + 1.0;
    let scaled = f64::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 52));
    if x > LOG_SMALLEST { scaled } else { 0.0 }
}

/// Computes aᵀb in sixteen independent partial sums.
pub(crate) struct Dot<'a>(pub(crate) &'a [f64], pub(crate) &'a [f64]);

impl Wide for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) -> f64 {
        let Self(a, b) = self;
        let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<SUMS>(), b.as_chunks::<SUMS>());
        let mut sums = [0.0; SUMS];
        for (a, b) in a.iter().zip(b) {
            for place in 0..SUMS {
                sums[place] = M::multiply_add(a[place], b[place], sums[place]);
            }
        }
        for ((sum, a), b) in sums.iter_mut().zip(a_rest).zip(b_rest) {
            *sum = M::multiply_add(*a, *b, *sum);
        }
        let mut width = SUMS / 2;
        while width > 0 {
            for place in 0..width {
                sums[place] += sums[place + width];
            }
            width /= 2;
        }
        sums[0]
    }
}

const SUMS: usize = 16;

/// Computes y ← y + factor·x.
pub(crate) struct AddScaled<'a>(pub(crate) f64, pub(crate) &'a [f64], pub(crate) &'a mut [f64]);

impl Wide for AddScaled<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        let Self(factor, x, y) = self;
        for (y, x) in y.iter_mut().zip(x) {
            *y = M::multiply_add(factor, *x, *y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes e^x of every element in place.
    struct Exponentials<'a>(&'a mut [f64]);

    impl Wide for Exponentials<'_> {
        type Output = ();

        #[inline(always)]
        fn run<M: MultiplyAdd>(self) {
            self.0.iter_mut().for_each(|x| *x = exp_of_negative::<M>(*x));
        }
    }

    fn places() -> Vec<f64> {
        let near = (0..20_000).map(|n| -f64::from(n) * 1e-3);
        let far = (0..70_800).map(|n| -f64::from(n) * 1e-2);
        near.chain(far).chain([-0.0, -1e-300, -5e-324]).collect()
    }

    #[test]
    fn exponentials_agree_with_the_standard_library() {
        let (mut wide, mut plain) = (places(), places());
        widest(Exponentials(&mut wide));
        Exponentials(&mut plain).run::<Unfused>();
        for ((x, wide), plain) in places().into_iter().zip(wide).zip(plain) {
            let expected = x.exp();
            assert!((wide - expected).abs() <= 1e-15 * expected, "{x}: {wide} for {expected}");
            // Without fusion, n·ln 2 is subtracted with two roundings of at most 2⁻⁵³|x| each.
            assert!((plain - expected).abs() <= 1e-15 * expected, "{x}: {plain} for {expected}");
        }
    }

    #[test]
    fn exponentials_below_the_normal_range_are_zero() {
        let mut beyond = [-708.5, -1e6, f64::MIN, f64::NEG_INFINITY];
        widest(Exponentials(&mut beyond));
        assert_eq!(beyond, [0.0; 4]);
    }

    #[test]
    fn products_agree_with_plain_sums_at_every_length() {
        for length in 0..70 {
            let a: Vec<f64> = (0..length).map(|n| (f64::from(n) * 0.7).sin()).collect();
            let b: Vec<f64> = (0..length).map(|n| (f64::from(n) * 1.3).cos()).collect();
            let expected: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
            assert!((widest(Dot(&a, &b)) - expected).abs() < 1e-14 * (1.0 + f64::from(length)), "{length}");
            assert!((Dot(&a, &b).run::<Unfused>() - expected).abs() < 1e-14 * (1.0 + f64::from(length)), "{length}");
            let mut sum = b.clone();
            widest(AddScaled(2.0, &a, &mut sum));
            assert!(sum.iter().zip(&a).zip(&b).all(|((sum, a), b)| (sum - (2.0 * a + b)).abs() < 1e-15 * 3.0));
        }
    }
}
