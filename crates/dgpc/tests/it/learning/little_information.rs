//! Learning with little or no information.

use super::*;

#[test]
fn without_events_the_prior_stays_the_template() {
    let none = Observations::new(Inputs::empty(2), Vec::new()).unwrap();
    for template in templates() {
        let learned = learn(&template, &none, &LearnOptions::default()).unwrap();
        assert_near("parameters", &learned.prior.parameter_values(), &template.parameter_values(), 1e-6);
        assert_near("E", &[learned.optimum_evidence], &[0.0], 1e-12);
    }
}

#[test]
fn a_prior_is_learned_from_messages_alone() {
    let none = Observations::new(Inputs::empty(2), Vec::new()).unwrap();
    let message_of_peer = message(7);
    for template in templates() {
        let learned = learn(&template, &none, &LearnOptions::default().messages(&[&message_of_peer])).unwrap();
        let (before, after) = (evidence_of(&template, &none, &[&message_of_peer]), learned.optimum_evidence);
        assert!(after > before + 1e-3, "E {after} after {before}");
    }
}

/// Events at one place determine the size of f there, but not its variation.
#[test]
fn events_at_one_place_do_not_change_length_scales() {
    let inputs = Inputs::new([0.3, 0.4].repeat(40), 2).unwrap();
    let events = Observations::new(inputs, (0..40).map(|n| n % 4 != 0).collect()).unwrap();
    let template = prior(vec![term(Shape::SquaredExponential, 4.0, &[0.7, 1.3])], PriorMean::Zero);
    for dense_events_max in [1000, 10] {
        let learned = learn(&template, &events, &LearnOptions::default().sparse_beyond(dense_events_max, 256)).unwrap();
        assert_ratios("length-scales", length_scales(&learned.prior), &[0.7, 1.3], 0.01);
        // f² is near ln²3 = 1.2.
        assert!((0.5..4.0).contains(&variance(&learned.prior)), "variance {}", variance(&learned.prior));
    }
}

#[test]
fn outcomes_of_one_class_keep_parameters_bounded() {
    let inputs = waves(8, 80).inputs().clone();
    for template in templates() {
        for (success, dense_events_max) in [(true, 1000), (false, 1000), (true, 20)] {
            let events = Observations::new(inputs.clone(), vec![success; 80]).unwrap();
            let options = LearnOptions::default().sparse_beyond(dense_events_max, 30);
            let learned = learn(&template, &events, &options).unwrap();
            assert!(learned.fit.evidence().is_finite() && learned.fit.mean().iter().all(|mean| mean.is_finite()));
            let parameters = learned.optimum.parameter_values().into_iter().zip(template.parameter_values());
            for ((found, centre), sd) in parameters.zip(spread_of(&template, &options.hyper_prior)) {
                // The largest possible gain is 80 · ln 2, and a parameter's move costs half of its square.
                assert!((found - centre).abs() < 3.5 * sd, "{found} from {centre}");
            }
            assert!((0.2..20.0).contains(&learned.calibration.factor()), "factor {}", learned.calibration.factor());
            let p = Posterior::fuse(&learned.prior, learned.fit.sites(), &[]).unwrap().probability(&inputs).unwrap();
            assert!(p.iter().all(|&p| if success { p > 0.8 } else { p < 0.2 }), "{p:?}");
        }
    }
}

/// Inverting all outcomes changes the sign of f.
#[test]
fn inverted_outcomes_change_only_the_sign_of_the_prior_mean() {
    let events = waves(9, 60);
    let reversed = events.outcomes().iter().map(|&success| !success).collect();
    let reversed = Observations::new(events.inputs().clone(), reversed).unwrap();
    for mean in [PriorMean::Zero, PriorMean::Constant(0.0), range_mean(0.0, 0.0)] {
        let template = prior(vec![term(Shape::Matern52, 4.0, &[1.0, 1.0])], mean);
        let [one, other] =
            [&events, &reversed].map(|events| learn(&template, events, &LearnOptions::default()).unwrap());
        assert_near("E", &[other.optimum_evidence], &[one.optimum_evidence], 1e-6);
        let (one, other) = (one.prior.parameter_values(), other.prior.parameter_values());
        assert_near("kernel", &other[..3], &one[..3], 1e-4);
        let turned: Vec<f64> = one[3..].iter().map(|parameter| -parameter).collect();
        assert_near("prior mean", &other[3..], &turned, 1e-4);
    }
}

#[test]
fn a_parameter_without_spread_is_fixed() {
    let events = waves(10, 80);
    let matern = Term::isotropic(Shape::Matern52, 3.0, 1.1, 2).unwrap();
    let template = prior(vec![term(Shape::SquaredExponential, 0.7, &[0.8, 1.7]), matern], range_mean(0.4, 0.3));
    let (variances, length_scales) = ([0, 3], [1, 2, 4]);
    let weak = HyperPrior::default();
    let cases: [(HyperPrior, &[usize]); 5] = [
        (weak.variance(0.0), &variances),
        (weak.length_scale(0.0), &length_scales),
        (weak.intercept(0.0), &[5]),
        (weak.slope(0.0), &[6]),
        (weak.variance(0.0).length_scale(0.0).intercept(0.0).slope(0.0), &[0, 1, 2, 3, 4, 5, 6]),
    ];
    let centre = template.parameter_values();
    for (spread, fixed) in cases {
        let learned = learn(&template, &events, &LearnOptions::default().hyper_prior(spread)).unwrap();
        for at in [learned.optimum.parameter_values(), learned.prior.parameter_values()] {
            for (place, (found, centre)) in at.iter().zip(&centre).enumerate() {
                let moved = (found - centre).abs();
                if fixed.contains(&place) {
                    assert!(moved <= 1e-12 * centre.abs(), "parameter {place} without spread moved by {moved}");
                } else {
                    assert!(moved > 1e-4, "parameter {place} did not move");
                }
            }
        }
        assert!(spread.variance > 0.0 || learned.calibration.factor() == 1.0);
    }
}

#[test]
fn without_calibration_the_prior_is_the_optimum() {
    let options = LearnOptions::default().calibrate(false);
    let learned = learn(&templates()[0], &waves(11, 50), &options).unwrap();
    assert_eq!((learned.calibration.factor(), &learned.prior), (1.0, &learned.optimum));
    assert_eq!(learned.fit.evidence(), learned.optimum_evidence);
}
