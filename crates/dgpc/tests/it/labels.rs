//! Labels: offsets of the points that share a label, and no offset for negative labels.

use dgpc::*;

/// Every event has a place, a label and a time.
fn inputs() -> Inputs {
    let row = |n: usize| [0.3 * n as f64 - 2.0, [3.0, 5.0, -1.0][n % 3], 0.7 * n as f64];
    Inputs::from_rows(&(0..18).map(row).collect::<Vec<_>>()).unwrap()
}

fn outcomes() -> Vec<bool> {
    (0..18).map(|n| (n * 7) % 5 < 3).collect()
}

fn prior() -> Prior {
    let place = Term::new(Shape::Matern32, 2.0, &[0], &[1.3]).unwrap();
    let offset = Term::of(0.8, Correlation::of_labels(&[1]).unwrap()).unwrap();
    let drift = Term::new(Shape::Matern12, 0.5, &[2], &[4.0]).unwrap();
    let drift = drift.times(Correlation::of_labels(&[1]).unwrap()).unwrap();
    Prior::new(Kernel::new(vec![place, offset, drift]).unwrap(), PriorMean::range(0.6, 0.2, &[0], &[2]).unwrap())
        .unwrap()
}

#[test]
fn equal_labels_share_an_offset_and_negative_labels_have_none() {
    let kernel = Kernel::new(vec![Term::of(0.8, Correlation::of_labels(&[1]).unwrap()).unwrap()]).unwrap();
    let inputs = inputs();
    let (gram, diagonal) = (kernel.gram(&inputs).unwrap(), kernel.diagonal(&inputs).unwrap());
    for i in 0..inputs.len() {
        let label = |n: usize| inputs.row(n)[1];
        for j in 0..inputs.len() {
            let expected = if label(i) == label(j) && label(i) >= 0.0 { 0.8 } else { 0.0 };
            assert_eq!(gram[(i, j)], expected, "{i} {j}");
        }
        assert_eq!(diagonal[i], gram[(i, i)]);
    }
}

#[test]
fn only_the_variance_of_an_offset_is_learned() {
    let term = Term::of(0.8, Correlation::of_labels(&[1]).unwrap()).unwrap();
    let kernel = Kernel::new(vec![term]).unwrap();
    assert_eq!(kernel.parameter_values(), [0.8f64.ln()]);
    assert!(kernel.parameters().eq([Parameter::Variance]));
    assert_eq!(kernel.with_parameters(&[0.0]).unwrap().terms()[0].variance(), 1.0);
}

/// Computes the same covariances independently: each label has an indicator column and a linear kernel.
#[test]
fn labels_agree_with_indicator_columns() {
    let inputs = inputs();
    let covariance = prior().kernel().gram(&inputs).unwrap();
    for i in 0..inputs.len() {
        for j in 0..inputs.len() {
            let ([a, b], labels) = ([inputs.row(i), inputs.row(j)], [3.0, 5.0]);
            let r = 3f64.sqrt() * (a[0] - b[0]).abs() / 1.3;
            let shared: f64 = labels
                .iter()
                .map(|&label| f64::from(u8::from(a[1] == label)) * f64::from(u8::from(b[1] == label)))
                .sum();
            let drift = 0.5 * (-(a[2] - b[2]).abs() / 4.0).exp();
            let expected = 2.0 * (1.0 + r) * (-r).exp() + shared * (0.8 + drift);
            assert!((covariance[(i, j)] - expected).abs() < 1e-12, "{i} {j}: {} {expected}", covariance[(i, j)]);
        }
    }
}

/// Compares with central differences by the variances, the length-scales of Matérn 3/2 and 1/2, the intercept and the
/// log slope. The fits are dense, and sparse with some inducing points that have no label.
#[test]
fn the_gradient_of_the_evidence_agrees_with_differences() {
    let events = Observations::new(inputs(), outcomes()).unwrap();
    let points = inputs().select(&[0, 4, 8, 11, 15]);
    for points in [None, Some(&points)] {
        let mut options = FitOptions::default().tolerance(1e-12);
        options.inducing_points = points;
        let at = |values: &[f64]| evidence(&prior().with_parameters(values).unwrap(), &events, &options).unwrap();
        let values = prior().parameter_values();
        assert_eq!(values.len(), 7);
        let gradient = at(&values).gradient;
        for place in 0..values.len() {
            let moved = |step: f64| {
                let mut values = values.clone();
                values[place] += step;
                at(&values).fit.evidence()
            };
            let slope = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!((gradient[place] - slope).abs() < 1e-6, "{place}: {} {slope}", gradient[place]);
        }
    }
}

#[cfg(feature = "learn")]
#[test]
fn a_falling_slope_stays_falling() {
    let inputs = Inputs::from_rows(&(0..40).map(|n| [0.0, 0.1 * f64::from(n)]).collect::<Vec<_>>()).unwrap();
    // The outcomes are successes far away only.
    let outcomes = (0..40).map(|n| n > 20).collect();
    let events = Observations::new(inputs, outcomes).unwrap();
    let kernel = Kernel::new(vec![Term::new(Shape::Matern32, 1.0, &[1], &[1.0]).unwrap()]).unwrap();
    let mean = |slope| PriorMean::range(1.0, slope, &[0], &[1]).unwrap();
    let learn = |slope| {
        let template = Prior::new(kernel.clone(), mean(slope)).unwrap();
        learn(&template, &events, &LearnOptions::default()).unwrap().prior
    };
    let PriorMean::Range(falling) = learn(0.5).mean().clone() else { panic!("another mean") };
    assert!(falling.slope() > 0.0, "{}", falling.slope());
    // A slope that does not fall is not learned.
    for slope in [0.0, -0.25] {
        let PriorMean::Range(unchanged) = learn(slope).mean().clone() else { panic!("another mean") };
        assert_eq!(unchanged.slope(), slope);
    }
}
