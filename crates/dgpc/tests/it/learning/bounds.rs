//! Bounds of the parameters, and their refusal.

use super::*;

/// A prior of two length-scales and a constant mean: variance, two length-scales, intercept.
fn template() -> Prior {
    prior(vec![term(Shape::Matern52, 2.0, &[0.8, 1.2])], PriorMean::Constant(0.3))
}

fn learned(bounds: &[Bounds]) -> Learned {
    learn(&template(), &waves(31, 120), &LearnOptions::default().bounds(bounds)).unwrap()
}

/// Returns the values of the parameters, not their logarithms.
fn values(prior: &Prior) -> [f64; 4] {
    let PriorMean::Constant(intercept) = prior.mean() else { panic!("the mean is constant") };
    [variance(prior), length_scales(prior)[0], length_scales(prior)[1], *intercept]
}

#[test]
fn fixed_parameters_keep_the_value_of_the_template() {
    let [free, fixed] = [Bounds::Free, Bounds::Fixed];
    let before = values(&template());
    for pattern in [[fixed, free, free, free], [free, fixed, free, fixed], [free, fixed, fixed, free], [fixed; 4]] {
        let after = values(&learned(&pattern).prior);
        for (place, bounds) in pattern.iter().enumerate() {
            let is_same = (after[place] - before[place]).abs() < 1e-12;
            assert_eq!(is_same, *bounds == fixed, "{pattern:?}, parameter {place}: {after:?}");
        }
    }
    let calibration = learned(&[fixed, free, free, free]).calibration;
    assert_eq!(calibration, Calibration::NotAsked, "a fixed variance is not calibrated");
}

#[test]
fn wide_bounds_lead_to_the_unbounded_optimum() {
    let wide =
        [(1e-5, 1e5), (1e-5, 1e5), (1e-5, 1e5), (-50.0, 50.0)].map(|(lower, upper)| Bounds::Between { lower, upper });
    let (bounded, free) = (learned(&wide), learned(&[]));
    assert!((bounded.optimum_evidence - free.optimum_evidence).abs() < 1e-3);
    assert_near("parameters", &bounded.prior.parameter_values(), &free.prior.parameter_values(), 0.02);
}

#[test]
fn an_optimum_beyond_a_bound_moves_to_the_bound() {
    let free = values(&learned(&[]).optimum);
    // The first length-scale must be longer than its optimum, and the variance smaller.
    let (shortest, largest) = (1.5 * free[1].max(0.8 / 1.5), 0.7 * free[0]);
    let template = prior(vec![term(Shape::Matern52, largest, &[1.2 * shortest, 1.2])], PriorMean::Constant(0.3));
    let bounds = [
        Bounds::Between { lower: 0.1, upper: largest },
        Bounds::Between { lower: shortest, upper: 10.0 },
        Bounds::Free,
        Bounds::Fixed,
    ];
    let learned = learn(&template, &waves(31, 120), &LearnOptions::default().bounds(&bounds)).unwrap();
    for found in [values(&learned.optimum), values(&learned.prior)] {
        assert!(found[0] <= largest * (1.0 + 1e-12) && found[0] > 0.9 * largest, "variance {} of {largest}", found[0]);
        assert!((0.999_999..1.05).contains(&(found[1] / shortest)), "length-scale {} from {shortest}", found[1]);
    }
}

#[test]
fn invalid_bounds_are_refused() {
    let free = Bounds::Free;
    let between = |lower, upper| Bounds::Between { lower, upper };
    let refusal = |bounds: &[Bounds]| {
        learn(&template(), &waves(31, 20), &LearnOptions::default().bounds(bounds)).unwrap_err().to_string()
    };
    assert!(refusal(&[free; 3]).contains("one per parameter of the template: expected 4, found 3"));
    for bad in [between(0.0, 1.0), between(-1.0, 3.0), between(3.0, 1.0), between(2.0, 2.0)] {
        assert!(refusal(&[bad, free, free, free]).starts_with("lower bound of a parameter must be"), "{bad:?}");
    }
    for bad in [between(f64::NAN, 1.0), between(1.0, f64::INFINITY)] {
        assert!(refusal(&[bad, free, free, free]).contains("bound must be finite"), "{bad:?}");
    }
    let found = refusal(&[between(2.5, 3.0), free, free, free]);
    assert!(found.starts_with("template's value of a bounded parameter must be between its bounds, found"), "{found}");
    assert!(refusal(&[free, free, free, between(0.4, 0.5)]).contains("found 0.3"));
}
