//! `pingmap plan gateway`: ranks positions for a gateway.

use std::path::PathBuf;

use clap::Args;
use pingmap_agent::{LinkQuery, Position};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

use super::common::{Common, LearnedPlan, PlanContent, waypoints};
use crate::answer::Answer;
use crate::cli_enums::{Join, name_of};
use crate::cli_parsers::positive;
use crate::exports::{Line, Shape};
use crate::figure::{Mark, Series, Style};
use crate::grid::Point;
use crate::learned_map::LearnedMap;
use crate::model::{InputDigests, KernelJson};
use crate::outage::{Outage, Outages, SampledFunctions};
use crate::output::{BadInput, Results, print_json, print_text, spinner, table};
use crate::reference::{PlaceJson, positions};
use crate::route::{Route, Sending};
use crate::success_map::{Cell, from_one};

#[derive(Args)]
#[command(
    after_help = "Example:\n  pingmap plan gateway log.csv --model model.toml --among places.csv --along waypoints.csv"
)]
pub struct Options {
    /// Table of candidate positions, with an optional column name
    ///
    /// Positions are in metres of the log or degrees.
    #[arg(long, value_name = "FILE")]
    pub among: PathBuf,
    /// Table of waypoints of the track from which the gateway is to receive
    #[arg(long, value_name = "FILE")]
    pub along: PathBuf,
    /// Speed on the track, if its waypoints have no times
    #[arg(long, default_value_t = 1.5, value_parser = positive, allow_negative_numbers = true)]
    pub speed_m_per_s: f64,
    /// Interval between messages in seconds
    #[arg(long, default_value_t = 10.0, value_parser = positive, allow_negative_numbers = true)]
    pub every_s: f64,
    #[command(flatten)]
    pub common: Common,
}

/// A candidate position of the gateway.
struct Candidate {
    name: String,
    place: Position,
    /// Expected share of the messages that are received, and the ends of its 90 % interval.
    share: f64,
    share_lower: f64,
    share_upper: f64,
    /// Share of the messages with an end far from all data.
    unknown: f64,
    /// Whether the required share is received.
    answer: Answer,
    lowest: f64,
    silence: Outage,
    /// Posterior probability that this is the best candidate.
    best: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct CandidateJson {
    /// Name in the table of candidates.
    name: String,
    /// Position of the candidate.
    place: PlaceJson,
    /// Expected share of the messages that are received.
    share: f64,
    /// The 5 % quantile of the share.
    share_lower: f64,
    /// The 95 % quantile of the share.
    share_upper: f64,
    /// Whether the share reaches the required probability.
    answer: Answer,
    /// Probability of the least probable message.
    probability_lowest: f64,
    /// Median over missions of the longest time without a received message.
    silence_median_s: f64,
    /// The 90 % quantile over missions of the longest time without a received message.
    silence_likely_s: f64,
    /// Posterior probability that this is the best candidate.
    best_share: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct GatewayJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Role of the candidates: `tx` transmits, `rx` receives, `both` both roles on two maps, `worst` the less probable
    /// direction.
    #[serde(rename = "as")]
    seen: String,
    /// Interval between messages in seconds.
    every_s: f64,
    /// Number of messages on the whole track.
    messages: usize,
    /// Number of events from which the map was learned.
    events_used: usize,
    /// Kernel of the model.
    kernel: KernelJson,
    /// Required probability.
    probability: f64,
    /// Where the data end, seen from the best candidate, in words.
    data: String,
    /// Name of the best candidate.
    best: String,
    /// All candidates, the best first.
    candidates: Vec<CandidateJson>,
}

/// Largest number of candidates.
const CANDIDATES_MAX: usize = 100;

impl Options {
    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let opened = self.common.open(&[&self.among, &self.along])?;
        let list = waypoints(&self.among)?;
        if list.len() > CANDIDATES_MAX {
            let (path, found) = (self.among.display(), list.len());
            return Err(BadInput(format!("{path}: {found} places; expected at most {CANDIDATES_MAX}")).into());
        }
        let places: Vec<_> = list.iter().map(|waypoint| (waypoint.place, waypoint.depth_m)).collect();
        let places = positions("--among", &places, &opened.reference, opened.depth_m)?;
        let named = list.iter().enumerate().map(|(n, waypoint)| waypoint.name.clone().unwrap_or((n + 1).to_string()));
        let named: Vec<(String, Position)> = named.zip(places).collect();
        let route = Route::new(&waypoints(&self.along)?, &opened.reference, self.speed_m_per_s, opened.depth_m)?;
        let sendings = route.sendings(self.every_s)?;
        let mut learned = opened.learn()?;
        let bar = spinner("comparing places");
        let candidates = ranked(&mut learned, &named, (&route, &sendings))?;
        bar.finish_and_clear();
        let extent = &learned.learned_map.extent;
        let on_track: Vec<Position> = sendings.iter().map(|sending| sending.position).collect();
        let track = extent.track_sentence(&on_track);
        let data = format!("{}\n{track}", extent.sentence(&candidates[0].place));
        let sentence = sentence(&candidates, self.common.probability);
        if self.common.json {
            print_json(results, &self.json(&candidates, &learned, sendings.len(), data))?;
        } else {
            print_text(results, &text(&candidates, self.common.probability, &sentence, &data))?;
        }
        let track: Vec<Point> = route.waypoints.iter().map(|(_, at)| (at.east_m, at.north_m)).collect();
        let others: Vec<Point> = candidates.iter().skip(1).map(|one| (one.place.east_m, one.place.north_m)).collect();
        let series = [
            Series { name: "planned track", points: &track, style: TRACK },
            Series { name: "other places", points: &others, style: OTHERS },
        ];
        let content = PlanContent {
            at: &[candidates[0].place],
            join: Join::All,
            title: &format!("Best for the gateway: {}", candidates[0].name),
            sentence: &sentence,
            lines: if others.is_empty() { &series[..1] } else { &series },
            shapes: self.shapes(&candidates, &track),
            below: None,
            header: &HEADER,
            rows: candidates.iter().map(row).collect(),
            shown: &[&track[..], &others].concat(),
        };
        learned.write(content, results)
    }

    fn json(&self, candidates: &[Candidate], learned: &LearnedPlan, messages: usize, data: String) -> GatewayJson {
        let of = |one: &Candidate| CandidateJson {
            name: one.name.clone(),
            place: PlaceJson::of(&one.place, &learned.reference),
            share: one.share,
            share_lower: one.share_lower,
            share_upper: one.share_upper,
            answer: one.answer,
            probability_lowest: one.lowest,
            silence_median_s: one.silence.median_s,
            silence_likely_s: one.silence.likely_s,
            best_share: one.best,
        };
        GatewayJson {
            schema: 1,
            digests: learned.learned_map.digests(),
            seen: name_of(&self.common.seen),
            every_s: self.every_s,
            messages,
            events_used: learned.learned_map.log.events.len(),
            kernel: KernelJson::of(learned.learned_map.model()),
            probability: self.common.probability,
            data,
            best: candidates[0].name.clone(),
            candidates: candidates.iter().map(of).collect(),
        }
    }

    fn shapes(&self, candidates: &[Candidate], track: &[Point]) -> Vec<Line> {
        let seen = name_of(&self.common.seen);
        let place = |one: &Candidate| Line {
            kind: "place",
            shape: Shape::Place((one.place.east_m, one.place.north_m)),
            properties: vec![
                ("name", json!(one.name)),
                ("share", json!(one.share)),
                ("share_lower", json!(one.share_lower)),
                ("share_upper", json!(one.share_upper)),
                ("answer", json!(one.answer)),
                ("best_share", json!(one.best)),
                ("silence_likely_s", json!(one.silence.likely_s)),
                ("seen_from", json!(seen)),
                ("as", json!(seen)),
            ],
        };
        let track = Line { kind: "track", shape: Shape::Line(track.to_vec()), properties: Vec::new() };
        candidates.iter().map(place).chain([track]).collect()
    }
}

/// Returns the candidates in descending order of their expected share of received messages.
fn ranked(
    learned: &mut LearnedPlan,
    named: &[(String, Position)],
    (route, sendings): (&Route, &[Sending]),
) -> anyhow::Result<Vec<Candidate>> {
    let on_track: Vec<Position> = sendings.iter().map(|sending| sending.position).collect();
    let (mut cells, mut attempts): (Vec<Vec<Cell>>, Vec<Vec<LinkQuery>>) = (Vec::new(), Vec::new());
    for (_, place) in named {
        let at = [*place];
        let LearnedMap { extent, agent, .. } = &mut learned.learned_map;
        let query = learned.queries.of(&at, Join::All, extent);
        let found = from_one(agent, &query, (query.seen, *place), &on_track)?;
        let (of_place, asked_about) = found.into_iter().unzip();
        cells.push(of_place);
        attempts.push(asked_about);
    }
    // All candidates are evaluated under the same functions, because they share the uncertainty about the water.
    let together = SampledFunctions::new(&mut learned.learned_map.agent, &attempts)?;
    let shares: Vec<Vec<f64>> = (0..together.functions())
        .map(|function| (0..named.len()).map(|place| mean(&together.probabilities(place, function))).collect())
        .collect();
    let best = best_shares(&shares, named.len());
    let LearnedPlan { common, .. } = *learned;
    let mut candidates = Vec::with_capacity(named.len());
    for (n, (name, place)) in named.iter().enumerate() {
        let at = [*place];
        let LearnedMap { extent, agent, .. } = &mut learned.learned_map;
        let query = learned.queries.of(&at, Join::All, extent);
        let alone = SampledFunctions::new(agent, &attempts[n..=n])?;
        let probabilities: Vec<f64> = cells[n].iter().map(|cell| cell.probability).collect();
        let mut drawn: Vec<f64> = shares.iter().map(|shares| shares[n]).collect();
        drawn.sort_by(f64::total_cmp);
        let quantile = |share: f64| drawn[(share * (drawn.len() - 1) as f64).round() as usize];
        let share = mean(&probabilities);
        // Messages about which nothing is known may all be received, or none.
        let is_unknown = |attempt: &&LinkQuery| query.extent.has_far_end(&attempt.link);
        let unknown = attempts[n].iter().filter(is_unknown).count() as f64 / attempts[n].len() as f64;
        let share_lower = (quantile(0.05).min(share) - unknown).max(0.0);
        let share_upper = (quantile(0.95).max(share) + unknown).min(1.0);
        candidates.push(Candidate {
            name: name.clone(),
            place: *place,
            share,
            share_lower,
            share_upper,
            unknown,
            answer: Answer::of((share_lower, share_upper), common.probability),
            lowest: probabilities.iter().copied().fold(1.0, f64::min),
            silence: Outages::new(&alone, &query, route, sendings, common.source.work.seed).whole,
            best: best[n],
        });
    }
    candidates.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok(candidates)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the share of the functions under which each candidate receives most messages. `shares` has a row for each
/// function.
fn best_shares(shares: &[Vec<f64>], candidates: usize) -> Vec<f64> {
    let mut best = vec![0.0; candidates];
    for of_function in shares {
        let first = (0..candidates).max_by(|&a, &b| of_function[a].total_cmp(&of_function[b])).unwrap_or(0);
        best[first] += 1.0 / shares.len() as f64;
    }
    best
}

const HEADER: [&str; 11] = [
    "name",
    "easting_m",
    "northing_m",
    "share",
    "share_lower",
    "share_upper",
    "probability_lowest",
    "silence_median_s",
    "silence_likely_s",
    "best_share",
    "answer",
];

fn row(one: &Candidate) -> (Point, Vec<String>) {
    let Outage { median_s, likely_s } = one.silence;
    let Position { east_m, north_m, .. } = one.place;
    let numbers =
        [east_m, north_m, one.share, one.share_lower, one.share_upper, one.lowest, median_s, likely_s, one.best];
    let numbers = numbers.map(|number| number.to_string()).to_vec();
    ((east_m, north_m), [vec![one.name.clone()], numbers, vec![one.answer.name().to_owned()]].concat())
}

/// States which position is best, whether it receives the required share, and about how many of the messages to all
/// candidates nothing is known.
fn sentence(candidates: &[Candidate], required: f64) -> String {
    let best = &candidates[0];
    let unknown = mean(&candidates.iter().map(|one| one.unknown).collect::<Vec<_>>());
    let extrapolates = if unknown > 0.0 {
        let percent = (100.0 * unknown).ceil();
        &*format!(" This ranking extrapolates: nothing is known about {percent:.0} % of the messages.")
    } else {
        ""
    };
    format!(
        "The best position is {}, with a probability of {:.0} %. It hears a share of {required} or more: {} ({:.2}–{:.2}).{extrapolates}",
        best.name,
        100.0 * best.best,
        best.answer.words(),
        best.share_lower,
        best.share_upper,
    )
}

fn text(candidates: &[Candidate], required: f64, sentence: &str, data: &str) -> String {
    let row = |one: &Candidate| {
        vec![
            one.name.clone(),
            format!("{:.2} ({:.2}–{:.2})", one.share, one.share_lower, one.share_upper),
            format!("{:.2}", one.lowest),
            format!("{:.0}", one.silence.median_s),
            format!("{:.0}", one.silence.likely_s),
            format!("{:.0} %", 100.0 * one.best),
            one.answer.words().to_owned(),
        ]
    };
    let rows: Vec<Vec<String>> = candidates.iter().map(row).collect();
    let hears = format!("hears {required}");
    let header = ["place", "share heard", "lowest probability", "silence (s)", "at most, 9 of 10", "best in", &hears];
    format!("{}\n\n{sentence}\n{data}", table(&header, &rows))
}

const TRACK: Style = Style { color: "#d00000", width: 2.2, dash: &[], mark: Mark::Dot };
const OTHERS: Style = Style { color: "#ff7f00", width: 0.0, dash: &[], mark: Mark::Square };
