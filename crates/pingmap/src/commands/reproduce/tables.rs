//! Tables of the experiment.

use dgpc::LocalityRegion;
use pingmap_trial::MeanScore;
use pingmap_trial::paper::statistics::{bound_orders_nll, effective_draws, local_score, mean, mean_bound, team_score};
use pingmap_trial::paper::{AtRadius, Choice, DRAWS, DataSet, Fusion, Omega, REGION_EVENTS_MAX, SetOutcome};

use super::cells::{NONE, accuracy, bound, decimal, nll, plain};
use super::published::{EVENTS_TABLE, Published, PublishedScore};
use super::results::{BOUNDS, Computed};
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
    Table::new(numbered(Some(EVENTS_TABLE), "events of every agent as the receiver"), &header, rows, note)
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
        "The centre is the agent's event with the most own events within the radius, held out or not; the first of equals. Of more \
         than a thousand events, a thousand are tried. The regions of a data set hold at most {REGION_EVENTS_MAX} events together. \
         Regions have equal shares and keep the events nearest to their centres. A permutation is skipped if it leaves a region \
         without training or held-out events. Effective draws: the number of independent draws that are worth as much as the {DRAWS} \
         draws of the chain, for the latent function at an event. The column shows the mean over events and permutations, and in \
         brackets the least."
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

/// Returns the scores of every agent's predictions for its own held-out events in the region: one table for each agent.
pub fn local(results: &Computed, at: &AtRadius) -> Vec<Table> {
    let header = ["points", "ACC", "NLL", "published ACC", "published NLL", "NLL, averaged draws", "NLL, mean field"];
    let of_agent = |set: &DataSet, outcome: &SetOutcome, published: Option<Published>, n: usize| {
        let outcomes = outcome.local(n);
        let row = |choice| {
            let theirs = published.and_then(|published| published.local(n, choice));
            local_row(&choice_text(choice), |omega| local_score(&outcomes, choice, omega), theirs)
        };
        let everything = |omega| mean(&outcomes, |outcome| outcome.all_events[&omega]);
        let rows = Choice::all().map(row).chain([local_row("all events", everything, None)]).collect();
        let name = format!("{} {} alone, {}", set.name, set.agents()[n].id, radius_text(results, at));
        let number = published.and_then(|published| published.local_table(n));
        Table::new(numbered(number, &name), &header, rows, "")
    };
    let of_set =
        |(set, outcome, published)| (0..DataSet::agents(set).len()).map(move |n| of_agent(set, outcome, published, n));
    results.sets(at).flat_map(of_set).collect()
}

fn local_row(
    choice: &str,
    score: impl Fn(Omega) -> Option<MeanScore>,
    published: Option<PublishedScore>,
) -> Vec<String> {
    let last = score(Omega::LastDraw);
    vec![
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
    let tables = results.sets(at).flat_map(|(set, outcome, published)| {
        let title = format!("{} team, {}", set.name, radius_text(results, at));
        let number = published.map(Published::team_table);
        [team_paper(outcome, published, &numbered(number, &title)), team_omegas(outcome, &title)]
    });
    tables.collect()
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
    let note = "KL is the divergence of the posterior at the points from that of all training events of the region. Gap, closed form \
                and the paper's bound are bounds on it. Values are means over permutations in nats, and ω is the last draw.";
    let bounds = Table::new(format!("The certificate, {radius}"), &header, rows, note);
    let header: Vec<&str> = ["rank correlation with NLL"].into_iter().chain(names).collect();
    let note = "Cells are Spearman's rank correlation between a bound and the NLL of held-out events, over the six choices of one \
                permutation. They show the mean and its standard error over permutations. At +1 the bound orders the choices as NLL does.";
    vec![bounds, Table::new(format!("Does the bound order the choices? {radius}"), &header, orders, note)]
}

/// Returns a title with the number of the paper's table, if the paper has one.
fn numbered(number: Option<&str>, title: &str) -> String {
    number.map_or_else(|| title.to_owned(), |number| format!("Table {number}: {title}"))
}

fn choice_text(choice: Choice) -> String {
    format!("{} {}", if choice.points == 1 { "one" } else { "two" }, choice.policy.name())
}

/// Names the radius of a table.
pub fn radius_text(results: &Computed, at: &AtRadius) -> String {
    let ratio = at.radius / results.experiment.length_scale();
    format!("r = {:.3} ({ratio:.3} ℓ)", at.radius)
}
