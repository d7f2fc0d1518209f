//! Refits: when a vehicle fits its events again, and from where the fit starts.

use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::{Prior, Summary};

use crate::error::AgentError;
use crate::inference::accepted::{AcceptedData, packets_with, summaries};
use crate::inference::event_fit::{EventFit, PreviousFit, RefitStart, fit_events};
use crate::inference::posteriors::{OwnModel, Posteriors};
use crate::store::memory::Memory;
use crate::types::limits::Limits;

impl Posteriors {
    /// Returns whether more events were added or removed since the last fit than the refit threshold, as of the last
    /// update.
    pub(crate) fn refit_due(&self, limits: &Limits) -> bool {
        let [absorbed, waiting] = self.included.pending_remote;
        let fitted = self.last_fit().map_or(0, |fit| fit.sources.len());
        self.included.pending_own.len() + self.included.forgotten + absorbed + waiting > limits.refit_threshold(fitted)
    }

    /// Fits own events and the data of trusted members, then detects faulty members under that fit. If the excluded
    /// members changed, fits once more. The site of an event depends on all events of its fit, so wrong events would
    /// otherwise still have an effect.
    pub(crate) fn refit(&mut self, memory: &Memory, data: &AcceptedData, start: RefitStart) -> Result<(), AgentError> {
        if start == RefitStart::Cold {
            self.excluded.clear();
            self.invalidate();
        }
        let before = self.excluded.clone();
        self.fit_trusted(memory, &data.without(&before), start)?;
        self.update(memory, data)?;
        match self.excluded == before {
            true => Ok(()),
            false => {
                self.fit_trusted(memory, &data.without(&self.excluded), start)?;
                self.update(memory, data)
            }
        }
    }

    /// Fits own events under the team's model, and then own events with the data of trusted members. The second fit
    /// uses the vehicle's own model if it has one. Otherwise it uses the team's model, and is omitted without remote
    /// events. A third fit is under the alternative model, if there is one. Existing fits of equal data are kept.
    fn fit_trusted(&mut self, memory: &Memory, trusted: &AcceptedData, start: RefitStart) -> Result<(), AgentError> {
        let has_untrusted = start == RefitStart::Incremental && self.has_fitted_untrusted(trusted);
        let start = if has_untrusted { RefitStart::Warm } else { start };
        let is_reusable = start != RefitStart::Cold || self.began_cold;
        let has_own_events =
            self.own_fit.is_some() && self.included.pending_own.is_empty() && self.included.forgotten == 0;
        let has_alternative = self.alternative.as_ref().is_none_or(|alternative| alternative.last_fit().is_some());
        if has_own_events && is_reusable && has_alternative && self.has_fitted(trusted) {
            return Ok(());
        }
        let model = &memory.codec.team.model;
        let site: Vec<&Summary> = model.site_summary().into_iter().collect();
        let fit = |prior: &Prior, data: &AcceptedData, messages: &[&Summary], previous: Option<PreviousFit<'_>>| {
            fit_events(memory, prior, data, messages, previous.filter(|_| start != RefitStart::Cold))
        };
        let previous = |fit, posterior, has_equal_messages: bool| {
            let may_be_amended = has_equal_messages && start == RefitStart::Incremental;
            PreviousFit { fit, posterior, may_be_amended }
        };
        let own_fit = match self.own_fit.clone().filter(|_| has_own_events && is_reusable) {
            Some(own_fit) => own_fit,
            None => {
                let before = self.own_fit.as_deref().map(|own_fit| previous(own_fit, &self.pair.own, true));
                Arc::new(fit(&model.prior, &AcceptedData::default(), &site, before)?)
            }
        };
        let (mut own_model, mut joint_fit) = (None, None);
        if let Some(own) = &self.own_model {
            let packets = packets_with(memory, &*trusted.packets);
            let messages = [site, summaries(&packets)].concat();
            let before = previous(&own.fit, self.pair.fused(), own.packets == trusted.packets);
            let refitted = fit(own.fit.fit.prior(), trusted, &messages, Some(before))?;
            own_model = Some(Arc::new(own.with_fit(refitted, trusted)));
        } else if !trusted.events.is_empty() {
            let before = self.joint_fit.as_deref().or(self.own_fit.as_deref());
            let before = before.map(|fit| previous(fit, self.pair.fused(), true));
            joint_fit = Some(Arc::new(fit(&model.prior, trusted, &site, before)?));
        }
        if let Some(alternative) = &mut self.alternative {
            alternative.refit(memory, trusted, start)?;
        }
        self.began_cold = start == RefitStart::Cold || self.own_fit.is_none();
        (self.own_fit, self.own_model, self.joint_fit) = (Some(own_fit), own_model, joint_fit);
        self.included.reset();
        (self.examined, self.nothing_to_send) = (None, None);
        Ok(())
    }

    /// Returns whether the last fit has events of members without trusted events. The fit is then not amended, because
    /// the sites of all its events depend on them.
    fn has_fitted_untrusted(&self, trusted: &AcceptedData) -> bool {
        let members: BTreeSet<u8> = trusted.events.keys().map(|key| key.0).collect();
        self.last_fit().is_some_and(|fit| fit.remote.keys().any(|key| !members.contains(&key.0)))
    }

    /// Returns whether the remote events of the last fit equal the trusted ones, with equal positions. Under the
    /// vehicle's own model the packets of the fit must equal the trusted ones too.
    fn has_fitted(&self, trusted: &AcceptedData) -> bool {
        self.last_fit().map_or(trusted.events.is_empty(), |fit| fit.remote == trusted.events)
            && self.own_model.as_ref().is_none_or(|own| own.packets == trusted.packets)
    }
}

impl OwnModel {
    fn with_fit(&self, fit: EventFit, trusted: &AcceptedData) -> Self {
        Self {
            fit,
            packets: trusted.packets.clone(),
            #[cfg(feature = "learn")]
            learned: self.learned.clone(),
        }
    }
}
