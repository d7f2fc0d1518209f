//! The site prior: knowledge from earlier missions.

use dgpc::{Posterior, Summary};

use crate::types::event::Link;

/// Knowledge from earlier missions at a site.
///
/// It is a summary of the latent function at some links, for typical vehicles at a typical time. Offsets of single
/// vehicles and of one day are integrated out. A mission that begins with a site prior treats it as part of the prior.
#[derive(Debug, Clone)]
pub struct SitePrior {
    links: Vec<Link>,
    summary: Summary,
    posterior: Posterior,
}

impl SitePrior {
    /// Returns the site prior at M links, given the summary of their M inputs.
    pub(crate) fn new(links: Vec<Link>, summary: Summary) -> dgpc::Result<Self> {
        let posterior = Posterior::of_summaries(summary.prior(), &[&summary])?;
        Ok(Self { links, summary, posterior })
    }

    /// Returns the M links at which the site prior is defined.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Returns the summary at the links.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Returns the posterior of the prior and the summary.
    pub(crate) fn posterior(&self) -> &Posterior {
        &self.posterior
    }

    /// Returns the rows of the lower triangle of the whitened precision.
    pub(crate) fn precision_rows(&self) -> impl Iterator<Item = Vec<f64>> {
        let precision = self.summary.whitened_precision();
        (0..self.links.len()).map(move |i| (0..=i).map(|j| precision[(i, j)]).collect())
    }
}

impl PartialEq for SitePrior {
    fn eq(&self, other: &Self) -> bool {
        self.links == other.links
            && self.precision_rows().eq(other.precision_rows())
            && self.summary.whitened_shift() == other.summary.whitened_shift()
    }
}
