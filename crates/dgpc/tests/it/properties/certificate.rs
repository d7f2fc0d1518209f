//! The certificate bounds the divergence.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(400))]

    #[test]
    fn the_certificate_bounds_the_divergence(problem in problems(1..=20), points in 0..6usize) {
        let candidates = Candidates::new(problem.prior.kernel(), problem.inputs()).unwrap();
        let chosen = candidates.greedy(points);
        let z = problem.inputs().select(&chosen.indices);
        let certificate = Certificate::new(&problem.prior, &problem.sites, &z).unwrap();
        let full = log_evidence(&problem.prior, &problem.sites).unwrap();
        let divergence = full - certificate.lower;
        let slack = 1e-9 * (1.0 + full.abs());
        prop_assert!(divergence >= -slack, "{} in {:?}", divergence, certificate);
        prop_assert!(divergence <= certificate.gap + slack, "{} in {:?}", divergence, certificate);
        prop_assert!(certificate.gap <= certificate.closed_form + slack, "{:?}", certificate);
        prop_assert!(certificate.gap <= certificate.paper_closed_form + slack, "{:?}", certificate);
        assert_near("trace", &[certificate.trace], &[chosen.trace], 1e-9);

        // Compare each bound with its dense formula.
        let gram = problem.gram();
        let residual = conditional(&gram, &chosen.indices);
        let omega = problem.sites.omega();
        let a = sum(&subtract(&gram, &residual), &diagonal_matrix(omega.iter().map(|omega| 1.0 / omega)));
        let shift = problem.sites.shift(problem.prior.mean()).unwrap();
        let c: Vec<f64> = shift.iter().zip(omega).map(|(shift, omega)| shift / omega).collect();
        let p = trace(&residual);
        let half_log = 0.5 * log_determinant(&a);
        let weighted: f64 = (0..omega.len()).map(|n| omega[n] * residual[n][n]).sum();
        let lower = -half_log - 0.5 * dot(&c, &solve_vector(&a, &c)) - 0.5 * weighted;
        let damped = sum(&a, &diagonal_matrix(omega.iter().map(|_| p)));
        let upper = -half_log - 0.5 * dot(&c, &solve_vector(&damped, &c));
        assert_near("bounds", &[certificate.lower, certificate.upper], &[lower, upper], 1e-9);

        // The divergence itself is the KL of two Gaussians over f(X): N(m, S) sparse, N(m', S') full.
        let sparse = Posterior::fuse(
            &problem.prior,
            &Sites::empty(z.dimension()),
            &[&Summary::variational(&problem.prior, &problem.sites, &z).unwrap()],
        ).unwrap();
        let sparse = sparse.latent(problem.inputs()).unwrap();
        let full = problem.full().latent(problem.inputs()).unwrap();
        let deviation: Vec<f64> = sparse.mean.iter().zip(&full.mean).map(|(a, b)| a - b).collect();
        // The squared deviation of the means in the metric Ω ≤ (K⁻¹ + Ω) alone is below twice the divergence.
        let squares: f64 = deviation.iter().zip(omega).map(|(d, omega)| omega * d * d).sum();
        prop_assert!(0.5 * squares <= divergence + slack, "{} in {}", squares, divergence);
    }
}
