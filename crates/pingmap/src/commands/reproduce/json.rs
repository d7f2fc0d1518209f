//! The same numbers for programs.

use std::collections::BTreeMap;

use pingmap_trial::paper::statistics::{
    Metric, bound_orders_nll, effective_draws, local_score, mean, mean_bound, team_score,
};
use pingmap_trial::paper::{AtRadius, Choice, Claim, DataSet, Fusion, Omega, SetOutcome, SweepRow};
use pingmap_trial::{Estimate, MeanScore, Score};
use serde_json::{Value, json};

use super::page;
use super::published::Published;
use super::results::{BOUNDS, Computed, Who};

/// Everything that was computed.
pub fn of(results: &Computed) -> Value {
    let sets = results.experiment.sets().iter().enumerate();
    json!({
        "schema": 1,
        "caveat": page::caveat(results),
        "seed": results.seed,
        "permutations": results.experiment.permutations(),
        "length_scale": results.experiment.length_scale(),
        "data_sets": sets.map(|(place, set)| data_set(place, set)).collect::<Vec<_>>(),
        "radii": results.radii.iter().map(|at| radius(results, at)).collect::<Vec<_>>(),
        "sweep": results.experiment.sets().iter().zip(&results.sweep).map(|(set, rows)| json!({
            "data_set": set.name, "rows": rows.iter().map(sweep_row).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
    })
}

fn data_set(place: usize, set: &DataSet) -> Value {
    let published = Published::at(place, set.agents().len());
    let agents = set.agents().iter().enumerate().map(|(n, agent)| {
        let (failures, successes) = set.failures_and_successes(agent);
        json!({
            "agent": agent.id.as_str(), "failures": failures, "successes": successes,
            "published": published.map(|published| {
                let (failures, successes) = published.events(n);
                json!({ "failures": failures, "successes": successes })
            }),
        })
    });
    json!({ "data_set": set.name, "agents": agents.collect::<Vec<_>>() })
}

fn radius(results: &Computed, at: &AtRadius) -> Value {
    let sets = results.sets(at).map(|(set, outcome, published)| {
        let agents = (0..set.agents().len()).map(|agent| local(set, outcome, agent, published));
        let claims = Who::all(set).flat_map(|who| Claim::all().into_iter().map(move |claim| (who, claim)));
        let claims = claims.map(|(who, claim)| {
            let ours = |metric| who.difference(outcome, &claim, metric).map(estimate);
            let theirs = |metric| who.published_difference(published, &claim, metric);
            json!({
                "who": who.name(set), "claim": claim.text(),
                "nll_difference": ours(Metric::Nll), "acc_difference": ours(Metric::Accuracy),
                "published": { "nll_difference": theirs(Metric::Nll), "acc_difference": theirs(Metric::Accuracy) },
            })
        });
        json!({
            "data_set": set.name, "agents": agents.collect::<Vec<_>>(), "team": team(outcome, published),
            "claims": claims.collect::<Vec<_>>(),
        })
    });
    let length_scales = at.radius / results.experiment.length_scale();
    json!({ "radius": at.radius, "length_scales": length_scales, "data_sets": sets.collect::<Vec<_>>() })
}

fn local(set: &DataSet, outcome: &SetOutcome, agent: usize, published: Option<Published>) -> Value {
    let outcomes = outcome.local(agent);
    let region = &outcome.regions[agent];
    let scores = Choice::all().flat_map(|choice| Omega::ALL.map(|omega| (choice, omega))).map(|(choice, omega)| {
        let theirs = published.filter(|_| omega == Omega::LastDraw);
        json!({
            "policy": choice.policy.name(), "points": choice.points, "omega": omega.name(),
            "score": local_score(&outcomes, choice, omega).map(score),
            "published": theirs.and_then(|published| published.local(agent, choice)).map(published_score),
        })
    });
    let all_events = Omega::ALL.map(|omega| {
        json!({ "omega": omega.name(), "score": mean(&outcomes, |outcome| outcome.all_events[&omega]).map(score) })
    });
    let certificate = Choice::all().map(|choice| {
        let bounds =
            BOUNDS.map(|(key, _, of)| (key.to_owned(), json!(mean_bound(&outcomes, choice, of).map(estimate))));
        json!({
            "policy": choice.policy.name(), "points": choice.points,
            "bounds": bounds.into_iter().collect::<serde_json::Map<_, _>>(),
        })
    });
    let correlations =
        BOUNDS.map(|(key, _, of)| (key.to_owned(), json!(bound_orders_nll(&outcomes, of).map(estimate))));
    json!({
        "agent": set.agents()[agent].id.as_str(),
        "region": { "centre_standardised": region.centre, "events": region.members.len() },
        "skipped": outcome.permutations.len() - outcomes.len(),
        "effective_draws": effective_draws(&outcomes).map(|draws| json!({ "mean": draws.mean, "least": draws.least })),
        "scores": scores.collect::<Vec<_>>(), "all_events": all_events,
        "certificate": certificate.collect::<Vec<_>>(),
        "rank_correlation_with_nll": correlations.into_iter().collect::<serde_json::Map<_, _>>(),
    })
}

fn team(outcome: &SetOutcome, published: Option<Published>) -> Value {
    let outcomes = outcome.team();
    let keys = Choice::all()
        .flat_map(|choice| Fusion::ALL.map(|fusion| (choice, fusion)))
        .flat_map(|(choice, fusion)| Omega::ALL.map(|omega| (choice, fusion, omega)));
    let scores = keys.map(|(choice, fusion, omega)| {
        let theirs = published.filter(|_| omega == Omega::LastDraw && fusion == Fusion::Concatenation);
        json!({
            "policy": choice.policy.name(), "points": choice.points, "fusion": fusion.name(), "omega": omega.name(),
            "score": team_score(&outcomes, choice, fusion, omega).map(score),
            "published": theirs.and_then(|published| published.team(choice)).map(published_score),
        })
    });
    let centralised = Omega::ALL.map(|omega| {
        json!({ "omega": omega.name(), "score": mean(&outcomes, |outcome| outcome.centralised[&omega]).map(score) })
    });
    json!({
        "skipped": outcome.permutations.len() - outcomes.len(),
        "scores": scores.collect::<Vec<_>>(), "centralised": centralised,
    })
}

fn sweep_row(row: &SweepRow) -> Value {
    let by_points = |estimates: &BTreeMap<usize, Estimate>| {
        let rows = estimates.iter().map(|(points, value)| json!({ "points": points, "nll": estimate(*value) }));
        rows.collect::<Vec<_>>()
    };
    json!({
        "length_scales": row.length_scales, "training_events": row.events, "skipped": row.skipped,
        "all_events": row.all_events.map(estimate), "good": by_points(&row.good),
        "random_minus_good": by_points(&row.gain),
    })
}

fn estimate(Estimate { mean, se }: Estimate) -> Value {
    json!({ "mean": mean, "se": se })
}

fn score(score: MeanScore) -> Value {
    let MeanScore { accuracy, accuracy_se, nll, nll_se } = score;
    json!({ "acc": accuracy, "acc_se": accuracy_se, "nll": nll, "nll_se": nll_se })
}

fn published_score(Score { accuracy, nll }: Score) -> Value {
    json!({ "acc": accuracy, "nll": nll })
}
