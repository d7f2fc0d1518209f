//! `pingmap plan standoff`: the area in which messages are received with a given probability.

use clap::Args;
use pingmap_agent::Position;
use pingmap_import::Place;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

use super::common::{Common, LearnedPlan, PlanContent};
use crate::answer::Answer;
use crate::cli_enums::{Join, SeenOnce, name_of};
use crate::cli_parsers::{place, positive};
use crate::exports::{Line, Shape};
use crate::figure::{Mark, Series, Style};
use crate::grid::Point;
use crate::learned_map::LearnedMap;
use crate::model::{InputDigests, KernelJson};
use crate::output::{BadInput, Results, print_json, print_text, spinner, table};
use crate::reference::{PlaceJson, positions};
use crate::standoff::{Ray, standoff, step_m};

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
    /// Largest range to test; the length of the longest link with data if not given
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
    /// Whether there is a range within which the probability is sufficient in every direction: `yes` if the answer is
    /// yes in all directions up to the shortest tested range, and `no` if it is no there in at least one direction.
    answer: Answer,
    /// Smallest range of all rays in metres. The probability is sufficient within it in every direction.
    range_m: f64,
    /// Smallest range of all rays for which the lower end of the interval is sufficient, in metres. The answer is yes
    /// within it.
    range_lower_m: f64,
    /// Largest range of all rays for which the upper end of the interval is sufficient, in metres. The answer is no
    /// beyond it, up to `range_max_m`. Null if the upper end is sufficient at `range_max_m` in at least one direction.
    range_upper_m: Option<f64>,
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
    /// Range in metres beyond which the upper end of the interval is never sufficient, up to `range_max_m`: the answer
    /// is no. Null if the upper end is sufficient at `range_max_m`.
    range_upper_m: Option<f64>,
    /// Distance of the farthest position with data within 15 degrees of the bearing, in metres.
    data_m: f64,
}

/// Interval of the rays in the printed table.
const SHOWN_EACH: usize = 6;

impl Options {
    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let opened = self.common.open(&[])?;
        let at = positions("--at", &[self.at], &opened.reference, opened.depth_m)?;
        let mut learned = opened.learn()?;
        let LearnedMap { extent, agent, .. } = &mut learned.learned_map;
        let range_max_m = self.range_max_m.unwrap_or(extent.longest_m);
        if range_max_m <= 0.0 {
            return Err(BadInput("all links with data are of length 0; expected --range-max-m".into()).into());
        }
        let bar = spinner("looking around");
        let rays =
            standoff(agent, &learned.queries.of(&at, Join::All, extent), (self.common.probability, range_max_m))?;
        bar.finish_and_clear();
        let found = Found::new(&self.common, rays, range_max_m, extent.sentence(&at[0]));
        if self.common.json {
            print_json(results, &self.json(&learned, &at[0], &found))?;
        } else {
            print_text(results, &found.text())?;
        }
        let lines = found.lines(at[0]);
        let closed = lines.clone().map(|line| [line.clone(), vec![line[0]]].concat());
        let series: Vec<Series> =
            (0..3).map(|n| Series { name: NAMES[n], points: &closed[n], style: LINES[n] }).collect();
        let content = PlanContent {
            at: &at,
            join: Join::All,
            title: &found.title(),
            sentence: &found.sentence(),
            lines: &series,
            shapes: self.shapes(&lines, (at[0].east_m, at[0].north_m)),
            below: None,
            header: &HEADER,
            rows: found.rows(at[0]),
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
    range_upper_m: Option<f64>,
    /// Where the data end.
    data: String,
}

impl Found {
    fn new(common: &Common, rays: Vec<Ray>, range_max_m: f64, data: String) -> Self {
        let least = |of: fn(&Ray) -> f64| rays.iter().map(of).fold(f64::MAX, f64::min);
        let (range_m, range_lower_m) = (least(|ray| ray.range_m), least(|ray| ray.range_lower_m));
        let range_upper_m = rays.iter().try_fold(0.0, |upper_m: f64, ray| Some(upper_m.max(ray.range_upper_m?)));
        let answer = if range_lower_m >= step_m(range_max_m) {
            Answer::Yes
        } else if rays.iter().any(|ray| ray.nearest == Answer::No) {
            Answer::No
        } else {
            Answer::NotKnown
        };
        let seen = match common.seen {
            SeenOnce::Tx => "a message from this place is heard",
            SeenOnce::Rx => "a message to this place is heard",
            SeenOnce::Worst => "messages to and from this place are heard",
        };
        let probability = common.probability;
        Self { rays, probability, range_max_m, seen, answer, range_m, range_lower_m, range_upper_m, data }
    }

    /// Returns the ends of the rays, by each of [`NAMES`]. A range that is not known is drawn at the largest one.
    fn lines(&self, from: Position) -> [Vec<Point>; 3] {
        let upper_m = |ray: &Ray| ray.range_upper_m.unwrap_or(self.range_max_m);
        let line = |of: &dyn Fn(&Ray) -> f64| self.rays.iter().map(|ray| ray.place(from, of(ray))).collect();
        [line(&|ray| ray.range_m), line(&|ray| ray.range_lower_m), line(&upper_m)]
    }

    /// Returns the rows of the table of rays. A range that is not known is empty.
    fn rows(&self, from: Position) -> Vec<(Point, Vec<String>)> {
        let row = |ray: &Ray| {
            let (east_m, north_m) = ray.place(from, ray.range_m);
            let &Ray { bearing_deg, range_m, range_lower_m, range_upper_m, data_m, .. } = ray;
            let numbers = [
                Some(bearing_deg),
                Some(range_m),
                Some(range_lower_m),
                range_upper_m,
                Some(data_m),
                Some(east_m),
                Some(north_m),
            ];
            let fields = numbers.map(|number| number.map_or_else(String::new, |number| number.to_string()));
            ((east_m, north_m), fields.to_vec())
        };
        self.rays.iter().map(row).collect()
    }

    fn title(&self) -> String {
        match self.answer {
            Answer::Yes => format!("Stay within the solid line to be heard with {}", self.probability),
            Answer::No | Answer::NotKnown => format!("Where messages are heard with {}", self.probability),
        }
    }

    /// Answers whether there is a sufficient range.
    fn sentence(&self) -> String {
        let &Self { probability, seen, range_m, range_lower_m, range_max_m, .. } = self;
        let answer = match self.answer {
            Answer::Yes => format!("Yes: within {range_lower_m:.0} m in every direction, {seen} with {probability}"),
            Answer::No => {
                format!("No: in at least one direction, the answer is no even at {:.0} m", step_m(range_max_m))
            }
            Answer::NotKnown => {
                format!("Not known: even at short range, the data do not decide whether {seen} with {probability}")
            }
        };
        let by_probability = if self.answer != Answer::No && range_m > 0.0 {
            &*format!(" (the probability itself reaches {probability} within {range_m:.0} m)")
        } else {
            ""
        };
        let beyond = match self.range_upper_m {
            Some(upper_m) if upper_m > 0.0 => {
                &*format!(". Between {upper_m:.0} m and {range_max_m:.0} m, the answer is no in every direction")
            }
            _ => "",
        };
        format!("{answer}{by_probability}{beyond}.")
    }

    fn text(&self) -> String {
        let metres = |range_m: f64| {
            if range_m >= self.range_max_m { format!("{range_m:.0}+") } else { format!("{range_m:.0}") }
        };
        let row = |ray: &Ray| {
            vec![
                format!("{:03.0}°", ray.bearing_deg),
                metres(ray.range_lower_m),
                metres(ray.range_m),
                ray.range_upper_m.map_or_else(|| "not known".to_owned(), metres),
                format!("{:.0}", ray.data_m),
            ]
        };
        let rows: Vec<Vec<String>> = self.rays.iter().step_by(SHOWN_EACH).map(row).collect();
        let header = ["bearing", "yes within (m)", "by the probability (m)", "no beyond (m)", "data up to (m)"];
        format!("{}\n\n{}\n{}", table(&header, &rows), self.sentence(), self.data)
    }
}

/// Names of the lines.
const NAMES: [&str; 3] = ["by the probability", "yes within", "no beyond (up to the tested range)"];

/// Columns of the table of rays.
const HEADER: [&str; 7] =
    ["bearing_deg", "range_m", "range_lower_m", "range_upper_m", "data_m", "easting_m", "northing_m"];

const LINES: [Style; 3] = [
    Style { color: "#d00000", width: 1.4, dash: &[2.0, 3.0], mark: Mark::None },
    Style { color: "#d00000", width: 2.2, dash: &[], mark: Mark::None },
    Style { color: "#d00000", width: 2.2, dash: &[6.0, 4.0], mark: Mark::None },
];
