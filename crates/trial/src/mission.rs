//! One split of a log as a mission: a team that has seen its training events, and the events it must predict.

use std::sync::Arc;

use dgpc::Inputs;
use pingmap_agent::{
    Agent, AgentError, Event, Fit, Fusion, Learning, Limits, Link, Model, Packet, PacketPlan, SummaryKind, VehicleId,
};
use rayon::prelude::*;

use crate::event_log::EventLog;
use crate::learning::learn_best;
use crate::split::Split;

/// Who learns the model that links are read with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Learners {
    /// Somebody who saw all training events, before the mission; the team then shares that model.
    Pooled,
    /// Every vehicle by itself, from its own events and what it received. Packets are formed under a model fixed beforehand.
    Own,
}

/// How a team learns and what it sends.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The team's model, if it is given. Otherwise it is learned from the pooled training events, or is what the first structure
    /// expects before any event where every vehicle learns by itself.
    pub model: Option<Model>,
    /// How models are learned.
    pub learning: Learning,
    /// Who learns.
    pub learners: Learners,
    /// Bounds on work and memory of every vehicle.
    pub limits: Limits,
    /// Which message a packet carries.
    pub summary: SummaryKind,
    /// How packets are put together.
    pub fusion: Fusion,
    /// Inducing points in a packet.
    pub points_per_frame: usize,
    /// Seed of everything random.
    pub seed: u64,
}

/// A team after it learned from its training events, before it shares.
#[derive(Debug, Clone)]
pub struct Mission {
    /// The team's model, under which packets are formed.
    pub model: Arc<Model>,
    /// How it was learned, if it was.
    pub fit: Option<Fit>,
    /// Every vehicle, in alphabetical order.
    pub team: Vec<Agent>,
    /// One vehicle that saw all training events: what sharing tries to reach.
    pub centralised: Agent,
    /// The packets that every vehicle plans to send.
    pub packet_plans: Vec<PacketPlan>,
    /// The links that are predicted.
    pub held_out: Vec<Link>,
    /// What happened there.
    pub outcomes: Vec<bool>,
    /// The links learned from, pooled, in log order.
    pub training: Vec<Link>,
    /// What happened there.
    pub training_outcomes: Vec<bool>,
    plan: Plan,
}

impl Mission {
    /// Splits the log, learns the model, lets every vehicle learn from its own training events, and plans up to `frames_max` packets
    /// of each. Runs vehicles in parallel on the current thread pool.
    ///
    /// # Errors
    /// [`AgentError`] when the method refuses.
    pub fn prepare(log: &EventLog, split: &Split, plan: &Plan, frames_max: usize) -> Result<Self, AgentError> {
        let events = |held_out| split.indices(held_out).into_iter().map(|n| &log.events[n]).collect::<Vec<_>>();
        let (training, held_out) = (events(false), events(true));
        let (model, fit) = team_model(log, &training, plan)?;
        let model = Arc::new(model);
        let learn = |id: VehicleId, owns: &(dyn Fn(&Event) -> bool + Sync)| -> Result<Agent, AgentError> {
            let mut agent = Agent::new(id, model.clone(), plan.limits);
            agent.observe_all(training.iter().filter(|event| owns(event)).map(|event| (*event).clone()));
            agent.learn()?;
            if plan.learners == Learners::Own {
                agent.adapt(&plan.learning)?;
            }
            Ok(agent)
        };
        let learn_vehicle = |id: VehicleId| {
            let agent = learn(id.clone(), &|event| event.receiver_id == id)?;
            let packet_plan = agent.plan_packets(frames_max, plan.points_per_frame)?;
            Ok((agent, packet_plan))
        };
        let (team, centralised) = rayon::join(
            || log.vehicles().into_par_iter().map(learn_vehicle).collect::<Result<Vec<_>, AgentError>>(),
            || learn(VehicleId::new("centralised"), &|_| true),
        );
        let (team, packet_plans) = team?.into_iter().unzip();
        let links = |events: &[&Event]| events.iter().map(|event| event.link).collect();
        let outcomes = |events: &[&Event]| events.iter().map(|event| event.success).collect();
        Ok(Self {
            model,
            fit,
            team,
            centralised: centralised?,
            packet_plans,
            held_out: links(&held_out),
            outcomes: outcomes(&held_out),
            training: links(&training),
            training_outcomes: outcomes(&training),
            plan: plan.clone(),
        })
    }

    /// The first `frames` packets of every vehicle.
    ///
    /// # Errors
    /// [`AgentError`] when the method refuses.
    pub fn packets(&self, frames: usize) -> Result<Vec<Packet>, AgentError> {
        let send = |(agent, packet_plan): (&Agent, &PacketPlan)| agent.packets(packet_plan, frames, self.plan.summary);
        let sent: Result<Vec<_>, _> = self.team.par_iter().zip(&self.packet_plans).map(send).collect();
        Ok(sent?.into_iter().flatten().collect())
    }

    /// The team after everybody received `packets` and, where every vehicle learns by itself, learned from them.
    ///
    /// # Errors
    /// [`AgentError`] when a packet was formed under another model, or the method refuses.
    pub fn after_sharing(&self, packets: &[Packet]) -> Result<Vec<Agent>, AgentError> {
        let receive = |agent: &Agent| {
            let mut agent = agent.clone();
            packets.iter().try_for_each(|packet| agent.receive(packet.clone()))?;
            if self.plan.learners == Learners::Own {
                agent.adapt(&self.plan.learning)?;
            }
            Ok(agent)
        };
        self.team.par_iter().map(receive).collect()
    }

    /// Probability of success of every held-out event, as the centralised vehicle sees it.
    ///
    /// # Errors
    /// [`AgentError`] when the method refuses.
    pub fn predict_centralised(&self) -> Result<Vec<f64>, AgentError> {
        self.predict(&self.centralised, Fusion::Sites, &self.inputs()?)
    }

    /// Probability of success of every held-out event, as every vehicle sees it by itself.
    ///
    /// # Errors
    /// [`AgentError`] when the method refuses.
    pub fn predict_alone(&self) -> Result<Vec<Vec<f64>>, AgentError> {
        let inputs = self.inputs()?;
        self.team.par_iter().map(|agent| self.predict(agent, Fusion::Sites, &inputs)).collect()
    }

    /// Probability of success of every held-out event, as every vehicle sees it after each sent its first `frames` packets.
    ///
    /// # Errors
    /// [`AgentError`] when the method refuses.
    pub fn predict_as_team(&self, frames: usize) -> Result<Vec<Vec<f64>>, AgentError> {
        let inputs = self.inputs()?;
        let team = self.after_sharing(&self.packets(frames)?)?;
        team.par_iter().map(|agent| self.predict(agent, self.plan.fusion, &inputs)).collect()
    }

    fn inputs(&self) -> dgpc::Result<Inputs> {
        self.model.inputs(&self.held_out)
    }

    fn predict(&self, agent: &Agent, fusion: Fusion, inputs: &Inputs) -> Result<Vec<f64>, AgentError> {
        Ok(agent.posterior(fusion)?.probability(inputs)?)
    }
}

/// The team's model, and how it was learned if it was.
fn team_model(log: &EventLog, training: &[&Event], plan: &Plan) -> dgpc::Result<(Model, Option<Fit>)> {
    if let Some(model) = &plan.model {
        return Ok((model.clone(), None));
    }
    let (chart, inputs) = (log.chart(), log.inputs());
    match (plan.learners, plan.learning.structures.first()) {
        (Learners::Own, Some(structure)) => {
            let prior = plan.learning.template(structure, inputs, chart.scale_m)?;
            Ok((Model::new(chart, inputs, prior), None))
        }
        _ => {
            let fit = learn_best(&plan.learning, chart, inputs, training)?;
            Ok((fit.model.clone(), Some(fit)))
        }
    }
}
