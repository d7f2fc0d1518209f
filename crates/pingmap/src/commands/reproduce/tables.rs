//! Tables of the experiment.

use dgpc::LocalityRegion;
use pingmap_trial::paper::statistics::{
    Metric, bound_orders_nll, effective_draws, local_score, mean, mean_bound, team_score,
};
use pingmap_trial::paper::{
    AtRadius, Choice, Claim, DRAWS, DataSet, Fusion, Omega, REGION_EVENTS_MAX, SWEEP_LENGTH_SCALES, SWEEP_POINTS,
    SetOutcome, SweepRow,
};
use pingmap_trial::{Estimate, MeanScore};

use super::cells::{FAILS, HOLDS, NONE, UNCLEAR, accuracy, bound, decimal, mark, nll, plain, verdict, verdict_by_t};
use super::published::{Published, PublishedScore};
use super::results::{BOUNDS, Computed, Who};
use super::table::Table;
use crate::output::count;

/// Returns the failures and successes of every agent.
pub fn events(results: &Computed) -> Table {
    let mut rows = Vec::new();
    for (place, set) in results.experiment.sets().iter().enumerate() {
        let published = Published::at(place, set.agents().len());
        for (n, agent) in set.agents().iter().enumerate() {
            let (failures, successes) = set.failures_and_successes(agent);
            let theirs = published.map(|published| published.events(n));
            let theirs = theirs.map_or([NONE.into(), NONE.into()], |(f, s)| [f.to_string(), s.to_string()]);
            let ours = [
                format!("{} ({})", set.name, place + 1),
                agent.id.to_string(),
                failures.to_string(),
                successes.to_string(),
            ];
            rows.push(ours.into_iter().chain(theirs).collect());
        }
    }
    let header = ["data set", "agent", "failures", "successes", "published failures", "published successes"];
    let note = "The number in brackets is the place among the paper's data sets.";
    Table::new("Events, by the agent that received them or should have", &header, rows, note)
}

/// Returns the centres of the regions, and their numbers of events.
pub fn regions(results: &Computed) -> Table {
    let mut rows = Vec::new();
    for (place, set) in results.experiment.sets().iter().enumerate() {
        for (n, agent) in set.agents().iter().enumerate() {
            for at in &results.radii {
                let region = &at.sets[place].regions[n];
                let skipped = at.sets[place].permutations.len() - at.sets[place].local(n).len();
                let draws = effective_draws(&at.sets[place].local(n));
                rows.push(vec![
                    format!("{} {}", set.name, agent.id),
                    format!("{:.3}", at.radius),
                    centre_m(set, region),
                    region.members.len().to_string(),
                    skipped.to_string(),
                    draws.map_or(NONE.into(), |draws| format!("{:.0} ({:.0})", draws.mean, draws.least)),
                ]);
            }
        }
    }
    let header = ["agent", "radius", "centre: transmitter → receiver (m)", "events", "skipped", "effective draws"];
    let note = format!(
        "The centre is the agent's event with the most own events within the radius, held out or not; the first of equals (of more than a \
         thousand events, a thousand are tried). The regions of a data set hold at most {REGION_EVENTS_MAX} events together, in equal shares, those nearest to the centres. A permutation \
         that leaves the region without training or held-out events is skipped. Effective draws: the number of independent draws to which the {DRAWS} draws of the chain are \
         equivalent for the latent function at an event; mean over events and permutations (and the least)."
    );
    Table::new("Locality regions", &header, rows, note)
}

/// Formats the link at the centre of a region.
fn centre_m(set: &DataSet, region: &LocalityRegion) -> String {
    // The centre is one of the members.
    let nearest = region.members.iter().find(|&&event| set.standardised(event) == region.centre);
    nearest.map_or(NONE.into(), |&event| {
        let link = &set.log().events[event].link;
        let place = |end: &pingmap_agent::Position| format!("{:.0}, {:.0}", end.east_m, end.north_m);
        format!("{} → {}", place(&link.transmitter), place(&link.receiver))
    })
}

/// Returns the differences that the paper's claims are about, in NLL and in accuracy.
pub fn claims(results: &Computed, at: &AtRadius) -> Vec<Table> {
    Metric::ALL.into_iter().map(|metric| claims_in(results, at, metric)).collect()
}

fn claims_in(results: &Computed, at: &AtRadius, metric: Metric) -> Table {
    let claims = Claim::all();
    let mut rows = Vec::new();
    let mut failures = Vec::new();
    let mut counts = [vec![Holding::default(); claims.len()], vec![Holding::default(); claims.len()]];
    let mut of_teams = vec![Vec::new(); claims.len()];
    for (set, outcome, published) in results.sets(at) {
        for who in Who::all(set) {
            let mut row = vec![who.name(set)];
            for (n, claim) in claims.iter().enumerate() {
                let difference = who.difference(outcome, claim, metric);
                let theirs = who.published_difference(published, claim, metric);
                let theirs = theirs.map_or(String::new(), |theirs| format!(" [{}]", decimal(theirs)));
                row.push(verdict(difference) + &theirs);
                let Some(difference) = difference else { continue };
                let is_team = matches!(who, Who::Team);
                counts[usize::from(is_team)][n].count(difference);
                of_teams[n].extend(is_team.then_some(difference.mean));
                if mark(difference) == FAILS {
                    failures.push(format!("{} ({})", claim.text(), who.name(set)));
                }
            }
            rows.push(row);
        }
    }
    for (name, counts) in ["agents for which it holds", "teams for which it holds"].iter().zip(&counts) {
        rows.push([name.to_string()].into_iter().chain(counts.iter().map(Holding::text)).collect());
    }
    let over_sets = of_teams.iter().map(|differences| verdict_by_t(Estimate::over(differences)));
    rows.push(["teams, over data sets".to_owned()].into_iter().chain(over_sets).collect());
    let texts: Vec<String> = claims.iter().map(Claim::text).collect();
    let title = format!("Does the order hold in {}? {}", metric.name(), radius_text(results, at));
    let header: Vec<&str> = ["difference"].into_iter().chain(texts.iter().map(String::as_str)).collect();
    let failures = match failures.as_slice() {
        _ if counts.iter().flatten().all(|holding| holding.of == 0) => "could not be judged anywhere".to_owned(),
        [] => "clearly fails nowhere".to_owned(),
        failures => format!("clearly fails: {}", failures.join("; ")),
    };
    let note = format!(
        "Paired differences over permutations, positive where the claim holds, packets concatenated, ω the last draw. ± is the error of dividing \
         one data set a limited number of times, which vanishes with more permutations; it does not describe other \
         trials. {HOLDS} holds and {FAILS} fails by more than two of these errors, {UNCLEAR} neither. The last row takes the data set as \
         the unit: mean and error over the teams, and {HOLDS} or {FAILS} by Student's t at 5 %. In square brackets the same difference in the paper's tables, \
         which give no standard errors. The order {failures}."
    );
    Table::new(title, &header, rows, note)
}

/// Number of agents or teams for which a claim holds, with the number of significant results.
#[derive(Clone, Default)]
struct Holding {
    of: usize,
    holding: usize,
    clearly: usize,
    clearly_not: usize,
}

impl Holding {
    fn count(&mut self, difference: Estimate) {
        self.of += 1;
        self.holding += usize::from(difference.mean > 0.0);
        self.clearly += usize::from(mark(difference) == HOLDS);
        self.clearly_not += usize::from(mark(difference) == FAILS);
    }

    fn text(&self) -> String {
        let Self { of, holding, clearly, clearly_not } = self;
        if *of == 0 { NONE.into() } else { format!("{holding} of {of} ({clearly} {HOLDS}, {clearly_not} {FAILS})") }
    }
}

/// Returns the scores of an agent's predictions for its own held-out events in the region.
pub fn local(results: &Computed, at: &AtRadius) -> Vec<Table> {
    let tables = results.sets(at).map(|(set, outcome, published)| {
        let mut rows = Vec::new();
        for (n, agent) in set.agents().iter().enumerate() {
            let outcomes = outcome.local(n);
            for choice in Choice::all() {
                let score = |omega| local_score(&outcomes, choice, omega);
                let theirs = published.and_then(|published| published.local(n, choice));
                rows.push(local_row(&agent.id.to_string(), &choice_text(choice), score, theirs));
            }
            let everything = |omega| mean(&outcomes, |outcome| outcome.all_events[&omega]);
            rows.push(local_row(&agent.id.to_string(), "all events", everything, None));
        }
        let title = format!("{}: every agent by itself, {}", set.name, radius_text(results, at));
        let header = [
            "agent",
            "points",
            "ACC",
            "NLL",
            "published ACC",
            "published NLL",
            "NLL, averaged draws",
            "NLL, mean field",
        ];
        Table::new(title, &header, rows, "")
    });
    tables.collect()
}

fn local_row(
    agent: &str,
    choice: &str,
    score: impl Fn(Omega) -> Option<MeanScore>,
    published: Option<PublishedScore>,
) -> Vec<String> {
    let last = score(Omega::LastDraw);
    vec![
        agent.into(),
        choice.into(),
        accuracy(last),
        nll(last),
        published.map_or(NONE.into(), |score| decimal(score.accuracy)),
        published.map_or(NONE.into(), |score| decimal(score.nll)),
        nll(score(Omega::AveragedDraws)),
        nll(score(Omega::MeanField)),
    ]
}

/// Returns the scores of the team's predictions, with the paper's ω and with the others.
pub fn team(results: &Computed, at: &AtRadius) -> Vec<Table> {
    results
        .sets(at)
        .flat_map(|(set, outcome, published)| {
            let title = format!("{}: the team, {}", set.name, radius_text(results, at));
            [team_paper(outcome, published, &title), team_omegas(outcome, &title)]
        })
        .collect()
}

fn team_paper(outcome: &SetOutcome, published: Option<Published>, title: &str) -> Table {
    let outcomes = outcome.team();
    let row = |choice| {
        let score = |fusion| team_score(&outcomes, choice, fusion, Omega::LastDraw);
        let theirs = published.and_then(|published| published.team(choice));
        vec![
            choice_text(choice),
            accuracy(score(Fusion::Concatenation)),
            nll(score(Fusion::Concatenation)),
            theirs.map_or(NONE.into(), |score| decimal(score.accuracy)),
            theirs.map_or(NONE.into(), |score| decimal(score.nll)),
            nll(score(Fusion::SiteFusion)),
            nll(score(Fusion::OwnAndPackets)),
        ]
    };
    let centralised = |omega| mean(&outcomes, |outcome| outcome.centralised[&omega]);
    let note = format!(
        "All training events of the regions in one place: ACC {}, NLL {} (averaged draws {}, mean field {}). {}",
        accuracy(centralised(Omega::LastDraw)),
        nll(centralised(Omega::LastDraw)),
        nll(centralised(Omega::AveragedDraws)),
        nll(centralised(Omega::MeanField)),
        count(outcome.permutations.len() - outcomes.len(), "permutation") + " skipped.",
    );
    let header = [
        "points of every agent",
        "ACC, concatenation",
        "NLL, concatenation",
        "published ACC",
        "published NLL",
        "NLL, site fusion",
        "NLL, own events + packets",
    ];
    Table::new(format!("{title}, ω the last draw of Gibbs"), &header, Choice::all().map(row).collect(), note)
}

fn team_omegas(outcome: &SetOutcome, title: &str) -> Table {
    let outcomes = outcome.team();
    let columns: Vec<(Fusion, Omega)> = Fusion::ALL
        .into_iter()
        .flat_map(|fusion| [Omega::AveragedDraws, Omega::MeanField].map(|omega| (fusion, omega)))
        .collect();
    let row = |choice| {
        let scores = columns.iter().map(|&(fusion, omega)| nll(team_score(&outcomes, choice, fusion, omega)));
        [choice_text(choice)].into_iter().chain(scores).collect()
    };
    let names: Vec<String> =
        columns.iter().map(|(fusion, omega)| format!("{}, {}", fusion.name(), omega.name())).collect();
    let header: Vec<&str> = ["NLL"].into_iter().chain(names.iter().map(String::as_str)).collect();
    Table::new(format!("{title}, other ω"), &header, Choice::all().map(row).collect(), "")
}

/// Returns the bounds, and whether they order the choices as NLL does.
pub fn certificate(results: &Computed, at: &AtRadius) -> Vec<Table> {
    let mut rows = Vec::new();
    let mut orders = Vec::new();
    for (set, outcome, _) in results.sets(at) {
        for (n, agent) in set.agents().iter().enumerate() {
            let outcomes = outcome.local(n);
            let name = format!("{} {}", set.name, agent.id);
            for choice in Choice::all() {
                let bounds = BOUNDS.iter().map(|(_, _, of)| bound(mean_bound(&outcomes, choice, *of)));
                let score = nll(local_score(&outcomes, choice, Omega::LastDraw));
                rows.push([name.clone(), choice_text(choice)].into_iter().chain(bounds).chain([score]).collect());
            }
            let correlations = BOUNDS.iter().map(|(_, _, of)| plain(bound_orders_nll(&outcomes, *of)));
            orders.push([name].into_iter().chain(correlations).collect());
        }
    }
    let names: Vec<&str> = BOUNDS.iter().map(|(_, name, _)| *name).collect();
    let radius = radius_text(results, at);
    let header: Vec<&str> = ["agent", "points"].into_iter().chain(names.iter().copied()).chain(["NLL"]).collect();
    let note = "KL divergence of the posterior at the points from that of all training events of the region, and its bounds, in nats; \
                means over permutations, ω the last draw.";
    let bounds = Table::new(format!("The certificate, {radius}"), &header, rows, note);
    let header: Vec<&str> = ["rank correlation with NLL"].into_iter().chain(names).collect();
    let note = "Spearman's rank correlation between a bound and the NLL of held-out events over the six choices (three policies, one and \
                two points) within a permutation; mean and standard error over permutations. At +1 the bound orders them as NLL does.";
    vec![bounds, Table::new(format!("Does the bound order the choices? {radius}"), &header, orders, note)]
}

/// Returns the results for larger radii and more points than in the paper.
pub fn sweep(results: &Computed) -> Vec<Table> {
    if results.sweep.is_empty() {
        return Vec::new();
    }
    let sets = results.experiment.sets().iter().zip(&results.sweep);
    let tables = sets.flat_map(|(set, rows)| [sweep_good(set, rows), sweep_gain(set, rows)]);
    [sweep_marks(results)].into_iter().chain(tables).collect()
}

/// Returns a table of marks: whether good points are better than random ones.
fn sweep_marks(results: &Computed) -> Table {
    let row = |(place, length_scales): (usize, f64)| {
        let marks = |points: usize| -> String {
            results.sweep.iter().map(|rows| rows[place].gain.get(&points).map_or(NONE, |gain| mark(*gain))).collect()
        };
        [length_scales.to_string()].into_iter().chain(SWEEP_POINTS.into_iter().map(marks)).collect()
    };
    let names: Vec<&str> = results.experiment.sets().iter().map(|set| set.name.as_str()).collect();
    let note = format!(
        "One mark for each data set, in the order {}: good points have a lower NLL than random ones by more than two standard errors \
         ({HOLDS}), a higher one ({FAILS}), or neither ({UNCLEAR}). A region with fewer events than points takes them all.",
        names.join(", ")
    );
    let rows = SWEEP_LENGTH_SCALES.into_iter().enumerate().map(row).collect();
    Table::new("Where the policy pays", &sweep_header(&["radius / ℓ"]), rows, note)
}

fn sweep_good(set: &DataSet, rows: &[SweepRow]) -> Table {
    let row = |row: &SweepRow| {
        let start = [row.length_scales.to_string(), format!("{:.0}", row.events), plain(row.all_events)];
        start.into_iter().chain(SWEEP_POINTS.into_iter().map(|points| plain(row.good.get(&points).copied()))).collect()
    };
    Table::new(
        format!("{}: NLL of good points", set.name),
        &sweep_header(&["radius / ℓ", "training events", "all events"]),
        rows.iter().map(row).collect(),
        "Local NLL, the mean over the agents; ω by mean field.",
    )
}

fn sweep_gain(set: &DataSet, rows: &[SweepRow]) -> Table {
    let row = |row: &SweepRow| {
        let cells = SWEEP_POINTS.into_iter().map(|points| verdict(row.gain.get(&points).copied()));
        [row.length_scales.to_string()].into_iter().chain(cells).collect()
    };
    let rows = rows.iter().map(row).collect();
    Table::new(
        format!("{}: NLL of random points minus that of good ones", set.name),
        &sweep_header(&["radius / ℓ"]),
        rows,
        "",
    )
}

fn sweep_header(first: &[&str]) -> Vec<String> {
    let points = SWEEP_POINTS.map(|points| count(points, "point"));
    first.iter().map(|name| name.to_string()).chain(points).collect()
}

fn choice_text(choice: Choice) -> String {
    format!("{} {}", if choice.points == 1 { "one" } else { "two" }, choice.policy.name())
}

/// Names the radius of a table.
pub fn radius_text(results: &Computed, at: &AtRadius) -> String {
    let ratio = at.radius / results.experiment.length_scale();
    format!("r = {:.3} ({ratio:.3} ℓ)", at.radius)
}
