//! `pingmap plan standoff`: the area in which messages are received with a given probability.

use clap::Args;
use pingmap_agent::Position;
use pingmap_import::Place;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

use super::common::{Common, LearnedPlan, PlanContent};
use crate::answer::Answer;
use crate::cli_enums::{Join, name_of};
use crate::cli_parsers::{place, positive};
use crate::exports::{Line, Shape};
use crate::figure::{Mark, Series, Style};
use crate::grid::Point;
use crate::learned_map::LearnedMap;
use crate::model::{InputDigests, KernelJson};
use crate::output::{BadInput, Results, print_json, print_text, spinner, table};
use crate::reference::{PlaceJson, positions};
use crate::standoff::{Ray, standoff};

#[derive(Args)]
#[command(
    after_help = "Example:\n  pingmap plan standoff log.csv --model model.toml --at 700,510 --probability 0.9 -o standoff.png"
)]
pub struct Options {
    /// Position of the listener
    ///
    /// A position is in metres of the log, or in degrees such as 41.52N,70.67W, with an optional depth.
    #[arg(long, value_name = "PLACE", value_parser = place, allow_hyphen_values = true)]
    pub at: (Place, Option<f64>),
    /// Largest range to test; the longest link of the log if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub range_max_m: Option<f64>,
    #[command(flatten)]
    pub common: Common,
}

/// Ranges with sufficient probability in JSON.
#[derive(Serialize, JsonSchema)]
pub struct StandoffJson {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// Queried position.
    at: PlaceJson,
    /// Role of the position: `tx` transmits, `rx` receives, `both` both roles on two maps, `worst` the less probable
    /// direction.
    #[serde(rename = "as")]
    seen: String,
    /// Required probability.
    probability: f64,
    /// Largest tested range in metres.
    range_max_m: f64,
    /// Number of events from which the map was learned.
    events_used: usize,
    /// Kernel of the model.
    kernel: KernelJson,
    /// Whether there is a range within which the probability is sufficient in every direction.
    answer: Answer,
    /// Smallest range of all rays in metres. The probability is sufficient within it in every direction.
    range_m: f64,
    /// Smallest range for which the lower end of the interval is sufficient, in metres. The answer is yes within it.
    range_lower_m: f64,
    /// Largest range of all rays for which the upper end of the interval is sufficient, in metres. The answer is no
    /// beyond it, up to `range_max_m`.
    range_upper_m: f64,
    /// Where the data end, in words.
    data: String,
    /// Ranges for each bearing.
    rays: Vec<RayJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct RayJson {
    /// Bearing in degrees, clockwise from north.
    bearing_deg: f64,
    /// Range in metres within which the probability is always sufficient.
    range_m: f64,
    /// Range in metres within which the lower end of the interval is always sufficient: the answer is yes.
    range_lower_m: f64,
    /// Range in metres beyond which the upper end of the interval is never sufficient: the answer is no.
    range_upper_m: f64,
    /// Distance of the farthest position of the log within 15 degrees of the bearing, in metres.
    data_m: f64,
}

/// Interval of the rays in the printed table.
const SHOWN_EACH: usize = 6;

impl Options {
    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let opened = self.common.open(&[])?;
        let at = positions("--at", &[self.at], &opened.reference, opened.depth_m)?;
        let longest_m = opened.log.events.iter().map(|event| event.link.range_m()).fold(0.0, f64::max);
        let range_max_m = self.range_max_m.unwrap_or(longest_m);
        if range_max_m <= 0.0 {
            return Err(BadInput("all links of the log are of length 0; expected --range-max-m".into()).into());
        }
        let mut learned = opened.learn()?;
        let bar = spinner("looking around");
        let LearnedMap { extent, agent, .. } = &mut learned.learned_map;
        let rays =
            standoff(agent, &learned.queries.of(&at, Join::All, extent), (self.common.probability, range_max_m))?;
        bar.finish_and_clear();
        let found = Found::new(self, rays, range_max_m, learned.learned_map.extent.sentence(&at[0]));
        if self.common.json {
            print_json(results, &self.json(&learned, &at[0], &found))?;
        } else {
            print_text(results, &found.text())?;
        }
        let rays = &found.rays;
        let lines = [|ray: &Ray| ray.range_m, |ray: &Ray| ray.range_lower_m, |ray: &Ray| ray.range_upper_m]
            .map(|of| rays.iter().map(|ray| ray.place(at[0], of(ray))).collect::<Vec<Point>>());
        let closed = lines.clone().map(|line| [line.clone(), vec![line[0]]].concat());
        let names = ["by the probability", "yes within", "no beyond"];
        let series: Vec<Series> =
            (0..3).map(|n| Series { name: names[n], points: &closed[n], style: LINES[n] }).collect();
        let shapes = self.shapes(&lines, (at[0].east_m, at[0].north_m));
        let row = |ray: &Ray| {
            let (east_m, north_m) = ray.place(at[0], ray.range_m);
            let numbers =
                [ray.bearing_deg, ray.range_m, ray.range_lower_m, ray.range_upper_m, ray.data_m, east_m, north_m];
            ((east_m, north_m), numbers.map(|number| number.to_string()).to_vec())
        };
        let content = PlanContent {
            at: &at,
            join: Join::All,
            title: &format!("Stay within the solid line to be heard with {}", self.common.probability),
            sentence: &found.sentence(),
            lines: &series,
            shapes,
            below: None,
            header: &HEADER,
            rows: rays.iter().map(row).collect(),
            shown: &lines.concat(),
        };
        learned.write(content, results)
    }

    fn json(&self, learned: &LearnedPlan, at: &Position, found: &Found) -> StandoffJson {
        let ray = |&Ray { bearing_deg, range_m, range_lower_m, range_upper_m, data_m, .. }: &Ray| RayJson {
            bearing_deg,
            range_m,
            range_lower_m,
            range_upper_m,
            data_m,
        };
        StandoffJson {
            schema: 1,
            digests: learned.learned_map.digests(),
            at: PlaceJson::of(at, &learned.reference),
            seen: name_of(&self.common.seen),
            probability: found.probability,
            range_max_m: found.range_max_m,
            events_used: learned.learned_map.log.events.len(),
            kernel: KernelJson::of(learned.learned_map.model()),
            answer: found.answer,
            range_m: found.range_m,
            range_lower_m: found.range_lower_m,
            range_upper_m: found.range_upper_m,
            data: found.data.clone(),
            rays: found.rays.iter().map(ray).collect(),
        }
    }

    fn shapes(&self, lines: &[Vec<Point>; 3], at: Point) -> Vec<Line> {
        let seen = name_of(&self.common.seen);
        let area = |n: usize, by: &str| Line {
            kind: "standoff",
            shape: Shape::Area(lines[n].clone()),
            properties: vec![
                ("probability", json!(self.common.probability)),
                ("by", json!(by)),
                ("seen_as", json!(seen)),
                ("as", json!(seen)),
            ],
        };
        let place = Line {
            kind: "place",
            shape: Shape::Place(at),
            properties: vec![("seen_from", json!(seen)), ("as", json!(seen))],
        };
        vec![area(0, "probability"), area(1, "lower"), area(2, "upper"), place]
    }
}

/// Rays and their summary.
struct Found {
    rays: Vec<Ray>,
    probability: f64,
    range_max_m: f64,
    /// The event whose probability is required, in words.
    seen: &'static str,
    answer: Answer,
    range_m: f64,
    range_lower_m: f64,
    range_upper_m: f64,
    /// Where the data end.
    data: String,
}

impl Found {
    fn new(options: &Options, rays: Vec<Ray>, range_max_m: f64, data: String) -> Self {
        let least = |of: fn(&Ray) -> f64| rays.iter().map(of).fold(f64::MAX, f64::min);
        let (range_m, range_lower_m) = (least(|ray| ray.range_m), least(|ray| ray.range_lower_m));
        let range_upper_m = rays.iter().map(|ray| ray.range_upper_m).fold(0.0, f64::max);
        let answer = if range_lower_m > 0.0 {
            Answer::Yes
        } else if rays.iter().any(|ray| ray.nearest == Answer::No) {
            Answer::No
        } else {
            Answer::NotKnown
        };
        let seen = match name_of(&options.common.seen).as_str() {
            "tx" => "a message from there is heard",
            "rx" => "a message to there is heard",
            _ => "messages there and back are heard",
        };
        let probability = options.common.probability;
        Self { rays, probability, range_max_m, seen, answer, range_m, range_lower_m, range_upper_m, data }
    }

    /// Answers whether there is a sufficient range.
    fn sentence(&self) -> String {
        let Self { probability, seen, range_m, range_lower_m, range_upper_m, range_max_m, .. } = self;
        let within = match self.answer {
            Answer::Yes => format!("Yes: within {range_lower_m:.0} m in every direction {seen} with {probability}"),
            Answer::No => format!("No: there is no range within which {seen} with {probability} in every direction"),
            Answer::NotKnown => format!("Not known: whether {seen} with {probability}, even at short range"),
        };
        let by_probability = format!(" (by the probability alone, within {range_m:.0} m)");
        let beyond = format!("; beyond {range_upper_m:.0} m it is not");
        let is_shown = self.answer != Answer::No && *range_m > 0.0;
        let by_probability = if is_shown { &*by_probability } else { "" };
        let beyond = if range_upper_m < range_max_m { &*beyond } else { "" };
        format!("{within}{by_probability}{beyond}.")
    }

    fn text(&self) -> String {
        let metres = |range_m: f64| {
            if range_m >= self.range_max_m { format!("{range_m:.0}+") } else { format!("{range_m:.0}") }
        };
        let row = |ray: &Ray| {
            let beyond = Some(metres(ray.range_upper_m)).filter(|_| ray.range_upper_m < self.range_max_m);
            vec![
                format!("{:03.0}°", ray.bearing_deg),
                metres(ray.range_lower_m),
                metres(ray.range_m),
                beyond.unwrap_or_else(|| "not known".to_owned()),
                format!("{:.0}", ray.data_m),
            ]
        };
        let rows: Vec<Vec<String>> = self.rays.iter().step_by(SHOWN_EACH).map(row).collect();
        let header = ["bearing", "yes within (m)", "by the probability (m)", "no beyond (m)", "data up to (m)"];
        format!("{}\n\n{}\n{}", table(&header, &rows), self.sentence(), self.data)
    }
}

/// Columns of the table of rays.
const HEADER: [&str; 7] =
    ["bearing_deg", "range_m", "range_lower_m", "range_upper_m", "data_m", "easting_m", "northing_m"];

const LINES: [Style; 3] = [
    Style { color: "#d00000", width: 1.4, dash: &[2.0, 3.0], mark: Mark::None },
    Style { color: "#d00000", width: 2.2, dash: &[], mark: Mark::None },
    Style { color: "#d00000", width: 2.2, dash: &[6.0, 4.0], mark: Mark::None },
];
