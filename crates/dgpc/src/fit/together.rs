//! Sites and messages put together.

use std::borrow::Cow;

use crate::error::Result;
use crate::posterior::Posterior;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// The posterior of sites, or of what they say at inducing points, and of summaries of whatever prior.
pub(super) fn put_together(
    prior: &Prior,
    sites: &Sites,
    condensed: Option<&Summary>,
    summaries: &[&Summary],
) -> Result<Posterior> {
    let read: Vec<Cow<'_, Summary>> =
        summaries.iter().map(|summary| summary.read_under(prior)).collect::<Result<_>>()?;
    let mut summaries: Vec<&Summary> = read.iter().map(AsRef::as_ref).collect();
    let Some(condensed) = condensed else { return Posterior::fuse(prior, sites, &summaries) };
    summaries.push(condensed);
    let mut posterior = Posterior::prior_alone(prior, sites.inputs().dimension());
    posterior.absorb_summaries(&summaries)?;
    Ok(posterior)
}
