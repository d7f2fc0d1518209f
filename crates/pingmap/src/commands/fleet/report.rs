//! The result of a fleet as text.

use pingmap_trial::{Online, Step};

use super::mission::{Killed, Known, Outcome};
use crate::output::{count, table};

/// Returns the report of a mission.
pub fn text(name: &str, outcome: &Outcome, replayed: &Online) -> String {
    let vehicles = replayed.team.members.len();
    let mut text = format!("{name}: {}, each a process\n", count(vehicles, "vehicle"));
    if let Some(Killed { vehicle, time_s, events: [before, after] }) = &outcome.killed {
        text += &format!(
            "{vehicle} was killed at {time_s:.0} s and started again: {} before, {after} after\n",
            count(*before, "own event")
        );
    }
    text += &format!(
        "\n{}\n\n{}\n",
        table(
            &["", "vehicle", "own events", "others' events", "NLL so far", "weight of the map"],
            &known_rows(outcome)
        ),
        comparison(outcome, replayed)
    );
    text += "\nNLL: negative log-likelihood in nats of own events, each predicted before it was learned; lower is better.\n";
    text += "Weight of the map: its posterior probability next to range alone, by the last 200 own events.";
    text
}

fn known_rows(outcome: &Outcome) -> Vec<Vec<String>> {
    let row = |known: &Known| {
        vec![
            format!("{:.0} %", 100.0 * known.share),
            known.vehicle.to_string(),
            known.own_events.to_string(),
            known.other_events.to_string(),
            known.nll.map_or("-".into(), |nll| format!("{nll:.3}")),
            format!("{:.2}", known.trust.map_weight),
        ]
    };
    outcome.known.iter().map(row).collect()
}

/// Compares the processes with a replay of the same mission in this process.
fn comparison(outcome: &Outcome, replayed: &Online) -> String {
    let row = |name: &str, nll: f64, events: usize| vec![name.to_owned(), format!("{nll:.4}"), events.to_string()];
    let mut rows = vec![row("these processes", outcome.nll, outcome.scored)];
    if let Some(mean) = Step::mean(&replayed.steps) {
        let events = replayed.steps.len();
        rows.push(row("`replay --online` of the same mission", mean.team, events));
        rows.push(row("own events alone", mean.own, events));
        rows.push(row("range alone", mean.range_only, events));
    }
    table(&["", "NLL", "events"], &rows)
}
