//! `pingmap plan standoff`: the area in which messages are received with a given probability.

use clap::Args;
use pingmap_agent::Position;
use pingmap_import::Place;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

use super::common::{Common, LearnedPlan, PlanContent};
use crate::cli_enums::{Join, name_of};
use crate::cli_parsers::{open_share, place, positive};
use crate::exports::{Line, Shape};
use crate::figure::{Mark, Series, Style};
use crate::grid::Point;
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
    /// Required probability that a message is received
    #[arg(long, default_value_t = 0.9, value_parser = open_share)]
    pub probability: f64,
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
    /// Smallest range of all rays in metres. The probability is sufficient within it in every direction.
    range_m: f64,
    /// Smallest range for which the lower end of the interval is sufficient, in metres.
    range_lower_m: f64,
    /// Ranges for each bearing.
    rays: Vec<RayJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct RayJson {
    /// Bearing in degrees, clockwise from north.
    bearing_deg: f64,
    /// Range in metres within which the probability is always sufficient.
    range_m: f64,
    /// Range in metres within which the lower end of the interval is always sufficient.
    range_lower_m: f64,
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
        let rays = standoff(
            &mut learned.learned_map.agent,
            &learned.queries.of(&at, Join::All),
            (self.probability, range_max_m),
        )?;
        bar.finish_and_clear();
        let least = |of: fn(&Ray) -> f64| rays.iter().map(of).fold(f64::MAX, f64::min);
        let (range_m, range_lower_m) = (least(|ray| ray.range_m), least(|ray| ray.range_lower_m));
        if self.common.json {
            let object = self.json(&learned, &at[0], &rays, (range_max_m, range_m, range_lower_m));
            print_json(results, &object)?;
        } else {
            print_text(results, &self.text(&rays, range_max_m, (range_m, range_lower_m)))?;
        }
        let lines = [|ray: &Ray| ray.range_m, |ray: &Ray| ray.range_lower_m]
            .map(|of| rays.iter().map(|ray| ray.place(at[0], of(ray))).collect::<Vec<Point>>());
        let names = [format!("heard with {}", self.probability), "by the lower end".to_owned()];
        let closed = lines.clone().map(|line| [line.clone(), vec![line[0]]].concat());
        let series: Vec<Series> =
            (0..2).map(|n| Series { name: &names[n], points: &closed[n], style: LINES[n] }).collect();
        let shapes = self.shapes(&lines, (at[0].east_m, at[0].north_m));
        let row = |ray: &Ray| {
            let (east_m, north_m) = ray.place(at[0], ray.range_m);
            let numbers = [ray.bearing_deg, ray.range_m, ray.range_lower_m, east_m, north_m];
            ((east_m, north_m), numbers.map(|number| number.to_string()).to_vec())
        };
        let content = PlanContent {
            at: &at,
            join: Join::All,
            title: &format!("Stay within the line to be heard with {}", self.probability),
            lines: &series,
            shapes,
            below: None,
            header: &["bearing_deg", "range_m", "range_lower_m", "easting_m", "northing_m"],
            rows: rays.iter().map(row).collect(),
            shown: &lines.concat(),
        };
        learned.write(content, results)
    }

    fn json(
        &self,
        learned: &LearnedPlan,
        at: &Position,
        rays: &[Ray],
        (range_max_m, range_m, range_lower_m): (f64, f64, f64),
    ) -> StandoffJson {
        let ray = |&Ray { bearing_deg, range_m, range_lower_m }: &Ray| RayJson { bearing_deg, range_m, range_lower_m };
        StandoffJson {
            schema: 1,
            digests: learned.learned_map.digests(),
            at: PlaceJson::of(at, &learned.reference),
            seen: name_of(&self.common.seen),
            probability: self.probability,
            range_max_m,
            events_used: learned.learned_map.log.events.len(),
            kernel: KernelJson::of(learned.learned_map.model()),
            range_m,
            range_lower_m,
            rays: rays.iter().map(ray).collect(),
        }
    }

    fn text(&self, rays: &[Ray], range_max_m: f64, (range_m, range_lower_m): (f64, f64)) -> String {
        let metres =
            |range_m: f64| if range_m >= range_max_m { format!("{range_m:.0}+") } else { format!("{range_m:.0}") };
        let row =
            |ray: &Ray| vec![format!("{:03.0}°", ray.bearing_deg), metres(ray.range_m), metres(ray.range_lower_m)];
        let rows: Vec<Vec<String>> = rays.iter().step_by(SHOWN_EACH).map(row).collect();
        let seen = match name_of(&self.common.seen).as_str() {
            "tx" => "a message from there gets through",
            "rx" => "a message to there gets through",
            _ => "messages there and back get through",
        };
        let table = table(&["bearing", "stay within (m)", "by the lower end (m)"], &rows);
        if range_m == 0.0 {
            let p = self.probability;
            return format!(
                "{table}\n\nThere is no range within which {seen} with a probability of {p} or more in every direction."
            );
        }
        format!(
            "{table}\n\nWithin {range_m:.0} m in every direction {seen} with a probability of {} or more; within {range_lower_m:.0} m by the lower \
             end of the 90 % interval, too.",
            self.probability
        )
    }

    fn shapes(&self, lines: &[Vec<Point>; 2], at: Point) -> Vec<Line> {
        let seen = name_of(&self.common.seen);
        let area = |n: usize, by: &str| Line {
            kind: "standoff",
            shape: Shape::Area(lines[n].clone()),
            properties: vec![
                ("probability", json!(self.probability)),
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
        vec![area(0, "probability"), area(1, "lower"), place]
    }
}

const LINES: [Style; 2] = [
    Style { color: "#d00000", width: 2.2, dash: &[], mark: Mark::None },
    Style { color: "#d00000", width: 2.2, dash: &[6.0, 4.0], mark: Mark::None },
];
