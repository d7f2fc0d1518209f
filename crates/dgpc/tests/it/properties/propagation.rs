//! Expectation propagation against its defining equations.

use super::fits::message;
use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

/// Returns mean and variance of a Gaussian times the likelihood of an outcome.
fn tilted(outcome: bool, weight: f64, mean: f64, variance: f64) -> (f64, f64) {
    let likelihood = |f: f64| logistic(if outcome { f } else { -f }).powf(weight);
    let moment = |power: i32| gaussian_expectation(mean, variance, |f| likelihood(f) * f.powi(power));
    let total = moment(0);
    let mean = moment(1) / total;
    (mean, moment(2) / total - mean * mean)
}

proptest! {
    #![proptest_config(cases(60))]

    /// The posterior of every event has the moments of its cavity times the likelihood of its outcome.
    #[test]
    fn every_site_matches_the_moments_of_its_outcome(problem in problems(1..=14), with_message in any::<bool>()) {
        let message = message(&problem);
        let messages: Vec<&Summary> = message.iter().filter(|_| with_message).collect();
        let fit = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
        let found = fit.propagated_with(&messages).unwrap();
        prop_assert!(found.converged(), "{} after {}", found.change(), found.iterations());
        let Latent { mean, variance } = found.posterior().unwrap().latent(problem.inputs()).unwrap();
        for n in 0..mean.len() {
            let (omega, kappa) = (found.sites().omega()[n], found.sites().kappa()[n]);
            let cavity = 1.0 / (1.0 / variance[n] - omega);
            let cavity_mean = cavity * (mean[n] / variance[n] - kappa);
            let (outcome, weight) = (problem.observations.outcomes()[n], problem.observations.weights()[n]);
            let expected = tilted(outcome, weight, cavity_mean, cavity);
            let off = [(mean[n] - expected.0) / variance[n].sqrt(), variance[n] / expected.1 - 1.0];
            prop_assert!(off.iter().all(|off| off.abs() < 1e-3), "{off:?} {expected:?} {cavity_mean} {cavity}");
        }
    }

    /// With inducing points at all events the results agree. The messages may be part of the fit or not.
    #[test]
    fn sparse_on_all_events_is_dense(problem in problems(3..=14), with_message in 0..3u8) {
        let observations = problem.observations.select(&problem.spread(14));
        let message = message(&problem);
        let messages: Vec<&Summary> = message.iter().filter(|_| with_message > 0).collect();
        let fitted: &[&Summary] = if with_message > 1 { &messages } else { &[] };
        let dense = FitOptions::default().messages(fitted);
        let sparse = dense.inducing_points(observations.inputs());
        let [dense, sparse] = [dense, sparse].map(|options| dgpc::fit(&problem.prior, &observations, &options).unwrap());
        prop_assume!(sparse.jitter() == 0.0);
        let latent = |fit: &Fit| {
            let found = fit.propagated_with(&messages).unwrap();
            assert!(found.converged());
            found.posterior().unwrap().latent(&problem.elsewhere).unwrap()
        };
        assert_same_latent(&latent(&sparse), &latent(&dense), 1e-3);
    }
}

#[test]
fn propagation_without_events_changes_nothing() {
    let none = Observations::new(Inputs::empty(1), Vec::new()).unwrap();
    let fit = fit(&line_prior(Shape::Matern32), &none, &FitOptions::default()).unwrap();
    let found = fit.propagated_with(&[]).unwrap();
    assert!(found.converged() && found.sites().is_empty());
    let [wide, before] =
        [found.posterior().unwrap(), fit.posterior().unwrap()].map(|p| p.latent(&line(&[0.0])).unwrap());
    assert_eq!(wide, before);
}

/// With one event there is no other site, so the moments are those of the exact posterior.
#[test]
fn one_event_has_its_exact_moments() {
    for (outcome, weight) in [(true, 1.0), (false, 1.0), (true, 4.0), (false, 0.3)] {
        let observations = Observations::weighted(line(&[0.3]), vec![outcome], vec![weight]).unwrap();
        let prior = line_prior(Shape::SquaredExponential);
        let variance = prior.kernel().diagonal(observations.inputs()).unwrap()[0];
        let mean = prior.mean().values(observations.inputs()).unwrap()[0];
        let expected = tilted(outcome, weight, mean, variance);
        let found = fit(&prior, &observations, &FitOptions::default()).unwrap().propagated_with(&[]).unwrap();
        let found = found.posterior().unwrap().latent(observations.inputs()).unwrap();
        assert_near("moments", &[found.mean[0], found.variance[0]], &[expected.0, expected.1], 1e-4);
    }
}
