//! Results of the experiment in JSON.

use std::collections::BTreeMap;

use pingmap_trial::paper::statistics::{Metric, bound_orders_nll, effective_draws, local_score, mean, team_score};
use pingmap_trial::paper::{AtRadius, Choice, Claim, DataSet, EffectiveDraws, Fusion, Omega, SetOutcome, SweepRow};
use schemars::JsonSchema;
use serde::Serialize;

use super::page;
use super::published::{EVENTS_TABLE, Published};
use super::results::{BOUNDS, Computed, Who};
use super::scores::{
    CertificateJson, DifferencesJson, DrawsJson, EstimateJson, LocalScoreJson, OmegaScoreJson, SweepJson, SweepRowJson,
    TeamScoreJson, by_omega, estimates,
};

/// Result of a reproduction in JSON.
#[derive(Serialize, JsonSchema)]
pub struct ReproductionJson {
    /// Version of this object.
    schema: u32,
    /// Limits of the comparison with the paper.
    caveat: String,
    /// Seed of all random numbers.
    seed: u64,
    /// Number of random divisions of each data set.
    permutations: usize,
    /// The length-scale of all data sets, in standardised units.
    length_scale: f64,
    /// Data sets in place of the paper's.
    data_sets: Vec<DataSetJson>,
    /// The tables of the paper for each radius.
    radii: Vec<RadiusJson>,
    /// NLL over the radius.
    sweep: Vec<SweepJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct DataSetJson {
    /// Number of the paper's table with these events: `I`.
    table: &'static str,
    /// Name of the data set.
    data_set: String,
    /// Digest of the events. It does not depend on the file or the order of lines.
    log_digest: String,
    /// Vehicles of the data set.
    agents: Vec<AgentJson>,
}

/// Number of events of an agent.
#[derive(Serialize, JsonSchema)]
pub struct AgentJson {
    /// Name of the agent.
    agent: String,
    #[serde(flatten)]
    events: EventsJson,
    /// Numbers in the paper.
    published: Option<EventsJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct EventsJson {
    /// Number of messages that were missed.
    failures: usize,
    /// Number of messages that were heard.
    successes: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct RadiusJson {
    /// Radius of the regions, in standardised units.
    radius: f64,
    /// Radius in length-scales.
    length_scales: f64,
    /// Results of each data set.
    data_sets: Vec<SetJson>,
}

/// One data set at one radius.
#[derive(Serialize, JsonSchema)]
pub struct SetJson {
    /// Name of the data set.
    data_set: String,
    /// Results of each agent alone.
    agents: Vec<LocalJson>,
    /// Results of the team.
    team: TeamJson,
    /// The paper's claims with the measured differences.
    claims: Vec<ClaimJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct ClaimJson {
    /// The agent, or the team.
    who: String,
    /// The claim.
    claim: String,
    /// Difference of the mean negative log-likelihood.
    nll_difference: Option<EstimateJson>,
    /// Difference of the accuracy.
    acc_difference: Option<EstimateJson>,
    /// Differences in the paper.
    published: DifferencesJson,
}

/// Results of one agent alone.
#[derive(Serialize, JsonSchema)]
pub struct LocalJson {
    /// Number of the paper's table: `II` or `III`.
    table: Option<&'static str>,
    /// Name of the agent.
    agent: String,
    /// The agent's locality region.
    region: RegionJson,
    /// Number of permutations that are not counted, because they leave the region empty.
    skipped: usize,
    /// Number of independent draws to which the chain is equivalent.
    effective_draws: Option<DrawsJson>,
    /// Scores by policy and number of points.
    scores: Vec<LocalScoreJson>,
    /// Scores with all events of the region.
    all_events: Vec<OmegaScoreJson>,
    /// Bounds on the divergence from the posterior with all events.
    certificate: Vec<CertificateJson>,
    /// Rank correlation between each bound and the NLL.
    rank_correlation_with_nll: BTreeMap<&'static str, Option<EstimateJson>>,
}

#[derive(Serialize, JsonSchema)]
pub struct RegionJson {
    /// Centre in standardised units.
    centre_standardised: Vec<f64>,
    /// Number of events in the region.
    events: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct TeamJson {
    /// Number of the paper's table: `IV`, `V` or `VI`.
    table: Option<&'static str>,
    /// Number of permutations that are not counted, because they leave a region empty.
    skipped: usize,
    /// Scores by fusion, policy and number of points.
    scores: Vec<TeamScoreJson>,
    /// Scores with all events in one place.
    centralised: Vec<OmegaScoreJson>,
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
        Self {
            table: EVENTS_TABLE,
            data_set: set.name.clone(),
            log_digest: set.log().digest(),
            agents: agents.collect(),
        }
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
            table: published.and_then(|published| published.local_table(agent)),
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
            table: published.map(Published::team_table),
            skipped: outcome.permutations.len() - outcomes.len(),
            scores: keys.map(score).collect(),
            centralised: by_omega(|omega| mean(&outcomes, |outcome| outcome.centralised[&omega])),
        }
    }
}
