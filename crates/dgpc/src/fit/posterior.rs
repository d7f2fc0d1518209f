//! Posterior of sites and messages.

use std::borrow::Cow;

use crate::error::Result;
use crate::posterior::Posterior;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// Returns the posterior of the sites and of `summaries` of any prior. If `condensed` is given, it represents the
/// sites.
pub(super) fn posterior_of(
    prior: &Prior,
    sites: &Sites,
    condensed: Option<&Summary>,
    summaries: &[&Summary],
) -> Result<Posterior> {
    let converted: Vec<Cow<'_, Summary>> =
        summaries.iter().map(|summary| summary.read_under(prior)).collect::<Result<_>>()?;
    let mut summaries: Vec<&Summary> = converted.iter().map(AsRef::as_ref).collect();
    let Some(condensed) = condensed else { return Posterior::fuse(prior, sites, &summaries) };
    summaries.push(condensed);
    let mut posterior = Posterior::prior_alone(prior, sites.inputs().dimension());
    posterior.absorb_summaries(&summaries)?;
    Ok(posterior)
}
