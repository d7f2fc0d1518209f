//! Options of a mission: the models, their learning, sharing and the channel.

use pingmap_agent::{
    AgentError, Event, InputSpec, Key, LearnedModel, Learning, Limits, Model, OptionalTerm, Sharing, Structure, Team,
};

use crate::alternative::Alternative;
use crate::channel_impairments::ChannelImpairments;
use crate::event_log::EventLog;
use crate::learning::learn;

/// Data from which the models are learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelSource {
    /// One model, learned offline from every vehicle's training events and shared by the team.
    Pooled,
    /// Each vehicle learns its own model from its own events and the received data. Packets use a model that is fixed
    /// beforehand.
    Own,
}

/// The part of the team configuration that is given.
#[derive(Debug, Clone)]
pub enum Preshared {
    /// Nothing is given: the packet model is learned from the pooled training events. If every vehicle learns by
    /// itself, the packet model is the prior of the first structure. Without training events, that prior also has
    /// optional terms, if they are among the additions. These are offsets of receivers, aspects, layers, a change with
    /// time, and a difference between both directions.
    Nothing,
    /// The packet model is given.
    Model(Model),
    /// The whole configuration is given.
    Team(Box<Team>),
}

/// Optional terms of a model before any event.
const VARIABLE_TERMS: [OptionalTerm; 6] = [
    OptionalTerm::Receivers,
    OptionalTerm::Time,
    OptionalTerm::OneWay,
    OptionalTerm::TransmitterAspect,
    OptionalTerm::ReceiverAspect,
    OptionalTerm::Vertical,
];

/// Options of learning and sharing.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The given part of the team configuration. The rest follows from the log and the fields below.
    pub preshared: Preshared,
    /// Options of learning models.
    pub learning: Learning,
    /// Data from which the models are learned.
    pub model_source: ModelSource,
    /// Limits on work and memory of every vehicle.
    pub limits: Limits,
    /// Bytes of a frame.
    pub frame_bytes: usize,
    /// Key for the authentication of packets, if any.
    pub key: Option<Key>,
    /// Features of sharing.
    pub sharing: Sharing,
    /// Impairments of the channel.
    pub impairments: ChannelImpairments,
    /// Alternative uses of the same bytes that are scored, too.
    pub alternatives: Vec<Alternative>,
    /// Whether the calibration is computed.
    pub calibration: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Plan {
    /// Returns a plan with these learning options, frames of 32 bytes and no impairments.
    pub fn new(learning: Learning, seed: u64) -> Self {
        Self {
            preshared: Preshared::Nothing,
            limits: learning.limits,
            learning,
            model_source: ModelSource::Pooled,
            frame_bytes: 32,
            key: None,
            sharing: Sharing::default(),
            impairments: ChannelImpairments::default(),
            alternatives: Vec::new(),
            calibration: false,
            seed,
        }
    }

    /// Returns the team of a log, and the fit of its model if the model was learned. Without events, or if every
    /// vehicle learns by itself, the model is the prior of the first structure.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure, or if the log has more vehicles than packets can number.
    pub fn team(
        &self,
        log: &EventLog,
        training: Option<&[&Event]>,
    ) -> Result<(Team, Option<LearnedModel>), AgentError> {
        let (model, fit) = match &self.preshared {
            Preshared::Team(team) => return Ok(((**team).clone(), None)),
            Preshared::Model(model) if log.has_depths && !model.inputs.has_depths() => (model.with_depths()?, None),
            Preshared::Model(model) => (model.clone(), None),
            Preshared::Nothing => self.model(log, training)?,
        };
        let positions = log.events.iter().flat_map(|event| event.link.ends());
        let team = Team::new(log.vehicles(), model, positions)?.with_frames(self.frame_bytes);
        let team = Team {
            grid: team.grid.spanning(log.events.iter().map(|event| event.time_s)),
            key: self.key.clone(),
            limits: self.limits,
            ..team
        };
        Ok((team, fit))
    }

    fn model(&self, log: &EventLog, training: Option<&[&Event]>) -> dgpc::Result<(Model, Option<LearnedModel>)> {
        let (chart, inputs) = (log.chart(), log.inputs());
        let structure = match training {
            // Without learning there is no evidence that receivers, directions, headings, layers and times are alike.
            None => self.with_variable_terms(log, inputs),
            Some(_) if self.model_source == ModelSource::Own => self.learning.structure,
            Some(training) => {
                let fit = learn(&self.learning, chart, inputs, training)?.best;
                return Ok((fit.model.clone(), Some(fit)));
            }
        };
        let prior = self.learning.template(&structure, inputs, chart.scale_m)?;
        Ok((Model::new(chart, inputs, prior), None))
    }

    /// Returns the model of a team without data, with the chart and columns of `given`, and with the scale of the log.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub(crate) fn model_before_data(&self, log: &EventLog, given: &Model) -> Result<Model, AgentError> {
        let prior =
            self.learning.template(&self.with_variable_terms(log, given.inputs), given.inputs, log.chart().scale_m)?;
        Ok(Model::new(given.chart, given.inputs, prior))
    }

    fn with_variable_terms(&self, log: &EventLog, inputs: InputSpec) -> Structure {
        let structure = self.learning.structure;
        let possible = self.learning.additions_to(&log.events.iter().collect::<Vec<_>>(), inputs);
        let expected = VARIABLE_TERMS.into_iter().filter(|term| possible.contains(term) && structure.can_have(*term));
        expected.fold(structure, |structure, term| structure.with(term))
    }
}
