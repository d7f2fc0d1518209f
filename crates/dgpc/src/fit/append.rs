//! Events that are appended to a mean field whose other sites stay fixed.

use super::mean_field::MeanField;
use super::single::absorb_with_tilts;
use crate::error::Result;
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::sites::Sites;

/// Appends the results for new events, and returns their sites. Each site is that of the event given `known` and all
/// events before it. The caller appends the variances that inducing points leave unexplained. O(n²) an event.
pub(super) fn append(mean_field: &mut MeanField, mut known: Posterior, new: &Observations) -> Result<Sites> {
    let (sites, tilts) = absorb_with_tilts(&mut known, new)?;
    let latent = known.latent(new.inputs())?;
    mean_field.tilts.extend(tilts);
    mean_field.mean.extend(latent.mean);
    mean_field.variance.extend(latent.variance);
    mean_field.weights.extend(new.weights());
    mean_field.sites.append(&sites)?;
    Ok(sites)
}
