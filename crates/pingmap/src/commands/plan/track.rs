//! `pingmap plan track`: the probability of reception along a planned track.

use std::path::PathBuf;

use clap::Args;
use pingmap_agent::{LinkQuery, Position};
use pingmap_import::{Place, Reference};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

use super::common::{Common, LearnedPlan, PlanContent, waypoints};
use crate::answer::Answer;
use crate::cli_enums::{Join, name_of};
use crate::cli_parsers::{place, positive};
use crate::exports::{Line, Shape};
use crate::figure::{Figure, Mark, Room, Series, Style, curves};
use crate::grid::Point;
use crate::model::{InputDigests, KernelJson};
use crate::outage::{Outage, Outages, SampledFunctions};
use crate::output::{Results, print_json, print_text, spinner, table};
use crate::reference::{PlaceJson, positions};
use crate::route::{Route, Sending};
use crate::success_map::{Cell, MapQuery, all_joined, from_one};

#[derive(Args)]
#[command(
    after_help = "Example:\n  pingmap plan track log.csv --model model.toml --along waypoints.csv --at 700,510 --every-s 10 -o track.png"
)]
pub struct Options {
    /// Table of waypoints, in metres or degrees, with optional times
    #[arg(long, value_name = "FILE")]
    pub along: PathBuf,
    /// Position of the listener; repeat the option for several listeners
    ///
    /// A position is in metres of the log, or in degrees such as 41.52N,70.67W, with an optional depth. --join combines
    /// several listeners.
    #[arg(long, value_name = "PLACE", value_parser = place, allow_hyphen_values = true, required = true)]
    pub at: Vec<(Place, Option<f64>)>,
    /// Whether all of several listeners must receive a message, or any
    #[arg(long, value_enum, default_value_t = Join::All)]
    pub join: Join,
    /// Speed on the track, if its waypoints have no times
    #[arg(long, default_value_t = 1.5, value_parser = positive, allow_negative_numbers = true)]
    pub speed_m_per_s: f64,
    /// Interval between messages in seconds
    #[arg(long, default_value_t = 10.0, value_parser = positive, allow_negative_numbers = true)]
    pub every_s: f64,
    #[command(flatten)]
    pub common: Common,
}

/// Predictions for a track, by message and by leg.
struct Expected {
    /// Required probability.
    required: f64,
    /// Where the data end.
    data: String,
    route: Route,
    sendings: Vec<Sending>,
    cells: Vec<Cell>,
    outages: Outages,
}

/// A leg, or the whole track, in JSON.
#[derive(Serialize, JsonSchema)]
pub struct LegJson {
    /// Start of the leg.
    from: PlaceJson,
    /// End of the leg.
    to: PlaceJson,
    /// Time at the start, in seconds.
    start_s: f64,
    /// Time at the end, in seconds.
    end_s: f64,
    /// Number of messages on the leg.
    messages: usize,
    /// Expected number of received messages.
    received_expected: f64,
    /// The least probable message.
    lowest: LowestJson,
    /// Whether every message reaches the required probability.
    answer: Answer,
    /// Smallest lower end of the messages' intervals.
    lower: f64,
    /// Smallest upper end of the messages' intervals.
    upper: f64,
    /// Median over missions of the longest time without a received message.
    silence_median_s: f64,
    /// The 90 % quantile over missions of the longest time without a received message.
    silence_likely_s: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct LowestJson {
    /// Time of the message in seconds.
    time_s: f64,
    /// Position at which the message is sent.
    at: PlaceJson,
    /// Probability that the message is received.
    probability: f64,
    /// Lower end of the 90 % interval of the probability.
    lower: f64,
    /// Upper end of that interval.
    upper: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct TrackJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Positions of the listeners, or of the transmitters.
    places: Vec<PlaceJson>,
    /// Role of these positions: `tx` transmits, `rx` receives, `both` both roles on two maps, `worst` the less probable
    /// direction.
    #[serde(rename = "as")]
    seen: String,
    /// Combination of several positions: `all` of them are needed, or `any`.
    join: String,
    /// Interval between messages in seconds.
    every_s: f64,
    /// Required probability.
    probability: f64,
    /// Where the data end, in words.
    data: String,
    /// Number of events from which the map was learned.
    events_used: usize,
    /// Kernel of the model.
    kernel: KernelJson,
    /// The whole track.
    whole: LegJson,
    /// Each leg from one waypoint to the next.
    legs: Vec<LegJson>,
}

impl Options {
    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let opened = self.common.open(&[&self.along])?;
        let list = waypoints(&self.along)?;
        let route = Route::new(&list, &opened.reference, self.speed_m_per_s, opened.depth_m)?;
        let sendings = route.sendings(self.every_s)?;
        let at = positions("--at", &self.at, &opened.reference, opened.depth_m)?;
        let mut learned = opened.learn()?;
        let bar = spinner("playing missions");
        let expected = Expected::new(&mut learned, (&at, self.join), (route, sendings))?;
        bar.finish_and_clear();
        if self.common.json {
            print_json(results, &self.json(&expected, &learned, &at))?;
        } else {
            print_text(results, &expected.text())?;
        }
        let track: Vec<Point> = expected.route.waypoints.iter().map(|(_, at)| (at.east_m, at.north_m)).collect();
        let series = [Series { name: "planned track", points: &track, style: TRACK }];
        let content = PlanContent {
            at: &at,
            join: self.join,
            title: "Reception along the track",
            sentence: &expected.sentence(),
            lines: &series,
            shapes: expected.shapes(&at, &name_of(&self.common.seen)),
            below: Some(&|room| expected.curve(room)),
            header: &["leg", "time_s", "easting_m", "northing_m", "probability", "lower", "upper", "explained"],
            rows: expected.rows(),
            shown: &track,
        };
        learned.write(content, results)
    }

    fn json(&self, expected: &Expected, learned: &LearnedPlan, at: &[Position]) -> TrackJson {
        let reference = &learned.reference;
        TrackJson {
            schema: 1,
            digests: learned.learned_map.digests(),
            places: at.iter().map(|at| PlaceJson::of(at, reference)).collect(),
            seen: name_of(&self.common.seen),
            join: name_of(&self.join),
            every_s: self.every_s,
            probability: expected.required,
            data: expected.data.clone(),
            events_used: learned.learned_map.log.events.len(),
            kernel: KernelJson::of(learned.learned_map.model()),
            whole: expected.leg(None, reference),
            legs: (0..expected.route.legs()).map(|leg| expected.leg(Some(leg), reference)).collect(),
        }
    }
}

impl Expected {
    fn new(
        learned: &mut LearnedPlan,
        (at, join): (&[Position], Join),
        (route, sendings): (Route, Vec<Sending>),
    ) -> anyhow::Result<Self> {
        let common = learned.common;
        let extent = &learned.learned_map.extent;
        let query: MapQuery = learned.queries.of(at, join, extent);
        let places: Vec<Position> = sendings.iter().map(|sending| sending.position).collect();
        let of_places =
            at.iter().map(|&at| from_one(&mut learned.learned_map.agent, &query, (query.seen, at), &places));
        let of_places = of_places.collect::<anyhow::Result<Vec<_>>>()?;
        let cells = all_joined(&mut learned.learned_map.agent, join, &of_places)?;
        let attempts: Vec<Vec<LinkQuery>> =
            of_places.iter().map(|place| place.iter().map(|(_, attempt)| *attempt).collect()).collect();
        let drawn = SampledFunctions::new(&mut learned.learned_map.agent, &attempts)?;
        let outages = Outages::new(&drawn, &query, &route, &sendings, common.source.work.seed);
        let track = extent.track_sentence(&places);
        let data: Vec<String> = at.iter().map(|at| extent.sentence(at)).chain([track]).collect();
        Ok(Self { required: common.probability, data: data.join("\n"), route, sendings, cells, outages })
    }

    /// Returns the messages of a leg, or of the whole track.
    fn of(&self, leg: Option<usize>) -> impl Iterator<Item = (&Sending, &Cell)> {
        let all = self.sendings.iter().zip(&self.cells);
        all.filter(move |(sending, _)| leg.is_none_or(|leg| sending.leg == leg))
    }

    fn leg(&self, leg: Option<usize>, reference: &Reference) -> LegJson {
        let last = self.route.legs();
        let (from, to) = leg.map_or((0, last), |leg| (leg, leg + 1));
        let [(start_s, from), (end_s, to)] = [self.route.waypoints[from], self.route.waypoints[to]];
        let lowest = self.of(leg).min_by(|a, b| a.1.probability.total_cmp(&b.1.probability));
        // A leg shorter than the interval between messages may have no message. The message before it stands in for it.
        let before = self.sendings.iter().zip(&self.cells).rfind(|(sending, _)| sending.time_s <= start_s);
        let (sending, cell) = lowest.or(before).unwrap_or((&self.sendings[0], &self.cells[0]));
        let Outage { median_s, likely_s } = leg.map_or(self.outages.whole, |leg| self.outages.legs[leg]);
        // The least of several probabilities is at most as large as each of them.
        let least = |of: fn(&Cell) -> f64| self.of(leg).map(|(_, cell)| of(cell)).fold(of(cell), f64::min);
        let (lower, upper) = (least(|cell| cell.lower), least(|cell| cell.upper));
        LegJson {
            answer: Answer::of((lower, upper), self.required),
            lower,
            upper,
            from: PlaceJson::of(&from, reference),
            to: PlaceJson::of(&to, reference),
            start_s,
            end_s,
            messages: self.of(leg).count(),
            received_expected: self.of(leg).map(|(_, cell)| cell.probability).sum(),
            lowest: LowestJson {
                time_s: sending.time_s,
                at: PlaceJson::of(&sending.position, reference),
                probability: cell.probability,
                lower: cell.lower,
                upper: cell.upper,
            },
            silence_median_s: median_s,
            silence_likely_s: likely_s,
        }
    }

    fn text(&self) -> String {
        let name = |n: usize| self.route.names[n].clone().unwrap_or_else(|| (n + 1).to_string());
        let row = |leg: Option<usize>| {
            let found = self.leg(leg, &Reference::unknown());
            let what = leg.map_or("all".to_owned(), |leg| format!("{} – {}", name(leg), name(leg + 1)));
            let length_m: f64 = match leg {
                Some(leg) => self.route.length_m(leg),
                None => (0..self.route.legs()).map(|leg| self.route.length_m(leg)).sum(),
            };
            let LegJson { lower, upper, lowest: LowestJson { time_s, probability, .. }, .. } = found;
            vec![
                what,
                format!("{length_m:.0}"),
                found.messages.to_string(),
                format!("{:.1}", found.received_expected),
                format!("{probability:.2} ({lower:.2}–{upper:.2})"),
                format!("{time_s:.0}"),
                format!("{:.0}", found.silence_median_s),
                format!("{:.0}", found.silence_likely_s),
                found.answer.words().to_owned(),
            ]
        };
        let rows: Vec<Vec<String>> = (0..self.route.legs()).map(Some).chain([None]).map(row).collect();
        let all = format!("all heard with {}", self.required);
        let lowest = "lowest probability";
        let header = ["leg", "m", "messages", "expected", lowest, "at (s)", "silence (s)", "at most, 9 of 10", &all];
        let Outage { median_s, likely_s } = self.outages.whole;
        format!(
            "{}\n\n{}\nThe longest silence on the whole track is at most {median_s:.0} s in half of all missions, and at most {likely_s:.0} s in 90 %.\n{}",
            table(&header, &rows),
            self.sentence(),
            self.data
        )
    }

    /// Answers whether every message reaches the required probability.
    fn sentence(&self) -> String {
        let LegJson { answer, lower, upper, .. } = self.leg(None, &Reference::unknown());
        format!("Every message is heard with {}: {} ({lower:.2}–{upper:.2}).", self.required, answer.words())
    }

    fn rows(&self) -> Vec<(Point, Vec<String>)> {
        let row = |(sending, cell): (&Sending, &Cell)| {
            let Position { east_m, north_m, .. } = sending.position;
            let numbers = [sending.time_s, east_m, north_m, cell.probability, cell.lower, cell.upper, cell.explained];
            let row = [vec![(sending.leg + 1).to_string()], numbers.map(|number| number.to_string()).to_vec()].concat();
            ((east_m, north_m), row)
        };
        self.of(None).map(row).collect()
    }

    /// Draws probability and interval over time.
    fn curve(&self, room: Room) -> Figure {
        let line = |of: fn(&Cell) -> f64| -> Vec<Point> {
            self.of(None).map(|(sending, cell)| (sending.time_s, of(cell))).collect()
        };
        let (middle, lower, upper) = (line(|cell| cell.probability), line(|cell| cell.lower), line(|cell| cell.upper));
        let series = [
            Series { name: "probability", points: &middle, style: TRACK },
            Series { name: "90 % interval, lower end", points: &lower, style: BOUND },
            Series { name: "90 % interval, upper end", points: &upper, style: Style { dash: &[2.0, 3.0], ..BOUND } },
        ];
        curves("Along the track", ["time (s)", "probability of success"], &series, room, 240.0)
    }

    fn shapes(&self, at: &[Position], seen: &str) -> Vec<Line> {
        let leg = |leg: usize| {
            let points = self.route.waypoints[leg..=leg + 1].iter().map(|(_, at)| (at.east_m, at.north_m)).collect();
            let found = self.leg(Some(leg), &Reference::unknown());
            let properties = vec![
                ("leg", json!(leg + 1)),
                ("messages", json!(found.messages)),
                ("received_expected", json!(found.received_expected)),
                ("probability_lowest", json!(found.lowest.probability)),
                ("lower", json!(found.lower)),
                ("upper", json!(found.upper)),
                ("answer", json!(found.answer)),
                ("silence_median_s", json!(found.silence_median_s)),
                ("silence_likely_s", json!(found.silence_likely_s)),
            ];
            Line { kind: "leg", shape: Shape::Line(points), properties }
        };
        let place = |at: &Position| Line {
            kind: "place",
            shape: Shape::Place((at.east_m, at.north_m)),
            properties: vec![("seen_from", json!(seen)), ("as", json!(seen))],
        };
        (0..self.route.legs()).map(leg).chain(at.iter().map(place)).collect()
    }
}

const TRACK: Style = Style { color: "#d00000", width: 2.2, dash: &[], mark: Mark::Dot };
const BOUND: Style = Style { color: "#555555", width: 1.2, dash: &[6.0, 4.0], mark: Mark::None };
