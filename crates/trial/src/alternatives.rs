//! Alternative uses of the same bytes, with which pingmap's packets are compared.

use std::borrow::Cow;

use dgpc::{Candidates, Concatenation, Inputs, Posterior, Sites, Summary};
use pingmap_agent::{Agent, AgentError, AgentOptions, Event, Link, LinkQuery, Sharing, Which};
use pingmap_packet::{Block, Layout};
use rand::seq::index::sample;
use rayon::prelude::*;

use crate::mission::{Mission, probabilities, send_frames};
use crate::streams::{self, stream};

/// An alternative use of the bytes of a frame. All alternatives quantise positions and values as our packets do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alternative {
    /// Only map messages: inducing points that summarise all events.
    SummariesOnly,
    /// Only reports: single outcomes by one bit each, and the sender's track.
    ReportsOnly,
    /// Our map messages without rounding: equal points with exact numbers.
    Unrounded,
    /// As many raw events as fit; events that reduce the trace most come first.
    RawEvents,
    /// Our packets at points drawn at random.
    RandomPoints,
    /// Our packets at the points that reduce the trace least.
    BadPoints,
    /// Variational summaries at good points. Each event belongs to the packet that explains most of its prior variance.
    Variational,
    /// Variational summaries fused as in the paper: concatenated, without the receiver's raw events.
    Concatenation,
}

impl Alternative {
    /// All alternatives.
    pub const ALL: [Alternative; 8] = [
        Alternative::SummariesOnly,
        Alternative::ReportsOnly,
        Alternative::Unrounded,
        Alternative::RawEvents,
        Alternative::RandomPoints,
        Alternative::BadPoints,
        Alternative::Variational,
        Alternative::Concatenation,
    ];

    /// Returns the name of the alternative.
    pub fn name(self) -> &'static str {
        match self {
            Alternative::SummariesOnly => "summaries only",
            Alternative::ReportsOnly => "reports only",
            Alternative::Unrounded => "unrounded",
            Alternative::RawEvents => "raw events",
            Alternative::RandomPoints => "random points",
            Alternative::BadPoints => "bad points",
            Alternative::Variational => "variational",
            Alternative::Concatenation => "concatenation",
        }
    }

    /// Whether the alternative fits into the frames. Exact numbers do not fit.
    pub fn is_sendable(self) -> bool {
        self != Alternative::Unrounded
    }

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
            agent.set_options(AgentOptions { sharing, ..*agent.options() });
            send_frames(&mut agent, frames)
        };
        let sender = Sender::new(mission, agent)?;
        if sender.queries.is_empty() {
            // No event lies within the grid.
            return Ok(Content::Summaries(Vec::new()));
        }
        Ok(match self {
            Alternative::SummariesOnly => Content::Frames(sent(Sharing::summaries())?),
            Alternative::ReportsOnly => Content::Frames(sent(Sharing::reports())?),
            Alternative::Unrounded => Content::Summaries(sender.unrounded(&sent(Sharing::summaries())?)?),
            Alternative::RawEvents => Content::Events(sender.raw_events(frames)?),
            Alternative::RandomPoints => {
                let mut rng = stream(mission.seed(), streams::ALTERNATIVES + place as u64);
                let all = sender.queries.len();
                let mut choose = |_: &Candidates| sample(&mut rng, all, sender.points().min(all)).into_vec();
                Content::Summaries(sender.residuals(frames, &mut choose)?)
            }
            Alternative::BadPoints => {
                let mut choose = |candidates: &Candidates| candidates.maximise_trace(sender.points()).indices;
                Content::Summaries(sender.residuals(frames, &mut choose)?)
            }
            Alternative::Variational | Alternative::Concatenation => Content::Summaries(sender.variational(frames)?),
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
        agent.set_options(AgentOptions { record_all_receivers: true, ..*agent.options() });
        let others = || contents.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, content)| content);
        if matches!(self, Alternative::SummariesOnly | Alternative::ReportsOnly) {
            others().flat_map(Content::frames).for_each(|frame| drop(agent.receive(frame, Some(mission.end_s))));
            agent.rebuild()?;
            return probabilities(&mut agent, &mission.held_out);
        }
        if self == Alternative::RawEvents {
            agent.record_all(others().flat_map(Content::events).cloned())?;
            agent.rebuild()?;
            return probabilities(&mut agent, &mission.held_out);
        }
        if self == Alternative::Concatenation {
            let all: Vec<&Summary> = contents.iter().flat_map(Content::summaries).collect();
            let inputs = agent.team().model.inputs(&mission.held_out)?;
            return Ok(Concatenation::new(&agent.team().model.prior, &all)?.probability(&inputs)?);
        }
        let mut posterior = agent.posterior(Which::Fused)?.clone();
        // A vehicle may predict under its own model.
        let read = others().flat_map(Content::summaries).map(|summary| summary.read_under(posterior.prior()));
        let read: Vec<Cow<'_, Summary>> = read.collect::<Result<_, dgpc::Error>>()?;
        posterior.absorb_summaries(&read.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
        let predictions = agent.predict_from(&posterior, &mission.held_out)?;
        Ok(predictions.into_iter().map(|prediction| prediction.probability).collect())
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

/// A vehicle that sends data.
struct Sender<'a> {
    agent: &'a Agent,
    own: Posterior,
    layout: &'static Layout,
    /// Candidate points: the queries of the vehicle's own events, and their inputs.
    queries: Vec<LinkQuery>,
    inputs: Inputs,
}

impl<'a> Sender<'a> {
    fn new(mission: &Mission, agent: &'a Agent) -> Result<Self, AgentError> {
        let queries = agent.team().candidates(agent.events());
        Ok(Self {
            own: agent.clone().posterior(Which::Own)?.clone(),
            layout: mission.team.layout(mission.team.frame_bytes)?,
            inputs: agent.team().model.inputs(&queries)?,
            queries,
            agent,
        })
    }

    /// Returns the number of points of a block.
    fn points(&self) -> usize {
        self.layout.points
    }

    fn prior_posterior(&self) -> Posterior {
        self.agent.team().model.prior_posterior()
    }

    /// Returns residual summaries at points that `choose` selects from the candidates, conditioned on the earlier
    /// points.
    fn residuals(
        &self,
        frames: usize,
        choose: &mut dyn FnMut(&Candidates) -> Vec<usize>,
    ) -> Result<Vec<Summary>, AgentError> {
        let mut candidates = Candidates::new(self.agent.team().model.prior.kernel(), &self.inputs)?;
        let mut public = self.prior_posterior();
        let mut summaries = Vec::new();
        for _ in 0..frames.saturating_mul(self.layout.blocks) {
            let chosen = choose(&candidates);
            candidates.condition_on(&chosen);
            let queries: Vec<LinkQuery> = chosen.iter().map(|&place| self.queries[place]).collect();
            let residual = |points: &Inputs| self.own.residual(&public, points);
            if let Some((_, summary)) = self.encode(&queries, &residual)? {
                public.absorb_summaries(&[&summary])?;
                summaries.push(summary);
            }
        }
        Ok(summaries)
    }

    /// Returns the summaries of these map messages without rounding.
    fn unrounded(&self, packets: &[Vec<u8>]) -> Result<Vec<Summary>, AgentError> {
        let mut public = self.prior_posterior();
        let mut summaries = Vec::new();
        let blocks = packets
            .iter()
            .filter_map(|packet| self.agent.codec().read(packet).ok())
            .flat_map(|(_, message)| message.blocks);
        for block in blocks.filter(Block::has_content) {
            let points = self.agent.team().model.inputs(self.agent.quantizer().queries(&block))?;
            let summary = self.own.residual(&public, &points)?;
            public.absorb_summaries(&[&summary])?;
            summaries.push(summary);
        }
        Ok(summaries)
    }

    /// Encodes a block at these queries. Returns the block and its decoded summary.
    fn encode(
        &self,
        queries: &[LinkQuery],
        summarise: &dyn Fn(&Inputs) -> dgpc::Result<Summary>,
    ) -> dgpc::Result<Option<(Block, Summary)>> {
        let links: Vec<Link> = queries.iter().map(|query| query.link).collect();
        let quantizer = self.agent.quantizer();
        quantizer.encode(self.layout, quantizer.time_of(queries), &links, summarise)
    }

    /// Returns as many events as fit into the frames, with rounded positions.
    fn raw_events(&self, frames: usize) -> Result<Vec<Event>, AgentError> {
        let frame_bits = 8 * self.layout.frame_bytes as u64;
        // An event takes the cells of both ends and one bit for the outcome.
        let events = (frame_bits - self.layout.overhead_bits()) / (self.layout.location_bits() + 1);
        let events_max = frames.saturating_mul(events as usize);
        let chosen = Candidates::new(self.agent.team().model.prior.kernel(), &self.inputs)?.greedy(events_max);
        let rounded = |event: &Event| {
            let link = self.agent.quantizer().rounded(&event.link)?;
            Some(Event { link, ..event.clone() })
        };
        // Repeated events over a link come after the first events over all links.
        let mut again: Vec<(usize, Event)> = Vec::new();
        for &place in &chosen.indices {
            let there = self.agent.events().filter(|event| event.link == self.queries[place].link);
            again.extend(there.filter_map(rounded).enumerate());
        }
        // Events too close to the chosen ones to add anything fill the remaining room.
        let is_chosen = |event: &&Event| chosen.indices.iter().any(|&place| self.queries[place].link == event.link);
        let rest = self.agent.events().filter(|event| !is_chosen(event));
        again.extend(rest.filter_map(rounded).map(|event| (usize::MAX, event)));
        again.sort_by_key(|&(times, _)| times);
        Ok(again.into_iter().map(|(_, event)| event).take(events_max).collect())
    }

    /// Returns variational summaries at good points. Each event belongs to the packet whose point explains most of its
    /// prior variance.
    fn variational(&self, frames: usize) -> Result<Vec<Summary>, AgentError> {
        let kernel = self.agent.team().model.prior.kernel();
        let mut candidates = Candidates::new(kernel, &self.inputs)?;
        let mut packets: Vec<Vec<LinkQuery>> = Vec::new();
        while packets.len() < frames.saturating_mul(self.layout.blocks) {
            let chosen = candidates.minimise_trace(self.points());
            if chosen.indices.is_empty() {
                break;
            }
            candidates.condition_on(&chosen.indices);
            packets.push(chosen.indices.iter().map(|&place| self.queries[place]).collect());
        }
        let Some(sites) = self.agent.sites() else { return Ok(Vec::new()) };
        let regions = self.regions(sites, &packets)?;
        let mut summaries = Vec::new();
        for (queries, members) in packets.iter().zip(regions) {
            let sites = sites.select(&members);
            let summarise = |points: &Inputs| Summary::variational(&self.agent.team().model.prior, &sites, points);
            summaries.extend(self.encode(queries, &summarise)?.map(|(_, summary)| summary));
        }
        Ok(summaries)
    }

    /// Returns for every packet the events that it summarises.
    fn regions(&self, sites: &Sites, packets: &[Vec<LinkQuery>]) -> Result<Vec<Vec<usize>>, AgentError> {
        let model = &self.agent.team().model;
        let mut best = vec![(0, f64::NEG_INFINITY); sites.len()];
        for (packet, queries) in packets.iter().enumerate() {
            let points = model.inputs(queries)?;
            let covariance = model.prior.kernel().cross(sites.inputs(), &points)?;
            for (column, variance) in model.prior.kernel().diagonal(&points)?.iter().enumerate() {
                for (best, k) in best.iter_mut().zip(covariance.column(column)) {
                    let explained = k * k / variance;
                    if explained > best.1 {
                        *best = (packet, explained);
                    }
                }
            }
        }
        let mut regions = vec![Vec::new(); packets.len()];
        if !packets.is_empty() {
            best.iter().enumerate().for_each(|(event, &(packet, _))| regions[packet].push(event));
        }
        Ok(regions)
    }
}
