//! A vehicle that sends alternatives to our packets.

use dgpc::{Candidates, Inputs, Posterior, Sites, Summary};
use pingmap_agent::{Agent, AgentError, Event, Link, LinkQuery, SummaryQuantizer, VehicleId, Which};
use pingmap_packet::{Block, Layout};
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;

use crate::mission::Mission;
use crate::paper::Policy;

/// A package of the paper, {Z, μ, Σ}: the posterior of one locality region at its inducing points.
#[derive(Debug, Clone)]
pub struct Package {
    /// The vehicle whose events the package summarises.
    pub sender: VehicleId,
    /// The inducing points Z, as links.
    pub links: Vec<Link>,
    /// Mean and covariance at the inducing points, as decoded by a receiver.
    pub summary: Summary,
}

/// A vehicle that sends data.
pub(super) struct Sender<'a> {
    agent: &'a Agent,
    quantizer: SummaryQuantizer<'a>,
    own: Posterior,
    layout: &'static Layout,
    /// Candidate points: the queries of the vehicle's own events, and their inputs.
    pub(super) queries: Vec<LinkQuery>,
    inputs: Inputs,
}

impl<'a> Sender<'a> {
    pub(super) fn new(mission: &Mission, agent: &'a Agent) -> Result<Self, AgentError> {
        let queries = agent.team().candidates(agent.events());
        let number = agent.team().number(agent.id());
        Ok(Self {
            quantizer: number.map_or_else(|| agent.team().quantizer(), |number| agent.team().quantizer_of(number)),
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

    /// Returns residual summaries at points drawn at random.
    pub(super) fn random_residuals(&self, frames: usize, rng: &mut ChaCha8Rng) -> Result<Vec<Summary>, AgentError> {
        let all = self.queries.len();
        self.residuals(frames, &mut |_| sample(rng, all, self.points().min(all)).into_vec())
    }

    /// Returns residual summaries at the points that reduce the trace least.
    pub(super) fn bad_residuals(&self, frames: usize) -> Result<Vec<Summary>, AgentError> {
        self.residuals(frames, &mut |candidates| candidates.maximise_trace(self.points()).indices)
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
    pub(super) fn unrounded(&self, packets: &[Vec<u8>]) -> Result<Vec<Summary>, AgentError> {
        let mut public = self.prior_posterior();
        let mut summaries = Vec::new();
        let blocks = packets
            .iter()
            .filter_map(|packet| self.agent.codec().read(packet).ok())
            .flat_map(|(_, message)| message.blocks);
        for block in blocks.filter(Block::has_content) {
            let points = self.agent.team().model.inputs(self.quantizer.queries(&block))?;
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
        self.quantizer.encode(self.layout, self.quantizer.time_of(queries), &links, summarise)
    }

    /// Returns as many events as fit into the frames, with rounded positions.
    pub(super) fn raw_events(&self, frames: usize) -> Result<Vec<Event>, AgentError> {
        let frame_bits = 8 * self.layout.frame_bytes as u64;
        // An event takes the cells of both ends and one bit for the outcome.
        let events = (frame_bits - self.layout.overhead_bits()) / (self.layout.location_bits() + 1);
        let events_max = frames.saturating_mul(events as usize);
        let chosen = Candidates::new(self.agent.team().model.prior.kernel(), &self.inputs)?.greedy(events_max);
        let rounded = |event: &Event| {
            let link = self.quantizer.rounded(&event.link)?;
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

    /// Returns variational summaries at points chosen by a policy, one for each locality region. Each event belongs to
    /// the region of the packet whose point explains most of its prior variance.
    pub(super) fn packages(
        &self,
        frames: usize,
        policy: Policy,
        rng: &mut ChaCha8Rng,
    ) -> Result<Vec<Package>, AgentError> {
        let kernel = self.agent.team().model.prior.kernel();
        let mut candidates = Candidates::new(kernel, &self.inputs)?;
        let mut packets: Vec<Vec<LinkQuery>> = Vec::new();
        while packets.len() < frames.saturating_mul(self.layout.blocks) {
            let chosen = policy.choose(&candidates, self.points(), rng);
            if chosen.indices.is_empty() {
                break;
            }
            candidates.condition_on(&chosen.indices);
            packets.push(chosen.indices.iter().map(|&place| self.queries[place]).collect());
        }
        let Some(sites) = self.agent.sites() else { return Ok(Vec::new()) };
        let regions = self.regions(sites, &packets)?;
        let mut packages = Vec::new();
        for (queries, members) in packets.iter().zip(regions) {
            let sites = sites.select(&members);
            let summarise = |points: &Inputs| Summary::variational(&self.agent.team().model.prior, &sites, points);
            packages.extend(self.encode(queries, &summarise)?.map(|(block, summary)| {
                let links = self.quantizer.queries(&block).iter().map(|query| query.link).collect();
                Package { sender: self.agent.id().clone(), links, summary }
            }));
        }
        Ok(packages)
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
