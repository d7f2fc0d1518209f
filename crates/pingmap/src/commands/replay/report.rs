//! The report of a replay: one self-contained HTML page, and some of its figures as PNG files in the same folder.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use pingmap_agent::VehicleId;
use pingmap_import::time_in_words;
use pingmap_trial::{EventLog, PairCount, Preshared};

use super::pictures::{MapPicture, PACKETS_DRAWN, Pictures, calibration};
use super::replayed::Replayed;
use super::tables::{self, SHARING_HEADER};
use crate::files::write_file;
use crate::log::WholeLog;
use crate::model::InputDigests;
use crate::output::{count, spinner};
use crate::page::Page;
use crate::success_map::HATCH_WIDTH;

/// Writes the report to an existing folder, and returns the path of its page. It starts with a map and its result.
/// `lead` adds sections after that.
pub fn write(
    replayed: &Replayed,
    command: &[String],
    folder: &Path,
    lead: &dyn Fn(&mut Page),
) -> anyhow::Result<PathBuf> {
    let bar = spinner("drawing the report");
    let pictures = Pictures::draw(replayed)?;
    let path = folder.join("index.html");
    if let Some(map) = pictures.maps.first() {
        write_file(&folder.join("map.png"), &map.figure.png()?)?;
    }
    if let Some(packets) = &pictures.packets {
        write_file(&folder.join("packets.png"), &packets.png()?)?;
    }
    write_file(&path, html(replayed, command, &pictures, lead).as_bytes())?;
    bar.finish_and_clear();
    Ok(path)
}

fn html(replayed: &Replayed, command: &[String], pictures: &Pictures, lead: &dyn Fn(&mut Page)) -> String {
    let mut page = Page::new(&format!("{}: where is a message heard?", replayed.whole.name));
    let (first, others) = pictures.maps.split_at(pictures.maps.len().min(1));
    if let [map] = first {
        page.conclusion(&map.sentence);
        add_map(&mut page, map, pictures);
    }
    page.heading("How good is the map?");
    page.paragraph(&conclusion(replayed));
    lead(&mut page);
    scores(&mut page, replayed);
    for map in others {
        page.heading(&format!("The map of {}", map.viewer));
        page.paragraph(&map.sentence);
        add_map(&mut page, map, pictures);
    }
    if pictures.maps.len() < pictures.vehicles {
        page.paragraph(&format!("Maps of {} of {} vehicles are shown.", pictures.maps.len(), pictures.vehicles));
    }
    the_log(&mut page, replayed, pictures);
    page.heading("Sent packets");
    match &pictures.packets {
        None => page.paragraph("The packets are reports of single outcomes; they contain no inducing points."),
        Some(packets) => page.figure(
            packets,
            &format!(
                "Every arrow is an inducing point of one of the first {} packets of each vehicle, drawn from transmitter to receiver: a \
                 link that represents those around it.",
                pictures.frames.min(PACKETS_DRAWN)
            ),
        ),
    }
    page.heading("Provenance");
    page.facts(&provenance(replayed, command));
    page.finish()
}

/// Returns the main result as a sentence.
fn conclusion(replayed: &Replayed) -> String {
    let replay = &replayed.replay;
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let (distance, centralised) = (replay.distance_only.accuracy.mean, replay.centralised.accuracy.mean);
    let team = replay.sharing.last().map(|sharing| sharing.team.accuracy.mean);
    let map = team.unwrap_or(replay.own.accuracy.mean);
    let map_name = if team.is_some() { "the map that the team shares" } else { "each vehicle's own map" };
    let held = if replayed.has_seen_log {
        "For events from which the model was learned, so that scores are too good"
    } else {
        "For held-out events"
    };
    let verdict = if map > distance {
        format!("the distance alone is right in {}, {map_name} in {}", percent(distance), percent(map))
    } else {
        format!(
            "the distance alone is right in {}, and {map_name} only in {}: here positions add little to the distance",
            percent(distance),
            percent(map)
        )
    };
    format!(
        "{held}, {verdict}; each vehicle's own events in {}, all events in one place in {}.",
        percent(replay.own.accuracy.mean),
        percent(centralised)
    )
}

fn scores(page: &mut Page, replayed: &Replayed) {
    page.heading("How well are held-out events predicted?");
    page.facts(&tables::LEGEND.map(|(name, meaning)| (name, meaning.to_owned())));
    page.table(&tables::score_header(replayed), &tables::score_rows(replayed));
    page.table(&SHARING_HEADER, &tables::sharing_rows(replayed));
    if replayed.replay.splits.len() > 1 {
        page.table(&tables::SPLIT_HEADER, &tables::split_rows(replayed));
    }
    if !replayed.plan.alternatives.is_empty() {
        page.heading("Other uses of the same bytes");
        page.table(&tables::comparison_header(replayed), &tables::comparison_rows(replayed));
        page.paragraph("NLL of held-out events; a star marks the best of those that can be sent.");
    }
    if let Some(calibrated) = &replayed.replay.calibration {
        page.heading("Are probabilities calibrated?");
        page.figure(
            &calibration(calibrated),
            "Share of held-out events that were heard, over their predicted probability. Calibrated probabilities lie on the grey line.",
        );
        page.paragraph(tables::RELIABILITY_LEGEND);
        page.table(&tables::RELIABILITY_HEADER, &tables::reliability_rows(calibrated));
        tables::coverage(calibrated).lines().for_each(|line| page.paragraph(line));
    }
}

fn add_map(page: &mut Page, map: &MapPicture, pictures: &Pictures) {
    let Pictures { frames, split, .. } = pictures;
    let packets = if *frames == 1 { "a packet".to_owned() } else { format!("{frames} packets") };
    let viewer = &map.viewer;
    page.figure(
        &map.figure,
        &format!(
            "Probability that a message from the last position of {viewer} is heard, predicted by {viewer} after every vehicle sent {packets} \
             (split {split}). Hatched: not known, because the 90 % interval of the probability is wider than {HATCH_WIDTH}. Dotted rings \
             show the distance from that position."
        ),
    );
}

fn the_log(page: &mut Page, replayed: &Replayed, pictures: &Pictures) {
    page.heading("Received messages");
    page.figure(
        &pictures.over_range,
        "Share of all messages that were heard, by distance, and the predictions of their receivers' maps for the same messages. A map may be \
         right for every distance and still wrong for every position.",
    );
    pairs(page, &replayed.log);
}

/// Adds a table with the numbers of sent and heard messages for each transmitter and receiver.
pub fn pairs(page: &mut Page, log: &EventLog) {
    let row = |((from, to), PairCount { heard, missed }): (&(VehicleId, VehicleId), &PairCount)| {
        let share = *heard as f64 / (heard + missed) as f64;
        vec![format!("{from} → {to}"), (heard + missed).to_string(), heard.to_string(), format!("{share:.3}")]
    };
    let rows: Vec<Vec<String>> = log.pairs().iter().map(row).collect();
    page.paragraph("Sent: messages that were sent while the receiver listened. Heard: those that it decoded.");
    page.table(&["from → to", "sent", "heard", "share heard"], &rows);
}

fn provenance(replayed: &Replayed, command: &[String]) -> Vec<(&'static str, String)> {
    let Replayed { log, whole, plan, .. } = replayed;
    let of_replay = [
        ("model", tables::kernel_line(replayed)),
        ("length-scale, variance", "distance over which the log-odds change, and their variance about the mean".into()),
        ("inference", tables::inference_line(replayed)),
        ("splits", format!("{}, seed {}", replayed.splits.len(), plan.seed)),
    ];
    [of_log(log, whole, &plan.preshared), of_replay.to_vec(), of_run(command)].concat()
}

/// Returns facts about the log and the model.
pub fn of_log(log: &EventLog, whole: &WholeLog, preshared: &Preshared) -> Vec<(&'static str, String)> {
    let InputDigests { log_digest, model_digest } = InputDigests::given(whole, preshared);
    let (used, all) = (log.events.len(), whole.events);
    let events = if used == all { all.to_string() } else { format!("{used} of {}", count(all, "event")) };
    let vehicles: Vec<String> = log.vehicles().iter().map(VehicleId::to_string).collect();
    vec![
        ("log", whole.name.clone()),
        ("digest of the log", log_digest),
        ("reference system", log.reference.to_string()),
        ("events", events),
        ("vehicles", vehicles.join(", ")),
        ("digest of the model", model_digest.unwrap_or_else(|| "no model given".into())),
    ]
}

/// Returns version, command line and date of the run.
pub fn of_run(command: &[String]) -> Vec<(&'static str, String)> {
    vec![
        ("version", format!("pingmap {}", env!("CARGO_PKG_VERSION"))),
        ("command", format!("pingmap {}", command.join(" "))),
        ("date", date()),
    ]
}

/// Returns the current date, or that of `SOURCE_DATE_EPOCH` for reproducible builds.
fn date() -> String {
    let fixed_time_s = std::env::var("SOURCE_DATE_EPOCH").ok().and_then(|seconds| seconds.parse::<u64>().ok());
    let now = || SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    time_in_words(fixed_time_s.unwrap_or_else(now) as f64)
}
