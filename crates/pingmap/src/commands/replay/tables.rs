//! A replay as text and tables.

use std::collections::BTreeSet;

use pingmap_agent::{Structure, VehicleId};
use pingmap_trial::{
    Alternative, Bin, Calibrated, Calibration, ChannelImpairments, Estimate, INTERVALS, MeanScore, ModelSource, Replay,
    Sharing, SplitNll, SplitSummary, Traffic,
};

use super::replayed::Replayed;
use crate::model::{HAS_SEEN_LOG, of_events, path_variance};
use crate::output::{count, table, table_of};

pub fn text(replayed: &Replayed) -> String {
    let replay = &replayed.replay;
    let vehicles: Vec<&str> = replay.vehicles.iter().map(VehicleId::as_str).collect();
    let splits = match replay.splits.as_slice() {
        [_] => "1 split".to_owned(),
        several => format!("mean of {} splits", several.len()),
    };
    let mut text = format!(
        "{}, {} ({}); {splits}, seed {}\n{}\n{}\n\n{}\n\n{}",
        count(replayed.log.events.len(), "event"),
        count(vehicles.len(), "vehicle"),
        vehicles.join(", "),
        replayed.plan.seed,
        kernel_line(replayed),
        inference_line(replayed),
        table_of(&score_header(replayed), &score_rows(replayed)),
        sharing_tables(replayed),
    );
    if replay.splits.len() > 1 {
        text += &format!("\n\n{}", table(&SPLIT_HEADER, &split_rows(replayed)));
    }
    if !replayed.plan.alternatives.is_empty() {
        text += &format!("\n\n{}", comparison_table(replayed));
        text += "\n\nA star marks the best of those that can be sent.";
    }
    if let (Some(calibrated), true) = (&replayed.replay.calibration, replayed.shows_calibration) {
        text +=
            &format!("\n\n{}\n\n{}", table(&RELIABILITY_HEADER, &reliability_rows(calibrated)), coverage(calibrated));
    }
    if let Some(own) = &replayed.own_learning {
        let header = ["model learned from", "pooled, NLL", "± s.e.", "every vehicle, NLL", "± s.e."];
        text += &format!("\n\n{}", table(&header, &learner_rows(replayed, own)));
    }
    let legend = LEGEND.map(|(name, meaning)| format!("{name}: {meaning}"));
    text + "\n\n" + &legend.join("\n")
}

/// Formats the comparison with one row for pingmap and one for each alternative, so that the table is narrow.
fn comparison_table(replayed: &Replayed) -> String {
    let (header, rows) = (comparison_header(replayed), comparison_rows(replayed));
    let column = |place: usize| rows.iter().map(move |row| row[place].clone());
    let turned = (1..header.len()).map(|place| [header[place].clone()].into_iter().chain(column(place)).collect());
    let names: Vec<String> = [header[0].clone()].into_iter().chain(column(0)).collect();
    table_of(&names, &turned.collect::<Vec<_>>())
}

/// Formats [`sharing_rows`] as two tables, so that each is narrow: the traffic, and the scores.
fn sharing_tables(replayed: &Replayed) -> String {
    let (traffic, scores) = SHARING_HEADER.split_at(4);
    let rows = sharing_rows(replayed);
    let traffic_rows: Vec<_> = rows.iter().map(|row| row[..4].to_vec()).collect();
    let score_rows: Vec<_> = rows.iter().map(|row| [&row[..1], &row[4..]].concat()).collect();
    let scores = [&traffic[..1], scores].concat();
    format!("{}\n\n{}", table(traffic, &traffic_rows), table(&scores, &score_rows))
}

/// Returns the header of the comparison: pingmap, then every alternative.
pub fn comparison_header(replayed: &Replayed) -> Vec<String> {
    let names = replayed.plan.alternatives.iter().map(|&way| alternative_title(way));
    ["NLL at equal bytes", "bytes", "pingmap"].map(str::to_owned).into_iter().chain(names).collect()
}

/// Returns the NLL of each alternative, one row for each number of frames. A star marks the best that can be sent.
pub fn comparison_rows(replayed: &Replayed) -> Vec<Vec<String>> {
    let bytes = replayed.layout().map_or(0, |layout| layout.frame_bytes);
    let row = |sharing: &Sharing| {
        let sendable = sharing.alternatives.iter().filter(|(way, _)| way.is_sendable());
        let best = sendable.map(|(_, score)| score.nll.mean).fold(sharing.team.nll.mean, f64::min);
        let cell = |nll: f64| format!("{nll:.4}{}", if nll <= best + 5e-5 { " *" } else { "  " });
        let ways = sharing.alternatives.iter().map(|(way, score)| match way.is_sendable() {
            true => cell(score.nll.mean),
            false => format!("{:.4}", score.nll.mean),
        });
        let ours = [frames_name(sharing.frames), (bytes * sharing.frames).to_string(), cell(sharing.team.nll.mean)];
        ours.into_iter().chain(ways).collect()
    };
    replayed.replay.sharing.iter().map(row).collect()
}

/// Compares one model learned from pooled events with models that every vehicle learned from its own data.
pub fn learner_rows(replayed: &Replayed, own: &Replay) -> Vec<Vec<String>> {
    let row = |name: &str, pooled: &MeanScore, own: &MeanScore| {
        let [pooled, own] = [pooled, own].map(|score| score_row("", score)[2..].to_vec());
        [vec![name.to_owned()], pooled, own].concat()
    };
    let mut rows = vec![row("own events only", &replayed.replay.own, &own.own)];
    rows.extend(
        replayed
            .replay
            .sharing
            .iter()
            .zip(&own.sharing)
            .map(|(pooled, own)| row(&frames_name(pooled.frames), &pooled.team, &own.team)),
    );
    rows.push(row("all raw events in one place", &replayed.replay.centralised, &own.centralised));
    rows
}

/// Returns the scores without sharing, after sharing, and with all events.
pub fn score_rows(replayed: &Replayed) -> Vec<Vec<String>> {
    let replay = &replayed.replay;
    let row = |name: &str, score: &MeanScore| {
        let more = [Some(score.brier), score.regret];
        let more = more.into_iter().flatten().map(|estimate| format!("{:.4}", estimate.mean));
        score_row(name, score).into_iter().chain(more).collect()
    };
    let mut rows = vec![
        row("base rate", &replay.base_rate),
        row("distance only", &replay.distance_only),
        row("own events only", &replay.own),
    ];
    rows.extend(replay.sharing.last().map(|sharing| row(&frames_name(sharing.frames), &sharing.team)));
    rows.push(row("all raw events in one place", &replay.centralised));
    rows.extend(replay.true_probability.as_ref().map(|score| row("true probability", score)));
    rows
}

/// Columns of [`score_rows`].
pub fn score_header(replayed: &Replayed) -> Vec<String> {
    let regret = replayed.replay.own.regret.map(|_| "regret");
    ["", "accuracy", "NLL", "± s.e.", "Brier"].into_iter().chain(regret).map(str::to_owned).collect()
}

/// Returns the scores of the team for each number of frames.
pub fn sharing_rows(replayed: &Replayed) -> Vec<Vec<String>> {
    let row = |sharing: &Sharing| {
        let name = frames_name(sharing.frames);
        let Traffic { bytes, reports, remote_event_share, .. } = sharing.traffic;
        let traffic = [format!("{bytes:.0}"), format!("{reports:.1}"), format!("{:.0} %", 100.0 * remote_event_share)];
        let share = |gap: Estimate| format!("{:.0} ± {:.0} %", 100.0 * gap.mean, 100.0 * gap.se.unwrap_or(f64::NAN));
        let gap = sharing.gap_closed.map_or("–".to_owned(), share);
        [
            vec![name],
            traffic.to_vec(),
            score_row("", &sharing.team)[1..].to_vec(),
            vec![difference(sharing.gain), difference(sharing.behind)],
            vec![format!("{:.4}", sharing.worst_vehicle_nll), gap],
        ]
        .concat()
    };
    replayed.replay.sharing.iter().map(row).collect()
}

/// Columns of [`reliability_rows`].
pub const RELIABILITY_HEADER: [&str; 10] =
    ["predicted", "own", "mean", "heard", "team", "mean", "heard", "all", "mean", "heard"];

/// Returns the number of events in each bin of predicted probability, their mean prediction and the share heard.
pub fn reliability_rows(calibrated: &Calibrated) -> Vec<Vec<String>> {
    let calibrations = [&calibrated.own, &calibrated.team, &calibrated.centralised];
    let percent = |share: Option<f64>| share.map_or("–".to_owned(), |share| format!("{:.1} %", 100.0 * share));
    let cells = |bin: &Bin| [bin.events.to_string(), percent(bin.predicted()), percent(bin.heard())];
    let row = |place: usize| {
        let name = format!("{} to {} %", 10 * place, 10 * place + 10);
        std::iter::once(name).chain(calibrations.iter().flat_map(|of| cells(&of.bins[place]))).collect()
    };
    (0..calibrated.own.bins.len()).map(row).collect()
}

/// Returns calibration errors and coverages as text.
pub fn coverage(calibrated: &Calibrated) -> String {
    let line = |(name, of): (&str, &Calibration)| {
        let coverage = of.coverage().map_or_else(String::new, |shares| {
            let held = shares.iter().zip(INTERVALS).map(|(held, (share, _))| {
                format!("; {:.0} % intervals hold the true log-odds in {:.0} %", 100.0 * share, 100.0 * held)
            });
            held.collect()
        });
        format!("{name}: expected calibration error {:.3}{coverage}\n", of.expected_error())
    };
    let calibrations = [("own", &calibrated.own), ("team", &calibrated.team), ("all", &calibrated.centralised)];
    let lines: String = calibrations.into_iter().map(line).collect();
    let surer = calibrated.surer().zip(calibrated.median_variance_ratio()).map(|(share, ratio)| {
        format!("The team's variance is below that of all raw events at {:.0} % of held-out events; the median ratio is {ratio:.2}.", 100.0 * share)
    });
    lines + &surer.unwrap_or_default()
}

/// Describes the model in one line.
pub fn kernel_line(replayed: &Replayed) -> String {
    let splits = &replayed.replay.splits;
    let numbers = format!(
        "path: length-scale {:.0} m, variance {:.2}",
        replayed.replay.median(|split| split.model().length_scale_m()),
        replayed.replay.median(|split| path_variance(split.model())),
    );
    if replayed.plan.model_source == ModelSource::Own {
        return format!("every vehicle learns its own model; packets under a fixed one, {numbers}");
    }
    let Some(fit) = splits.iter().find_map(|split| split.fit.as_ref()) else {
        let given = if replayed.has_seen_log { HAS_SEEN_LOG } else { "model as given" };
        return format!("{given}; {numbers}");
    };
    let (parts, differs) = (fit.structure.parts(), differing_parts(replayed));
    let part = |(part, differs): (&String, &bool)| {
        if *differs { "… (see the splits below)".to_owned() } else { part.clone() }
    };
    let parts: Vec<String> = parts.iter().zip(&differs).map(part).collect();
    format!(
        "{}; learned from {}; {numbers}",
        parts.join(", "),
        of_events(fit.events_used, fit.events, "pooled training event"),
    )
}

/// Returns which parts of the structure differ among splits, in the order of [`Structure::parts`].
fn differing_parts(replayed: &Replayed) -> [bool; 5] {
    let parts = replayed.replay.splits.iter().filter_map(|split| split.fit.as_ref()).map(|fit| fit.structure.parts());
    let all: Vec<[String; 5]> = parts.collect();
    std::array::from_fn(|place| all.iter().any(|parts| parts[place] != all[0][place]))
}

/// Index of the kernel terms in [`Structure::parts`].
const TERMS_PART: usize = 3;

/// Header of [`split_rows`].
pub const SPLIT_HEADER: [&str; 7] = ["split", "terms", "excluded", "distance only", "own", "team", "all"];

/// Returns the terms of the kernel, other parts of the structure that differ, the excluded members and the NLL of each
/// split. The NLL of the team is that after most packets.
pub fn split_rows(replayed: &Replayed) -> Vec<Vec<String>> {
    let differs = differing_parts(replayed);
    let words = |structure: &Structure| {
        let parts = structure.parts().into_iter().enumerate();
        let shown = parts.filter(|&(place, _)| differs[place] || place == TERMS_PART).map(|(_, part)| part);
        shown.collect::<Vec<_>>().join(", ")
    };
    let without_fit = if replayed.plan.model_source == ModelSource::Own { "own models" } else { "as given" };
    let row = |split: &SplitSummary| {
        let structure = split.fit.as_ref().map_or_else(|| without_fit.to_owned(), |fit| words(&fit.structure));
        let excluded: BTreeSet<&str> = split.ignored.iter().map(|ignored| ignored.member.as_str()).collect();
        let excluded = Vec::from_iter(excluded).join(", ");
        let SplitNll { distance_only, own, team, centralised } = &split.nll;
        let team = team.last().unwrap_or(own);
        let names = [split.name.clone(), structure, if excluded.is_empty() { "none".to_owned() } else { excluded }];
        names.into_iter().chain([distance_only, own, team, centralised].map(|nll| format!("{nll:.4}"))).collect()
    };
    replayed.replay.splits.iter().map(row).collect()
}

pub fn inference_line(replayed: &Replayed) -> String {
    let (own, centralised) = replayed.replay.dense();
    let words = |dense: bool| if dense { "dense" } else { "sparse" };
    format!(
        "{} mean field for each vehicle, {} for all events together; {}",
        words(own),
        words(centralised),
        packets_line(replayed),
    )
}

/// Describes the packets and the impairments of the channel in a few words.
pub fn packets_line(replayed: &Replayed) -> String {
    let ChannelImpairments { loss, duplicate, reorder } = replayed.plan.impairments;
    let mut line = replayed.layout().map_or_else(String::new, |layout| {
        let points = layout.points_in_all();
        let authenticated = if layout.is_authenticated { ", authenticated" } else { "" };
        format!("packets of {} with up to {points} points{authenticated}", count(layout.schema().length(), "byte"))
    });
    for (share, what) in [(loss, "lost"), (duplicate, "duplicated"), (reorder, "reordered")] {
        if share > 0.0 {
            line += &format!(", {:.0} % {what}", 100.0 * share);
        }
    }
    line
}

fn score_row(name: &str, score: &MeanScore) -> Vec<String> {
    let error = score.nll.se.map_or("–".to_owned(), |error| format!("{error:.4}"));
    vec![name.to_owned(), format!("{:.1} %", 100.0 * score.accuracy.mean), format!("{:.4}", score.nll.mean), error]
}

/// Returns a paired difference, marked where it is not significant.
fn difference(difference: Estimate) -> String {
    let mark = if difference.is_clear() { " " } else { "≈" };
    match difference.se {
        Some(se) => format!("{:.4} ± {se:.4} {mark}", difference.mean),
        None => format!("{:.4} {mark}", difference.mean),
    }
}

/// Columns of [`sharing_rows`].
pub const SHARING_HEADER: [&str; 11] = [
    "after sharing",
    "bytes",
    "reports",
    "known",
    "accuracy",
    "NLL",
    "± s.e.",
    "better than own",
    "worse than all",
    "worst vehicle",
    "gap closed",
];

/// Explanations of the columns.
pub const LEGEND: [(&str, &str); 12] = [
    ("accuracy", "share of held-out events whose outcome was predicted with a probability above 50 %"),
    ("NLL", "negative log-likelihood of held-out events in nats; lower is better"),
    ("± s.e.", "standard error over splits, which overlap (Nadeau and Bengio 2003)"),
    ("Brier", "mean squared error of the probability"),
    ("regret", "difference in success between the best of ten held-out positions and the one that the model prefers"),
    ("bytes, reports", "sent by each vehicle; reports are packets with outcomes of single events"),
    ("known", "share of the other vehicles' events that a vehicle has received one by one"),
    ("better, worse", "paired differences of NLL over splits; ≈ marks those that are not significant"),
    ("worst vehicle", "NLL of the vehicle with the highest NLL"),
    ("gap closed", "position between own events only (0 %) and all raw events (100 %); a dash if not significant"),
    ("excluded", "members whose data at least one vehicle does not use in full"),
    ("rows of splits", "NLL of the distance, own events, the team after most packets, and all raw events"),
];

/// Explanation of [`RELIABILITY_HEADER`] and of [`coverage`].
pub const RELIABILITY_LEGEND: &str = "\
Rows are bins of predicted probability. For own events, the team, and all events in one place, the columns give the number of \
held-out events, their mean prediction, and the share of them that was heard. The calibration error is the mean difference of the \
last two. Simulated trials contain the true probability, with which intervals are compared.";

/// Returns the name of an alternative; in brackets if the alternative cannot be sent.
fn alternative_title(way: Alternative) -> String {
    if way.is_sendable() { way.name().to_owned() } else { format!("({})", way.name()) }
}

fn frames_name(frames: usize) -> String {
    count(frames, "packet")
}
