//! Fits binary outcomes, and predicts elsewhere with the remaining uncertainty.
//!
//!     cargo run -p dgpc --example fit_and_predict

#![allow(clippy::print_stdout)]

use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};

/// Success where the wave is high. Every seventh outcome is inverted.
fn observations() -> dgpc::Result<Observations> {
    let inputs = Inputs::new((0..60).map(|n| f64::from(n) * 0.1).collect(), 1)?;
    let outcomes = inputs.rows().enumerate().map(|(n, x)| ((2.0 * x[0]).sin() > 0.0) != (n % 7 == 0)).collect();
    Observations::new(inputs, outcomes)
}

/// Fits and predicts.
///
/// # Errors
/// None with these numbers.
pub fn main() -> dgpc::Result<()> {
    // The prior: variance 4, length-scale 1, and even odds everywhere.
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 1.0, 1)?])?;
    let prior = Prior::new(kernel, PriorMean::Zero)?;
    let observations = observations()?;

    let dense = fit(&prior, &observations, &FitOptions::default())?;
    // A sparse fit on a dozen inducing points, as one would use for thousands of events.
    let points = observations.inputs().select(&(0..60).step_by(5).collect::<Vec<_>>());
    let sparse = fit(&prior, &observations, &FitOptions::default().inducing_points(&points))?;
    println!("evidence bound: {:.2} nats dense, {:.2} sparse", dense.evidence(), sparse.evidence());

    let places = Inputs::new((0..8).map(f64::from).collect(), 1)?;
    let (latent, posterior) = (dense.posterior()?.latent(&places)?, sparse.posterior()?);
    println!("   x  probability  (sparse)  sd of f");
    for (n, sparse) in posterior.probability(&places)?.iter().enumerate() {
        let (p, sd) = (latent.probability()[n], latent.variance[n].sqrt());
        println!("{:4.1}  {p:11.3}  {sparse:8.3}  {sd:7.2}", places.row(n)[0]);
        assert!((p - sparse).abs() < 0.1);
    }
    // The uncertainty is small at the events and large beyond them.
    assert!(latent.variance[2] < 1.0 && latent.variance[7] > 2.0);
    Ok(())
}
