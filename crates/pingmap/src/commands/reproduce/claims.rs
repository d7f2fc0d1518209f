//! Tables of the paper's claims.

use pingmap_trial::Estimate;
use pingmap_trial::paper::statistics::Metric;
use pingmap_trial::paper::{AtRadius, Claim};

use super::cells::{FAILS, HOLDS, NONE, UNCLEAR, decimal, mark, verdict, verdict_by_t};
use super::results::{Computed, Who};
use super::table::Table;
use super::tables::radius_text;

/// Returns the differences that the paper's claims are about, in NLL and in accuracy.
pub fn claims(results: &Computed, at: &AtRadius) -> Vec<Table> {
    Metric::ALL.into_iter().map(|metric| claims_in(results, at, metric)).collect()
}

fn claims_in(results: &Computed, at: &AtRadius, metric: Metric) -> Table {
    let claims = Claim::all();
    let mut rows = Vec::new();
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
    let all = |of: fn(&Holding) -> usize| counts.iter().flatten().map(of).sum::<usize>();
    let failures = match (all(|holding| holding.of), all(|holding| holding.clearly_not)) {
        (0, _) => "could not be judged".to_owned(),
        (of, failures) => format!("clearly fails in {failures} of {of} cells"),
    };
    let note = format!(
        "Cells are paired differences over permutations, positive where the claim holds. Packets are concatenated, and ω is the \
         last draw. The error ± describes the divisions of one data set, not other trials. {HOLDS} holds and {FAILS} fails by more \
         than two of these errors; {UNCLEAR} marks all other cells. The last row takes the data set as the unit: mean and error \
         over the teams, and marks by Student's t at 5 %. Square brackets hold the difference in the paper's tables, which give no \
         standard errors. The order {failures}."
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
