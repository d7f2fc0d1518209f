//! Two agents share their evidence. Each keeps its own events and absorbs a summary at two points from the other.
//!
//!     cargo run -p dgpc --example two_agents

#![allow(clippy::print_stdout)]

use dgpc::{
    Candidates, Certificate, Fit, FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Summary, Term, fit,
};

/// The events of both agents follow one rule: success within a distance of 2 of the origin.
fn events(places: impl Iterator<Item = [f64; 2]>) -> dgpc::Result<Observations> {
    let inputs = Inputs::from_rows(&places.collect::<Vec<_>>())?;
    let outcomes = inputs.rows().map(|x| x[0].hypot(x[1]) < 2.0).collect();
    Observations::new(inputs, outcomes)
}

/// Summarises an agent's events at the two best points, and prints the certificate.
fn message(prior: &Prior, fit: &Fit) -> dgpc::Result<Summary> {
    let inputs = fit.sites().inputs();
    let chosen = Candidates::new(prior.kernel(), inputs)?.minimise_trace(2);
    let points = inputs.select(&chosen.indices);
    let certificate = Certificate::new(prior, fit.sites(), &points)?;
    println!("two of {} events leave out at most {:.2} nats", inputs.len(), certificate.gap);
    Summary::marginal(prior, fit.sites(), &points)
}

/// Fits both agents, shares a summary, and compares the probabilities.
///
/// # Errors
/// None with these numbers.
pub fn main() -> dgpc::Result<()> {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.5, 2)?])?;
    let prior = Prior::new(kernel, PriorMean::Zero)?;
    let at = |n: u32, turn: f64| {
        let (radius, angle) = (0.1 * f64::from(n), 0.7 * f64::from(n) + turn);
        [radius * angle.cos().abs(), radius * angle.sin()]
    };
    // One agent has events in the east, the other in the west.
    let east = fit(&prior, &events((0..40).map(|n| at(n, 0.0)))?, &FitOptions::default())?;
    let west = fit(&prior, &events((0..40).map(|n| at(n, 2.0).map(|x| -x)))?, &FitOptions::default())?;

    let received = message(&prior, &west)?;
    let (alone, together) = (east.posterior()?, east.posterior_with(&[&received])?);
    let places = Inputs::from_rows(&[[-0.5, 0.2], [-2.9, 0.3], [1.0, 0.0]])?;
    let (before, after) = (alone.probability(&places)?, together.probability(&places)?);
    for (n, place) in places.rows().enumerate() {
        println!("at {place:?}: {:.2} alone, {:.2} with two points of the other", before[n], after[n]);
    }
    // The summary changes the probabilities near the other agent's events, and not elsewhere.
    assert!(after[0] > before[0] && after[1] < before[1] && (after[2] - before[2]).abs() < 0.1);
    Ok(())
}
