//! The mean-field fixed point and its evidence bound.

use super::fits::message;
use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::collection::vec;
use proptest::prelude::*;

/// Returns E of [`dgpc::method::learning`] at arbitrary tilts, by dense formulas.
fn evidence_bound(problem: &Problem, tilts: &[f64]) -> f64 {
    let (gram, count) = (problem.gram(), tilts.len());
    let weights = problem.observations.weights();
    let omega: Vec<f64> = (0..count).map(|n| weights[n] * (0.5 * tilts[n]).tanh() / (2.0 * tilts[n])).collect();
    let sites = Sites::new(&problem.observations, omega.clone()).unwrap();
    let shift = sites.shift(problem.prior.mean()).unwrap();
    let mean = problem.prior.mean().values(problem.inputs()).unwrap();
    // ln|B| = ln|K + Ω⁻¹| + ln|Ω|; κ̃ᵀΣκ̃ with Σ = K − K(K + Ω⁻¹)⁻¹K.
    let noisy = sum(&gram, &diagonal_matrix(omega.iter().map(|omega| 1.0 / omega)));
    let log_b = log_determinant(&noisy) + omega.iter().map(|omega| omega.ln()).sum::<f64>();
    let covariance = subtract(&gram, &times(&gram, &solve(&noisy, &gram)));
    let fit: f64 = covariance.iter().zip(&shift).map(|(row, own)| own * dot(row, &shift)).sum();
    let local: f64 = (0..count)
        .map(|n| {
            0.5 * omega[n] * tilts[n] * tilts[n] - weights[n] * (2.0 * (0.5 * tilts[n]).cosh()).ln()
                + sites.kappa()[n] * mean[n]
                - 0.5 * omega[n] * mean[n] * mean[n]
        })
        .sum();
    local - 0.5 * log_b + 0.5 * fit
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn the_mean_field_is_a_maximum_of_its_bound(problem in problems(1..=16), changes in vec(-0.3..0.3f64, 16)) {
        let fit = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
        prop_assert!(fit.converged() && fit.change() <= 1e-10);
        for n in 0..problem.inputs().len() {
            let omega = polya_gamma::mean(problem.observations.weights()[n], fit.tilts()[n]);
            assert_near("ω", &[fit.sites().omega()[n]], &[omega], 1e-12);
            let square = fit.mean()[n] * fit.mean()[n] + fit.variance()[n];
            assert_near("c", &[fit.tilts()[n]], &[square.sqrt()], 1e-9);
        }
        let posterior = Posterior::fuse(&problem.prior, fit.sites(), &[]).unwrap().latent(problem.inputs()).unwrap();
        assert_same_latent(&Latent { mean: fit.mean().to_vec(), variance: fit.variance().to_vec() }, &posterior, 1e-9);
        assert_near("E", &[fit.evidence()], &[evidence_bound(&problem, fit.tilts())], 1e-9);
        for scale in [0.01, 0.1, 1.0] {
            let moved: Vec<f64> = fit.tilts().iter().zip(&changes).map(|(c, change)| c * (scale * change).exp()).collect();
            prop_assert!(evidence_bound(&problem, &moved) <= fit.evidence() + 1e-9 * (1.0 + fit.evidence().abs()));
        }
    }

    /// Newton's method converges quadratically only with the correct derivatives. An error of one percent is then below
    /// 1e-9 after three steps. One more pass detects the convergence.
    #[test]
    fn newton_steps_converge_quadratically(problem in problems(3..=16), signs in vec(any::<bool>(), 16), with_message in any::<bool>()) {
        let message = message(&problem);
        let messages: Vec<&Summary> = message.iter().filter(|_| with_message).collect();
        let options = FitOptions::default().messages(&messages);
        let fit = dgpc::fit(&problem.prior, &problem.observations, &options).unwrap();
        let off = |(tilt, sign): (&f64, &bool)| tilt * if *sign { 1.01 } else { 0.99 };
        let start: Vec<f64> = fit.tilts().iter().zip(&signs).map(off).collect();
        let again = dgpc::fit(&problem.prior, &problem.observations, &options.start(&start).tolerance(1e-9)).unwrap();
        prop_assert!(again.iterations() <= 4, "{} passes, {} in the last", again.iterations(), again.change());
    }

    /// Repeating c ← √E[f²], the plain fixed-point iteration, leads to the same fixed point as a fit.
    #[test]
    fn plain_passes_converge_to_the_same_fixed_point(problem in problems(1..=12)) {
        let fit = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
        let mut tilts = vec![1.0; problem.inputs().len()];
        let mut change = f64::INFINITY;
        for _ in 0..2000 {
            let options = FitOptions::default().start(&tilts).iterations_max(1);
            let pass = dgpc::fit(&problem.prior, &problem.observations, &options).unwrap();
            prop_assert!(pass.evidence() <= fit.evidence() + 1e-9 * (1.0 + fit.evidence().abs()));
            tilts = pass.mean().iter().zip(pass.variance()).map(|(mean, variance)| (mean * mean + variance).sqrt()).collect();
            change = pass.change();
            if change < 1e-10 {
                break;
            }
        }
        prop_assert!(change < 1e-6, "{change}");
        assert_near("tilts", &tilts, fit.tilts(), 1e-4);
    }

    #[test]
    fn inducing_points_at_all_events_give_the_dense_fit(problem in problems(1..=16)) {
        let dense = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
        let sparse =
            dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default().inducing_points(problem.inputs())).unwrap();
        assert_near("mean", sparse.mean(), dense.mean(), 1e-6);
        assert_near("variance", sparse.variance(), dense.variance(), 1e-6);
        assert_near("evidence", &[sparse.evidence()], &[dense.evidence()], 1e-6);
        // With fewer points the bound cannot be higher.
        let z = problem.inputs().select(&problem.spread(2));
        let fewer = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default().inducing_points(&z)).unwrap();
        prop_assert!(fewer.evidence() <= dense.evidence() + 1e-9 * (1.0 + dense.evidence().abs()));
    }

    #[test]
    fn the_evidence_is_a_lower_bound(problem in problems(1..=2)) {
        let fit = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
        let (gram, outcomes) = (problem.gram(), problem.observations.outcomes());
        let (weights, mean) = (problem.observations.weights(), problem.prior.mean().values(problem.inputs()).unwrap());
        let likelihood = |n: usize, f: f64| logistic(if outcomes[n] { f } else { -f }).powf(weights[n]);
        let marginal = if gram.len() == 1 {
            gaussian_expectation(mean[0], gram[0][0], |f| likelihood(0, f))
        } else {
            // f₁ given f₀ is Gaussian, too. The outer rule is as fine as the inner one, although a coarser one would
            // suffice.
            let slope = gram[1][0] / gram[0][0];
            let rest = (gram[1][1] - slope * gram[1][0]).max(0.0);
            let inner = |f0: f64| {
                let (mean, sd) = (mean[1] + slope * (f0 - mean[0]), rest.sqrt());
                trapezoid(|u| likelihood(1, mean + sd * u))
            };
            let sd = gram[0][0].sqrt();
            trapezoid(|u| { let f0 = mean[0] + sd * u; likelihood(0, f0) * inner(f0) })
        };
        prop_assert!(fit.evidence() <= marginal.ln() + 1e-9, "{} above {}", fit.evidence(), marginal.ln());
        // The slack of the bound per event grows with the variance. It is .15 at variance 16.
        prop_assert!(fit.evidence() >= marginal.ln() - 0.5, "{} far below {}", fit.evidence(), marginal.ln());
    }

    #[test]
    fn an_event_of_weight_two_counts_as_two_events(problem in problems(1..=10), which in 0..10usize) {
        let count = problem.inputs().len();
        let which = which % count;
        let fit = |observations: &Observations| dgpc::fit(&problem.prior, observations, &FitOptions::default()).unwrap();
        let order: Vec<usize> = (0..count).chain([which]).collect();
        let twice = problem.observations.select(&order);
        let mut weights = problem.observations.weights().to_vec();
        weights[which] *= 2.0;
        let heavy = Observations::weighted(problem.inputs().clone(), problem.observations.outcomes().to_vec(), weights);
        let (heavy, twice) = (fit(&heavy.unwrap()), fit(&twice));
        assert_near("mean", heavy.mean(), &twice.mean()[..count], 1e-8);
        assert_near("variance", heavy.variance(), &twice.variance()[..count], 1e-8);
        assert_near("evidence", &[heavy.evidence()], &[twice.evidence()], 1e-8);
        let predict = |fit: &Fit| {
            Posterior::fuse(&problem.prior, fit.sites(), &[]).unwrap().latent(&problem.elsewhere).unwrap()
        };
        assert_same_latent(&predict(&heavy), &predict(&twice), 1e-8);
    }
}

/// Returns ∫ g(u) N(u; 0, 1) du by the trapezoid rule at steps of 0.06, coarser than [`gaussian_expectation`].
fn trapezoid(g: impl Fn(f64) -> f64) -> f64 {
    let at = |i: i32| {
        let u = 0.06 * f64::from(i);
        (-0.5 * u * u).exp() * g(u)
    };
    (-150..=150).map(at).sum::<f64>() * 0.06 / std::f64::consts::TAU.sqrt()
}
