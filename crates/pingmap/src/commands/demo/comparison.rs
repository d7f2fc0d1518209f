//! The table of the demo: predictions without sharing, from summaries, from reports, and from all events.

use pingmap_trial::paper::Policy;
use pingmap_trial::{Alternative, MeanScore, Sharing};

use crate::commands::replay::Replayed;
use crate::output::{count, table};
use crate::page::Page;

/// A method and its score.
pub struct Row {
    pub method: &'static str,
    /// Number of packets of each vehicle; `None` without sharing.
    pub packets: Option<usize>,
    /// Bytes that each vehicle sends; `None` for all events in one place.
    pub bytes: Option<f64>,
    pub score: MeanScore,
}

/// Returns the rows from no sharing to all events.
pub fn rows(replayed: &Replayed) -> Vec<Row> {
    let replay = &replayed.replay;
    let alone = |method, score| Row { method, packets: None, bytes: Some(0.0), score };
    let frame_bytes = replayed.layout().map_or(0, |layout| layout.frame_bytes) as f64;
    let shared = |method, sharing: &Sharing, bytes, score| Row {
        method,
        packets: Some(sharing.frames),
        bytes: Some(bytes),
        score,
    };
    let mut rows = vec![alone("distance only", replay.distance_only), alone("own events only", replay.own)];
    for (method, way) in SUMMARIES {
        for sharing in &replay.sharing {
            let score = sharing.alternatives.iter().find(|(tried, _)| *tried == way).map(|(_, score)| *score);
            rows.extend(score.map(|score| shared(method, sharing, frame_bytes * sharing.frames as f64, score)));
        }
    }
    rows.extend(
        replay
            .sharing
            .iter()
            .map(|sharing| shared("event reports + own events", sharing, sharing.traffic.bytes, sharing.team)),
    );
    rows.push(Row { bytes: None, ..alone("all events in one place", replay.centralised) });
    rows
}

/// Ways of sharing summaries: the paper's, and our own.
const SUMMARIES: [(&str, Alternative); 2] = [
    ("summaries, paper's scheme", Alternative::Concatenation(Policy::Good)),
    ("summaries + own events", Alternative::SummariesOnly),
];

const HEADER: [&str; 5] = ["each vehicle predicts from", "packets", "bytes", "NLL ± s.e.", "accuracy"];

/// Explanations of the rows, then advice on the two ways of sharing, in lines of at most 100 characters.
const NOTES: [&str; 5] = [
    "NLL: negative log-likelihood of held-out events in nats; lower is better.",
    "Paper's scheme: each packet is a package {Z, μ, Σ} of one locality region. The inducing points Z\n\
     minimise tr K̃. Each vehicle concatenates all packages, and uses no raw events.",
    "A concatenation counts the prior once a package, so overlapping regions make it worse.",
    "Use event reports if the team has a transmission schedule and few events.",
    "Use summaries if there is no schedule, or if there are more events than reports can carry.",
];

fn cells(rows: &[Row]) -> Vec<Vec<String>> {
    let dash = || "–".to_owned();
    let row = |Row { method, packets, bytes, score }: &Row| {
        let error = score.nll.se.map_or_else(dash, |error| format!("{error:.4}"));
        vec![
            (*method).to_owned(),
            packets.map_or_else(dash, |packets| packets.to_string()),
            bytes.map_or_else(dash, |bytes| format!("{bytes:.0}")),
            format!("{:.4} ± {error}", score.nll.mean),
            format!("{:.1} %", 100.0 * score.accuracy.mean),
        ]
    };
    rows.iter().map(row).collect()
}

/// Returns the table as text, with notes and advice.
pub fn text(replayed: &Replayed, rows: &[Row]) -> String {
    let events = count(replayed.log.events.len(), "event");
    let vehicles = count(replayed.replay.vehicles.len(), "vehicle");
    let splits = count(replayed.splits.len(), "split");
    let table = table(&HEADER, &cells(rows));
    format!("{events}, {vehicles}; mean of {splits}, seed {}\n\n{table}\n\n{}", replayed.plan.seed, NOTES.join("\n"))
}

/// Adds the table to the report.
pub fn section(page: &mut Page, rows: &[Row]) {
    page.heading("Summaries or reports?");
    page.table(&HEADER, &cells(rows));
    NOTES.iter().for_each(|line| page.paragraph(line));
}
