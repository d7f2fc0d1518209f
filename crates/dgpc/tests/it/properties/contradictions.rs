//! Reported outcomes against a posterior without them.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;
use rand::RngExt;
use rand_distr::StandardNormal;

/// Computes [`Posterior::contradiction`] from the covariance of the outcomes. All outcomes must be at determined
/// inputs.
fn contradiction_by_definition(posterior: &Posterior, reported: &Observations, offset_sd: f64) -> f64 {
    let (mean, covariance) = posterior.joint(reported.inputs()).unwrap();
    let (count, covariance) = (reported.len(), rows(&covariance));
    let p: Vec<f64> = (0..count).map(|n| success_probability(mean[n], covariance[n][n])).collect();
    let varies = |f: f64| logistic(f) * logistic(-f);
    let slope: Vec<f64> = (0..count).map(|n| gaussian_expectation(mean[n], covariance[n][n], varies)).collect();
    let of_outcomes = |a: usize, b: usize| {
        let given_f = if a == b { slope[a].max(0.1) / reported.weights()[a] } else { 0.0 };
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
            let residual: Vec<f64> = part.iter().map(|&n| f64::from(u8::from(reported.outcomes()[n])) - p[n]).collect();
            for direction in [|p: f64| -p, |p: f64| 1.0 - p, |p: f64| 1.0 - 2.0 * p] {
                let direction: Vec<f64> = part.iter().map(|&n| direction(p[n])).collect();
                let weight = solve_vector(&sigma, &direction);
                largest = largest.max(dot(&weight, &residual) / dot(&weight, &direction).sqrt());
            }
        }
    }
    largest
}

/// Returns the variance of one value, and the variance of its deviation from the mean of all values.
fn variances_of_value_and_deviation(covariance: &Dense, n: usize) -> [f64; 2] {
    let count = covariance.len();
    let less_mean: Vec<f64> = (0..count).map(|other| f64::from(u8::from(other == n)) - 1.0 / count as f64).collect();
    [covariance[n][n], dot(&less_mean, &covariance.iter().map(|row| dot(row, &less_mean)).collect::<Vec<_>>())]
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn a_contradiction_agrees_with_its_definition(problem in problems(1..=70), offset_sd in 0.0..1.0f64) {
        let posterior = problem.full();
        let (_, covariance) = posterior.joint(problem.inputs()).unwrap();
        let is_determined = |n: &usize| {
            let either = [rows(&covariance), problem.gram()].map(|covariance| variances_of_value_and_deviation(&covariance, *n));
            let [[value, deviation], [prior, prior_deviation]] = either;
            let is_explained = |left: f64, prior: f64| left > 0.0 && left <= 0.5 * prior;
            let is_apart = prior_deviation >= 0.01 * prior;
            is_explained(value, prior) || is_apart && is_explained(deviation, prior_deviation)
        };
        let determined: Vec<usize> = (0..problem.inputs().len()).filter(is_determined).collect();
        let found = posterior.contradiction(&problem.observations, offset_sd).unwrap();
        let expected = match determined.is_empty() {
            true => 0.0,
            false => contradiction_by_definition(&posterior, &problem.observations.select(&determined), offset_sd),
        };
        prop_assert!((found - expected).abs() < 1e-5 * (1.0 + expected), "{} instead of {}", found, expected);
        // Outcomes cannot contradict the prior.
        let nothing = Posterior::prior_alone(&problem.prior, problem.inputs().dimension());
        prop_assert_eq!(nothing.contradiction(&problem.observations, offset_sd).unwrap(), 0.0);
    }

    #[test]
    fn a_single_outcome_never_contradicts_strongly(problem in problems(1..=20), outcome in any::<bool>(), n in 0..20usize) {
        let one = problem.inputs().select(&[n % problem.inputs().len()]);
        let one = Observations::new(one, vec![outcome]).unwrap();
        prop_assert!(problem.full().contradiction(&one, 0.0).unwrap() < 3.17);
    }
}

/// Returns the posterior of own events along a line, twelve at each place, and forty places between them.
fn line_posterior() -> (Posterior, Inputs) {
    let prior = line_prior(Shape::Matern32);
    let places: Vec<f64> = (0..240).map(|n| f64::from(n / 12) * 0.5).collect();
    let outcomes = (0..240).map(|n| (n / 12) % 8 < 5 || n % 12 == 0).collect();
    let own = fit(&prior, &Observations::new(line(&places), outcomes).unwrap(), &FitOptions::default()).unwrap();
    (own.posterior().unwrap(), line(&(0..40).map(|n| 0.1 + 0.24 * f64::from(n)).collect::<Vec<_>>()))
}

/// Draws functions from the posterior and outcomes from the functions. True outcomes contradict about as rarely as a
/// normal number exceeds the limit. False reports of the same outcomes nearly always contradict. Without the covariance
/// of f, correlated outcomes of neighbouring points would count as independent contradictions.
#[test]
fn true_outcomes_rarely_contradict_and_false_ones_do() {
    const DRAWS: usize = 500;
    let (posterior, places) = line_posterior();
    let mut random = seeded(15);
    let normals = Matrix::from_fn(places.len(), DRAWS, |_, _| random.sample(StandardNormal));
    let (functions, _) = posterior.draws(&places, &normals).unwrap();
    let mut above = |limit: f64, report: &dyn Fn(bool) -> bool| {
        let mut contradicts = |draw: usize| {
            let outcomes = functions.column(draw).iter().map(|&f| report(random.random::<f64>() < logistic(f)));
            let reported = Observations::new(places.clone(), outcomes.collect()).unwrap();
            posterior.contradiction(&reported, 0.0).unwrap() > limit
        };
        (0..DRAWS).filter(|&draw| contradicts(draw)).count() as f64 / DRAWS as f64
    };
    // The statistic is the largest over several parts and three directions, most of which are strongly correlated.
    assert!((0.1..0.4).contains(&above(1.5, &|outcome| outcome)));
    assert!(above(3.0, &|outcome| outcome) < 0.04);
    assert!(above(4.5, &|outcome| outcome) < 0.005);
    for falsify in [|_| false, |_| true, |outcome: bool| !outcome] {
        assert!(above(4.5, &falsify) > 0.95, "{}", above(4.5, &falsify));
    }
}
