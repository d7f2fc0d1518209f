//! Tables of larger radii and more points than in the paper.

use pingmap_trial::paper::{DataSet, SWEEP_LENGTH_SCALES, SWEEP_POINTS, SweepRow};

use super::cells::{FAILS, HOLDS, NONE, UNCLEAR, mark, plain, verdict};
use super::results::Computed;
use super::table::Table;
use crate::output::count;

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
        "Each cell has one mark for each data set, in the order {}. {HOLDS} means that good points have a lower NLL than random ones by more \
         than two standard errors. {FAILS} means a higher NLL by as much, and {UNCLEAR} neither. A region with fewer events than points takes them all.",
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
