//! The Pólya-Gamma sampler against its distribution: moments from the gamma series, the Laplace transform in closed
//! form, and the distribution function from the theta series of its density.
//!
//! Thresholds are five standard errors, or the Kolmogorov-Smirnov critical value at level 1e-6. No choice of seed makes
//! a correct sampler fail.

use crate::common::seeded;
use dgpc::polya_gamma;
use rand::RngExt;
use rand_distr::Exp1;
use std::f64::consts::{PI, TAU};

/// Tilts from the symmetric distribution to a narrow and nearly Gaussian one.
const TILTS: [f64; 9] = [0.0, 0.1, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0, 700.0];

/// Draws per tilt. A 1 % error of the mean is at least twelve standard errors at every tilt.
const DRAWS: usize = 1_000_000;

fn draws(c: f64, seed: u64) -> Vec<f64> {
    let mut rng = seeded(seed);
    (0..DRAWS).map(|_| polya_gamma::sample(&mut rng, c).unwrap()).collect()
}

fn average(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

/// Returns the first, second and fourth cumulant of PG(1, c) = Σ_k g_k / (2π² d_k), d_k = (k − ½)² + c²/(4π²), g_k ~
/// Exp(1).
fn cumulants(c: f64) -> [f64; 3] {
    const TERMS: u32 = 200_000;
    let a = c / TAU;
    let d = |k: u32| (f64::from(k) - 0.5).powi(2) + a * a;
    let sum = |power: i32| (1..=TERMS).rev().map(|k| d(k).powi(-power)).sum::<f64>();
    // The remainder of each sum is its integral to within 1e-16, by the midpoint rule at unit steps.
    let end = f64::from(TERMS);
    let first_rest = if a == 0.0 { 1.0 / end } else { (a / end).atan() / a };
    let unit = 1.0 / (2.0 * PI * PI);
    [unit * (sum(1) + first_rest), unit.powi(2) * (sum(2) + end.powi(-3) / 3.0), 6.0 * unit.powi(4) * sum(4)]
}

#[test]
fn moments_agree_with_the_gamma_series() {
    for c in TILTS.into_iter().chain([1e-5, 0.0999, 0.1001, 0.3, 3.0, 50.0]) {
        let [mean, variance, _] = cumulants(c);
        for (b, c) in [(1.0, c), (1.0, -c), (2.5, c)] {
            let error = (polya_gamma::mean(b, c) / (b * mean) - 1.0).abs();
            assert!(error < 1e-9, "mean of PG({b}, {c}): relative error {error:e}");
            let error = (polya_gamma::variance(b, c) / (b * variance) - 1.0).abs();
            assert!(error < 1e-9, "variance of PG({b}, {c}): relative error {error:e}");
        }
    }
    for c in [1e4, 1e8, 1e100] {
        assert!((polya_gamma::mean(1.0, c) * 2.0 * c - 1.0).abs() < 1e-12);
        // Divide one factor at a time, because c³ may overflow although the quotient does not.
        let limit = 0.5 / c / c / c;
        assert!((polya_gamma::variance(1.0, c) - limit).abs() <= 1e-12 * limit, "variance of PG(1, {c})");
    }
}

#[test]
fn sample_moments() {
    for (seed, c) in TILTS.into_iter().enumerate() {
        let draws = draws(c, 100 + seed as u64);
        let count = DRAWS as f64;
        let [mean, variance, fourth_cumulant] = cumulants(c);
        let standard_error = (variance / count).sqrt();
        assert!(standard_error < mean / 1200.0, "a 1 % error must stand out at c = {c}");
        let found = average(draws.iter().copied());
        for expected in [mean, polya_gamma::mean(1.0, c)] {
            let error = (found - expected).abs() / standard_error;
            assert!(error < 5.0, "mean at c = {c}: {found}, expected {expected}: {error:.1} standard errors");
        }
        let standard_error = ((fourth_cumulant + 2.0 * variance * variance) / count).sqrt();
        let found = average(draws.iter().map(|x| (x - mean) * (x - mean)));
        for expected in [variance, polya_gamma::variance(1.0, c)] {
            let error = (found - expected).abs() / standard_error;
            assert!(error < 5.0, "variance at c = {c}: {found}, expected {expected}: {error:.1} standard errors");
        }
    }
}

#[test]
fn the_sign_of_the_tilt_does_not_matter() {
    for c in TILTS {
        let (mut plus, mut minus) = (seeded(7), seeded(7));
        for _ in 0..1000 {
            assert_eq!(polya_gamma::sample(&mut plus, c), polya_gamma::sample(&mut minus, -c), "c = {c}");
        }
    }
}

/// Returns ln(cosh x) without overflow.
fn ln_cosh(x: f64) -> f64 {
    x.abs() + (0.5 * (1.0 + (-2.0 * x.abs()).exp())).ln()
}

/// Returns E[exp(−t(ω − centre))] = cosh(c/2)/cosh(√((c²/2 + t)/2)) · exp(t · centre).
fn laplace(c: f64, t: f64, centre: f64) -> f64 {
    (ln_cosh(0.5 * c) - ln_cosh(0.5 * (c * c + 2.0 * t).sqrt()) + t * centre).exp()
}

#[test]
fn laplace_transform() {
    for (seed, c) in TILTS.into_iter().enumerate() {
        let draws = draws(-c, 200 + seed as u64);
        let [mean, variance, _] = cumulants(c);
        // Centred, so that the transform is of order one even for a narrow distribution.
        for scaled in [0.25, 1.0, 2.0, 4.0] {
            let t = scaled / variance.sqrt();
            let expected = laplace(c, t, mean);
            let standard_error = ((laplace(c, 2.0 * t, mean) - expected * expected) / DRAWS as f64).sqrt();
            let found = average(draws.iter().map(|x| (-t * (x - mean)).exp()));
            let error = (found - expected).abs() / standard_error;
            assert!(error < 5.0, "c = {c}, t = {t}: {found}, expected {expected}: {error:.1} standard errors");
        }
    }
}

/// Number of terms of either series of the density, far more than any argument needs.
const TERMS: i32 = 40;

/// Returns ln of the density of PG(1, 0), by the series that converges fast for small x.
fn ln_density_small(x: f64) -> f64 {
    let term = |n: i32| {
        let odd = f64::from(2 * n + 1);
        (if n % 2 == 0 { odd } else { -odd }) * (-(odd * odd - 1.0) / (8.0 * x)).exp()
    };
    -0.5 * (TAU * x * x * x).ln() - 0.125 / x + (0..TERMS).rev().map(term).sum::<f64>().ln()
}

/// Returns ln of the density of PG(1, 0) by the dual theta series, which converges fast for large x.
fn ln_density_large(x: f64) -> f64 {
    let term = |n: i32| {
        let odd = f64::from(2 * n + 1);
        (if n % 2 == 0 { odd } else { -odd }) * (-0.5 * (odd * odd - 1.0) * PI * PI * x).exp()
    };
    TAU.ln() - 0.5 * PI * PI * x + (0..TERMS).rev().map(term).sum::<f64>().ln()
}

/// Returns ln of the density of PG(1, c), the tilted density of PG(1, 0).
fn ln_density(c: f64, x: f64) -> f64 {
    let symmetric = if x < 0.1 { ln_density_small(x) } else { ln_density_large(x) };
    symmetric + ln_cosh(0.5 * c) - 0.5 * c * c * x
}

/// Distribution function of PG(1, c) on a grid in ln x.
struct Law {
    first: f64,
    step: f64,
    below: Vec<f64>,
}

impl Law {
    fn new(c: f64) -> Self {
        const CELLS: usize = 20_000;
        // Density of ln x.
        let density = |u: f64| (ln_density(c, u.exp()) + u).exp();
        // The density of ln x has one mode, near the mean. Beyond these ends it is below 1e-18 of the value at the
        // mean.
        let [mean, variance, _] = cumulants(c);
        let stride = 0.1 * variance.sqrt() / mean;
        let end = |direction: f64| {
            let mut u = mean.ln() + 2.0 * direction * stride;
            while density(u) > 1e-18 * density(mean.ln()) {
                u += direction * stride;
            }
            u
        };
        let (first, last) = (end(-1.0), end(1.0));
        let step = (last - first) / CELLS as f64;
        let mut below = vec![0.0];
        for cell in 0..CELLS {
            let u = first + cell as f64 * step;
            // Simpson's rule on the cell.
            let mass = step / 6.0 * (density(u) + 4.0 * density(u + 0.5 * step) + density(u + step));
            below.push(below[cell] + mass);
        }
        assert!((below[CELLS] - 1.0).abs() < 1e-8, "the density at c = {c} integrates to {}", below[CELLS]);
        Self { first, step, below }
    }

    /// Returns P(ω ≤ x), interpolated linearly between grid points with an error below 1e-6.
    fn below(&self, x: f64) -> f64 {
        let place = (x.ln() - self.first) / self.step;
        if place <= 0.0 {
            return 0.0;
        }
        let cell = place as usize;
        match self.below.get(cell + 1) {
            Some(right) => self.below[cell] + (right - self.below[cell]) * place.fract(),
            None => 1.0,
        }
    }

    /// Returns √n · the largest difference between the distribution functions of the sample and of PG(1, c).
    fn kolmogorov(&self, mut sample: Vec<f64>) -> f64 {
        sample.sort_unstable_by(f64::total_cmp);
        let count = sample.len() as f64;
        let distances = sample.iter().enumerate().map(|(i, &x)| {
            let below = self.below(x);
            (below - i as f64 / count).max((i + 1) as f64 / count - below)
        });
        count.sqrt() * distances.fold(0.0, f64::max)
    }
}

/// √(ln(2/α)/2) for α = 1e-6.
const KOLMOGOROV_CRITICAL: f64 = 2.6935;

#[test]
fn both_series_give_the_same_density() {
    // Both series converge in a range around the point where they are exchanged.
    for i in 0..=40 {
        let x = 0.04 + 0.01 * f64::from(i);
        let error = (ln_density_small(x) - ln_density_large(x)).abs();
        assert!(error < 1e-10, "x = {x}: {error:e}");
    }
}

#[test]
fn whole_distribution() {
    for (seed, c) in TILTS.into_iter().chain([1.5, 3.1, 3.2, 10.0, 41.0]).enumerate() {
        let statistic = Law::new(c).kolmogorov(draws(c, 300 + seed as u64));
        assert!(statistic < KOLMOGOROV_CRITICAL, "c = {c}: {statistic}");
    }
}

#[test]
fn a_truncated_series_is_detected() {
    let mut rng = seeded(400);
    let scale: Vec<f64> = (1..=20).map(|k| 0.5 / (PI * (f64::from(k) - 0.5)).powi(2)).collect();
    let mut truncated = || scale.iter().map(|scale| scale * rng.sample::<f64, _>(Exp1)).sum::<f64>();
    let statistic = Law::new(0.0).kolmogorov((0..DRAWS).map(|_| truncated()).collect());
    assert!(statistic > 2.0 * KOLMOGOROV_CRITICAL, "{statistic}");
}

#[test]
fn a_wrong_tilt_or_scale_is_detected() {
    for (seed, c) in TILTS.into_iter().enumerate() {
        let law = Law::new(c);
        let seed = 500 + seed as u64;
        let stretched = draws(c, seed).iter().map(|x| 1.01 * x).collect();
        let statistic = law.kolmogorov(stretched);
        assert!(statistic > 1.5 * KOLMOGOROV_CRITICAL, "1 % wider at c = {c}: {statistic}");
        // Below c = 2 the distribution depends only weakly on c.
        if c >= 2.0 {
            let statistic = law.kolmogorov(draws(1.03 * c, seed));
            assert!(statistic > 1.5 * KOLMOGOROV_CRITICAL, "c = {c} and 3 % more: {statistic}");
        }
    }
}

#[test]
fn ten_million_draws_are_positive_and_finite() {
    let tilts = [
        0.0,
        f64::MIN_POSITIVE,
        1e-8,
        0.01,
        -0.3,
        1.0,
        -2.0,
        3.12,
        3.13,
        -5.0,
        12.0,
        39.9,
        40.1,
        -100.0,
        700.0,
        1e4,
        -1e6,
        1e10,
        1e150,
        f64::MAX,
    ];
    let mut rng = seeded(600);
    for c in tilts {
        for _ in 0..10_000_000 / tilts.len() {
            let omega = polya_gamma::sample(&mut rng, c).unwrap();
            assert!(omega > 0.0 && omega.is_finite(), "{omega} at c = {c}");
        }
    }
}

#[test]
fn draws_at_huge_tilts_are_close_to_the_mean() {
    let mut rng = seeded(700);
    for c in [1e6f64, -1e6, 1e12, 1e150, 1e160, -1e300] {
        // The relative width is √(2/|c|). The limit is 8 widths plus rounding.
        let width = 8.0 * (2.0 / c.abs()).sqrt() + 1e-14;
        for _ in 0..10_000 {
            let relative = 2.0 * c.abs() * polya_gamma::sample(&mut rng, c).unwrap();
            assert!((relative - 1.0).abs() < width, "c = {c}: {relative} of the mean");
        }
    }
}
