//! Posteriors and summaries against dense formulas.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn posterior_of_events_is_gaussian_regression(problem in problems(1..=20)) {
        // The targets are c = κ/ω with noise 1/ω.
        let kernel = problem.prior.kernel();
        let omega = problem.sites.omega();
        let noisy = sum(&problem.gram(), &diagonal_matrix(omega.iter().map(|omega| 1.0 / omega)));
        let prior_mean = problem.prior.mean().values(problem.inputs()).unwrap();
        let target: Vec<f64> = problem.sites.kappa().iter().zip(omega).zip(&prior_mean)
            .map(|((kappa, omega), mean)| kappa / omega - mean).collect();
        let cross = rows(&kernel.cross(&problem.elsewhere, problem.inputs()).unwrap());
        let weights = solve_vector(&noisy, &target);
        let gains = solve(&noisy, &transposed(&cross));
        let own_mean = problem.prior.mean().values(&problem.elsewhere).unwrap();
        let own_variance = kernel.diagonal(&problem.elsewhere).unwrap();
        let mean = cross.iter().zip(&own_mean).map(|(row, mean)| mean + dot(row, &weights)).collect();
        let explained = transposed(&gains);
        let variance =
            own_variance.iter().zip(&cross).zip(&explained).map(|((k, row), gain)| k - dot(row, gain)).collect();
        let found = problem.full().latent(&problem.elsewhere).unwrap();
        assert_same_latent(&found, &Latent { mean, variance }, 1e-10);

        let evidence = -0.5 * log_determinant(&noisy) - 0.5 * dot(&target, &weights);
        assert_near("log evidence", &[log_evidence(&problem.prior, &problem.sites).unwrap()], &[evidence], 1e-10);
    }

    #[test]
    fn summaries_agree_with_their_definition(problem in problems(1..=20)) {
        let chosen = problem.spread(4);
        let z = problem.inputs().select(&chosen);
        let kernel = problem.prior.kernel();
        let k_mn = rows(&kernel.cross(&z, problem.inputs()).unwrap());
        let k_mm = rows(&kernel.gram(&z).unwrap());
        let omega = problem.sites.omega();
        let shift = problem.sites.shift(problem.prior.mean()).unwrap();

        let variational = Summary::variational(&problem.prior, &problem.sites, &z).unwrap();
        let g = times(&times(&k_mn, &diagonal_matrix(omega.iter().copied())), &transposed(&k_mn));
        assert_near_matrix("variational G", &rows(&variational.precision()), &g, 1e-10);
        let b: Vec<f64> = k_mn.iter().map(|row| dot(row, &shift)).collect();
        assert_near("variational b", &variational.shift(), &b, 1e-10);

        // The marginal summary has (K̃ + Ω⁻¹)⁻¹ in place of Ω.
        let noise = diagonal_matrix(omega.iter().map(|omega| 1.0 / omega));
        let unexplained = sum(&conditional(&problem.gram(), &chosen), &noise);
        let target: Vec<f64> = shift.iter().zip(omega).map(|(shift, omega)| shift / omega).collect();
        let marginal = Summary::marginal(&problem.prior, &problem.sites, &z).unwrap();
        let g = times(&k_mn, &solve(&unexplained, &transposed(&k_mn)));
        assert_near_matrix("marginal G", &rows(&marginal.precision()), &g, 1e-9);
        let weights = solve_vector(&unexplained, &target);
        let b: Vec<f64> = k_mn.iter().map(|row| dot(row, &weights)).collect();
        assert_near("marginal b", &marginal.shift(), &b, 1e-9);

        for summary in [&variational, &marginal] {
            // μ₀ + K_MM (K_MM + G)⁻¹ b and K_MM (K_MM + G)⁻¹ K_MM.
            let total = sum(&k_mm, &rows(&summary.precision()));
            let (mean, covariance) = summary.moments().unwrap();
            let weights = solve_vector(&total, &summary.shift());
            let prior_mean = problem.prior.mean().values(&z).unwrap();
            let expected: Vec<f64> = k_mm.iter().zip(&prior_mean).map(|(row, mean)| mean + dot(row, &weights)).collect();
            assert_near("moments: mean", &mean, &expected, 1e-9);
            assert_near_matrix("moments: covariance", &rows(&covariance), &times(&k_mm, &solve(&total, &k_mm)), 1e-9);
            // P = K_MM⁻¹ G K_MM⁻¹, η = K_MM⁻¹ b + P μ₀(Z).
            let factor = summary.factor().unwrap();
            let half = solve(&k_mm, &rows(&summary.precision()));
            let precision = solve(&k_mm, &transposed(&half));
            assert_near_matrix("factor: precision", &rows(factor.precision()), &precision, 1e-8);
            let eta: Vec<f64> = solve_vector(&k_mm, &summary.shift()).iter().zip(&precision)
                .map(|(h, row)| h + dot(row, &prior_mean)).collect();
            assert_near("factor: shift", factor.shift(), &eta, 1e-8);
        }
    }

    #[test]
    fn the_marginal_summary_is_the_summary_of_the_posterior(problem in problems(1..=20)) {
        let z = problem.inputs().select(&problem.spread(4));
        let marginal = Summary::marginal(&problem.prior, &problem.sites, &z).unwrap();
        let summary = problem.full().summarise(&z).unwrap();
        assert_same_message(&summary, &marginal, 1e-8);

        let alone = Posterior::fuse(&problem.prior, &Sites::empty(z.dimension()), &[&marginal]).unwrap();
        let full = problem.full().latent(&z).unwrap();
        assert_same_latent(&alone.latent(&z).unwrap(), &full, 1e-9);
        let (mean, covariance) = marginal.moments().unwrap();
        assert_same_latent(&Latent { mean, variance: covariance.diagonal() }, &full, 1e-9);
        // A posterior and its summary agree at Z also if the posterior contains other messages.
        let mixed = Posterior::fuse(&problem.prior, &problem.sites, &[&marginal]).unwrap();
        let summary = mixed.summarise(&z).unwrap();
        let again = Posterior::fuse(&problem.prior, &Sites::empty(z.dimension()), &[&summary]).unwrap();
        assert_same_latent(&again.latent(&z).unwrap(), &mixed.latent(&z).unwrap(), 1e-8);
        let stacked = Concatenation::new(&problem.prior, &[&marginal]).unwrap();
        assert_same_latent(&stacked.latent(&problem.elsewhere).unwrap(), &alone.latent(&problem.elsewhere).unwrap(), 1e-9);
    }

    #[test]
    fn inducing_points_at_all_events_lose_nothing(problem in problems(1..=12)) {
        let z = problem.inputs();
        let full = problem.full().latent(&problem.elsewhere).unwrap();
        let none = Sites::empty(z.dimension());
        for summary in [
            Summary::variational(&problem.prior, &problem.sites, z).unwrap(),
            Summary::marginal(&problem.prior, &problem.sites, z).unwrap(),
        ] {
            let fused = Posterior::fuse(&problem.prior, &none, &[&summary]).unwrap();
            // If K is singular to rounding, it gets a jitter of at most 1e-8.
            assert_same_latent(&fused.latent(&problem.elsewhere).unwrap(), &full, 1e-7);
        }
        let certificate = Certificate::new(&problem.prior, &problem.sites, z).unwrap();
        prop_assert!(certificate.trace < 1e-7 && certificate.gap.abs() < 1e-7, "{:?}", certificate);
    }

    #[test]
    fn concatenation_of_distant_regions_equals_fusion(problem in problems(2..=16), seed in any::<u64>()) {
        // The second half of the events is moved beyond the reach of the covariance. A rational quadratic has unlimited
        // reach.
        let reaches = |correlation: &Correlation| matches!(correlation.shape(), Shape::RationalQuadratic { .. });
        prop_assume!(!problem.prior.kernel().terms().iter().flat_map(Term::correlations).any(reaches));
        let dimension = problem.inputs().dimension();
        let count = problem.inputs().len();
        let moved = |inputs: &Inputs| {
            let values = inputs.rows().flat_map(|row| row.iter().map(|value| value + 1e4).collect::<Vec<_>>());
            Inputs::new(values.collect(), dimension).unwrap()
        };
        let order = shuffled(count, seed);
        let (near, difference) = order.split_at(count / 2);
        let region = |indices: &[usize], away: bool| {
            let part = problem.observations.select(indices);
            let inputs = if away { moved(part.inputs()) } else { part.inputs().clone() };
            let omega = indices.iter().map(|&n| problem.sites.omega()[n]).collect();
            let part = Observations::weighted(inputs, part.outcomes().to_vec(), part.weights().to_vec()).unwrap();
            Sites::new(&part, omega).unwrap()
        };
        let summarise = |sites: &Sites| {
            let candidates = Candidates::new(problem.prior.kernel(), sites.inputs()).unwrap();
            let z = sites.inputs().select(&candidates.greedy(2).indices);
            [Summary::variational(&problem.prior, sites, &z).unwrap(), Summary::marginal(&problem.prior, sites, &z).unwrap()]
        };
        let (near, difference) = (summarise(&region(near, false)), summarise(&region(difference, true)));
        let mut test_points = problem.elsewhere.clone();
        test_points.append(&moved(&problem.elsewhere)).unwrap();
        for (near, difference) in near.iter().zip(&difference) {
            let fused = Posterior::fuse(&problem.prior, &Sites::empty(dimension), &[near, difference]).unwrap();
            let stacked = Concatenation::new(&problem.prior, &[near, difference]).unwrap();
            assert_same_latent(&fused.latent(&test_points).unwrap(), &stacked.latent(&test_points).unwrap(), 1e-9);
        }
    }

    #[test]
    fn more_evidence_never_raises_the_variance(problem in problems(2..=18), first in 1..5usize, second in 1..5usize) {
        let count = problem.inputs().len();
        let (own, theirs) = (0..count / 2, count / 2..count);
        let own = problem.sites.select(&own.collect::<Vec<_>>());
        let theirs = problem.sites.select(&theirs.collect::<Vec<_>>());
        let candidates = Candidates::new(problem.prior.kernel(), theirs.inputs()).unwrap();
        let z = |points| theirs.inputs().select(&candidates.greedy(points).indices);
        let packets = [
            Summary::variational(&problem.prior, &theirs, &z(first)).unwrap(),
            Summary::marginal(&problem.prior, &theirs, &z(second)).unwrap(),
        ];
        let mut before = problem.prior.kernel().diagonal(&problem.elsewhere).unwrap();
        for summaries in [&[][..], &[&packets[0]], &[&packets[0], &packets[1]]] {
            let posterior = Posterior::fuse(&problem.prior, &own, summaries).unwrap();
            let after = posterior.latent(&problem.elsewhere).unwrap().variance;
            for (before, after) in before.iter().zip(&after) {
                prop_assert!(*after <= before * (1.0 + 1e-9) && *after >= 0.0, "{} after {}", after, before);
            }
            before = after;
        }
    }

    #[test]
    fn the_order_of_events_does_not_matter(problem in problems(1..=20), seed in any::<u64>()) {
        let order = shuffled(problem.inputs().len(), seed);
        let permuted = problem.sites.select(&order);
        let full = problem.full().latent(&problem.elsewhere).unwrap();
        let other = Posterior::fuse(&problem.prior, &permuted, &[]).unwrap();
        assert_same_latent(&other.latent(&problem.elsewhere).unwrap(), &full, 1e-9);
        let gram = problem.gram();
        let expected: Dense = order.iter().map(|&i| order.iter().map(|&j| gram[i][j]).collect()).collect();
        assert_near_matrix("gram", &rows(&problem.prior.kernel().gram(permuted.inputs()).unwrap()), &expected, 1e-14);
        let z = problem.inputs().select(&problem.spread(3));
        for summarise in [Summary::variational, Summary::marginal] {
            let found = summarise(&problem.prior, &permuted, &z).unwrap();
            assert_same_message(&found, &summarise(&problem.prior, &problem.sites, &z).unwrap(), 1e-9);
        }
        let certificate = Certificate::new(&problem.prior, &permuted, &z).unwrap();
        let expected = Certificate::new(&problem.prior, &problem.sites, &z).unwrap();
        assert_near("bounds", &[certificate.lower, certificate.upper], &[expected.lower, expected.upper], 1e-9);
        let fit = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
        let other = dgpc::fit(&problem.prior, &problem.observations.select(&order), &FitOptions::default()).unwrap();
        assert_near("evidence", &[other.evidence()], &[fit.evidence()], 1e-9);
        assert_near("tilts", other.tilts(), &order.iter().map(|&n| fit.tilts()[n]).collect::<Vec<_>>(), 1e-8);
    }

    #[test]
    fn the_order_of_packets_does_not_matter(problem in problems(3..=18)) {
        let count = problem.inputs().len();
        let part = |which: usize| problem.sites.select(&(0..count).filter(|n| n % 3 == which).collect::<Vec<_>>());
        let packets: Vec<Summary> = (0..3).map(|which| {
            let sites = part(which);
            let candidates = Candidates::new(problem.prior.kernel(), sites.inputs()).unwrap();
            let z = sites.inputs().select(&candidates.greedy(1 + which).indices);
            Summary::marginal(&problem.prior, &sites, &z).unwrap()
        }).collect();
        let none = Sites::empty(problem.inputs().dimension());
        let fuse = |order: [usize; 3]| {
            let summaries: Vec<&Summary> = order.iter().map(|&i| &packets[i]).collect();
            Posterior::fuse(&problem.prior, &none, &summaries).unwrap().latent(&problem.elsewhere).unwrap()
        };
        assert_same_latent(&fuse([2, 0, 1]), &fuse([0, 1, 2]), 1e-9);
        assert_same_latent(&fuse([1, 0, 2]), &fuse([0, 1, 2]), 1e-9);
    }
}

/// Many points are stored in rows and few in columns. The results agree for every combination of events and summaries.
#[test]
fn predictions_of_many_points_agree_with_predictions_of_few() {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 3.0, 1.5, 1).unwrap()]).unwrap();
    let prior = Prior::new(kernel, PriorMean::Constant(-0.3)).unwrap();
    let sites = |first: u32, count: u32| {
        let places: Vec<f64> = (first..first + count).map(|n| (f64::from(n) * 0.618_034).fract() * 20.0).collect();
        let outcomes = places.iter().map(|x| x.sin() > 0.2).collect();
        let events = Observations::new(line(&places), outcomes).unwrap();
        Sites::new(&events, (0..count).map(|n| 0.02 + 0.2 * f64::from(n % 7) / 6.0).collect()).unwrap()
    };
    let message = |first: u32, points: &[f64]| Summary::variational(&prior, &sites(first, 30), &line(points)).unwrap();
    let (one, other) = (message(100, &[1.0, 4.0, 9.0]), message(200, &[2.5, 14.0, 15.0, 19.0]));
    let mut posterior = Posterior::fuse(&prior, &sites(0, 40), &[&one]).unwrap();
    posterior.absorb_events(&sites(50, 11)).unwrap();
    posterior.absorb_summaries(&[&other]).unwrap();
    posterior.absorb_events(&sites(70, 1)).unwrap();
    let points = line(&(0..150).map(|n| f64::from(n) * 0.15 - 1.0).collect::<Vec<_>>());
    let many = posterior.latent(&points).unwrap();
    for first in (0..150).step_by(10) {
        let few = posterior.latent(&points.slice(first..first + 10)).unwrap();
        for n in 0..10 {
            assert!((few.mean[n] - many.mean[first + n]).abs() < 1e-10);
            assert!((few.variance[n] - many.variance[first + n]).abs() < 1e-10);
        }
    }
}
