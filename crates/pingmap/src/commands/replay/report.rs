//! The report of a replay: one self-contained HTML page, and its figures as PNG beside it.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use pingmap_agent::{Agent, Attempt, Link, Position, VehicleId, When};
use pingmap_trial::{Agreed, Mission, Plan};

use super::replayed::Replayed;
use super::tables::{self, SHARING_HEADER};
use crate::contour::Point;
use crate::figure::{Arrows, Figure, Mark, Style, link_map};
use crate::files::write_file;
use crate::output::spinner;
use crate::success_map::{SIDE, SuccessMap};
use crate::tracks;
use crate::values::End;

/// Packets of every vehicle behind the map, if the replay went that far.
const FRAMES_SHOWN: usize = 10;

/// Packets of every vehicle whose points are drawn; more would hide each other.
const PACKETS_DRAWN: usize = 2;

/// Writes the report to a folder that is there, and returns its page.
pub fn write(replayed: &Replayed, folder: &Path) -> anyhow::Result<PathBuf> {
    let bar = spinner("drawing the report");
    let pictures = Pictures::draw(replayed)?;
    let page = folder.join("index.html");
    write_file(&folder.join("map.png"), &pictures.map.png()?)?;
    write_file(&folder.join("packets.png"), &pictures.packets.png()?)?;
    write_file(&page, html(replayed, &pictures).as_bytes())?;
    bar.finish_and_clear();
    Ok(page)
}

struct Pictures {
    /// Whose map it is.
    viewer: VehicleId,
    frames: usize,
    split: String,
    map: Figure,
    packets: Figure,
}

impl Pictures {
    /// Plays the first split once more, up to [`FRAMES_SHOWN`] packets, and draws what the first vehicle then knows.
    fn draw(replayed: &Replayed) -> anyhow::Result<Self> {
        let counts = replayed.replay.sharing.iter().map(|sharing| sharing.frames);
        let frames = counts.clone().filter(|&frames| frames <= FRAMES_SHOWN).max().or(counts.min()).unwrap_or(0);
        let split = replayed.splits.first().context("a replay has at least one split")?;
        // What the team had agreed on in this split.
        let found = replayed.replay.splits.first().context("a replay has at least one split")?;
        let plan = Plan { agreed: Agreed::Team(Box::new((*found.team).clone())), ..replayed.plan.clone() };
        let mission = Mission::prepare(&replayed.log, split, &plan, frames)?;
        let mut team = mission.after_sharing(frames)?;
        let viewer = team.first_mut().context("every log has a receiver")?;
        let at = last_position(viewer).unwrap_or_else(|| replayed.log.events[0].link.receiver);
        // How a typical vehicle hears the viewer at the end of what it learned from.
        let end_s = viewer.events().last().map(|event| event.time_s);
        let (transmitter, when) = (viewer.id().into(), end_s.map_or(When::Typical, When::At));
        let asked = |link| Attempt { transmitter, when, ..Attempt::from(link) };
        let events = &replayed.log.events;
        let map = SuccessMap::new(viewer, events, (at, End::Tx), &asked, None)?;
        let mut sent = viewer.links_of_packets();
        sent.extend(mission.links_of_packets(0, frames));
        Ok(Self {
            viewer: viewer.id().clone(),
            frames,
            split: split.name.clone(),
            map: map.figure(&replayed.log.events),
            packets: packets_figure(replayed, &sent),
        })
    }
}

/// Where a vehicle received last.
fn last_position(agent: &Agent) -> Option<Position> {
    agent.events().last().map(|event| event.link.receiver)
}

/// The links of packets, by sender and counter.
type Sent = Vec<(VehicleId, u16, Vec<Link>)>;

/// The inducing points that everybody sent, as arrows from transmitter to receiver over the tracks.
fn packets_figure(replayed: &Replayed, sent: &Sent) -> Figure {
    let mut arrows: BTreeMap<&VehicleId, Vec<(Point, Point)>> = BTreeMap::new();
    for (sender, _, links) in sent.iter().filter(|(_, counter, _)| usize::from(*counter) < PACKETS_DRAWN) {
        let end = |place: Position| (place.east_m, place.north_m);
        let pairs = links.iter().map(|link| (end(link.transmitter), end(link.receiver)));
        arrows.entry(sender).or_default().extend(pairs);
    }
    let tracks = tracks::tracks(&replayed.log.events);
    let place = |id: &VehicleId| tracks.keys().position(|other| *other == id).unwrap_or_default();
    let names: Vec<String> = arrows.keys().map(|id| format!("sent by {id}")).collect();
    let groups: Vec<Arrows> = arrows
        .iter()
        .zip(&names)
        .map(|((id, pairs), name)| {
            let style = Style { mark: Mark::None, ..tracks::style(place(id)) };
            Arrows { name, pairs, style, heads: true }
        })
        .collect();
    let any: &Link = &replayed.log.events[0].link;
    let (east, north) = tracks::extent(&replayed.log.events, &any.receiver);
    link_map(
        "Links that stand for all others: the first inducing points",
        east,
        north,
        &groups,
        &tracks::tracks_as_series(&tracks),
        SIDE,
    )
}

fn html(replayed: &Replayed, pictures: &Pictures) -> String {
    let mut page = String::from(HEAD);
    let vehicles: Vec<&str> = replayed.replay.vehicles.iter().map(VehicleId::as_str).collect();
    let facts = format!(
        "{} events, vehicles {}; {} splits, seed {}. {}.",
        replayed.log.events.len(),
        vehicles.join(", "),
        replayed.splits.len(),
        replayed.plan.seed,
        tables::kernel_line(replayed)
    );
    // Writing to a String cannot fail.
    let _ = writeln!(page, "<p>{}</p>", escape(&facts));
    page += "<h2>How well are held-out events predicted?</h2>\n";
    page += &html_table(&tables::score_header(replayed), &tables::score_rows(replayed));
    page += &html_table(&SHARING_HEADER, &tables::sharing_rows(replayed));
    let _ = writeln!(page, "<p>{}</p>", escape(tables::LEGEND));
    if replayed.plan.compare {
        page += "<h2>Other uses of the same bytes</h2>\n";
        page += &html_table(&tables::comparison_header(replayed), &tables::comparison_rows(replayed));
        page += "<p>NLL of held-out events; a star marks the best of those that can be sent.</p>\n";
    }
    if let Some(calibrated) = &replayed.replay.calibration {
        page += "<h2>Do probabilities mean what they say?</h2>\n";
        page += &html_table(&tables::RELIABILITY_HEADER, &tables::reliability_rows(calibrated));
        let _ = writeln!(page, "<p>{}</p>", escape(&tables::coverage(calibrated)));
    }
    let (viewer, frames, split) = (escape(pictures.viewer.as_str()), pictures.frames, escape(&pictures.split));
    let packets = if frames == 1 { "packet".to_owned() } else { format!("{frames} packets") };
    let _ = writeln!(
        page,
        "<h2>The map of {viewer}</h2>\n<p>Probability that a message from the last position of {viewer} is heard, as {viewer} sees \
         it after every vehicle sent {packets} (split {split}).</p>\n<figure>{}</figure>",
        pictures.map.svg(false)
    );
    let _ = writeln!(
        page,
        "<h2>What was sent</h2>\n<p>Every arrow is an inducing point of one of the first {} packets of each vehicle, drawn from \
         transmitter to receiver: a link that stands for those around it.</p>\n<figure>{}</figure>\n</body>\n</html>",
        frames.min(PACKETS_DRAWN),
        pictures.packets.svg(false)
    );
    page
}

/// The page of a mission in the order of time.
pub fn online_page(headline: &str, header: &[&str], rows: &[Vec<String>], figure: &Figure) -> String {
    format!(
        "{HEAD}<p>{}</p>\n<h2>How well are coming events predicted?</h2>\n<figure>{}</figure>\n{}<p>Every event is predicted by its \
         receiver before it is learned from. NLL is the negative log-likelihood in nats: lower is better.</p>\n</body>\n</html>\n",
        escape(headline),
        figure.svg(false),
        html_table(header, rows)
    )
}

const HEAD: &str = "<!DOCTYPE html>
<html lang=\"en\">
<head>
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">
<title>pingmap report</title>
<style>
body { font: 16px/1.5 'DejaVu Sans', Verdana, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { padding: .25rem .9rem; text-align: right; border-bottom: 1px solid #ddd; font-variant-numeric: tabular-nums; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 1rem 0; overflow-x: auto; }
figure svg { max-width: 100%; height: auto; }
</style>
</head>
<body>
<h1>pingmap: will a message from here reach there?</h1>
";

fn html_table(header: &[impl AsRef<str>], rows: &[Vec<String>]) -> String {
    let cells = |tag: &str, cells: &mut dyn Iterator<Item = &str>| {
        cells.map(|cell| format!("<{tag}>{}</{tag}>", escape(cell))).collect::<String>()
    };
    let head = cells("th", &mut header.iter().map(AsRef::as_ref));
    let body = rows.iter().map(|row| format!("<tr>{}</tr>\n", cells("td", &mut row.iter().map(String::as_str))));
    format!("<table>\n<tr>{head}</tr>\n{}</table>\n", body.collect::<String>())
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
