//! The same numbers for programs.

use std::collections::BTreeMap;

use pingmap_trial::paper::statistics::{
    Metric, bound_orders_nll, effective_draws, local_score, mean, mean_bound, team_score,
};
use pingmap_trial::paper::{
    AtRadius, Choice, Claim, DataSet, EffectiveDraws, Fusion, LocalOutcome, Omega, SetOutcome, SweepRow,
};
use pingmap_trial::{Estimate, MeanScore};
use schemars::JsonSchema;
use serde::Serialize;

use super::page;
use super::published::{Published, PublishedScore};
use super::results::{BOUNDS, Computed, Who};

/// Everything that was computed.
#[derive(Serialize, JsonSchema)]
pub struct ReproductionJson {
    schema: u32,
    caveat: String,
    seed: u64,
    permutations: usize,
    length_scale: f64,
    data_sets: Vec<DataSetJson>,
    radii: Vec<RadiusJson>,
    sweep: Vec<SweepJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct DataSetJson {
    data_set: String,
    agents: Vec<AgentJson>,
}

/// Events of an agent.
#[derive(Serialize, JsonSchema)]
pub struct AgentJson {
    agent: String,
    #[serde(flatten)]
    events: EventsJson,
    published: Option<EventsJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct EventsJson {
    failures: usize,
    successes: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct RadiusJson {
    radius: f64,
    length_scales: f64,
    data_sets: Vec<SetJson>,
}

/// One data set at one radius.
#[derive(Serialize, JsonSchema)]
pub struct SetJson {
    data_set: String,
    agents: Vec<LocalJson>,
    team: TeamJson,
    claims: Vec<ClaimJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct ClaimJson {
    who: String,
    claim: String,
    nll_difference: Option<EstimateJson>,
    acc_difference: Option<EstimateJson>,
    published: DifferencesJson,
}

#[derive(Serialize, JsonSchema)]
pub struct DifferencesJson {
    nll_difference: Option<f64>,
    acc_difference: Option<f64>,
}

/// An agent by itself.
#[derive(Serialize, JsonSchema)]
pub struct LocalJson {
    agent: String,
    region: RegionJson,
    skipped: usize,
    effective_draws: Option<DrawsJson>,
    scores: Vec<LocalScoreJson>,
    all_events: Vec<OmegaScoreJson>,
    certificate: Vec<CertificateJson>,
    rank_correlation_with_nll: BTreeMap<&'static str, Option<EstimateJson>>,
}

#[derive(Serialize, JsonSchema)]
pub struct RegionJson {
    centre_standardised: Vec<f64>,
    events: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct DrawsJson {
    mean: f64,
    least: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct LocalScoreJson {
    policy: &'static str,
    points: usize,
    omega: &'static str,
    score: Option<ScoreJson>,
    published: Option<PublishedJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct OmegaScoreJson {
    omega: &'static str,
    score: Option<ScoreJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct CertificateJson {
    policy: &'static str,
    points: usize,
    bounds: BTreeMap<&'static str, Option<EstimateJson>>,
}

#[derive(Serialize, JsonSchema)]
pub struct TeamJson {
    skipped: usize,
    scores: Vec<TeamScoreJson>,
    centralised: Vec<OmegaScoreJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct TeamScoreJson {
    fusion: &'static str,
    #[serde(flatten)]
    score: LocalScoreJson,
}

#[derive(Serialize, JsonSchema)]
pub struct SweepJson {
    data_set: String,
    rows: Vec<SweepRowJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct SweepRowJson {
    length_scales: f64,
    training_events: f64,
    skipped: usize,
    all_events: Option<EstimateJson>,
    good: Vec<PointsJson>,
    random_minus_good: Vec<PointsJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct PointsJson {
    points: usize,
    nll: EstimateJson,
}

#[derive(Serialize, JsonSchema)]
pub struct EstimateJson {
    mean: f64,
    se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct ScoreJson {
    acc: f64,
    acc_se: Option<f64>,
    nll: f64,
    nll_se: Option<f64>,
}

#[derive(Serialize, JsonSchema)]
pub struct PublishedJson {
    acc: f64,
    nll: f64,
}

impl ReproductionJson {
    pub fn of(results: &Computed) -> Self {
        let sets = results.experiment.sets();
        let sweep = |(set, rows): (&DataSet, &Vec<SweepRow>)| SweepJson {
            data_set: set.name.clone(),
            rows: rows.iter().map(SweepRowJson::of).collect(),
        };
        Self {
            schema: 1,
            caveat: page::caveat(results),
            seed: results.seed,
            permutations: results.experiment.permutations(),
            length_scale: results.experiment.length_scale(),
            data_sets: sets.iter().enumerate().map(|(place, set)| DataSetJson::of(place, set)).collect(),
            radii: results.radii.iter().map(|at| RadiusJson::of(results, at)).collect(),
            sweep: sets.iter().zip(&results.sweep).map(sweep).collect(),
        }
    }
}

impl DataSetJson {
    fn of(place: usize, set: &DataSet) -> Self {
        let published = Published::at(place, set.agents().len());
        let events = |(failures, successes)| EventsJson { failures, successes };
        let agents = set.agents().iter().enumerate().map(|(n, agent)| AgentJson {
            agent: agent.id.to_string(),
            events: events(set.failures_and_successes(agent)),
            published: published.map(|published| events(published.events(n))),
        });
        Self { data_set: set.name.clone(), agents: agents.collect() }
    }
}

impl RadiusJson {
    fn of(results: &Computed, at: &AtRadius) -> Self {
        let sets = results.sets(at).map(|(set, outcome, published)| {
            let agents = (0..set.agents().len()).map(|agent| LocalJson::of(set, outcome, agent, published));
            let claims = Who::all(set).flat_map(|who| Claim::all().into_iter().map(move |claim| (who, claim)));
            SetJson {
                data_set: set.name.clone(),
                agents: agents.collect(),
                team: TeamJson::of(outcome, published),
                claims: claims.map(|(who, claim)| ClaimJson::of(set, outcome, published, who, &claim)).collect(),
            }
        });
        let length_scales = at.radius / results.experiment.length_scale();
        Self { radius: at.radius, length_scales, data_sets: sets.collect() }
    }
}

impl ClaimJson {
    fn of(set: &DataSet, outcome: &SetOutcome, published: Option<Published>, who: Who, claim: &Claim) -> Self {
        let ours = |metric| who.difference(outcome, claim, metric).map(EstimateJson::of);
        let theirs = |metric| who.published_difference(published, claim, metric);
        Self {
            who: who.name(set),
            claim: claim.text(),
            nll_difference: ours(Metric::Nll),
            acc_difference: ours(Metric::Accuracy),
            published: DifferencesJson {
                nll_difference: theirs(Metric::Nll),
                acc_difference: theirs(Metric::Accuracy),
            },
        }
    }
}

impl LocalJson {
    fn of(set: &DataSet, outcome: &SetOutcome, agent: usize, published: Option<Published>) -> Self {
        let outcomes = outcome.local(agent);
        let region = &outcome.regions[agent];
        let score = |(choice, omega): (Choice, Omega)| {
            let theirs = published.filter(|_| omega == Omega::LastDraw);
            let theirs = theirs.and_then(|published| published.local(agent, choice));
            LocalScoreJson::of(choice, omega, local_score(&outcomes, choice, omega), theirs)
        };
        let choices = Choice::all().flat_map(|choice| Omega::ALL.map(|omega| (choice, omega)));
        let orders = |(key, _, of): &(&'static str, &str, _)| (*key, bound_orders_nll(&outcomes, *of));
        Self {
            agent: set.agents()[agent].id.to_string(),
            region: RegionJson { centre_standardised: region.centre.clone(), events: region.members.len() },
            skipped: outcome.permutations.len() - outcomes.len(),
            effective_draws: effective_draws(&outcomes).map(|EffectiveDraws { mean, least }| DrawsJson { mean, least }),
            scores: choices.map(score).collect(),
            all_events: by_omega(|omega| mean(&outcomes, |outcome| outcome.all_events[&omega])),
            certificate: Choice::all().map(|choice| CertificateJson::of(choice, &outcomes)).collect(),
            rank_correlation_with_nll: estimates(BOUNDS.iter().map(orders)),
        }
    }
}

impl CertificateJson {
    fn of(choice: Choice, outcomes: &[&LocalOutcome]) -> Self {
        let bound = |(key, _, of): &(&'static str, &str, _)| (*key, mean_bound(outcomes, choice, *of));
        Self { policy: choice.policy.name(), points: choice.points, bounds: estimates(BOUNDS.iter().map(bound)) }
    }
}

impl TeamJson {
    fn of(outcome: &SetOutcome, published: Option<Published>) -> Self {
        let outcomes = outcome.team();
        let score = |(choice, fusion, omega): (Choice, Fusion, Omega)| {
            let theirs = published.filter(|_| omega == Omega::LastDraw && fusion == Fusion::Concatenation);
            let theirs = theirs.and_then(|published| published.team(choice));
            let ours = team_score(&outcomes, choice, fusion, omega);
            TeamScoreJson { fusion: fusion.name(), score: LocalScoreJson::of(choice, omega, ours, theirs) }
        };
        let keys = Choice::all()
            .flat_map(|choice| Fusion::ALL.map(|fusion| (choice, fusion)))
            .flat_map(|(choice, fusion)| Omega::ALL.map(|omega| (choice, fusion, omega)));
        Self {
            skipped: outcome.permutations.len() - outcomes.len(),
            scores: keys.map(score).collect(),
            centralised: by_omega(|omega| mean(&outcomes, |outcome| outcome.centralised[&omega])),
        }
    }
}

impl LocalScoreJson {
    fn of(choice: Choice, omega: Omega, score: Option<MeanScore>, published: Option<PublishedScore>) -> Self {
        Self {
            policy: choice.policy.name(),
            points: choice.points,
            omega: omega.name(),
            score: score.map(ScoreJson::of),
            published: published.map(|PublishedScore { accuracy, nll }| PublishedJson { acc: accuracy, nll }),
        }
    }
}

impl SweepRowJson {
    fn of(row: &SweepRow) -> Self {
        let by_points = |all: &BTreeMap<usize, Estimate>| {
            all.iter().map(|(&points, &nll)| PointsJson { points, nll: EstimateJson::of(nll) }).collect()
        };
        Self {
            length_scales: row.length_scales,
            training_events: row.events,
            skipped: row.skipped,
            all_events: row.all_events.map(EstimateJson::of),
            good: by_points(&row.good),
            random_minus_good: by_points(&row.gain),
        }
    }
}

impl EstimateJson {
    fn of(Estimate { mean, se, .. }: Estimate) -> Self {
        Self { mean, se }
    }
}

impl ScoreJson {
    fn of(MeanScore { accuracy, nll, .. }: MeanScore) -> Self {
        Self { acc: accuracy.mean, acc_se: accuracy.se, nll: nll.mean, nll_se: nll.se }
    }
}

fn by_omega(score: impl Fn(Omega) -> Option<MeanScore>) -> Vec<OmegaScoreJson> {
    let of = |omega: Omega| OmegaScoreJson { omega: omega.name(), score: score(omega).map(ScoreJson::of) };
    Omega::ALL.into_iter().map(of).collect()
}

fn estimates(
    all: impl Iterator<Item = (&'static str, Option<Estimate>)>,
) -> BTreeMap<&'static str, Option<EstimateJson>> {
    all.map(|(key, value)| (key, value.map(EstimateJson::of))).collect()
}
