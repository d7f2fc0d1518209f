//! A stream of messages, each with only the evidence that the messages before it lack. Messages may be lost, repeated
//! or reordered. Receivers of the same set of messages have the same posterior.
//!
//!     cargo run -p dgpc --example stream_of_residuals

#![allow(clippy::print_stdout)]

use dgpc::{
    Candidates, FitOptions, Inputs, Kernel, Observations, Posterior, Prior, PriorMean, Shape, Summary, Term, fit,
};

/// Returns the mean absolute difference of two posteriors' probabilities.
fn difference(a: &Posterior, b: &Posterior, inputs: &Inputs) -> dgpc::Result<f64> {
    let (a, b) = (a.probability(inputs)?, b.probability(inputs)?);
    Ok(a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum::<f64>() / a.len() as f64)
}

/// Sends, loses and receives.
///
/// # Errors
/// None with these numbers.
pub fn main() -> dgpc::Result<()> {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 4.0, 1.0, 1)?])?;
    let prior = Prior::new(kernel, PriorMean::Zero)?;
    let inputs = Inputs::new((0..80).map(|n| f64::from(n) * 0.1).collect(), 1)?;
    let outcomes = inputs.rows().map(|x| (1.7 * x[0]).sin() > 0.3).collect();
    let own = fit(&prior, &Observations::new(inputs.clone(), outcomes)?, &FitOptions::default())?.posterior()?;

    // The public posterior: the evidence of all messages so far. The sender maintains it, too.
    let mut public = Posterior::prior_alone(&prior, 1);
    let mut messages: Vec<Summary> = Vec::new();
    println!("messages  difference from the sender");
    println!("{:8}  {:.3}", 0, difference(&own, &public, &inputs)?);
    for count in 1..=6 {
        // Two points at which the own posterior is certain and the public one is not.
        let chosen = Candidates::for_residual(&public, &own, &inputs)?.greedy(2);
        let message = own.residual(&public, &inputs.select(&chosen.indices))?;
        public.absorb_summaries(&[&message])?;
        messages.push(message);
        println!("{count:8}  {:.3}", difference(&own, &public, &inputs)?);
    }
    assert!(difference(&own, &public, &inputs)? < 0.1);

    // Two receivers hear all messages but the third, in different orders.
    let listen = |order: [usize; 5]| {
        let heard: Vec<&Summary> = order.iter().map(|&n| &messages[n]).collect();
        Posterior::of_summaries(&prior, &heard)
    };
    let (one, other) = (listen([0, 1, 3, 4, 5])?, listen([5, 3, 0, 4, 1])?);
    assert!(difference(&one, &other, &inputs)? < 1e-9);
    println!("without the third: {:.3}, in any order", difference(&own, &one, &inputs)?);
    Ok(())
}
