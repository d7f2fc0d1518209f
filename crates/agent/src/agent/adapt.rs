//! A vehicle that learns a model of its own under way.

use std::sync::Arc;

use dgpc::Summary;

use crate::agent::state::Agent;
use crate::error::AgentError;
use crate::inference::accepted::{packets_with, summaries};
use crate::inference::event_fit::{RefitStart, all_events, fit_events};
use crate::inference::posteriors::OwnModel;
use crate::model::learning::{LearnedModel, Learning};
use crate::model::link_model::Model;

impl Agent {
    /// Learns the vehicle's own model from its own events and from the data of trusted members. Predictions are under
    /// this model from then on. Frames stay under the team's model. The first call tries all additions. Later calls
    /// continue from the last optimum of the chosen structure, at the cost of one search, and never lower the evidence.
    ///
    /// # Errors
    /// As [`Learning::best`].
    pub fn adapt(&mut self, learning: &Learning) -> Result<&LearnedModel, AgentError> {
        self.refit()?;
        let trusted = self.trusted();
        let packets = packets_with(&self.memory, &*trusted.packets);
        let place = self.team().model.site_summary().into_iter();
        let messages: Vec<&Summary> = place.chain(summaries(&packets)).collect();
        let &Model { chart, inputs, .. } = &self.team().model;
        let (_, events) = all_events(&self.memory, &trusted);
        let events = || events.iter().copied();
        // The fading stays that of the team's model, so that events keep their weights.
        let learning = &Learning { fading: Some(self.team().model.fading), ..learning.clone() };
        let learned = match &self.posteriors.own_model {
            Some(own) => {
                let earlier = &own.learned;
                learning.fit(&earlier.structure, chart, inputs, events(), &messages, Some(earlier))?
            }
            None => learning.best(chart, inputs, events(), &messages)?,
        };
        let fitted = fit_events(&self.memory, &learned.model.prior, &trusted, &messages, None)?;
        if let Some(alternative) = &mut self.posteriors.alternative {
            alternative.refit(&self.memory, &trusted, RefitStart::Incremental)?;
        }
        let own = self
            .posteriors
            .own_model
            .insert(Arc::new(OwnModel { fit: fitted, packets: trusted.packets.clone(), learned }))
            .clone();
        self.posteriors.invalidate();
        self.data_changed();
        self.update()?;
        Ok(&self.posteriors.own_model.insert(own).learned)
    }
}
