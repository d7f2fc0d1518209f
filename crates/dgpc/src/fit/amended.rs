//! Events that come to a mean field whose other sites stay as they are.

use super::mean_field::MeanField;
use super::single::absorb_with_tilts;
use crate::error::Result;
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::sites::Sites;

/// Appends what is found of new events, each at the site that it has beside what is `known` and all before it, and returns these
/// sites. What inducing points leave unexplained is left to the caller. O(n²) an event.
pub(super) fn append(found: &mut MeanField, mut known: Posterior, new: &Observations) -> Result<Sites> {
    let (sites, tilts) = absorb_with_tilts(&mut known, new)?;
    let latent = known.latent(new.inputs())?;
    found.tilts.extend(tilts);
    found.mean.extend(latent.mean);
    found.variance.extend(latent.variance);
    found.weights.extend(new.weights());
    found.sites.append(&sites)?;
    Ok(sites)
}
