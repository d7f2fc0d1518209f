//! Probabilities from latent moments.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

/// Returns ∫ σ(f) N(f; mean, variance) df by Simpson's rule, with steps that resolve both factors.
fn simpson_probability(mean: f64, variance: f64) -> f64 {
    let sd = variance.sqrt();
    // Less than 1e-18 of the mass is beyond 9 standard deviations; σ varies over a few units of f.
    let steps = 2 * (9.0 * sd.max(1.0) / 0.02).ceil() as usize;
    let step = 18.0 / steps as f64;
    let at = |i: usize| {
        let u = -9.0 + step * i as f64;
        let weight = if i == 0 || i == steps {
            1.0
        } else if i % 2 == 1 {
            4.0
        } else {
            2.0
        };
        weight * (-0.5 * u * u).exp() * logistic(mean + sd * u)
    };
    (0..=steps).map(at).sum::<f64>() * step / 3.0 / std::f64::consts::TAU.sqrt()
}

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn probabilities_agree_with_quadrature(mean in prop_oneof![-3.0..3.0f64, -40.0..40.0f64], root in 0.0..20.0f64, step in 0.0..5.0f64) {
        let variance = root * root;
        let p = success_probability(mean, variance);
        let expected = simpson_probability(mean, variance);
        prop_assert!((p - expected).abs() < 1e-8, "{} instead of {}", p, expected);
        prop_assert!((p + success_probability(-mean, variance) - 1.0).abs() < 5e-15);
        let (low, high) = (logistic(mean).min(0.5), logistic(mean).max(0.5));
        prop_assert!(p >= low * (1.0 - 1e-15) && p <= high * (1.0 + 1e-15));
        prop_assert!(success_probability(mean + step, variance) >= p);
        let latent = Latent { mean: vec![mean], variance: vec![variance] };
        prop_assert_eq!(latent.probability(), vec![p]);
    }
}

#[test]
fn certain_latent_values_have_logistic_probabilities() {
    for i in -800..=800 {
        let f = 0.1 * f64::from(i);
        let p = success_probability(f, 0.0);
        assert!((p - logistic(f)).abs() < 3e-9, "f = {f}: {p}");
        // The logarithm stays finite in the far tail, too: a missed event costs about |f| nats.
        assert!(p > 0.0, "f = {f}");
    }
    assert_eq!(success_probability(0.0, 1e300), 0.5);
    assert!(success_probability(1e300, 1.0) == 1.0 && success_probability(-1e300, 1.0) >= 0.0);
}

#[test]
fn probabilities_of_nan_do_not_panic() {
    for (mean, variance) in [(f64::NAN, 1.0), (0.5, f64::NAN), (f64::INFINITY, f64::INFINITY), (f64::NAN, f64::NAN)] {
        let result = std::panic::catch_unwind(|| success_probability(mean, variance));
        assert!(result.is_ok(), "mean {mean}, variance {variance}");
    }
}
