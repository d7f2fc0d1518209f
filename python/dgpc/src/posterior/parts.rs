//! The parts of a posterior, from which a pickle builds it again.

use std::borrow::Cow;

use dgpc::{Prior, Sites, Summary};
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};

use super::summary::copies;
use crate::border::check_memory;

/// The prior, the sites and the summaries of a posterior.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parts {
    prior: Prior,
    sites: Sites,
    summaries: Vec<Summary>,
}

impl Parts {
    /// Collects the parts of a posterior. The summaries must have its prior.
    pub fn new(prior: &Prior, sites: &Sites, summaries: &[&Summary]) -> Self {
        Self { prior: prior.clone(), sites: sites.clone(), summaries: copies(summaries) }
    }

    /// Collects the parts of the posterior of a fit: either sites, or the summary `condensed` of all sites. Messages of
    /// another prior are read under the prior of the fit.
    pub fn of_fit(
        prior: &Prior,
        sites: Sites,
        condensed: Option<Summary>,
        messages: &[&Summary],
    ) -> dgpc::Result<Self> {
        let converted = messages.iter().map(|message| message.read_under(prior).map(Cow::into_owned));
        let mut summaries: Vec<Summary> = converted.collect::<dgpc::Result<_>>()?;
        summaries.extend(condensed);
        Ok(Self { prior: prior.clone(), sites, summaries })
    }

    /// Checks that memory for the posterior can be reserved.
    pub fn check_memory(&self) -> PyResult<()> {
        let rows = self.sites.len() + self.summaries.iter().map(Summary::len).sum::<usize>();
        check_memory(&[3, rows, rows])
    }

    pub fn fused(&self) -> dgpc::Result<dgpc::Posterior> {
        dgpc::Posterior::fuse(&self.prior, &self.sites, &self.summaries.iter().collect::<Vec<_>>())
    }

    pub fn absorb_events(&mut self, sites: &Sites) -> dgpc::Result<()> {
        self.sites.append(sites)
    }

    pub fn absorb_summaries(&mut self, summaries: &[&Summary]) {
        self.summaries.extend(copies(summaries));
    }
}
