//! Events that come to a mean field whose other sites stay as they are.

use super::mean_field::MeanField;
use super::single::sites_and_tilts_given;
use crate::error::Result;
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::sites::Sites;

/// So many events get their sites at once: soon done, and each is near what it is given the others.
const AT_ONCE: usize = 8;

/// Appends what is found of new events, each at the site that it has beside what is `known` and all before it, and returns these
/// sites. What inducing points leave unexplained is left to the caller. O(n²) an event.
pub(super) fn append(found: &mut MeanField, mut known: Posterior, new: &Observations) -> Result<Sites> {
    let mut sites = Sites::empty(new.inputs().dimension());
    let places: Vec<usize> = (0..new.len()).collect();
    for some in places.chunks(AT_ONCE) {
        let (some, tilts) = sites_and_tilts_given(&known, &new.select(some))?;
        known.absorb_events(&some)?;
        sites.append(&some)?;
        found.tilts.extend(tilts);
    }
    let latent = known.latent(new.inputs())?;
    found.mean.extend(latent.mean);
    found.variance.extend(latent.variance);
    found.weights.extend(new.weights());
    found.sites.append(&sites)?;
    Ok(sites)
}
