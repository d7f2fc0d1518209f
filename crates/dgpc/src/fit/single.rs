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

/// Takes more events into what is known, eight at a time in their order, each of these with the site that it has beside what was
/// known before these eight; the sites, which so depend a little on the order. O(n²) an event.
///
/// # Errors
/// As [`sites_given`] and [`Posterior::absorb_events`]; then those before are in.
pub fn absorb_observations(known: &mut Posterior, observations: &Observations) -> Result<Sites> {
    Ok(absorb_with_tilts(known, observations)?.0)
}

/// The same, and the tilts that their ω are of.
pub(super) fn absorb_with_tilts(known: &mut Posterior, observations: &Observations) -> Result<(Sites, Vec<f64>)> {
    let (mut sites, mut tilts) = (Sites::empty(observations.inputs().dimension()), Vec::new());
    let places: Vec<usize> = (0..observations.len()).collect();
    for some in places.chunks(AT_ONCE) {
        let (some, of_some) = sites_and_tilts_given(known, &observations.select(some))?;
        known.absorb_events(&some)?;
        sites.append(&some)?;
        tilts.extend(of_some);
    }
    Ok((sites, tilts))
}

fn sites_and_tilts_given(known: &Posterior, observations: &Observations) -> Result<(Sites, Vec<f64>)> {
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

/// So many events are taken in at once: soon done, and each site is near what it is beside the others, too.
const AT_ONCE: usize = 8;

/// Steps to the fixed point of a single site.
const ITERATIONS: usize = 50;
