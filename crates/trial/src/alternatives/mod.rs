//! Predictions from alternative uses of the same bytes.

mod sender;

use std::borrow::Cow;

use dgpc::{Concatenation, Summary};
use pingmap_agent::{Agent, AgentError, Event, Sharing, Which};
use rayon::prelude::*;

use crate::alternative::Alternative;
use crate::mission::{Mission, probabilities, send_frames};
use crate::paper::Policy;
use crate::streams::{self, stream};
pub use sender::Package;
use sender::Sender;

impl Alternative {
    /// Returns every vehicle's predictions for the held-out events, after each vehicle sent `frames` frames of this
    /// alternative.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn predict(self, mission: &Mission, frames: usize) -> Result<Vec<Vec<f64>>, AgentError> {
        let send = |(place, agent): (usize, &Agent)| self.send(mission, place, agent, frames);
        let contents = mission.vehicles.par_iter().enumerate().map(send).collect::<Result<Vec<_>, _>>()?;
        let receive = |(place, agent): (usize, &Agent)| self.receive(mission, place, agent, &contents);
        mission.vehicles.par_iter().enumerate().map(receive).collect()
    }

    /// Returns the content of a vehicle's first `frames` frames.
    fn send(self, mission: &Mission, place: usize, agent: &Agent, frames: usize) -> Result<Content, AgentError> {
        if !agent.team().is_member(agent.id()) || agent.events().len() == 0 {
            return Ok(Content::Summaries(Vec::new()));
        }
        let sent = |sharing: Sharing| {
            let mut agent = agent.clone();
            agent.options.sharing = sharing;
            send_frames(&mut agent, frames)
        };
        let sender = Sender::new(mission, agent)?;
        if sender.queries.is_empty() {
            // No event lies within the grid.
            return Ok(Content::Summaries(Vec::new()));
        }
        let mut rng = stream(mission.seed(), streams::ALTERNATIVES + place as u64);
        let summaries =
            |packages: Vec<Package>| Content::Summaries(packages.into_iter().map(|package| package.summary).collect());
        Ok(match self {
            Alternative::SummariesOnly => Content::Frames(sent(Sharing::summaries())?),
            Alternative::ReportsOnly => Content::Frames(sent(Sharing::reports())?),
            Alternative::Unrounded => Content::Summaries(sender.unrounded(&sent(Sharing::summaries())?)?),
            Alternative::RawEvents => Content::Events(sender.raw_events(frames)?),
            Alternative::RandomPoints => Content::Summaries(sender.random_residuals(frames, &mut rng)?),
            Alternative::BadPoints => Content::Summaries(sender.bad_residuals(frames)?),
            Alternative::Variational => summaries(sender.packages(frames, Policy::Good, &mut rng)?),
            Alternative::Concatenation(policy) => summaries(sender.packages(frames, policy, &mut rng)?),
        })
    }

    /// Returns a vehicle's predictions for the held-out events, given the content of all vehicles' frames.
    fn receive(
        self,
        mission: &Mission,
        place: usize,
        agent: &Agent,
        contents: &[Content],
    ) -> Result<Vec<f64>, AgentError> {
        let mut agent = agent.clone();
        agent.options.record_all_receivers = true;
        let others = || contents.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, content)| content);
        if matches!(self, Alternative::SummariesOnly | Alternative::ReportsOnly) {
            others().flat_map(Content::frames).for_each(|frame| drop(agent.receive(frame, Some(mission.end_s))));
            agent.rebuild()?;
            return probabilities(&mut agent, &mission.held_out);
        }
        if self == Alternative::RawEvents {
            agent.record(others().flat_map(Content::events).cloned())?;
            agent.rebuild()?;
            return probabilities(&mut agent, &mission.held_out);
        }
        if let Alternative::Concatenation(_) = self {
            let all: Vec<&Summary> = contents.iter().flat_map(Content::summaries).collect();
            let inputs = agent.team().model.inputs(&mission.held_out)?;
            return Ok(Concatenation::new(&agent.team().model.prior, &all)?.probability(&inputs)?);
        }
        let mut posterior = agent.posterior(Which::Fused)?.clone();
        // A vehicle may predict under its own model.
        let read = others().flat_map(Content::summaries).map(|summary| summary.read_under(posterior.prior()));
        let read: Vec<Cow<'_, Summary>> = read.collect::<Result<_, dgpc::Error>>()?;
        posterior.absorb_summaries(&read.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
        let predictions = agent.predict(&mission.held_out, Which::Given(&posterior))?;
        Ok(predictions.into_iter().map(|prediction| prediction.probability).collect())
    }
}

impl Package {
    /// Returns the packages of all vehicles that [`Alternative::Concatenation`] sends in `frames` frames of each.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn of_team(mission: &Mission, frames: usize, policy: Policy) -> Result<Vec<Self>, AgentError> {
        let mut all = Vec::new();
        for (place, agent) in mission.vehicles.iter().enumerate().filter(|(_, agent)| agent.events().len() > 0) {
            let mut rng = stream(mission.seed(), streams::ALTERNATIVES + place as u64);
            all.extend(Sender::new(mission, agent)?.packages(frames, policy, &mut rng)?);
        }
        Ok(all)
    }
}

enum Content {
    Frames(Vec<Vec<u8>>),
    Summaries(Vec<Summary>),
    Events(Vec<Event>),
}

impl Content {
    fn frames(&self) -> &[Vec<u8>] {
        if let Content::Frames(frames) = self { frames } else { &[] }
    }

    fn summaries(&self) -> &[Summary] {
        if let Content::Summaries(summaries) = self { summaries } else { &[] }
    }

    fn events(&self) -> &[Event] {
        if let Content::Events(events) = self { events } else { &[] }
    }
}
