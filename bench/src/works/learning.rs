//! Learning of kernels. The measure of the result is the loss over other events.

use dgpc::{LearnOptions, learn};

use crate::data::{loss, synthetic, template};

/// Learns from 1000 events with dense fits.
pub fn dense() -> Box<dyn FnMut() -> f64> {
    learned_from(1000, LearnOptions::default())
}

/// Learns from 100 000 events with 175 fixed inducing points. Other software moves 100 points. The search uses 4000 of the events.
pub fn sparse() -> Box<dyn FnMut() -> f64> {
    let mut options = LearnOptions::default();
    options.inducing_points_max = 175;
    learned_from(100_000, options)
}

fn learned_from(size: usize, options: LearnOptions<'static>) -> Box<dyn FnMut() -> f64> {
    let (prior, events, test) = (template(), synthetic(size), synthetic(5000));
    Box::new(move || {
        let learned = learn(&prior, &events, &options).expect("a learned prior");
        let posterior = learned.fit.posterior().expect("a posterior");
        loss(&posterior.probability(test.inputs()).expect("places that fit"), &test)
    })
}
