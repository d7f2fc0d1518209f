//! What earlier missions learned of a place.

use dgpc::{Inputs, Matrix, Posterior, Prior, Summary};

use crate::event::Link;

/// What earlier missions learned of a place: how typical vehicles hear each other over some links there at a typical
/// time, and how surely. What was of one vehicle or one day is not in it. Missions that begin with it count it as known
/// beforehand, as they do the prior.
#[derive(Debug, Clone)]
pub struct Place {
    links: Vec<Link>,
    summary: Summary,
    /// The prior, and what is known of the place.
    posterior: Posterior,
}

impl Place {
    /// From the links, their inputs, and what is said of them under `prior`: whitened precision (M×M) and shift (M).
    pub(crate) fn new(
        prior: &Prior,
        links: Vec<Link>,
        inputs: &Inputs,
        precision: Matrix,
        shift: Vec<f64>,
    ) -> dgpc::Result<Self> {
        let summary = Summary::from_whitened(prior, inputs, precision, shift)?;
        let posterior = Posterior::of_summaries(prior, &[&summary])?;
        Ok(Self { links, summary, posterior })
    }

    /// The links that it speaks of, M.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// What is said of them.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    pub(crate) fn posterior(&self) -> &Posterior {
        &self.posterior
    }

    /// Rows of the lower triangle of the whitened precision.
    pub(crate) fn precision_rows(&self) -> impl Iterator<Item = Vec<f64>> {
        let precision = self.summary.whitened_precision();
        (0..self.links.len()).map(move |i| (0..=i).map(|j| precision[(i, j)]).collect())
    }
}

impl PartialEq for Place {
    fn eq(&self, other: &Self) -> bool {
        self.links == other.links
            && self.precision_rows().eq(other.precision_rows())
            && self.summary.whitened_shift() == other.summary.whitened_shift()
    }
}
