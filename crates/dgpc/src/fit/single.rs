//! Sites of single events given a posterior that stays fixed.

use crate::error::Result;
use crate::latent::Latent;
use crate::observations::Observations;
use crate::polya_gamma;
use crate::posterior::Posterior;
use crate::sites::Sites;

/// Returns the sites of more events given the posterior `known`, which stays fixed. Each event has its own fixed point
/// of c² = E f², given `known` and itself alone. Other effects of the events are left to the next full fit. O(n²) an
/// event.
///
/// # Errors
/// As [`Posterior::latent`]; [`crate::Error::OutOfRange`] if the latent function is so far from zero that ω vanishes.
pub fn sites_given(known: &Posterior, observations: &Observations) -> Result<Sites> {
    let (omega, _) = omega_and_tilts(&known.latent(observations.inputs())?, observations);
    Sites::new(observations, omega)
}

/// Absorbs more events into the posterior `known` and returns their sites. O(n²) an event.
///
/// The events are absorbed in order, eight at a time. The site of each event is its site given the posterior before
/// these eight events. The sites therefore depend slightly on the order.
///
/// # Errors
/// As [`sites_given`] and [`Posterior::absorb_events`]. Earlier groups of events stay absorbed after an error.
pub fn absorb_observations(known: &mut Posterior, observations: &Observations) -> Result<Sites> {
    Ok(absorb_with_tilts(known, observations)?.0)
}

/// Absorbs events as [`absorb_observations`] does, and also returns the tilts from which ω was computed.
pub(super) fn absorb_with_tilts(known: &mut Posterior, observations: &Observations) -> Result<(Sites, Vec<f64>)> {
    let (mut sites, mut tilts) = (Sites::empty(observations.inputs().dimension()), Vec::new());
    let places: Vec<usize> = (0..observations.len()).collect();
    for some in places.chunks(AT_ONCE) {
        let some = observations.select(some);
        let absorbed = known.absorb_observations_by(&some, |latent| {
            let (omega, of_some) = omega_and_tilts(latent, &some);
            tilts.extend(of_some);
            omega
        })?;
        sites.append(&absorbed)?;
    }
    Ok((sites, tilts))
}

/// Returns ω and the tilt of each event, given these moments and itself alone.
fn omega_and_tilts(latent: &Latent, observations: &Observations) -> (Vec<f64>, Vec<f64>) {
    let one = |(((&mean, &variance), kappa), &weight): (((&f64, &f64), f64), &f64)| {
        // The start is ω's largest value. Every step contracts, so a fixed number of steps is enough.
        (0..ITERATIONS).fold((0.25, 0.0), |(omega, _), _| {
            let narrowed = variance / (1.0 + variance * omega);
            let moved = mean + narrowed * (kappa - omega * mean);
            let tilt = (moved * moved + narrowed).sqrt();
            (polya_gamma::mean(weight, tilt), tilt)
        })
    };
    let moments = latent.mean.iter().zip(&latent.variance);
    moments.zip(observations.kappa()).zip(observations.weights()).map(one).unzip()
}

/// Number of events that are absorbed at once. With few events, each site is close to its site given the others.
const AT_ONCE: usize = 8;

/// Number of steps to the fixed point of a single site.
const ITERATIONS: usize = 50;
