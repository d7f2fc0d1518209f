//! The Pólya-Gamma distribution: exact draws from PG(1, c), and moments ([`crate::method::likelihood`]).
//!
//! The sampler is Devroye's rejection method for the Jacobi distribution J*(1, z) with z = |c|/2 and PG(1, c) = J*(1,
//! z)/4 (Polson, Scott and Windle 2013, section 4). The proposal is an inverse Gaussian left of 0.64 and an exponential
//! right of it. The density is an alternating series whose partial sums bracket it, so that a few terms decide
//! acceptance exactly. All masses are compared as logarithms: nothing overflows or cancels at any finite c.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

use rand::{Rng, RngExt};
use rand_distr::{Exp1, StandardNormal};

use crate::error::{Result, finite};
use crate::special::normal_cdf;

/// The point where the two series of the Jacobi density meet. Any value near 0.64 is valid and nearly optimal.
const SPLIT: f64 = 0.64;

/// Draws exactly from PG(1, c), in about 50 ns at any finite c. The result is finite and positive.
///
/// ```
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
///
/// let omega = dgpc::polya_gamma::sample(&mut ChaCha8Rng::seed_from_u64(1), 0.5)?;
/// assert!(omega > 0.0);
/// # Ok::<(), dgpc::Error>(())
/// ```
///
/// # Errors
/// [`crate::Error::NotFinite`] for a c that is not finite.
pub fn sample<R: Rng + ?Sized>(rng: &mut R, c: f64) -> Result<f64> {
    finite("tilt of a Pólya-Gamma variable", c)?;
    let z = 0.5 * c.abs();
    let left = LeftShare::of(z);
    loop {
        let x = if left.decides(rng.random::<f64>()) {
            inverse_gaussian_left(rng, z)
        } else {
            let exponential: f64 = rng.sample(Exp1);
            SPLIT + exponential / rate(z)
        };
        if accept(rng, x) {
            return Ok(0.25 * x);
        }
    }
}

/// Returns the rate of the exponential right of the split.
fn rate(z: f64) -> f64 {
    PI * PI / 8.0 + 0.5 * z * z
}

/// The share of the proposal's mass left of [`SPLIT`], with an interpolated value that nearly always suffices. The
/// exact share costs more than the rest of a draw.
struct LeftShare {
    z: f64,
    near: f64,
}

impl LeftShare {
    fn of(z: f64) -> Self {
        let place = (z * TABLE_PER_UNIT).min(TABLE_END);
        let first = place as usize;
        let near = match TABLE.get(first..first + 2) {
            Some(&[low, high]) => low + (place - first as f64) * (high - low),
            _ => 1.0,
        };
        Self { z, near }
    }

    /// Returns whether a uniform number lies below the share. The decision is exact.
    #[inline]
    fn decides(&self, uniform: f64) -> bool {
        let beyond = uniform - self.near;
        if beyond.abs() > TABLE_ERROR { beyond < 0.0 } else { uniform < left_share(self.z) }
    }
}

/// The share at every multiple of 1/[`TABLE_PER_UNIT`] up to z = 16. Beyond z = 16, all but 1e-12 of the mass lies
/// left.
static TABLE: LazyLock<Vec<f64>> =
    LazyLock::new(|| (0..=TABLE_END as u32).map(|n| left_share(f64::from(n) / TABLE_PER_UNIT)).collect());

const TABLE_END: f64 = 16.0 * TABLE_PER_UNIT;

const TABLE_PER_UNIT: f64 = 64.0;

/// Bound on the interpolation error. A straight line between neighbours is off by at most h²/8 max |f″| with h = 1/64.
/// The largest |f″| is 0.261, at z = 0.
const TABLE_ERROR: f64 = 0.3 / (8.0 * TABLE_PER_UNIT * TABLE_PER_UNIT);

/// Returns the exact share of the proposal's mass left of [`SPLIT`].
fn left_share(z: f64) -> f64 {
    let rate = rate(z);
    // ln of ∫ (π/2) exp(−rate x) dx right of the split, and ln of 2 exp(−z) · P(IG(1/z, 1) < split) left of it.
    let ln_right = (FRAC_PI_2 / rate).ln() - rate * SPLIT;
    let root = SPLIT.sqrt();
    let (near, far) = ((SPLIT * z - 1.0) / root, (SPLIT * z + 1.0) / root);
    // The second term is exp(2z) Φ(−far). Beyond z = 20 it is below 1e-47 of the first, and its factors would overflow.
    let reflected = if z < 20.0 { (2.0 * z).exp() * normal_cdf(-far) } else { 0.0 };
    let ln_left = std::f64::consts::LN_2 - z + (normal_cdf(near) + reflected).ln();
    1.0 / (1.0 + (ln_right - ln_left).exp())
}

/// Draws from the inverse Gaussian of mean 1/z and shape 1, conditional on a value below [`SPLIT`].
fn inverse_gaussian_left<R: Rng + ?Sized>(rng: &mut R, z: f64) -> f64 {
    let mean = 1.0 / z;
    if mean > SPLIT {
        // Draw 1/χ² restricted to x < SPLIT by a pair of exponentials, then thin by exp(−z²x/2).
        loop {
            let (first, second): (f64, f64) = (rng.sample(Exp1), rng.sample(Exp1));
            if first * first > 2.0 * second / SPLIT {
                continue;
            }
            let x = SPLIT / ((1.0 + SPLIT * first) * (1.0 + SPLIT * first));
            if rng.random::<f64>() <= (-0.5 * z * z * x).exp() {
                return x;
            }
        }
    }
    loop {
        // The larger root has no cancellation; the smaller one is mean² / larger.
        let normal: f64 = rng.sample(StandardNormal);
        let y = mean * normal * normal;
        let ratio = 1.0 + 0.5 * y + (y + 0.25 * y * y).sqrt();
        let x = if rng.random::<f64>() * (1.0 + ratio) <= ratio { mean / ratio } else { mean * ratio };
        if x < SPLIT {
            return x;
        }
    }
}

/// Lower bound on the first partial sum of the series. The minimum is at the split: .99422 left and .99459 right of it.
const KEPT: f64 = 0.994;

/// Decides by the alternating series whether to accept a proposal.
fn accept<R: Rng + ?Sized>(rng: &mut R, x: f64) -> bool {
    let uniform = rng.random::<f64>();
    if uniform <= KEPT {
        return true;
    }
    let mut partial = 1.0;
    let mut n = 0.0;
    loop {
        n += 1.0;
        partial -= term_ratio(n, x);
        if uniform <= partial {
            return true;
        }
        n += 1.0;
        partial += term_ratio(n, x);
        if uniform > partial {
            return false;
        }
    }
}

/// Returns a_n(x)/a_0(x), the ratio of the n-th term of the Jacobi series to its first term.
fn term_ratio(n: f64, x: f64) -> f64 {
    let exponent = if x > SPLIT { 0.5 * PI * PI * x } else { 2.0 / x };
    (2.0 * n + 1.0) * (-exponent * n * (n + 1.0)).exp()
}

/// Returns the mean of PG(b, c): b/(2c) · tanh(c/2), or b/4 at c = 0. The result is NaN if an argument is NaN.
pub fn mean(b: f64, c: f64) -> f64 {
    let c = c.abs();
    // Below 1e-4 the next term, c⁴/120, is below 1e-18.
    if c < 1e-4 { 0.25 * b * (1.0 - c * c / 12.0) } else { 0.5 * b * (0.5 * c).tanh() / c }
}

/// Returns the variance of PG(b, c): b/(4c³) · (sinh c − c)/cosh²(c/2), or b/24 at c = 0. The result is NaN if an
/// argument is not finite.
pub fn variance(b: f64, c: f64) -> f64 {
    let c = c.abs();
    if c < 0.1 {
        // Series at 0; the first omitted term, 5461 c¹⁰/86 486 400, is below 1e-14.
        let c2 = c * c;
        b / 24.0
            * (1.0 - c2 / 5.0 + 17.0 * c2 * c2 / 560.0 - 31.0 * c2 * c2 * c2 / 7560.0
                + 691.0 * c2.powi(4) / 1_330_560.0)
    } else {
        // (sinh c − c)/cosh²(c/2) with numerator and denominator divided by e^c/4, so that neither overflows.
        let decay = (-c).exp();
        b / (4.0 * c * c * c) * 2.0 * (1.0 - decay * decay - 2.0 * c * decay) / ((1.0 + decay) * (1.0 + decay))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interpolation_error_stays_below_its_bound() {
        let largest =
            (0..20 * 6400).map(|n| f64::from(n) / 6400.0 + 1e-5).map(|z| (LeftShare::of(z).near - left_share(z)).abs());
        let largest = largest.fold(0.0, f64::max);
        assert!(largest < TABLE_ERROR, "{largest}");
        // The bound is not too wide either: a wide bound would make the table useless.
        assert!(largest > TABLE_ERROR / 2.0, "{largest}");
    }

    #[test]
    fn uniforms_near_the_share_are_decided_exactly() {
        for z in [0.0, 0.007, 1.0, 3.3, 15.99, 16.0, 40.0, 1e9] {
            let (share, exact) = (LeftShare::of(z), left_share(z));
            for uniform in [exact.next_down(), exact, exact.next_up(), exact - 1e-7, exact + 1e-7, 0.0, 0.999] {
                assert_eq!(share.decides(uniform), uniform < exact, "{uniform} of {exact} at {z}");
            }
        }
    }

    #[test]
    fn the_first_partial_sum_is_nowhere_below_its_bound() {
        let first = |x| 1.0 - term_ratio(1.0, x);
        let least = (1..10_000).map(|n| first(f64::from(n) * 1e-3)).fold(1.0, f64::min);
        assert!(least > KEPT && first(SPLIT.next_up()) > KEPT, "{least}");
    }
}
