//! Summaries: group operations, tempering, and other priors.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn summaries_form_a_group(problem in problems(3..=20)) {
        let z = problem.inputs().select(&problem.spread(4));
        let count = problem.inputs().len();
        let part = |which: usize| problem.sites.select(&(0..count).filter(|n| n % 3 == which).collect::<Vec<_>>());
        let summarise = |sites: &Sites| Summary::variational(&problem.prior, sites, &z).unwrap();
        let [a, b, c] = [0, 1, 2].map(|which| summarise(&part(which)));
        let merged = |first: &Summary, second: &Summary| {
            let mut merged = first.clone();
            merged.merge(second).unwrap();
            merged
        };
        let whole = merged(&merged(&a, &b), &c);
        assert_same_message(&merged(&a, &b), &merged(&b, &a), 0.0);
        assert_same_message(&whole, &merged(&a, &merged(&b, &c)), 1e-12);
        assert_same_message(&merged(&a, &Summary::empty(&problem.prior, &z).unwrap()), &a, 0.0);
        // Variational messages are additive over events, observed at once or in parts.
        assert_same_message(&whole, &summarise(&problem.sites), 1e-9);
        let mut parts = a.clone();
        parts.observe(&part(1)).unwrap();
        parts.observe(&part(2)).unwrap();
        assert_same_message(&parts, &whole, 1e-9);
        parts.forget(&part(1)).unwrap();
        assert_same_message(&parts, &merged(&a, &c), 1e-9);
        let mut left = whole.clone();
        left.subtract(&c).unwrap();
        assert_same_message(&left, &merged(&a, &b), 1e-9);
        left.subtract(&a).unwrap();
        assert_same_message(&left, &b, 1e-9);
    }

    #[test]
    fn removing_all_events_gives_the_prior(problem in problems(2..=20)) {
        let z = problem.inputs().select(&problem.spread(4));
        let count = problem.inputs().len();
        let part = |which: usize| problem.sites.select(&(0..count).filter(|n| n % 2 == which).collect::<Vec<_>>());
        let mut summary = Summary::variational(&problem.prior, &problem.sites, &z).unwrap();
        summary.forget(&part(0)).unwrap();
        summary.forget(&part(1)).unwrap();
        assert_same_message(&summary, &Summary::empty(&problem.prior, &z).unwrap(), 1e-12);
        let posterior = Posterior::fuse(&problem.prior, &Sites::empty(z.dimension()), &[&summary]).unwrap();
        let latent = posterior.latent(&problem.elsewhere).unwrap();
        let mean = problem.prior.mean().values(&problem.elsewhere).unwrap();
        let variance = problem.prior.kernel().diagonal(&problem.elsewhere).unwrap();
        assert_same_latent(&latent, &Latent { mean, variance }, 1e-9);
    }

    #[test]
    fn tempered_parts_sum_to_the_whole(problem in problems(2..=20), share in 0.0..1.0f64) {
        let z = problem.inputs().select(&problem.spread(4));
        let summary = Summary::variational(&problem.prior, &problem.sites, &z).unwrap();
        let mut whole = summary.tempered(share);
        whole.merge(&summary.tempered(1.0 - share)).unwrap();
        assert_same_message(&whole, &summary, 1e-12);
        assert_same_message(&summary.tempered(7.0), &summary, 0.0);
        for nothing in [0.0, -1.0, f64::NAN] {
            assert_same_message(&summary.tempered(nothing), &Summary::empty(&problem.prior, &z).unwrap(), 0.0);
        }
    }

    #[test]
    fn the_factor_is_the_same_under_another_prior(problem in problems(1..=16), seed in 0..1000u64) {
        let dimension = problem.inputs().dimension();
        let z = problem.inputs().select(&problem.spread(3));
        let variance = 0.5 + seed as f64 / 500.0;
        let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, variance, 0.8, dimension).unwrap()]).unwrap();
        let other = Prior::new(kernel, PriorMean::Constant(0.3)).unwrap();
        for summarise in [Summary::variational, Summary::marginal] {
            let summary = summarise(&problem.prior, &problem.sites, &z).unwrap();
            assert_same_message(&summary.under(&problem.prior).unwrap(), &summary, 1e-9);
            let moved = summary.under(&other).unwrap();
            prop_assert_eq!(moved.prior(), &other);
            let (found, expected) = (moved.factor().unwrap(), summary.factor().unwrap());
            assert_near_matrix("precision", &rows(found.precision()), &rows(expected.precision()), 1e-8);
            assert_near("shift", found.shift(), expected.shift(), 1e-8);
            assert_same_message(&moved.under(&problem.prior).unwrap(), &summary, 1e-8);
        }
        // With Z = X a summary is the likelihood itself under any prior. Reading it under another prior is equivalent
        // to fusing the events under that prior.
        let z = problem.inputs().select(&problem.spread(16));
        let sites = problem.sites.select(&problem.spread(16));
        let summary = Summary::variational(&problem.prior, &sites, &z).unwrap().under(&other).unwrap();
        let found = Posterior::fuse(&other, &Sites::empty(dimension), &[&summary]).unwrap();
        let expected = Posterior::fuse(&other, &sites, &[]).unwrap();
        assert_same_latent(&found.latent(&problem.elsewhere).unwrap(), &expected.latent(&problem.elsewhere).unwrap(), 1e-7);
    }
}
