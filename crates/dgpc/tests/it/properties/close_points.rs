//! Points that nearly coincide, and points that are far apart.

use super::problems::*;
use crate::common::*;
use dgpc::*;

#[test]
fn summaries_at_nearly_equal_points_agree_with_their_merger() {
    let prior = line_prior(Shape::SquaredExponential);
    let none = Sites::empty(1);
    let elsewhere = line(&[-2.0, -0.5, 0.0, 0.4, 3.0]);
    // A message at z − δ/2 and z + δ/2, against the message twice at z. They differ by δ² only.
    let packet =
        |z: f64| Summary::from_whitened(&prior, &line(&[z]), Matrix::from_fn(1, 1, |_, _| 3.0), vec![1.2]).unwrap();
    let mut merged = packet(0.1);
    merged.merge(&packet(0.1)).unwrap();
    let merged = Posterior::fuse(&prior, &none, &[&merged]).unwrap().latent(&elsewhere).unwrap();
    for spacing in [1e-3, 1e-5, 1e-7, 1e-9, 0.0] {
        let (left, right) = (packet(0.1 - 0.5 * spacing), packet(0.1 + 0.5 * spacing));
        let fused = Posterior::fuse(&prior, &none, &[&left, &right]).unwrap().latent(&elsewhere).unwrap();
        assert_same_latent(&fused, &merged, 1e-12 + 2.0 * spacing * spacing);
    }
}

#[test]
fn nearly_equal_inducing_points_carry_value_and_derivative() {
    let sites = line_sites();
    let none = Sites::empty(1);
    let elsewhere = line(&[-2.0, -0.5, 0.0, 0.4, 3.0]);
    for shape in [Shape::SquaredExponential, Shape::Matern52] {
        let prior = line_prior(shape);
        for summarise in [Summary::variational, Summary::marginal] {
            let fused = |spacing: f64| {
                let z = line(&[0.1 - 0.5 * spacing, 0.1 + 0.5 * spacing]);
                let summary = summarise(&prior, &sites, &z).unwrap();
                assert_eq!(summary.jitter(), 0.0);
                assert!(summary.moments().unwrap().0.iter().all(|mean| mean.is_finite()));
                Posterior::fuse(&prior, &none, &[&summary]).unwrap().latent(&elsewhere).unwrap()
            };
            // The two points represent f and f′ at 0.1, up to O(δ²), or O(δ) for the kernel with the rougher f′.
            let tolerance = if shape == Shape::SquaredExponential { 3e-6 } else { 3e-3 };
            assert_same_latent(&fused(1e-3), &fused(2e-3), tolerance);
        }
    }
}

#[test]
fn equal_inducing_points_count_once() {
    let (prior, sites) = (line_prior(Shape::SquaredExponential), line_sites());
    let elsewhere = line(&[-2.0, -0.5, 0.0, 0.4, 3.0]);
    for summarise in [Summary::variational, Summary::marginal] {
        let fused = |z: &[f64]| {
            let summary = summarise(&prior, &sites, &line(z)).unwrap();
            let posterior = Posterior::fuse(&prior, &Sites::empty(1), &[&summary]).unwrap();
            (posterior.latent(&elsewhere).unwrap(), posterior.jitter())
        };
        let (once, jitter) = fused(&[0.1, 1.0]);
        assert_eq!(jitter, 0.0);
        let (twice, jitter) = fused(&[0.1, 1.0, 0.1]);
        assert!(jitter < 1e-7, "{jitter}");
        assert_same_latent(&twice, &once, 1e-6);
    }
}

#[test]
fn far_points_have_no_covariance() {
    // The scaled squared distances overflow.
    let inputs = line(&[0.0, 1e155, -1e200, 1e300]);
    for shape in [Shape::SquaredExponential, Shape::Matern32, Shape::Matern52] {
        let prior = line_prior(shape);
        let gram = rows(&prior.kernel().gram(&inputs).unwrap());
        assert_eq!(gram, diagonal_matrix([2.0; 4].into_iter()), "{shape:?}");
    }
}

#[test]
fn rounding_errors_of_subtraction_are_ignored() {
    // 0.3 − 0.1 − 0.2 is −2.8e-17, which is negligible compared with the prior's precision of 1.
    let prior = line_prior(Shape::SquaredExponential);
    let summary = |precision| {
        Summary::from_whitened(&prior, &line(&[0.0]), Matrix::from_fn(1, 1, |_, _| precision), vec![0.0]).unwrap()
    };
    let mut left = summary(0.3);
    left.subtract(&summary(0.1)).unwrap();
    left.subtract(&summary(0.2)).unwrap();
    let posterior = Posterior::fuse(&prior, &Sites::empty(1), &[&left]).unwrap();
    assert_near("variance", &posterior.latent(&line(&[0.0])).unwrap().variance, &[2.0], 1e-14);
    left.factor().unwrap();
}
