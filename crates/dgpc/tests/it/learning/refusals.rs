//! Invalid arguments, and the choice of the events for the first comparison.

use super::*;

#[test]
fn invalid_hyperpriors_are_refused() {
    let (template, events) = (&templates()[2], waves(12, 20));
    for value in [-1e-9, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let weak = HyperPrior::default();
        let spreads = [weak.length_scale(value), weak.variance(value), weak.intercept(value), weak.slope(value)];
        for spread in spreads {
            let cold = LearnOptions::default().hyper_prior(spread);
            for options in [cold, cold.warm_start(template)] {
                let found = learn(template, &events, &options);
                assert!(
                    matches!(found, Err(Error::OutOfRange { what: "standard deviation of a hyperprior", .. })),
                    "{spread:?}: {found:?}"
                );
            }
        }
    }
    for tolerance in [-1.0, f64::NAN, f64::INFINITY] {
        let found = learn(template, &events, &LearnOptions::default().tolerance(tolerance));
        assert!(matches!(found, Err(Error::OutOfRange { what: "tolerance of a search", .. })), "{found:?}");
    }
}

fn is_refused_as_different(template: &Prior, start: &Prior) -> bool {
    let options = LearnOptions::default().warm_start(start);
    matches!(learn(template, &waves(13, 20), &options), Err(Error::DifferentStructures))
}

#[test]
fn warm_starts_with_more_or_fewer_parameters_are_refused() {
    let templates = templates();
    let isotropic = prior(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 2).unwrap()], PriorMean::Zero);
    for (template, start) in [(0, 1), (1, 0), (1, 2), (2, 1)] {
        assert!(is_refused_as_different(&templates[template], &templates[start]), "{template}, {start}");
    }
    assert!(is_refused_as_different(&templates[0], &isotropic) && is_refused_as_different(&isotropic, &templates[0]));
}

#[test]
fn warm_starts_of_another_structure_are_refused() {
    let line = |shape, mean| prior(vec![term(shape, 4.0, &[1.0])], mean);
    let template = &line(Shape::SquaredExponential, PriorMean::Constant(0.0));
    let plane = prior(vec![term(Shape::SquaredExponential, 4.0, &[1.0, 1.0])], PriorMean::Zero);
    let column =
        prior(vec![Term::new(Shape::SquaredExponential, 4.0, &[1], &[1.0]).unwrap()], PriorMean::Constant(0.0));
    assert!(is_refused_as_different(template, &plane), "a length-scale for a prior mean");
    assert!(is_refused_as_different(template, &line(Shape::Matern32, PriorMean::Constant(0.0))), "another shape");
    assert!(is_refused_as_different(template, &column), "another column");
}

#[test]
fn a_fixed_parameter_is_that_of_the_template_after_a_warm_start() {
    let (template, events) = (&templates()[0], waves(1, 60));
    let start = learn(template, &events, &LearnOptions::default()).unwrap().optimum;
    let spread = HyperPrior::default().length_scale(0.0);
    let options = LearnOptions::default().hyper_prior(spread).warm_start(&start);
    let learned = learn(template, &events, &options).unwrap();
    assert_near("length-scales", length_scales(&learned.prior), length_scales(template), 1e-12);
}

#[test]
fn inputs_with_too_few_columns_are_refused() {
    let line = Observations::new(Inputs::from_rows(&[[0.0], [1.0]]).unwrap(), vec![true, false]).unwrap();
    for template in templates() {
        for dense_events_max in [1000, 1] {
            for warm_start in [None, Some(template.clone())] {
                let options = LearnOptions::default().sparse_beyond(dense_events_max, 256);
                let options = warm_start.as_ref().map_or(options, |start| options.warm_start(start));
                let found = learn(&template, &line, &options);
                assert!(matches!(found, Err(Error::BadColumn { column: 1, columns: 1, .. })), "{found:?}");
            }
        }
    }
    let range = prior(vec![term(Shape::SquaredExponential, 1.0, &[1.0])], range_mean(0.0, 1.0));
    let found = learn(&range, &line, &LearnOptions::default());
    assert!(matches!(found, Err(Error::BadColumn { what: "range prior mean", .. })), "{found:?}");
}

#[test]
fn chosen_events_are_few_distinct_and_in_order() {
    for count_max in [0, 1, 2, 7, 150, 1024] {
        for count in (0..40).chain([149, 150, 151, 152, 300, 1023, 1024, 1025, 4181, 100_000]) {
            let chosen = spread_out(count, count_max);
            assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]), "{count}, {count_max}: not in order");
            assert!(chosen.last().is_none_or(|&last| last < count), "{count}, {count_max}: beyond the end");
            assert!(chosen.len() <= count_max, "{count}, {count_max}: {}", chosen.len());
            if count <= count_max {
                assert_eq!(chosen.len(), count);
            } else {
                assert!(5 * chosen.len() >= 4 * count_max, "{count}, {count_max}: only {}", chosen.len());
            }
        }
    }
}

#[test]
fn chosen_events_are_spread_evenly() {
    for count in [1000, 2741, 20_000] {
        for count_max in [150, 1024] {
            let chosen = spread_out(count, count_max);
            for tenth in 0..10 {
                let part = chosen.iter().filter(|&&n| n * 10 / count == tenth).count() as f64;
                assert!(
                    (part / chosen.len() as f64 - 0.1).abs() < 0.03,
                    "{count}, {count_max}: {part} in tenth {tenth}"
                );
            }
        }
    }
}

/// Returns the largest deviation of a residue's share from a uniform share, in standard deviations of a random choice.
fn largest_residue_deviation(chosen: &[usize], period: usize) -> f64 {
    let mut counts = vec![0.0; period];
    chosen.iter().for_each(|n| counts[n % period] += 1.0);
    let (size, share) = (chosen.len() as f64, 1.0 / period as f64);
    let off = counts.iter().map(|count| (count - size * share).abs()).fold(0.0, f64::max);
    off / (size * share * (1.0 - share)).sqrt()
}

#[test]
fn chosen_events_share_no_period_with_a_schedule() {
    for count in [500, 1000, 1500, 2000, 3000, 5000, 10_000] {
        for (period, count_max) in (2..=10).flat_map(|period| [(period, 150), (period, 1024)]) {
            let off = largest_residue_deviation(&spread_out(count, count_max), period);
            assert!(off < 4.5, "{count_max} of {count}: a residue modulo {period} is {off} standard deviations off");
        }
    }
}

#[test]
fn chosen_events_share_no_period_with_a_schedule_of_any_length() {
    for count in (151..8000).chain([8430, 12_345, 37_629, 100_000]) {
        for period in 2..=10 {
            let off = largest_residue_deviation(&spread_out(count, 150), period);
            assert!(off < 5.5, "150 of {count}: a residue modulo {period} is {off} standard deviations off");
        }
    }
}
