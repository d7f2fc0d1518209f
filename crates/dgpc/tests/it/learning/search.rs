//! Starts and ends of searches.

use super::*;

/// Returns a prior near the template.
fn elsewhere(rng: &mut ChaCha8Rng, template: &Prior) -> Prior {
    let moved: Vec<f64> =
        template.parameter_values().iter().map(|parameter| parameter + rng.random_range(-1.0..1.0)).collect();
    template.with_parameters(&moved).unwrap()
}

/// Returns a random hyperprior, from strong ones, which move the optimum away from the maximum of E, to weak ones.
fn random_spread(rng: &mut ChaCha8Rng) -> HyperPrior {
    let mut sd = || rng.random_range(0.05..1.5);
    HyperPrior::default().length_scale(sd()).variance(sd()).intercept(sd()).slope(sd())
}

#[test]
fn a_warm_start_never_lowers_the_evidence() {
    for seed in 0..30 {
        let mut rng = seeded(100 + seed);
        let template = &templates()[seed as usize % 3];
        let (all, message_of_peer) = (waves(seed, 70), message(200 + seed));
        let early = all.select(&(0..30).collect::<Vec<_>>());
        let messages = if rng.random() { vec![&message_of_peer] } else { vec![] };
        let options = LearnOptions::default().hyper_prior(random_spread(&mut rng)).calibrate(rng.random());
        let earlier = learn(template, &early, &options).unwrap().optimum;
        for start in [earlier, elsewhere(&mut rng, template)] {
            let at_start = evidence_of(&start, &all, &messages);
            let later = learn(template, &all, &options.warm_start(&start).messages(&messages)).unwrap();
            assert!(
                later.optimum_evidence >= at_start - 1e-6,
                "seed {seed}: {} after {at_start}",
                later.optimum_evidence
            );
            // The reported values are those of separate fits.
            let at_end = evidence_of(&later.optimum, &all, &messages);
            assert_near("E of the optimum", &[later.optimum_evidence], &[at_end], 1e-7);
            assert_near("E", &[later.fit.evidence()], &[evidence_of(&later.prior, &all, &messages)], 1e-7);
            assert!(later.starts.is_empty(), "compared starts");
        }
    }
}

#[test]
fn a_sparse_warm_start_never_lowers_the_evidence() {
    for seed in 0..9 {
        let template = &templates()[seed as usize % 3];
        let (all, message_of_peer) = (waves(300 + seed, 120), message(400 + seed));
        let early = all.select(&(0..60).collect::<Vec<_>>());
        let options = LearnOptions::default().sparse_beyond(20, 30);
        let messages = [&message_of_peer];
        let options = options.messages(&messages);
        let start = learn(template, &early, &options).unwrap().optimum;
        let options = options.warm_start(&start);
        let later = learn(template, &all, &options).unwrap();
        let points = later.fit.inducing_points().unwrap();
        assert!(points.len() <= 33, "{} points", points.len());
        // The last three points are those of the message.
        let chosen = points.slice(0..points.len() - 3);
        let is_inducing_point = |z: &[f64]| points.rows().any(|point| point == z);
        assert!(
            message_of_peer.inducing_points().rows().all(is_inducing_point),
            "a point of the message is not an inducing point"
        );
        let at_start = dgpc::fit(&start, &all, &FitOptions::default().messages(&messages).inducing_points(&chosen))
            .unwrap()
            .evidence();
        assert!(later.optimum_evidence >= at_start - 1e-6, "seed {seed}: {} after {at_start}", later.optimum_evidence);
    }
}

#[test]
fn a_search_on_given_inducing_points_ends_at_the_best_prior_for_these_points() {
    for seed in 0..6 {
        let template = &templates()[seed as usize % 3];
        let events = waves(500 + seed, 80);
        let message_of_peer = message(600 + seed);
        let messages = [&message_of_peer];
        let points = events.inputs().select(&(0..80).step_by(8).collect::<Vec<_>>());
        let under = |prior: &Prior| {
            let options = FitOptions::default().messages(&messages).inducing_points(&points);
            dgpc::fit(prior, &events, &options).unwrap().evidence()
        };
        let weak = HyperPrior::default().length_scale(9.0).variance(9.0).intercept(9.0).slope(9.0);
        let options = LearnOptions::default().messages(&messages).hyper_prior(weak);
        let given = learn(template, &events, &options.inducing_points(&points)).unwrap();
        let used = given.fit.inducing_points().unwrap();
        assert!(used.slice(0..points.len()).rows().eq(points.rows()), "seed {seed}: other points");
        assert_near("E of the optimum", &[given.optimum_evidence], &[under(&given.optimum)], 1e-7);
        let dense = learn(template, &events, &options).unwrap();
        let [best, other] = [under(&given.optimum), under(&dense.optimum)];
        assert!(best >= other - 0.05, "seed {seed}: {best} at the end, {other} at the end of a dense search");
    }
}

#[test]
fn inducing_points_of_another_dimension_are_refused() {
    let (template, events, points) = (&templates()[0], waves(1, 30), Inputs::new(vec![0.0; 9], 9).unwrap());
    let learned = learn(template, &events, &LearnOptions::default().inducing_points(&points));
    let fitted = dgpc::fit(template, &events, &FitOptions::default().inducing_points(&points));
    for error in [learned.err(), fitted.err()] {
        assert!(matches!(error, Some(Error::SizeMismatch { what: "input dimension", .. })), "{error:?}");
    }
}

/// Learns, and asserts that no change of a single parameter improves the objective.
#[track_caller]
fn assert_maximum(
    template: &Prior,
    events: &Observations,
    messages: &[&Summary],
    options: &LearnOptions<'_>,
) -> Learned {
    let learned = learn(template, events, &options.messages(messages)).unwrap();
    let at = learned.optimum.parameter_values();
    let value = |at: &[f64]| objective(template, at, &options.hyper_prior, events, messages);
    let best = value(&at);
    for (place, sd) in spread_of(template, &options.hyper_prior).into_iter().enumerate() {
        for step in [-0.05, 0.05, -0.3, 0.3] {
            let mut moved = at.clone();
            moved[place] += step * sd;
            let rise = value(&moved) - best;
            assert!(rise < 0.02, "parameter {place} by {step} standard deviations gains {rise}");
        }
    }
    if learned.start_events == events.len() {
        let starts = learned.starts.iter().map(|start| start.objective.unwrap());
        assert!(starts.clone().count() > 1 && starts.clone().all(|other| best > other - 1e-3), "{best}, {starts:?}");
    }
    learned
}

#[test]
fn the_optimum_maximises_the_objective() {
    let mut rng = seeded(5);
    for seed in 0..18 {
        let (events, message_of_peer) = (waves(600 + seed, rng.random_range(30..150)), message(700 + seed));
        let messages = if rng.random() { vec![&message_of_peer] } else { vec![] };
        let options = LearnOptions::default().hyper_prior(random_spread(&mut rng));
        let learned = assert_maximum(&templates()[seed as usize % 3], &events, &messages, &options);
        assert_eq!(learned.start_events, events.len());
    }
}

/// From 150 events on, the curvature of the objective is computed from a third of them.
#[test]
fn the_optimum_is_a_maximum_with_curvature_from_few_events() {
    let mut rng = seeded(15);
    for seed in 0..9 {
        let (events, message_of_peer) = (waves(1600 + seed, rng.random_range(160..300)), message(1700 + seed));
        let messages = if rng.random() { vec![&message_of_peer] } else { vec![] };
        let options = LearnOptions::default().hyper_prior(random_spread(&mut rng));
        assert_maximum(&templates()[seed as usize % 3], &events, &messages, &options);
    }
}

#[test]
fn initial_tilts_do_not_change_the_result() {
    let (template, events) = (&templates()[0], waves(17, 90));
    let options = LearnOptions::default();
    let learned = learn(template, &events, &options).unwrap();
    let tilts = learned.fit.tilts();
    let warm = learn(template, &events, &options.tilts(tilts)).unwrap();
    assert_near("parameters", &warm.optimum.parameter_values(), &learned.optimum.parameter_values(), 1e-2);
    assert_near("E", &[warm.optimum_evidence], &[learned.optimum_evidence], 1e-3);
    let few = learn(template, &events, &options.tilts(&tilts[1..]));
    assert!(matches!(few, Err(Error::SizeMismatch { expected: 90, found: 89, .. })), "{few:?}");
}

/// E must not decrease from a warm start. This does not apply to a start found from few events: it may have more E on
/// all events and a lower density of the hyperprior.
#[test]
fn all_events_overrule_a_start_from_few_events() {
    let template = prior(vec![term(Shape::SquaredExponential, 4.0, &[1.0])], PriorMean::Zero);
    let spread = HyperPrior::default().length_scale(0.7).variance(0.7);
    for (seed, count, start_events_max) in [(162, 42, 17), (49, 171, 150)] {
        let events = waves(seed, count);
        let [few, all] = [start_events_max, count].map(|start_events_max| {
            let options = LearnOptions::default().hyper_prior(spread).start_events_max(start_events_max);
            let optimum = learn(&template, &events, &options).unwrap().optimum;
            objective(&template, &optimum.parameter_values(), &spread, &events, &[])
        });
        assert!(
            few > all - 0.02,
            "seed {seed}: {few} after comparing starts on {start_events_max} events, {all} on all"
        );
    }
}

/// On the last of these data sets, ten events lead to a maximum that is 3 nats worse than the maximum near the
/// template.
#[test]
fn comparing_starts_is_never_worse_than_starting_at_the_template() {
    for seed in (900..912).chain([1929, 2511]) {
        let (template, events) = (&templates()[seed as usize % 3], waves(seed, 60));
        let options = LearnOptions::default().start_events_max(10);
        let value = |warm_start: Option<&Prior>| {
            let options = warm_start.map_or(options, |start| options.warm_start(start));
            let optimum = learn(template, &events, &options).unwrap().optimum;
            objective(template, &optimum.parameter_values(), &options.hyper_prior, &events, &[])
        };
        let (found, from_template) = (value(None), value(Some(template)));
        assert!(found > from_template - 1e-3, "seed {seed}: {found}, {from_template} from the template");
    }
}

#[test]
fn calibration_raises_the_corrected_evidence() {
    for seed in 0..12 {
        let template = &templates()[seed as usize % 3];
        let (events, options) = (waves(800 + seed, 60), LearnOptions::default());
        let learned = learn(template, &events, &options).unwrap();
        let corrected = |factor: f64| {
            let terms = learned.optimum.kernel().terms().iter();
            let terms = terms.map(|term| term.with_variance(factor * term.variance()).unwrap()).collect();
            let prior = prior(terms, learned.optimum.mean().clone());
            dgpc::fit(&prior, &events, &FitOptions::default()).unwrap().corrected_evidence()
        };
        let value = |factor: f64| corrected(factor) - 0.5 * (factor.ln() / options.hyper_prior.variance).powi(2);
        let found = learned.calibration.factor();
        assert_near("corrected E", &[learned.fit.corrected_evidence()], &[corrected(found)], 1e-6);
        for factor in (-20..=40).map(|step| (0.05 * f64::from(step)).exp()) {
            let gain = value(factor) - value(found);
            assert!(gain < 0.02, "seed {seed}: {factor} instead of {found} gains {gain}");
        }
    }
}

#[test]
fn a_start_at_a_known_end_costs_one_evaluation() {
    let events = waves(7, 90);
    for template in templates() {
        let options = LearnOptions::default();
        let at_end = learn(&template, &events, &options).unwrap().optimum;
        let warm = options.warm_start(&at_end);
        let alone = learn(&template, &events, &warm).unwrap();
        let further = [(); 2].map(|()| alone.optimum.clone());
        let with_further = learn(&template, &events, &warm.further_starts(&further)).unwrap();
        assert_eq!((with_further.prior, with_further.stop), (alone.prior, alone.stop));
        assert_eq!(with_further.evaluations, alone.evaluations + 2);
    }
}

#[test]
fn a_known_end_does_not_hide_a_better_end() {
    // A smooth start interprets short waves as noise. A start at their length-scale finds them.
    let places = inputs(&mut seeded(8), 200, 1, 2.0);
    let mut rng = seeded(9);
    let outcomes = places.rows().map(|x| rng.random::<f64>() < logistic(4.0 * (10.0 * x[0]).sin())).collect();
    let events = Observations::new(places, outcomes).unwrap();
    let template = prior(vec![term(Shape::SquaredExponential, 4.0, &[1.0])], PriorMean::Zero);
    let [far, near] = [3.0, 0.2].map(|factor| template.with_length_scales_times(factor).unwrap());
    let options = LearnOptions::default().hyper_prior(HyperPrior::default().length_scale(3.0));
    let merit = |start: &Prior, further: &[Prior]| {
        let learned = learn(&template, &events, &options.warm_start(start).further_starts(further)).unwrap();
        learned.fit.corrected_evidence()
    };
    let (from_far, from_near) = (merit(&far, &[]), merit(&near, &[]));
    assert!(from_near > from_far + 10.0, "one place alone, {from_far} and {from_near}: nothing is tested");
    assert_near("near last", &[merit(&far, std::slice::from_ref(&near))], &[from_near], 0.1);
    assert_near("near first", &[merit(&near, std::slice::from_ref(&far))], &[from_near], 0.1);
}

#[test]
fn learning_is_deterministic() {
    let (events, message_of_peer) = (waves(5, 120), message(6));
    for template in templates() {
        for dense_events_max in [1000, 50] {
            let options = LearnOptions::default().sparse_beyond(dense_events_max, 40);
            let [first, second] =
                [(); 2].map(|()| learn(&template, &events, &options.messages(&[&message_of_peer])).unwrap());
            assert_eq!(first.prior, second.prior);
            assert_eq!(first.optimum, second.optimum);
            assert_eq!((first.stop, first.starts), (second.stop, second.starts));
            assert_eq!(
                (first.evaluations, first.fit.inducing_points()),
                (second.evaluations, second.fit.inducing_points())
            );
            let bits = |learned: &[f64]| learned.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(first.fit.mean()), bits(second.fit.mean()));
            let numbers = |fit: &Fit, evidence: f64, factor: f64| bits(&[fit.evidence(), evidence, factor]);
            let first = numbers(&first.fit, first.optimum_evidence, first.calibration.factor());
            assert_eq!(first, numbers(&second.fit, second.optimum_evidence, second.calibration.factor()));
        }
    }
}
