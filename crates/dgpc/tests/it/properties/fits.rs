//! Fits, and the posteriors that follow from them.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

/// Returns a summary at two points that are far apart, by another agent with another prior.
pub(super) fn message(problem: &Problem) -> Option<Summary> {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 1.5, 1.2, problem.inputs().dimension()).unwrap()]);
    let prior = Prior::new(kernel.unwrap(), PriorMean::Constant(0.3)).unwrap();
    let count = problem.elsewhere.len();
    let observations = Observations::new(problem.elsewhere.clone(), (0..count).map(|n| n % 3 == 0).collect()).unwrap();
    let sites = Sites::new(&observations, vec![0.2; count]).unwrap();
    let message = Summary::marginal(&prior, &sites, &problem.elsewhere.select(&[0, 1])).unwrap();
    let distinct = Candidates::new(problem.prior.kernel(), message.inducing_points()).unwrap().distinct(DISTINCT_SHARE);
    (distinct.len() == 2 && message.jitter() == 0.0).then_some(message)
}

fn latent_at_events(fit: &Fit) -> Latent {
    Latent { mean: fit.mean().to_vec(), variance: fit.variance().to_vec() }
}

proptest! {
    #![proptest_config(cases(80))]

    /// The posterior of a fit has the fit's own moments, for dense and sparse fits, with and without messages.
    #[test]
    fn the_posterior_of_a_fit_has_the_moments_of_the_fit(
        problem in problems(3..=14),
        is_sparse in any::<bool>(),
        with_message in any::<bool>(),
    ) {
        let message = message(&problem);
        prop_assume!(message.is_some());
        let messages: Vec<&Summary> = message.iter().filter(|_| with_message).collect();
        let z = problem.inputs().select(&problem.spread(3));
        let mut options = FitOptions::default().messages(&messages);
        if is_sparse {
            options = options.inducing_points(&z);
        }
        let fit = dgpc::fit(&problem.prior, &problem.observations, &options).unwrap();
        prop_assume!(fit.jitter() == 0.0);
        let posterior = fit.posterior().unwrap();
        assert_same_latent(&posterior.latent(problem.inputs()).unwrap(), &latent_at_events(&fit), 1e-6);
        // Its size is that of the events or the inducing points, plus the messages.
        let own = if is_sparse { z.len() + 2 * messages.len() } else { problem.inputs().len() };
        prop_assert_eq!(posterior.len(), own + 2 * messages.len());
    }

    /// A residual may move the mean without adding precision, in all directions or in some.
    #[test]
    fn a_shift_without_precision_moves_a_fit_as_it_moves_a_posterior(
        problem in problems(3..=14),
        is_sparse in any::<bool>(),
        precision in prop_oneof![Just(0.0), Just(2.0)],
    ) {
        let z = problem.elsewhere.select(&[0, 1]);
        prop_assume!(Candidates::new(problem.prior.kernel(), &z).unwrap().distinct(DISTINCT_SHARE).len() == 2);
        // Precision exists along (1, 1) only, or not at all.
        let whitened = Matrix::from_fn(2, 2, |_, _| precision);
        let message = Summary::from_whitened(&problem.prior, &z, whitened, vec![0.7, -0.2]).unwrap();
        let (messages, points) = ([&message], problem.inputs().select(&problem.spread(3)));
        let mut options = FitOptions::default().messages(&messages);
        if is_sparse {
            options = options.inducing_points(&points);
        }
        let fit = dgpc::fit(&problem.prior, &problem.observations, &options).unwrap();
        prop_assume!(fit.jitter() == 0.0);
        let latent = fit.posterior().unwrap().latent(problem.inputs()).unwrap();
        assert_same_latent(&latent, &latent_at_events(&fit), 1e-5);
    }

    /// The moments of the fit at its own events are those of its posterior, in any order and with repetitions.
    #[test]
    fn moments_at_events_agree_with_the_posterior(problem in problems(2..=14), order in proptest::collection::vec(0..14usize, 1..20)) {
        let fit = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
        let order: Vec<usize> = order.into_iter().map(|place| place % problem.inputs().len()).collect();
        let inputs = problem.inputs().select(&order);
        let posterior = fit.posterior().unwrap();
        assert_same_latent(&fit.latent_at_events(&inputs).unwrap(), &posterior.latent(&inputs).unwrap(), 1e-9);
        prop_assert_eq!(fit.latent_at_events(&problem.elsewhere), None);
        let sparse = FitOptions::default().inducing_points(problem.inputs());
        let sparse = dgpc::fit(&problem.prior, &problem.observations, &sparse).unwrap();
        prop_assert_eq!(sparse.latent_at_events(&inputs), None);
    }

    /// The result is the same for all parts, whether the included or the excluded events are summed up.
    #[test]
    fn the_posterior_of_a_part_is_that_of_its_sites(problem in problems(3..=14), included in any::<[bool; 14]>(), before in any::<[bool; 14]>()) {
        let z = problem.inputs().select(&problem.spread(3));
        let sparse = FitOptions::default().inducing_points(&z);
        let fit = dgpc::fit(&problem.prior, &problem.observations, &sparse).unwrap();
        let part: Vec<usize> = (0..problem.inputs().len()).filter(|&event| included[event]).collect();
        let condensed = Summary::variational(&problem.prior, &fit.sites().select(&part), &z).unwrap();
        let expected = Posterior::of_summaries(&problem.prior, &[&condensed]).unwrap();
        let latent = |posterior: &Posterior| posterior.latent(&problem.elsewhere).unwrap();
        assert_same_latent(&latent(&fit.posterior_of_part(&part, &[]).unwrap()), &latent(&expected), 1e-8);
        // A summary of another part leads to the same posterior by adding and removing events.
        let places = |is_in: &dyn Fn(usize) -> bool| (0..problem.inputs().len()).filter(|&event| is_in(event)).collect::<Vec<_>>();
        let mut moved = fit.summary_of_part(&places(&|event| before[event])).unwrap().unwrap();
        moved.forget(&fit.sites().select(&places(&|event| before[event] && !included[event]))).unwrap();
        moved.observe(&fit.sites().select(&places(&|event| included[event] && !before[event]))).unwrap();
        assert_same_latent(&latent(&Posterior::of_summaries(&problem.prior, &[&moved]).unwrap()), &latent(&expected), 1e-7);
    }

    #[test]
    fn an_amended_fit_is_the_posterior_of_its_sites(problem in problems(4..=14), removed in any::<[bool; 14]>()) {
        let message = message(&problem);
        prop_assume!(message.is_some());
        let message = message.unwrap();
        let (messages, z) = ([&message], problem.inputs().select(&problem.spread(3)));
        let (count, half) = (problem.inputs().len(), problem.inputs().len() / 2);
        let [first, others] = [0..half, half..count].map(|range| problem.observations.select(&range.collect::<Vec<_>>()));
        let sparse = FitOptions::default().inducing_points(&z).messages(&messages);
        let before = dgpc::fit(&problem.prior, &first, &sparse).unwrap();
        let removed: Vec<usize> = (0..half).filter(|&event| removed[event]).collect();
        // Each event is removed once, however often it is named.
        let after = before.amended(&[&removed[..], &removed].concat(), &others).unwrap().unwrap();

        let remaining: Vec<usize> = (0..half).filter(|event| !removed.contains(event)).collect();
        let places: Vec<usize> = (0..remaining.len()).collect();
        prop_assert_eq!(&after.sites().select(&places), &before.sites().select(&remaining));
        prop_assert_eq!(after.sites().len(), remaining.len() + others.len());
        prop_assert_eq!([after.tilts(), after.weights(), after.mean(), after.variance()].map(<[f64]>::len), [after.sites().len(); 4]);
        let latent = |posterior: &Posterior| posterior.latent(&problem.elsewhere).unwrap();
        let points = after.inducing_points().unwrap();
        let condensed = Summary::variational(&problem.prior, after.sites(), points).unwrap();
        let converted = message.under(&problem.prior).unwrap();
        let expected = Posterior::of_summaries(&problem.prior, &[&condensed, &converted]).unwrap();
        assert_same_latent(&latent(&after.posterior().unwrap()), &latent(&expected), 1e-7);
        // A new event gets its site given all events before it.
        let one = before.amended(&removed, &others.select(&[0])).unwrap().unwrap();
        let known = before.amended(&removed, &others.select(&[])).unwrap().unwrap().posterior().unwrap();
        let expected = sites_given(&known, &others.select(&[0])).unwrap();
        prop_assert!((one.sites().omega()[remaining.len()] - expected.omega()[0]).abs() < 1e-12);
        let dense = dgpc::fit(&problem.prior, &first, &FitOptions::default()).unwrap();
        prop_assert!(dense.amended(&[], &others).unwrap().is_none());
    }

    #[test]
    fn posterior_with_replaces_the_messages_of_a_fit(problem in problems(3..=14), is_sparse in any::<bool>()) {
        let message = message(&problem);
        prop_assume!(message.is_some());
        let message = message.unwrap();
        let (messages, z) = ([&message], problem.inputs().select(&problem.spread(3)));
        let mut options = FitOptions::default().messages(&messages);
        if is_sparse {
            options = options.inducing_points(&z);
        }
        let fit = dgpc::fit(&problem.prior, &problem.observations, &options).unwrap();
        let latent = |posterior: Posterior| posterior.latent(&problem.elsewhere).unwrap();
        // The same message, read under the fit's prior before or by the fit.
        let converted = message.under(&problem.prior).unwrap();
        let expected = latent(fit.posterior().unwrap());
        assert_same_latent(&latent(fit.posterior_with(&[&message]).unwrap()), &expected, 1e-12);
        assert_same_latent(&latent(fit.posterior_with(&[&converted]).unwrap()), &expected, 1e-7);
        // Without messages, the posterior is that of the events at the sites of the fit.
        let alone = fit.posterior_with(&[]).unwrap();
        let expected = match fit.inducing_points() {
            None => Posterior::of_sites(&problem.prior, fit.sites()).unwrap(),
            Some(points) => {
                let condensed = Summary::variational(&problem.prior, fit.sites(), points).unwrap();
                Posterior::fuse(&problem.prior, &Sites::empty(points.dimension()), &[&condensed]).unwrap()
            }
        };
        assert_same_latent(&latent(alone.clone()), &latent(expected), 1e-9);
        // Absorbing the message afterwards gives the same posterior.
        let mut later = alone;
        later.absorb_summaries(&[&converted]).unwrap();
        assert_same_latent(&latent(later), &latent(fit.posterior_with(&[&converted]).unwrap()), 1e-7);
    }

    #[test]
    fn a_summary_from_its_factor_is_the_same_message(problem in problems(2..=14)) {
        let z = problem.inputs().select(&problem.spread(3));
        let summary = Summary::marginal(&problem.prior, &problem.sites, &z).unwrap();
        let factor = summary.factor().unwrap();
        assert_same_message(&Summary::from_factor(&problem.prior, &factor).unwrap(), &summary, 1e-7);
        // Under another prior, the factor gives the same message as the summary does.
        let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 1.3, 0.9, z.dimension()).unwrap()]).unwrap();
        let other = Prior::new(kernel, PriorMean::Constant(-0.4)).unwrap();
        let converted = Summary::from_factor(&other, &factor).unwrap();
        assert_same_message(&converted, &summary.under(&other).unwrap(), 1e-6);
    }

    /// Ties between parameters change no moments. Priors that differ in ties only are equal and can be combined.
    #[test]
    fn ties_do_not_matter_for_equality_of_priors(problem in problems(2..=8)) {
        let dimension = problem.inputs().dimension();
        let columns: Vec<usize> = (0..dimension).collect();
        let prior = |correlation: Correlation| {
            let kernel = Kernel::new(vec![Term::of(1.5, correlation).unwrap()]).unwrap();
            Prior::new(kernel, PriorMean::Zero).unwrap()
        };
        let each = prior(Correlation::new(Shape::Matern32, &columns, &vec![1.2; dimension]).unwrap());
        let tied = prior(Correlation::isotropic(Shape::Matern32, &columns, 1.2).unwrap());
        prop_assert_eq!(&each, &tied);
        prop_assert_eq!(each.has_structure_of(&tied), dimension == 1);
        prop_assert_eq!(each.parameters().len(), 1 + dimension);
        prop_assert_eq!(tied.parameters(), vec![Parameter::Variance, Parameter::LengthScale]);
        let z = problem.inputs().select(&[0]);
        let mut summary = Summary::marginal(&each, &problem.sites, &z).unwrap();
        prop_assert!(summary.merge(&Summary::empty(&tied, &z).unwrap()).is_ok());
        prop_assert!(Posterior::prior_alone(&tied, dimension).absorb_summaries(&[&summary]).is_ok());
    }
}

/// Under a prior of very large variance, accelerated steps often lower E and are rejected. After any number of
/// iterations the fit must return an accepted step.
#[test]
fn every_number_of_iterations_returns_an_accepted_step() {
    let kernel = |variance| Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, variance, 1.0, 1).unwrap()]);
    let cases = [(2e5, 1), (2e5, 2), (7e7, 3), (2e3, 4)].into_iter();
    for ((variance, seed), is_sparse) in cases.flat_map(|case| [(case, false), (case, true)]) {
        let prior = Prior::new(kernel(variance).unwrap(), PriorMean::Constant(0.2)).unwrap();
        let order = shuffled(8, seed);
        let inputs = line(&order.iter().map(|&n| n as f64 * 0.7 - 2.5).collect::<Vec<_>>());
        let observations = Observations::new(inputs.clone(), (0..8).map(|n| n % 3 == 0).collect()).unwrap();
        let evidence = |iterations_max| {
            let mut options = FitOptions::default().tolerance(0.0).iterations_max(iterations_max);
            options.inducing_points = is_sparse.then_some(&inputs);
            let fit = dgpc::fit(&prior, &observations, &options).unwrap();
            assert!(
                fit.change().is_finite(),
                "variance {variance}, sparse: {is_sparse}: no change reported after {iterations_max} iterations"
            );
            fit.evidence()
        };
        let all: Vec<f64> = (1..=80).map(evidence).collect();
        let first = all[0];
        for (before, &after) in all.windows(2).map(|pair| (pair[0], &pair[1])) {
            // Plain steps from accepted places may differ slightly. A rejected step would lose whole nats.
            assert!(
                after >= before - 0.02 * (before - first).abs() - 1e-9,
                "variance {variance}, sparse: {is_sparse}: {after} after {before}"
            );
        }
    }
}

/// A sparse fit that stops early has moments and leave-one-out moments that belong to its sites.
#[test]
fn a_fit_that_stopped_early_is_consistent() {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 100.0, 1.0, 1).unwrap()]).unwrap();
    let prior = Prior::new(kernel, PriorMean::Zero).unwrap();
    let observations = Observations::new(line(&[0.0, 0.0]), vec![true, false]).unwrap();
    let points = line(&[0.0]);
    for iterations_max in 1..4 {
        let options = FitOptions::default().start(&[50.0, 50.0]).iterations_max(iterations_max);
        let fit = dgpc::fit(&prior, &observations, &options.inducing_points(&points)).unwrap();
        let latent = fit.posterior().unwrap().latent(observations.inputs()).unwrap();
        assert_same_latent(&Latent { mean: fit.mean().to_vec(), variance: fit.variance().to_vec() }, &latent, 1e-9);
        // The leave-one-out probability of either event, computed by hand from the other event.
        let omega = fit.sites().omega()[0];
        let variance = 1.0 / (0.01 + omega);
        let expected = success_probability(-0.5 * variance, variance).ln();
        assert!(fit.leave_one_out().iter().all(|found| (found - expected).abs() < 1e-6), "{iterations_max}");
    }
}

/// A prior mean that overflows is refused before any sampling.
#[test]
fn a_prior_mean_that_overflows_is_refused() {
    let mean = PriorMean::range(0.0, 1e300, &[0], &[1]).unwrap();
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 1.0, 1.0, 2).unwrap()]).unwrap();
    let prior = Prior::new(kernel, mean).unwrap();
    let far = Observations::new(Inputs::from_rows(&[[0.0, 1e300]]).unwrap(), vec![true]).unwrap();
    assert!(matches!(Gibbs::new(&prior, far.clone()), Err(Error::NotFinite { what: "prior mean", .. })));
    assert!(matches!(dgpc::fit(&prior, &far, &FitOptions::default()), Err(Error::NotFinite { .. })));
}

#[test]
fn the_sampler_refuses_tilts_that_are_not_finite() {
    for c in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let refused = polya_gamma::sample(&mut seeded(1), c);
        assert!(matches!(refused, Err(Error::NotFinite { place: Place::Alone, .. })), "{c}: {refused:?}");
    }
}

/// A huge number of requested points allocates no more memory than the number of candidates needs.
#[test]
fn huge_numbers_of_points_need_no_memory() {
    let prior = line_prior(Shape::Matern52);
    let candidates = Candidates::new(prior.kernel(), &line(&[0.0, 1.0, 2.0])).unwrap();
    for points in [10_000_000_000_000, usize::MAX] {
        for chosen in [
            candidates.minimise_trace(points),
            candidates.maximise_trace(points),
            candidates.greedy(points),
            candidates.random(points, &mut seeded(1)),
        ] {
            assert_eq!(chosen.indices.len(), 3);
        }
        assert_eq!(spread_out(5, points), [0, 1, 2, 3, 4]);
    }
    assert_eq!(spread_out(usize::MAX, 3).len(), 3);
}
