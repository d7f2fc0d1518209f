//! Learns length-scales, variance and prior mean from events.
//!
//!     cargo run -p dgpc --example learn_kernel

#![allow(clippy::print_stdout)]

use dgpc::{Inputs, Kernel, LearnOptions, Observations, Prior, PriorMean, Shape, Term, learn};

/// Success in stripes that depend on the first column only.
fn stripes(count: u32) -> dgpc::Result<Observations> {
    let place = |n: u32| [f64::from(n * 37 % 101) * 0.05, f64::from(n * 53 % 97) * 0.05];
    let inputs = Inputs::from_rows(&(0..count).map(place).collect::<Vec<_>>())?;
    let outcomes = inputs.rows().map(|x| (2.5 * x[0]).sin() > 0.0).collect();
    Observations::new(inputs, outcomes)
}

/// Learns a prior, and prints the result.
///
/// # Errors
/// None with these numbers.
pub fn main() -> dgpc::Result<()> {
    // The template with one length-scale for each column. The search starts from it, and parameters stay at its values
    // if the events contain no information about them.
    let kernel = Kernel::new(vec![Term::new(Shape::SquaredExponential, 4.0, &[0, 1], &[1.0, 1.0])?])?;
    let template = Prior::new(kernel, PriorMean::Constant(0.0))?;

    let learned = learn(&template, &stripes(120)?, &LearnOptions::default())?;
    let term = &learned.prior.kernel().terms()[0];
    let length_scales = term.correlations()[0].length_scales();
    println!("length-scales {length_scales:.2?}, variance {:.2}", term.variance());
    println!("E {:.1} nats after {} evaluations: {:?}", learned.optimum_evidence, learned.evaluations, learned.stop);
    println!("calibration: {:?}", learned.calibration);
    assert!(length_scales[1] > 3.0 * length_scales[0]);

    let places = Inputs::from_rows(&[[0.6, 4.0], [1.9, 4.0]])?;
    let probability = learned.fit.posterior()?.probability(&places)?;
    println!("in a stripe {:.2}, between two {:.2}", probability[0], probability[1]);
    assert!(probability[0] > 0.8 && probability[1] < 0.2);
    Ok(())
}
