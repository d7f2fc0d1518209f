//! Sparse fits of events in several shards.

use std::borrow::Cow;

use crate::common::{assert_near, seeded};
use dgpc::*;
use rand::RngExt;

/// Returns weighted events over the unit square, with odds that vary along a wave.
fn events(count: usize) -> Observations {
    let mut rng = seeded(90);
    let inputs = Inputs::new((0..2 * count).map(|_| rng.random_range(0.0..1.0)).collect(), 2).unwrap();
    let outcomes = inputs.rows().map(|x| rng.random::<f64>() < 0.5 + 0.4 * (7.0 * x[0] + 3.0 * x[1]).sin()).collect();
    let weights = (0..count).map(|n| 1.0 + (n % 3) as f64).collect();
    Observations::weighted(inputs, outcomes, weights).unwrap()
}

fn prior() -> Prior {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 3.0, 0.3, 2).unwrap()]).unwrap();
    Prior::new(kernel, PriorMean::Constant(0.4)).unwrap()
}

fn points(events: &Observations) -> Inputs {
    events.inputs().select(&spread_out(events.len(), 12))
}

/// Returns a summary of other events at three points, under another prior.
fn message() -> Summary {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 1.5, 0.5, 2).unwrap()]).unwrap();
    let other = Prior::new(kernel, PriorMean::Zero).unwrap();
    let inputs = Inputs::from_rows(&[[0.1, 0.2], [0.5, 0.9], [0.8, 0.3]]).unwrap();
    let observations = Observations::new(inputs.clone(), vec![true, false, true]).unwrap();
    Summary::marginal(&other, &Sites::new(&observations, vec![0.2; 3]).unwrap(), &inputs).unwrap()
}

/// Divides events into shards of different sizes; the last shard is empty.
fn divided(events: &Observations, shards: usize) -> Vec<Observations> {
    let of = |shard: usize| {
        let chosen: Vec<usize> = (0..events.len()).filter(|n| n * n % (shards - 1).max(1) == shard).collect();
        events.select(&chosen)
    };
    (0..shards).map(of).collect()
}

fn shards<'a>(fit: &ShardedFit, events: &'a [Observations]) -> Vec<Shard<'a>> {
    // Some shards keep no covariances.
    let shard = |(n, events)| match n % 2 {
        0 => Shard::new(&prior(), Cow::Borrowed(events), fit.inducing_points()).unwrap(),
        _ => Shard::with_memory(&prior(), Cow::Borrowed(events), fit.inducing_points(), 0).unwrap(),
    };
    events.iter().enumerate().map(shard).collect()
}

/// Runs a fit to its end, and returns it with the gradient. `answer` returns the contributions of all shards.
fn run(
    options: &FitOptions<'_>,
    mut answer: impl FnMut(&ShardedFit, &ShardRequest) -> Vec<ShardContribution>,
) -> (ShardedFit, Vec<f64>) {
    let mut fit = ShardedFit::new(&prior(), options).unwrap();
    while let Some(request) = fit.request() {
        let contributions = answer(&fit, &request);
        fit.absorb(ShardContribution::sum(contributions).unwrap()).unwrap();
    }
    let gradient = fit.gradient(ShardContribution::sum(answer(&fit, &fit.gradient_request())).unwrap()).unwrap();
    (fit, gradient)
}

/// Runs a fit whose shards stay between the requests.
fn run_with_shards(options: &FitOptions<'_>, events: &[Observations]) -> (ShardedFit, Vec<f64>) {
    let mut workers: Option<Vec<Shard<'_>>> = None;
    run(options, |fit, request| {
        let workers = workers.get_or_insert_with(|| shards(fit, events));
        workers.iter_mut().map(|shard| shard.contribute(request).unwrap()).collect()
    })
}

#[test]
fn a_fit_of_several_shards_equals_the_fit_of_all_events() {
    let (events, message) = (events(400), message());
    let (points, messages) = (points(&events), [&message]);
    let options = FitOptions::default().inducing_points(&points).messages(&messages);
    let whole = evidence(&prior(), &events, &options).unwrap();
    let places = Inputs::from_rows(&[[0.2, 0.3], [0.7, 0.6], [2.0, 2.0]]).unwrap();
    let expected = whole.fit.posterior().unwrap().latent(&places).unwrap();
    for count in [2, 3, 6] {
        let (fit, gradient) = run_with_shards(&options, &divided(&events, count));
        assert_eq!(fit.stop(), Some(FitStop::Converged));
        assert!((fit.evidence() - whole.fit.evidence()).abs() < 1e-8);
        assert_near("gradient", &gradient, &whole.gradient, 1e-6);
        let found = fit.posterior().unwrap().latent(&places).unwrap();
        assert_near("mean", &found.mean, &expected.mean, 1e-8);
        assert_near("variance", &found.variance, &expected.variance, 1e-8);
    }
}

#[test]
fn one_shard_gives_the_bits_of_a_fit() {
    let events = events(300);
    let points = points(&events);
    for tolerance in [1e-10, 0.0] {
        let options = FitOptions::default().inducing_points(&points).tolerance(tolerance).iterations_max(60);
        let whole = evidence(&prior(), &events, &options).unwrap();
        let own = [events.clone()];
        let mut shard = None;
        let (fit, gradient) = run(&options, |fit, request| {
            let shard = shard.get_or_insert_with(|| shards(fit, &own).remove(0));
            vec![shard.contribute(request).unwrap()]
        });
        let shard = shard.unwrap();
        assert_eq!((fit.evidence(), fit.iterations()), (whole.fit.evidence(), whole.fit.iterations()));
        assert_eq!((shard.mean(), shard.variance()), (whole.fit.mean(), whole.fit.variance()));
        assert_eq!(&shard.sites().unwrap(), whole.fit.sites());
        assert_eq!(gradient, whole.gradient);
    }
}

#[test]
fn lost_workers_and_transport_change_no_bit() {
    let events = events(300);
    let (points, parts) = (points(&events), divided(&events, 4));
    for iterations_max in [1000, 4] {
        let options = FitOptions::default().inducing_points(&points).iterations_max(iterations_max);
        let (kept, of_kept) = run_with_shards(&options, &parts);
        // Every request goes to new workers, and is read from its numbers; so are the contributions.
        let (lost, of_lost) = run(&options, |fit, request| {
            let request = ShardRequest::from_numbers(&request.to_numbers()).unwrap();
            let answer = |mut shard: Shard<'_>| shard.contribute(&request).unwrap();
            let answers = shards(fit, &parts).into_iter().map(answer);
            answers.map(|answer| ShardContribution::from_numbers(&answer.to_numbers()).unwrap()).collect()
        });
        assert_eq!((kept.evidence(), kept.iterations()), (lost.evidence(), lost.iterations()));
        let [kept, lost] = [kept, lost].map(|fit| fit.summary().unwrap());
        assert_eq!(kept.whitened_precision(), lost.whitened_precision());
        assert_eq!(kept.whitened_shift(), lost.whitened_shift());
        assert_eq!(of_kept, of_lost);
    }
}

#[test]
fn contributions_to_other_requests_are_refused() {
    let events = events(60);
    let points = points(&events);
    let mut fit = ShardedFit::new(&prior(), &FitOptions::default().inducing_points(&points)).unwrap();
    let parts = divided(&events, 3);
    let mut workers = shards(&fit, &parts);
    let first = fit.request().unwrap();
    let mut answer = |request: &ShardRequest| -> Vec<ShardContribution> {
        workers.iter_mut().map(|shard| shard.contribute(request).unwrap()).collect()
    };
    assert_eq!(fit.summary().err(), Some(Error::Unfinished));
    assert_eq!(fit.stop(), None);
    let (early, again) = (answer(&first), answer(&first));
    fit.absorb(ShardContribution::sum(again).unwrap()).unwrap();
    let second = answer(&fit.request().unwrap());
    assert_eq!(fit.absorb(early[0].clone()).err(), Some(Error::WrongContribution));
    let mixed = vec![early[0].clone(), second[1].clone()];
    assert_eq!(ShardContribution::sum(mixed).err(), Some(Error::WrongContribution));
    assert!(matches!(ShardContribution::sum(Vec::new()), Err(Error::OutOfRange { .. })));
    let gradient = answer(&fit.gradient_request());
    assert_eq!(fit.absorb(gradient[0].clone()).err(), Some(Error::WrongContribution));
    assert_eq!(fit.gradient(gradient[0].clone()).err(), Some(Error::Unfinished));

    // A refused contribution leaves the fit as it was.
    fit.absorb(ShardContribution::sum(second).unwrap()).unwrap();
    assert_eq!(fit.iterations(), 1);
    let fewer = points.select(&[0, 1, 2]);
    let mut small = Shard::new(&prior(), Cow::Borrowed(&events), &fewer).unwrap();
    let refused = small.contribute(&fit.request().unwrap()).err();
    assert!(matches!(refused, Some(Error::SizeMismatch { expected: 3, found: 12, .. })), "{refused:?}");
    assert!(matches!(ShardedFit::new(&prior(), &FitOptions::default()), Err(Error::OutOfRange { .. })));
}

#[test]
fn damaged_lists_of_numbers_are_refused() {
    let events = events(40);
    let points = points(&events);
    let mut fit = ShardedFit::new(&prior(), &FitOptions::default().inducing_points(&points)).unwrap();
    let mut shard = Shard::new(&prior(), Cow::Borrowed(&events), &points).unwrap();
    fit.absorb(shard.contribute(&fit.request().unwrap()).unwrap()).unwrap();
    let request = fit.request().unwrap();
    let (asked, answered) = (request.to_numbers(), shard.contribute(&request).unwrap().to_numbers());
    assert_eq!(asked.len(), 2 + 1 + 12 * 13 / 2 + 12, "before the second walk there is one posterior");
    assert_eq!(answered.len(), 5 + 12 * 13 / 2 + 12);
    let is_refused = |asked: &[f64], answered: &[f64]| {
        ShardRequest::from_numbers(asked).is_err() && ShardContribution::from_numbers(answered).is_err()
    };
    for length in 0..asked.len() {
        assert!(ShardRequest::from_numbers(&asked[..length]).is_err(), "{length} numbers");
    }
    for length in 0..answered.len() {
        assert!(ShardContribution::from_numbers(&answered[..length]).is_err(), "{length} numbers");
    }
    assert!(is_refused(&[&asked[..], &[0.5]].concat(), &[&answered[..], &[0.5]].concat()));
    for bad in [f64::NAN, f64::INFINITY, -1.0, 0.5, 1e300] {
        for place in [0, 1] {
            let [mut asked, mut answered] = [asked.clone(), answered.clone()];
            (asked[place], answered[place]) = (bad, bad);
            assert!(is_refused(&asked, &answered), "{bad} at {place}");
        }
        let [mut asked, mut answered] = [asked.clone(), answered.clone()];
        (asked[2], answered[4]) = (bad, bad);
        assert!(is_refused(&asked, &answered), "{bad} inducing points");
    }
}
