//! The alternative model: a second posterior of the same events, and the weight of both models.

use std::sync::Arc;

use dgpc::{Posterior, Summary};

use crate::error::AgentError;
use crate::inference::accepted::AcceptedData;
use crate::inference::event_fit::{EventFit, EventSource, PreviousFit, RefitStart, fit_events};
use crate::model::link_model::Model;
use crate::store::events::RecordedEvent;
use crate::store::memory::Memory;

/// A second model in addition to the team's, with its posterior of own events and of trusted events of other members.
/// Summaries are under the team's model, so that this posterior has none.
#[derive(Debug, Clone)]
pub(crate) struct AlternativeModel {
    model: Arc<Model>,
    /// The last fit; it has the same events as the last fit under the team's model.
    fit: Option<Arc<EventFit>>,
    pub(crate) posterior: Posterior,
    /// Log Bayes factor in nats: the log score of the team's model minus that of the alternative, over own events.
    log_bayes_factor: f64,
}

impl AlternativeModel {
    pub(crate) fn new(model: Model) -> Self {
        Self { posterior: model.prior_posterior(), model: Arc::new(model), fit: None, log_bayes_factor: 0.0 }
    }

    /// Returns the weight of the alternative: its posterior probability, given even prior odds of both models.
    pub(crate) fn weight(&self) -> f64 {
        dgpc::success_probability(-self.log_bayes_factor, 0.0)
    }

    /// Adds the difference of log scores of some events.
    pub(crate) fn add_score(&mut self, difference: f64) {
        self.log_bayes_factor += difference;
    }

    /// Returns the summary of the site prior, if there is one.
    pub(crate) fn site(&self) -> Vec<&Summary> {
        self.model.site_summary().into_iter().collect()
    }

    pub(crate) fn last_fit(&self) -> Option<&EventFit> {
        self.fit.as_deref()
    }

    /// Fits own and trusted events.
    pub(crate) fn refit(
        &mut self,
        memory: &Memory,
        trusted: &AcceptedData,
        start: RefitStart,
    ) -> Result<(), AgentError> {
        let may_be_amended = start == RefitStart::Incremental;
        let previous = |fit| PreviousFit { fit, posterior: &self.posterior, may_be_amended };
        let previous = self.last_fit().filter(|_| start != RefitStart::Cold).map(previous);
        self.fit = Some(Arc::new(fit_events(memory, &self.model.prior, trusted, &self.site(), previous)?));
        Ok(())
    }

    /// Computes the posterior of the last fit, of trusted events only, and of own events since that fit.
    pub(crate) fn rebuild(
        &mut self,
        memory: &Memory,
        trusted: &AcceptedData,
        since: &[RecordedEvent],
    ) -> Result<(), AgentError> {
        let mut posterior = match &self.fit {
            None => self.model.prior_posterior(),
            Some(fit) => {
                let is_in = |source: &EventSource| match source {
                    EventSource::Own(_) => true,
                    EventSource::Remote(key) => fit.is_accepted(key, trusted),
                };
                fit.posterior_of(is_in, &self.site())?
            }
        };
        for recorded in since {
            dgpc::absorb_observations(&mut posterior, &memory.observation(&recorded.event)?)?;
        }
        self.posterior = posterior;
        Ok(())
    }
}
