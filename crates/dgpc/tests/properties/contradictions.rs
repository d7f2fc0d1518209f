//! What is told against what is known without it.

use crate::common::*;
use crate::problems::*;
use dgpc::*;
use proptest::prelude::*;
use rand::RngExt;
use rand_distr::StandardNormal;

/// What [`Posterior::contradiction`] says of outcomes that are all looked at, worked out with the covariance of the outcomes themselves.
fn directly(posterior: &Posterior, told: &Observations, offset_sd: f64) -> f64 {
    let (mean, covariance) = posterior.joint(told.inputs()).unwrap();
    let (count, covariance) = (told.len(), rows(&covariance));
    let p: Vec<f64> = (0..count).map(|n| success_probability(mean[n], covariance[n][n])).collect();
    let varies = |f: f64| logistic(f) * logistic(-f);
    let slope: Vec<f64> = (0..count).map(|n| gaussian_expectation(mean[n], covariance[n][n], varies)).collect();
    let of_outcomes = |a: usize, b: usize| {
        let given_f = if a == b { slope[a].max(0.1) / told.weights()[a] } else { 0.0 };
        given_f + slope[a] * (covariance[a][b] + offset_sd * offset_sd) * slope[b]
    };
    let mut largest: f64 = 0.0;
    for parts in [1, 2, 4, 8] {
        let length = count.div_ceil(parts);
        if parts > 1 && length < 16 {
            break;
        }
        for first in (0..count).step_by(length) {
            let part: Vec<usize> = (first..count.min(first + length)).collect();
            let sigma: Dense = part.iter().map(|&a| part.iter().map(|&b| of_outcomes(a, b)).collect()).collect();
            let residual: Vec<f64> = part.iter().map(|&n| f64::from(u8::from(told.outcomes()[n])) - p[n]).collect();
            for direction in [|p: f64| -p, |p: f64| 1.0 - p, |p: f64| 1.0 - 2.0 * p] {
                let direction: Vec<f64> = part.iter().map(|&n| direction(p[n])).collect();
                let weight = solve_vector(&sigma, &direction);
                largest = largest.max(dot(&weight, &residual) / dot(&weight, &direction).sqrt());
            }
        }
    }
    largest
}

/// Variance of one of some values, and of it less their mean.
fn itself_and_about_mean(covariance: &Dense, n: usize) -> [f64; 2] {
    let count = covariance.len();
    let less_mean: Vec<f64> = (0..count).map(|other| f64::from(u8::from(other == n)) - 1.0 / count as f64).collect();
    [covariance[n][n], dot(&less_mean, &covariance.iter().map(|row| dot(row, &less_mean)).collect::<Vec<_>>())]
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn a_contradiction_is_a_score_in_standard_deviations(problem in problems(1..=70), offset_sd in 0.0..1.0f64) {
        let posterior = problem.full();
        let (_, covariance) = posterior.joint(problem.inputs()).unwrap();
        let is_known = |n: &usize| {
            let either = [rows(&covariance), problem.gram()].map(|covariance| itself_and_about_mean(&covariance, *n));
            let [[itself, about_mean], [prior, prior_about_mean]] = either;
            let is_explained = |left: f64, prior: f64| left > 0.0 && left <= 0.5 * prior;
            let is_apart = prior_about_mean >= 0.01 * prior;
            is_explained(itself, prior) || is_apart && is_explained(about_mean, prior_about_mean)
        };
        let known: Vec<usize> = (0..problem.inputs().len()).filter(is_known).collect();
        let found = posterior.contradiction(&problem.observations, offset_sd).unwrap();
        let expected = match known.is_empty() {
            true => 0.0,
            false => directly(&posterior, &problem.observations.select(&known), offset_sd),
        };
        prop_assert!((found - expected).abs() < 1e-5 * (1.0 + expected), "{} instead of {}", found, expected);
        // Of a prior nothing can be told.
        let nothing = Posterior::prior_alone(&problem.prior, problem.inputs().dimension());
        prop_assert_eq!(nothing.contradiction(&problem.observations, offset_sd).unwrap(), 0.0);
    }

    #[test]
    fn one_outcome_alone_never_contradicts_by_much(problem in problems(1..=20), heard in any::<bool>(), n in 0..20usize) {
        let one = problem.inputs().select(&[n % problem.inputs().len()]);
        let one = Observations::new(one, vec![heard]).unwrap();
        prop_assert!(problem.full().contradiction(&one, 0.0).unwrap() < 3.17);
    }
}

/// Somebody's own events along a line, twelve at each place, and what others may tell of forty places between.
fn known_line() -> (Posterior, Inputs) {
    let prior = line_prior(Shape::Matern32);
    let places: Vec<f64> = (0..240).map(|n| f64::from(n / 12) * 0.5).collect();
    let outcomes = (0..240).map(|n| (n / 12) % 8 < 5 || n % 12 == 0).collect();
    let own = fit(&prior, &Observations::new(line(&places), outcomes).unwrap(), &FitOptions::default()).unwrap();
    (own.posterior().unwrap(), line(&(0..40).map(|n| 0.1 + 0.24 * f64::from(n)).collect::<Vec<_>>()))
}

/// Of functions drawn from what is known, what is told contradicts as seldom as a normal number does; of the same functions, told
/// otherwise, nearly always. Without the covariance of f, outcomes nearby would seem to agree in contradicting.
#[test]
fn the_truth_seldom_contradicts_and_lies_do() {
    const DRAWS: usize = 500;
    let (posterior, places) = known_line();
    let mut random = seeded(15);
    let normals = Matrix::from_fn(places.len(), DRAWS, |_, _| random.sample(StandardNormal));
    let (functions, _) = posterior.draws(&places, &normals).unwrap();
    let mut above = |limit: f64, tell: &dyn Fn(bool) -> bool| {
        let mut contradicts = |draw: usize| {
            let outcomes = functions.column(draw).iter().map(|&f| tell(random.random::<f64>() < logistic(f)));
            let told = Observations::new(places.clone(), outcomes.collect()).unwrap();
            posterior.contradiction(&told, 0.0).unwrap() > limit
        };
        (0..DRAWS).filter(|&draw| contradicts(draw)).count() as f64 / DRAWS as f64
    };
    // The largest of several parts, each in three directions, most of which go together.
    assert!((0.1..0.4).contains(&above(1.5, &|heard| heard)));
    assert!(above(3.0, &|heard| heard) < 0.04);
    assert!(above(4.5, &|heard| heard) < 0.005);
    for lie in [|_| false, |_| true, |heard: bool| !heard] {
        assert!(above(4.5, &lie) > 0.95, "{}", above(4.5, &lie));
    }
}
