//! Posteriors that absorb more evidence, and residuals between posteriors.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn absorbing_in_parts_agrees_with_fusing_at_once(problem in problems(6..=24), cuts in any::<[u8; 3]>()) {
        let z = problem.inputs().select(&problem.spread(3));
        let half = problem.inputs().len() / 2;
        let sites = |range: std::ops::Range<usize>| problem.sites.select(&range.collect::<Vec<_>>());
        let (near, far) = (sites(0..half), sites(half..problem.inputs().len()));
        let messages = [
            Summary::marginal(&problem.prior, &far, &z).unwrap(),
            Summary::variational(&problem.prior, &far, &problem.elsewhere.slice(0..1)).unwrap(),
        ];
        let at_once = Posterior::fuse(&problem.prior, &near, &[&messages[0], &messages[1]]).unwrap();
        // Absorb events and messages alternately, starting from the prior.
        let mut grown = Posterior::prior_alone(&problem.prior, problem.inputs().dimension());
        let cut = usize::from(cuts[0]) % (half + 1);
        grown.absorb_events(&sites(0..cut)).unwrap();
        grown.absorb_summaries(&[&messages[1]]).unwrap();
        grown.absorb_summaries(&[]).unwrap();
        grown.absorb_events(&sites(cut..half)).unwrap();
        grown.absorb_summaries(&[&messages[0]]).unwrap();
        prop_assert_eq!(grown.len(), at_once.len());
        let latent = |posterior: &Posterior| posterior.latent(&problem.elsewhere).unwrap();
        assert_same_latent(&latent(&grown), &latent(&at_once), 1e-9);
        let summaries = |posterior: &Posterior| posterior.summarise(&z).unwrap();
        assert_same_message(&summaries(&grown), &summaries(&at_once), 1e-7);
    }

    #[test]
    fn a_posterior_at_points_predicts_under_every_extension(problem in problems(6..=24), cut in any::<u8>()) {
        let half = problem.inputs().len() / 2;
        let sites = |range: std::ops::Range<usize>| problem.sites.select(&range.collect::<Vec<_>>());
        let far = sites(half..problem.inputs().len());
        let messages = [
            Summary::marginal(&problem.prior, &far, &problem.inputs().select(&problem.spread(3))).unwrap(),
            Summary::variational(&problem.prior, &far, &problem.elsewhere.slice(0..1)).unwrap(),
        ];
        let mut base = Posterior::prior_alone(&problem.prior, problem.inputs().dimension());
        base.absorb_events(&sites(0..usize::from(cut) % (half + 1))).unwrap();
        base.absorb_summaries(&[&messages[0]]).unwrap();
        let (mut by_events, mut by_summary) = (base.clone(), base.clone());
        by_events.absorb_events(&far).unwrap();
        by_summary.absorb_summaries(&[&messages[1]]).unwrap();
        let mut by_both = by_summary.clone();
        by_both.absorb_events(&far).unwrap();
        // More points than one block holds.
        let mut points = problem.elsewhere.clone();
        while points.len() < 150 {
            points.append(&problem.elsewhere).unwrap();
        }
        let mut at_points = PosteriorAtPoints::new(&base, &points).unwrap();
        for posterior in [&by_events, &base, &by_both, &by_summary, &base] {
            let expected = posterior.latent(&points).unwrap();
            assert_same_latent(&at_points.latent(posterior).unwrap(), &expected, 1e-9);
        }
        // Another posterior over the same points is no extension.
        let mut other = Posterior::prior_alone(&problem.prior, problem.inputs().dimension());
        other.absorb_events(&sites(0..usize::from(cut) % (half + 1))).unwrap();
        other.absorb_summaries(&[&Summary::empty(&problem.prior, messages[0].inducing_points()).unwrap()]).unwrap();
        prop_assert_eq!(other.len(), base.len());
        let is_refused = matches!(at_points.latent(&other), Err(Error::NotAnExtension { .. }));
        prop_assert!(is_refused);
    }

    #[test]
    fn failed_absorption_changes_nothing(problem in problems(2..=10)) {
        let mut posterior = problem.full();
        let before = posterior.latent(&problem.elsewhere).unwrap();
        let other = Prior::new(problem.prior.kernel().clone(), PriorMean::Constant(7.0)).unwrap();
        let foreign = Summary::empty(&other, &problem.elsewhere).unwrap();
        prop_assert!(posterior.absorb_summaries(&[&foreign]).is_err());
        let dimension = problem.inputs().dimension() + 1;
        let wide = Observations::new(Inputs::new(vec![0.0; dimension], dimension).unwrap(), vec![true]).unwrap();
        prop_assert!(posterior.absorb_events(&Sites::new(&wide, vec![0.2]).unwrap()).is_err());
        prop_assert!(absorb_observations(&mut posterior, &wide).is_err());
        let mut empty = Posterior::prior_alone(&problem.prior, problem.inputs().dimension());
        prop_assert!(absorb_observations(&mut empty, &wide).is_err() && empty.is_empty());
        let wide = Summary::empty(&problem.prior, wide.inputs()).unwrap();
        prop_assert!(posterior.absorb_summaries(&[&wide]).is_err());
        prop_assert_eq!(posterior.latent(&problem.elsewhere).unwrap(), before);
    }

    #[test]
    fn observations_are_absorbed_eight_at_a_time_by_their_sites(problem in problems(6..=24), first in any::<u8>()) {
        let places: Vec<usize> = (0..problem.inputs().len()).collect();
        let (earlier, later) = places.split_at(usize::from(first) % places.len());
        let message = Summary::variational(&problem.prior, &problem.sites, &problem.elsewhere.slice(0..1)).unwrap();
        let mut expected = Posterior::fuse(&problem.prior, &problem.sites.select(earlier), &[&message]).unwrap();
        let mut absorbed = expected.clone();
        let sites = absorb_observations(&mut absorbed, &problem.observations.select(later)).unwrap();
        let mut omega = Vec::new();
        for some in later.chunks(8) {
            let sites = sites_given(&expected, &problem.observations.select(some)).unwrap();
            omega.extend_from_slice(sites.omega());
            expected.absorb_events(&sites).unwrap();
        }
        prop_assert_eq!(sites.omega(), &omega[..]);
        let latent = |posterior: &Posterior| posterior.latent(&problem.elsewhere).unwrap();
        prop_assert_eq!(latent(&absorbed), latent(&expected));
    }

    #[test]
    fn a_shift_is_the_difference_of_the_posteriors(problem in problems(6..=24), offset_sd in 0.0..2.0f64) {
        let z = problem.inputs().select(&problem.spread(3));
        let half = problem.inputs().len() / 2;
        let sites = |range: std::ops::Range<usize>| problem.sites.select(&range.collect::<Vec<_>>());
        let far = sites(half..problem.inputs().len());
        // One point occurs twice among the summaries.
        let summaries = [
            Summary::marginal(&problem.prior, &far, &z).unwrap(),
            Summary::variational(&problem.prior, &far, &problem.elsewhere.slice(0..1)).unwrap(),
            Summary::marginal(&problem.prior, &far, &problem.elsewhere.slice(0..1)).unwrap(),
        ];
        let summaries: Vec<&Summary> = summaries.iter().collect();
        let without = Posterior::of_sites(&problem.prior, &sites(0..half)).unwrap();
        let mut with = without.clone();
        with.absorb_summaries(&summaries).unwrap();
        let mut points = z;
        (0..2).for_each(|_| points.append(&problem.elsewhere.slice(0..1)).unwrap());
        let [before, after] = [&without, &with].map(|posterior| posterior.latent(&points).unwrap());
        let mean = after.mean.iter().zip(&before.mean).map(|(after, before)| after - before).collect();
        let expected = Latent { mean, variance: before.variance };
        for found in [without.shift_by(&summaries).unwrap(), with.shift_of(&summaries).unwrap()] {
            let largest = found.largest(offset_sd);
            assert_same_latent(&Latent { mean: found.mean.clone(), variance: found.covariance.diagonal() }, &expected, 1e-6);
            prop_assert!(largest.is_finite() && largest >= 0.0);
            // If the points share their whole variation, it is an offset of arbitrary size.
            let apart = Shift { mean: vec![100.0; points.len()], ..found };
            prop_assert!(apart.largest(1e6) < 1e-3);
        }
        prop_assert_eq!(without.shift_by(&[]).unwrap().largest(offset_sd), 0.0);
    }

    #[test]
    fn the_joint_has_the_marginals(problem in problems(1..=16)) {
        let posterior = problem.full();
        let (mean, covariance) = posterior.joint(&problem.elsewhere).unwrap();
        let latent = posterior.latent(&problem.elsewhere).unwrap();
        assert_same_latent(&Latent { mean, variance: covariance.diagonal() }, &latent, 1e-9);
    }

    #[test]
    fn drawn_functions_have_the_joint_covariance(problem in problems(1..=16)) {
        let posterior = problem.full();
        let rows = problem.elsewhere.len();
        let (mean, covariance) = posterior.joint(&problem.elsewhere).unwrap();
        // With a zero column and unit columns as normals, the draws are the mean and the columns of a root.
        let unit = Matrix::from_fn(rows, rows + 1, |row, draw| f64::from(u8::from(row + 1 == draw)));
        let (draws, jitter) = posterior.draws(&problem.elsewhere, &unit).unwrap();
        for a in 0..rows {
            prop_assert!((draws.column(0)[a] - mean[a]).abs() < 1e-12);
            for b in 0..rows {
                let of = |row: usize, draw: usize| draws.column(draw)[row] - mean[row];
                let found: f64 = (1..=rows).map(|draw| of(a, draw) * of(b, draw)).sum();
                let expected = covariance.column(b)[a] + if a == b { jitter } else { 0.0 };
                prop_assert!((found - expected).abs() < 1e-9 * (1.0 + covariance.column(a)[a]), "{} {}", found, expected);
            }
        }
        prop_assert!(posterior.draws(&problem.elsewhere, &Matrix::zeros(rows + 1, 2)).is_err());
    }

    #[test]
    fn merging_the_residual_gives_the_full_summary(problem in problems(4..=20)) {
        // `known` contains some of the events of `all`, so that nothing is clipped.
        let z = problem.inputs().select(&problem.spread(4));
        let some: Vec<usize> = (0..problem.inputs().len()).step_by(2).collect();
        let all = Summary::variational(&problem.prior, &problem.sites, &z).unwrap();
        let known = Summary::variational(&problem.prior, &problem.sites.select(&some), &z).unwrap();
        let mut receiver = known.clone();
        receiver.merge(&all.residual(&known).unwrap()).unwrap();
        assert_same_message(&receiver, &all, 1e-8);
        // The residual of a summary beyond itself is empty.
        let empty = all.residual(&all).unwrap();
        assert_same_message(&empty, &Summary::empty(&problem.prior, &z).unwrap(), 1e-7);
    }

    #[test]
    fn a_residual_removes_no_precision_and_corrects_the_mean(problem in problems(4..=20)) {
        let z = problem.inputs().select(&problem.spread(4));
        let some: Vec<usize> = (0..problem.inputs().len()).step_by(2).collect();
        let all = Summary::variational(&problem.prior, &problem.sites, &z).unwrap();
        let less = Summary::variational(&problem.prior, &problem.sites.select(&some), &z).unwrap();
        // A receiver that is more certain than the sender keeps its precision and gets the sender's mean.
        let mut receiver = all.clone();
        receiver.merge(&less.residual(&all).unwrap()).unwrap();
        let (certain, moments) = (receiver.moments().unwrap(), all.moments().unwrap());
        let before = Latent { mean: certain.0.clone(), variance: moments.1.diagonal() };
        let after = Latent { mean: less.moments().unwrap().0, variance: certain.1.diagonal() };
        assert_same_latent(&before, &after, 1e-7);
    }

    #[test]
    fn sending_a_residual_lowers_the_trace_as_predicted(problem in problems(4..=20)) {
        let own = problem.full();
        let some: Vec<usize> = (0..problem.inputs().len()).step_by(3).collect();
        let public = Posterior::fuse(&problem.prior, &problem.sites.select(&some), &[]).unwrap();
        let chosen = Candidates::for_residual(&public, &own, problem.inputs()).unwrap().greedy(1);
        let trace = |posterior: &Posterior| posterior.latent(problem.inputs()).unwrap().variance.iter().sum::<f64>();
        prop_assert!(chosen.trace <= trace(&public) + 1e-9);
        let z = problem.inputs().select(&chosen.indices);
        if !z.is_empty() {
            let residual = own.summarise(&z).unwrap().residual(&public.summarise(&z).unwrap()).unwrap();
            let mut receiver = public.clone();
            receiver.absorb_summaries(&[&residual]).unwrap();
            prop_assert!((trace(&receiver) - chosen.trace).abs() <= 1e-8 * trace(&public), "{} {}", trace(&receiver), chosen.trace);
            // No other point lowers the trace more.
            for n in 0..problem.inputs().len() {
                let z = problem.inputs().select(&[n]);
                let residual = own.summarise(&z).unwrap().residual(&public.summarise(&z).unwrap()).unwrap();
                let mut other = public.clone();
                other.absorb_summaries(&[&residual]).unwrap();
                prop_assert!(trace(&receiver) <= trace(&other) + 1e-8 * trace(&public));
            }
        }
    }

    /// Candidates that follow a public posterior agree with candidates created from the updated public posterior.
    #[test]
    fn candidates_follow_their_public_posterior(problem in problems(4..=20)) {
        let (own, inputs) = (problem.full(), problem.inputs());
        let mut public = Posterior::prior_alone(&problem.prior, inputs.dimension());
        let variance = own.latent(inputs).unwrap().variance;
        let mut candidates = Candidates::towards(&public, &variance, inputs).unwrap();
        for place in problem.spread(3) {
            let residual = own.residual(&public, &inputs.select(&[place])).unwrap();
            public.absorb_summaries(&[&residual]).unwrap();
            // A second call without new evidence changes nothing.
            candidates.follow(&public, inputs).unwrap();
            candidates.follow(&public, inputs).unwrap();
            let recreated = Candidates::towards(&public, &variance, inputs).unwrap();
            assert_near("trace", &[candidates.trace()], &[recreated.trace()], 1e-9);
            for points in 1..=3 {
                assert_near("trace left", &[candidates.greedy(points).trace], &[recreated.greedy(points).trace], 1e-7);
            }
        }
        prop_assert!(candidates.follow(&public, &problem.elsewhere.select(&[0])).is_err());
    }

    #[test]
    fn no_gain_is_predicted_for_equal_posteriors(problem in problems(2..=12)) {
        let own = problem.full();
        let candidates = Candidates::for_residual(&own, &own, problem.inputs()).unwrap();
        let chosen = candidates.greedy(3);
        prop_assert!(candidates.trace() - chosen.trace <= 1e-6 * candidates.trace());
    }

    #[test]
    fn a_single_site_is_at_its_fixed_point(problem in problems(2..=16)) {
        let last = problem.inputs().len() - 1;
        let known = Posterior::fuse(&problem.prior, &problem.sites.select(&(0..last).collect::<Vec<_>>()), &[]).unwrap();
        let event = problem.observations.select(&[last]);
        let site = sites_given(&known, &event).unwrap();
        let mut with = known.clone();
        with.absorb_events(&site).unwrap();
        let latent = with.latent(event.inputs()).unwrap();
        let tilt = (latent.mean[0].powi(2) + latent.variance[0]).sqrt();
        let expected = polya_gamma::mean(event.weights()[0], tilt);
        prop_assert!((site.omega()[0] - expected).abs() <= 1e-7 * expected, "{} {expected}", site.omega()[0]);
    }

    #[test]
    fn distinct_points_have_a_gram_matrix_without_jitter(problem in problems(3..=12)) {
        let repeated = [0, 1, 0, 2, 1].map(|n: usize| n.min(problem.inputs().len() - 1));
        let points = problem.inputs().select(&repeated);
        let distinct = Candidates::new(problem.prior.kernel(), &points).unwrap().distinct(DISTINCT_SHARE);
        prop_assert!(distinct.contains(&0) && !distinct.contains(&2) && !distinct.contains(&4));
        let kept = points.select(&distinct);
        prop_assert_eq!(Summary::empty(&problem.prior, &kept).unwrap().jitter(), 0.0);
    }
}

#[test]
fn a_common_offset_does_not_count_as_a_shift() {
    // The covariance has an independent part for each value and a part that all values share.
    let covariance =
        |each: f64, shared: f64| Matrix::from_fn(3, 3, |row, column| shared + if row == column { each } else { 0.0 });
    let shift = |mean: [f64; 3]| Shift {
        mean: mean.to_vec(),
        covariance: covariance(0.25, 0.0),
        prior_covariance: covariance(1.0, 0.0),
    };
    let common = shift([3.0; 3]);
    assert!((common.largest(0.0) - 6.0).abs() < 1e-12);
    assert!(common.largest(1e3) < 1e-3 && common.largest(0.5) < 4.0);
    // Values that only the prior determines are not compared.
    let unknown = Shift { prior_covariance: covariance(0.49, 0.0), ..common.clone() };
    assert_eq!(unknown.largest(0.0), 0.0);
    // Differences between points remain, in standard deviations of the deviations from the mean: 2/3 of the variance.
    let differing = shift([3.0, 0.0, -3.0]);
    assert!((differing.largest(1e3) - 6.0 * 1.5f64.sqrt()).abs() < 1e-9);
    // They also remain if the shared part is undetermined.
    let with_shared_variance =
        |shift: Shift| Shift { covariance: covariance(0.25, 9.0), prior_covariance: covariance(1.0, 9.0), ..shift };
    assert_eq!(with_shared_variance(common).largest(0.0), 0.0);
    assert!((with_shared_variance(differing).largest(0.0) - 6.0 * 1.5f64.sqrt()).abs() < 1e-9);
}
