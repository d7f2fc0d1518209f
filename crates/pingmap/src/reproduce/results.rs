//! What was computed, and the statistics that tables and JSON share.

use pingmap_trial::paper::{
    AtRadius, Bounds, Choice, Claim, DataSet, EffectiveDraws, Example, Experiment, Fusion, LocalOutcome, Omega, RADIUS,
    RADIUS_LENGTH_SCALES, SWEEP_LENGTH_SCALES, SetOutcome, SweepRow, TeamOutcome, rank_correlation,
};
use pingmap_trial::{Estimate, MeanScore, Score};

use super::published::Published;
use crate::cli::Exhibit;
use crate::output::progress;

/// The experiment, as far as it was asked for.
pub struct Results {
    pub experiment: Experiment,
    /// Whether the data are those that come with pingmap.
    pub built_in: bool,
    pub seed: u64,
    /// At the paper's ratio of radius to length-scale, and at its radius.
    pub radii: Vec<AtRadius>,
    /// For every data set.
    pub sweep: Vec<Vec<SweepRow>>,
    /// A permutation of the first data set to look at.
    pub example: Option<Example>,
}

impl Results {
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

    /// The data sets, their outcomes at one radius, and the paper's data sets in their places.
    pub fn sets<'a>(
        &'a self,
        at: &'a AtRadius,
    ) -> impl Iterator<Item = (&'a DataSet, &'a SetOutcome, Option<Published>)> {
        let sets = self.experiment.sets().iter().zip(&at.sets).enumerate();
        sets.map(|(place, (set, outcome))| (set, outcome, Published::at(place, set.agents().len())))
    }
}

/// What is good: a low NLL, or a high accuracy.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    Nll,
    Accuracy,
}

impl Metric {
    pub const ALL: [Metric; 2] = [Metric::Nll, Metric::Accuracy];

    pub fn name(self) -> &'static str {
        match self {
            Metric::Nll => "NLL",
            Metric::Accuracy => "ACC",
        }
    }

    /// What should be low.
    fn cost(self, score: &Score) -> f64 {
        match self {
            Metric::Nll => score.nll,
            Metric::Accuracy => -score.accuracy,
        }
    }
}

/// Who is scored: an agent by itself, or the team with packets concatenated.
#[derive(Clone, Copy)]
pub enum Who {
    Agent(usize),
    Team,
}

impl Who {
    /// Everybody in a data set.
    pub fn all(set: &DataSet) -> impl Iterator<Item = Who> {
        (0..set.agents().len()).map(Who::Agent).chain([Who::Team])
    }

    pub fn name(self, set: &DataSet) -> String {
        match self {
            Who::Agent(agent) => format!("{} {}", set.name, set.agents()[agent].id),
            Who::Team => format!("{} team", set.name),
        }
    }

    /// By how much a claim holds, with the paper's ω and fusion.
    pub fn difference(self, outcome: &SetOutcome, claim: &Claim, metric: Metric) -> Option<Estimate> {
        claim.difference(|choice| match self {
            Who::Agent(agent) => outcome
                .local(agent)
                .iter()
                .map(|local| metric.cost(&local.scores[&(choice, Omega::LastDraw)]))
                .collect(),
            Who::Team => {
                let key = (choice, Fusion::Concatenation, Omega::LastDraw);
                outcome.team().iter().map(|team| metric.cost(&team.scores[&key])).collect()
            }
        })
    }

    /// The same difference in the paper's tables.
    pub fn published_difference(self, published: Option<Published>, claim: &Claim, metric: Metric) -> Option<f64> {
        let cost = |choice| {
            let score = match self {
                Who::Agent(agent) => published?.local(agent, choice)?,
                Who::Team => published?.team(choice)?,
            };
            Some(metric.cost(&score))
        };
        Some(cost(claim.worse)? - cost(claim.better)?)
    }
}

/// Mean score over permutations.
pub fn mean<T>(outcomes: &[T], of: impl Fn(&T) -> Score) -> Option<MeanScore> {
    MeanScore::over(&outcomes.iter().map(of).collect::<Vec<_>>())
}

pub fn local_score(outcomes: &[&LocalOutcome], choice: Choice, omega: Omega) -> Option<MeanScore> {
    mean(outcomes, |outcome| outcome.scores[&(choice, omega)])
}

pub fn team_score(outcomes: &[&TeamOutcome], choice: Choice, fusion: Fusion, omega: Omega) -> Option<MeanScore> {
    mean(outcomes, |outcome| outcome.scores[&(choice, fusion, omega)])
}

/// A number of [`Bounds`].
pub type BoundOf = fn(&Bounds) -> f64;

/// The numbers of [`Bounds`]: their key in JSON, what people call them, and where they are.
pub const BOUNDS: [(&str, &str, BoundOf); 5] = [
    ("trace", "tr K̃", |bounds| bounds.trace),
    ("kl", "KL", |bounds| bounds.kl),
    ("gap", "gap", |bounds| bounds.gap),
    ("closed_form", "closed form", |bounds| bounds.closed_form),
    ("paper", "paper's bound", |bounds| bounds.paper_closed_form),
];

/// The mean of a bound over permutations.
pub fn mean_bound(outcomes: &[&LocalOutcome], choice: Choice, of: BoundOf) -> Option<Estimate> {
    Estimate::over(&outcomes.iter().map(|outcome| of(&outcome.bounds[&choice])).collect::<Vec<_>>())
}

/// Does a smaller bound mean a smaller NLL? The rank correlation over the six choices within a permutation, its mean over those in which
/// it is defined.
pub fn bound_orders_nll(outcomes: &[&LocalOutcome], of: BoundOf) -> Option<Estimate> {
    let within = |outcome: &&LocalOutcome| {
        let bounds: Vec<f64> = Choice::all().map(|choice| of(&outcome.bounds[&choice])).collect();
        let nll: Vec<f64> = Choice::all().map(|choice| outcome.scores[&(choice, Omega::LastDraw)].nll).collect();
        rank_correlation(&bounds, &nll)
    };
    Estimate::over(&outcomes.iter().filter_map(within).collect::<Vec<_>>())
}

/// How many independent draws the draws of a chain are worth, over permutations.
pub fn effective_draws(outcomes: &[&LocalOutcome]) -> Option<EffectiveDraws> {
    let mean = Estimate::over(&outcomes.iter().map(|outcome| outcome.effective_draws.mean).collect::<Vec<_>>())?.mean;
    let least = outcomes.iter().map(|outcome| outcome.effective_draws.least).fold(f64::INFINITY, f64::min);
    Some(EffectiveDraws { mean, least })
}
