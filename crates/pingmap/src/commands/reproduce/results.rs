//! Computed results, and the agents and teams that are scored.

use pingmap_trial::Estimate;
use pingmap_trial::paper::statistics::{BoundOf, Metric, local_difference, team_difference};
use pingmap_trial::paper::{
    AtRadius, Claim, DataSet, Example, Experiment, RADIUS, RADIUS_LENGTH_SCALES, SWEEP_LENGTH_SCALES, SetOutcome,
    SweepRow,
};

use super::exhibit::Exhibit;
use super::published::Published;
use crate::output::progress;

/// The experiment, with the parts that were requested.
pub struct Computed {
    pub experiment: Experiment,
    /// Whether the data are the built-in ones.
    pub built_in: bool,
    pub seed: u64,
    /// Results at the paper's ratio of radius to length-scale, and at the paper's radius.
    pub radii: Vec<AtRadius>,
    /// Results of the sweep for every data set.
    pub sweep: Vec<Vec<SweepRow>>,
    /// A permutation of the first data set for the figures.
    pub example: Option<Example>,
}

impl Computed {
    pub fn compute(experiment: Experiment, built_in: bool, seed: u64, exhibit: Exhibit) -> anyhow::Result<Self> {
        let all = exhibit == Exhibit::All;
        let tables = all || matches!(exhibit, Exhibit::Local | Exhibit::Team | Exhibit::Certificate);
        let sweep = all || exhibit == Exhibit::Sweep;
        let ratio = RADIUS_LENGTH_SCALES * experiment.length_scale();
        let radii = if tables { vec![ratio, RADIUS] } else { vec![] };
        let rounds = radii.len() + if sweep { SWEEP_LENGTH_SCALES.len() } else { 0 };
        let steps = rounds * experiment.sets().len() * experiment.permutations();
        let bar = progress(steps as u64, "permutations");
        let done = || bar.inc(1);
        let radii = radii.into_iter().map(|radius| experiment.at_radius(radius, &done)).collect::<Result<_, _>>()?;
        let sweep = if sweep { experiment.sweep(&done)? } else { vec![] };
        let example = if exhibit.has_pictures() { experiment.example(0, ratio)? } else { None };
        bar.finish_and_clear();
        Ok(Self { experiment, built_in, seed, radii, sweep, example })
    }

    /// Returns the data sets, their outcomes at one radius, and the corresponding data sets of the paper.
    pub fn sets<'a>(
        &'a self,
        at: &'a AtRadius,
    ) -> impl Iterator<Item = (&'a DataSet, &'a SetOutcome, Option<Published>)> {
        let sets = self.experiment.sets().iter().zip(&at.sets).enumerate();
        sets.map(|(place, (set, outcome))| (set, outcome, Published::at(place, set.agents().len())))
    }
}

/// The subject of a score: one agent alone, or the team with concatenated packets.
#[derive(Clone, Copy)]
pub enum Who {
    Agent(usize),
    Team,
}

impl Who {
    /// Returns all agents of a data set, and the team.
    pub fn all(set: &DataSet) -> impl Iterator<Item = Who> {
        (0..set.agents().len()).map(Who::Agent).chain([Who::Team])
    }

    pub fn name(self, set: &DataSet) -> String {
        match self {
            Who::Agent(agent) => format!("{} {}", set.name, set.agents()[agent].id),
            Who::Team => format!("{} team", set.name),
        }
    }

    /// Returns the difference that a claim is about, with the paper's ω and fusion.
    pub fn difference(self, outcome: &SetOutcome, claim: &Claim, metric: Metric) -> Option<Estimate> {
        match self {
            Who::Agent(agent) => local_difference(&outcome.local(agent), claim, metric),
            Who::Team => team_difference(&outcome.team(), claim, metric),
        }
    }

    /// Returns the difference in the paper's tables.
    pub fn published_difference(self, published: Option<Published>, claim: &Claim, metric: Metric) -> Option<f64> {
        let cost = |choice| {
            let score = match self {
                Who::Agent(agent) => published?.local(agent, choice)?,
                Who::Team => published?.team(choice)?,
            };
            Some(score.cost(metric))
        };
        Some(cost(claim.worse)? - cost(claim.better)?)
    }
}

/// Bounds of [`pingmap_trial::paper::Bounds`]: key in JSON, name in tables, and accessor.
pub const BOUNDS: [(&str, &str, BoundOf); 5] = [
    ("trace", "tr K̃", |bounds| bounds.trace),
    ("kl", "KL", |bounds| bounds.kl),
    ("gap", "gap", |bounds| bounds.gap),
    ("closed_form", "closed form", |bounds| bounds.closed_form),
    ("paper", "paper's bound", |bounds| bounds.paper_closed_form),
];
