//! A vehicle that learns a model of its own under way.

use std::sync::Arc;

use dgpc::Summary;

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::beliefs::OwnModel;
use crate::fitted::{all_events, fit_events};
use crate::heard::{said, summaries};
use crate::learning::{LearnedModel, Learning};
use crate::model::Model;
use crate::reports::Worth;

impl Agent {
    /// Learns a model of its own from its own events and from what others said that it believes, and from then on predicts under that.
    /// What it sends stays under the team's model. The first time every structure is tried; later the chosen one goes
    /// on from its last optimum, at the cost of one search that never ends worse in E than it began.
    ///
    /// # Errors
    /// As [`Learning::best`].
    pub fn adapt(&mut self, learning: &Learning) -> Result<&LearnedModel, AgentError> {
        self.refit()?;
        let heard = self.believed();
        let packets = said(&self.memory, &heard.packets, Worth::All);
        let place = self.model().place_summary().into_iter();
        let messages: Vec<&Summary> = place.chain(summaries(&packets)).collect();
        let &Model { chart, inputs, .. } = self.model();
        let (_, events) = all_events(&self.memory, &heard);
        let events = || events.iter().copied();
        // How much its own events count is for all that it tells of them, under the team's model.
        let learning = &Learning { fading: Some(self.model().fading), ..learning.clone() };
        let learned = match &self.beliefs.own_model {
            Some(own) => {
                let earlier = &own.learned;
                learning.fit(&earlier.structure, chart, inputs, events(), &messages, Some(earlier))?
            }
            None => learning.best(chart, inputs, events(), &messages)?,
        };
        let fitted = fit_events(&self.memory, &learned.model.prior, &heard, &messages, None)?;
        let own = self
            .beliefs
            .own_model
            .insert(Arc::new(OwnModel { fitted, packets: heard.packets.clone(), learned }))
            .clone();
        self.beliefs.invalidate();
        self.update()?;
        Ok(&self.beliefs.own_model.insert(own).learned)
    }

    /// The model it learned by itself, if it did.
    pub fn own_model(&self) -> Option<&LearnedModel> {
        self.beliefs.own_model.as_ref().map(|own| &own.learned)
    }
}
