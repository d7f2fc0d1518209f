//! `pingmap replay --online`: the mission in the order of time.

use std::path::Path;

use pingmap_trial::{Agreed, EventLog, Online, Plan, Step};
use serde_json::{Value, json};

use crate::cli;
use crate::figure::{Figure, Mark, Series, Style, curves};
use crate::output::{count, note, print, print_json, progress, table, write_file};
use crate::report;

/// Rows of the table.
const PARTS: usize = 10;

/// Places along a curve.
const CURVE_POINTS: usize = 200;

/// One of the things compared: a name, how its curve looks, and its part of a step.
type Way = (&'static str, Style<'static>, fn(&Step) -> f64);

const WAYS: [Way; 3] = [
    ("own events only", Style { color: "#d7301f", width: 1.6, dash: &[2.0, 3.0], mark: Mark::Triangle }, |step| {
        step.own
    }),
    ("team", Style { color: "#0571b0", width: 2.2, dash: &[], mark: Mark::Dot }, |step| step.team),
    (
        "all events at once, without delay",
        Style { color: "#404040", width: 1.6, dash: &[7.0, 4.0], mark: Mark::Square },
        |step| step.centralised,
    ),
];

/// Transmissions between packets where nothing is said of it.
const SLOT_EVERY: usize = 10;

fn slot_every(options: &cli::Replay) -> usize {
    options.slot_every.unwrap_or(SLOT_EVERY)
}

pub fn run(log: &EventLog, plan: &Plan, options: &cli::Replay) -> anyhow::Result<()> {
    let bar = progress(log.events.len() as u64, "replaying in the order of time");
    let online = pingmap_trial::online(log, plan, slot_every(options), &|| bar.inc(1))?;
    bar.finish_and_clear();
    if options.json {
        print_json(&to_json(&online, options))?;
    } else {
        print(&text(&online, plan, options))?;
    }
    if let Some(folder) = &options.report {
        note(format_args!("report: {}", write_report(&online, plan, options, folder)?.display()));
    }
    Ok(())
}

fn headline(online: &Online, plan: &Plan, options: &cli::Replay) -> String {
    let packets: usize = online.packets.values().sum();
    let model = match plan.agreed {
        Agreed::Nothing => "the model is what is expected before any event; give --model for a learned one",
        Agreed::Model(_) | Agreed::Team(_) => "model as given",
    };
    let vehicles = online.team.members.len();
    format!(
        "{} in the order of time, {}; a packet every {} of a vehicle at most\n{}, {}, heard {}; {model}",
        count(online.steps.len(), "event"),
        count(vehicles, "vehicle"),
        count(slot_every(options), "transmission"),
        count(packets, "packet"),
        count(online.bytes, "byte"),
        count(online.received, "time"),
    )
}

/// NLL in each part of the mission, and over all of it.
fn rows(online: &Online) -> Vec<Vec<String>> {
    let size = online.steps.len().div_ceil(PARTS).max(1);
    let row =
        |name: String, step: &Step| [vec![name], WAYS.map(|(_, _, of)| format!("{:.4}", of(step))).to_vec()].concat();
    let parts = online.steps.chunks(size).filter_map(|part| {
        let mean = Step::mean(part)?;
        Some(row(format!("{:.0} s to {:.0} s", part.first()?.time_s, mean.time_s), &mean))
    });
    parts.chain(Step::mean(&online.steps).map(|mean| row("all".to_owned(), &mean))).collect()
}

fn header() -> Vec<&'static str> {
    ["NLL of coming events"].into_iter().chain(WAYS.map(|(name, _, _)| name)).collect()
}

fn text(online: &Online, plan: &Plan, options: &cli::Replay) -> String {
    format!(
        "{}\n\n{}\n\nNLL: negative log-likelihood in nats of every event as its receiver saw it coming, lower is better.",
        headline(online, plan, options),
        table(&header(), &rows(online))
    )
}

fn to_json(online: &Online, options: &cli::Replay) -> Value {
    let step = |step: &Step| json!({ "time_s": step.time_s, "own": step.own, "team": step.team, "centralised": step.centralised });
    let packets: Value = online.packets.iter().map(|(id, count)| (id.as_str().to_owned(), json!(count))).collect();
    json!({
        "schema": 1, "events": online.steps.len(), "slot_every": slot_every(options), "seed": options.work.seed,
        "packets": packets, "bytes": online.bytes, "received": online.received,
        "nll": Step::mean(&online.steps).as_ref().map(step),
        "running_nll": running(online).iter().map(step).collect::<Vec<_>>(),
    })
}

/// Mean NLL of all events so far, at places spread over the mission.
fn running(online: &Online) -> Vec<Step> {
    let (count, places) = (online.steps.len(), online.steps.len().min(CURVE_POINTS));
    (1..=places).filter_map(|n| Step::mean(&online.steps[..n * count / places])).collect()
}

fn figure(online: &Online) -> Figure {
    let running = running(online);
    // The mean of the first few events swings too widely to show.
    let settled = &running[(running.len() / 20).min(running.len().saturating_sub(2))..];
    let points = WAYS.map(|(_, _, of)| settled.iter().map(|step| (step.time_s, of(step))).collect::<Vec<_>>());
    let series: Vec<Series> =
        WAYS.iter().zip(&points).map(|(&(name, style, _), points)| Series { name, points, style }).collect();
    let title = "How well coming events are predicted, so far";
    curves(title, "time (s)", "mean NLL so far (nats)", &series, (620.0, 380.0))
}

fn write_report(
    online: &Online,
    plan: &Plan,
    options: &cli::Replay,
    folder: &Path,
) -> anyhow::Result<std::path::PathBuf> {
    let figure = figure(online);
    write_file(&folder.join("online.png"), &figure.png()?)?;
    let page = folder.join("index.html");
    write_file(
        &page,
        report::online_page(&headline(online, plan, options), &header(), &rows(online), &figure).as_bytes(),
    )?;
    Ok(page)
}
