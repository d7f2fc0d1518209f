//! Events one by one beside a posterior that stays as it is.

use crate::error::Result;
use crate::observations::Observations;
use crate::polya_gamma;
use crate::posterior::Posterior;
use crate::sites::Sites;

/// Sites of more events beside what is known, all of which stays as it is: each has its own fixed point of c² = E f²
/// given what is known and itself. What a fit of everything would change besides is left to the next one. O(n²) an
/// event.
///
/// # Errors
/// As [`Posterior::latent`]; [`crate::Error::OutOfRange`] where the latent function is so far from zero that ω
/// vanishes.
pub fn sites_given(known: &Posterior, observations: &Observations) -> Result<Sites> {
    Ok(sites_and_tilts_given(known, observations)?.0)
}

/// The same, and the tilts that their ω are of.
pub(super) fn sites_and_tilts_given(known: &Posterior, observations: &Observations) -> Result<(Sites, Vec<f64>)> {
    let latent = known.latent(observations.inputs())?;
    let one = |(((&mean, &variance), kappa), &weight): (((&f64, &f64), f64), &f64)| {
        // A start at ω's largest value; every step contracts, so a fixed number is enough.
        (0..ITERATIONS).fold((0.25, 0.0), |(omega, _), _| {
            let narrowed = variance / (1.0 + variance * omega);
            let moved = mean + narrowed * (kappa - omega * mean);
            let tilt = (moved * moved + narrowed).sqrt();
            (polya_gamma::mean(weight, tilt), tilt)
        })
    };
    let moments = latent.mean.iter().zip(&latent.variance);
    let (omega, tilts) = moments.zip(observations.kappa()).zip(observations.weights()).map(one).unzip();
    Ok((Sites::new(observations, omega)?, tilts))
}

/// Steps to the fixed point of a single site.
const ITERATIONS: usize = 50;
