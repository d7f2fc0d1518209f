//! When a vehicle fits its events again, and what it fits.

use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::{Prior, Summary};

use crate::agent_error::AgentError;
use crate::beliefs::{Beliefs, OwnModel};
use crate::fitted::{Fitted, Last, fit_events};
use crate::heard::{Heard, said, summaries};
use crate::limits::Limits;
use crate::memory::Memory;
use crate::reports::Worth;

/// Where a fit begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Start {
    /// At the last one, which is amended where that is enough.
    Near,
    /// At the last one, every event anew: sooner done than a cold one, and the same to the tolerance of a fit.
    Warm,
    /// Anew: the same to the bit whatever was before.
    Cold,
}

impl Beliefs {
    /// Whether more events came or went since the last fit than should stand beside it, as of the last question.
    pub(crate) fn refit_due(&self, limits: &Limits) -> bool {
        let [told, waiting] = self.taken.told_beside;
        let fitted = self.fitted().map_or(0, |fitted| fitted.sources.len());
        self.taken.beside.len() + self.taken.forgotten + told + waiting > limits.beside_fit(fitted)
    }

    /// Fits what is believed, judges by that fit whom to believe, and fits once more where that is somebody else: how much an
    /// event says follows from all events of a fit, and lies among them would stay felt.
    pub(crate) fn refit(&mut self, memory: &Memory, heard: &Heard, start: Start) -> Result<(), AgentError> {
        if start == Start::Cold {
            self.left_out.clear();
            self.invalidate();
        }
        let before = self.left_out.clone();
        self.fit_believed(memory, &heard.without(&before), start)?;
        self.update(memory, heard)?;
        match self.left_out == before {
            true => Ok(()),
            false => {
                self.fit_believed(memory, &heard.without(&self.left_out), start)?;
                self.update(memory, heard)
            }
        }
    }

    /// Fits its own events under the team's model, and all that is believed: under its own model if it has one, else under the
    /// team's where events were told. Leaves a fit alone that this one would be the same as.
    fn fit_believed(&mut self, memory: &Memory, believed: &Heard, start: Start) -> Result<(), AgentError> {
        let start = if start == Start::Near && self.has_fitted_others(believed) { Start::Warm } else { start };
        let is_as_good = start != Start::Cold || self.began_cold;
        let has_own_events = self.alone.is_some() && self.taken.beside.is_empty() && self.taken.forgotten == 0;
        if has_own_events && is_as_good && self.has_fitted(believed) {
            return Ok(());
        }
        let model = &memory.frames.team.model;
        let place: Vec<&Summary> = model.place_summary().into_iter().collect();
        let fit = |prior: &Prior, told: &Heard, messages: &[&Summary], last: Option<Last<'_>>| {
            fit_events(memory, prior, told, messages, last.filter(|_| start != Start::Cold))
        };
        let last = |fitted, near, is_alike| Last { fitted, near, may_be_amended: is_alike && start == Start::Near };
        let alone = match self.alone.clone().filter(|_| has_own_events && is_as_good) {
            Some(alone) => alone,
            None => {
                let before = self.alone.as_deref().map(|alone| last(alone, &self.own, true));
                Arc::new(fit(&model.prior, &Heard::default(), &place, before)?)
            }
        };
        let (mut own_model, mut together) = (None, None);
        if let Some(own) = &self.own_model {
            let packets = said(memory, &believed.packets, Worth::All);
            let messages = [place, summaries(&packets)].concat();
            let before = last(&own.fitted, &self.fused, own.packets == believed.packets);
            let fitted = fit(own.fitted.fit.prior(), believed, &messages, Some(before))?;
            own_model = Some(Arc::new(own.with(fitted, believed)));
        } else if !believed.told.is_empty() {
            let before = self.together.as_deref().or(self.alone.as_deref());
            let before = before.map(|before| last(before, &self.fused, true));
            together = Some(Arc::new(fit(&model.prior, believed, &place, before)?));
        }
        self.began_cold = start == Start::Cold || self.alone.is_none();
        (self.alone, self.own_model, self.together) = (Some(alone), own_model, together);
        self.taken.begin_anew();
        (self.judged, self.nothing_new_in) = (None, None);
        Ok(())
    }

    /// Whether the last fit has events of members who are not believed: what remains of it has to be known without them.
    fn has_fitted_others(&self, believed: &Heard) -> bool {
        let members: BTreeSet<u8> = believed.told.keys().map(|key| key.0).collect();
        self.fitted().is_some_and(|fitted| fitted.told.keys().any(|key| !members.contains(&key.0)))
    }

    /// Whether the last fit has the told events that are believed, where they are taken to have been, and no others; and, under
    /// its own model, was made beside the packets that are.
    fn has_fitted(&self, believed: &Heard) -> bool {
        self.fitted().map_or(believed.told.is_empty(), |fitted| fitted.told == believed.told)
            && self.own_model.as_ref().is_none_or(|own| own.packets == believed.packets)
    }
}

impl OwnModel {
    /// The same model with another fit, of what is believed.
    fn with(&self, fitted: Fitted, believed: &Heard) -> Self {
        Self {
            fitted,
            packets: believed.packets.clone(),
            #[cfg(feature = "learn")]
            learned: self.learned.clone(),
        }
    }
}
