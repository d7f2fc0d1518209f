//! `pingmap map`: the probability of success seen from one place.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::Position;
use pingmap_trial::EventLog;
use serde::Serialize;

use crate::model::KernelJson;
use crate::options::{Asked, Source};
use crate::output::{BadInput, Results, note, print_json, spinner};
use crate::outputs::{Kind, STANDARD_OUTPUT, Target};
use crate::success_map::{CONTOURS, SuccessMap};
use crate::survey::Survey;
use crate::values::{End, name_of, origin, pair, positive};

/// Draw the probability of success seen from one place
#[derive(Args)]
pub struct Options {
    #[command(flatten)]
    pub source: Source,
    /// The place the map is seen from, in metres of the log
    #[arg(long, value_name = "EAST,NORTH", value_parser = pair, allow_hyphen_values = true)]
    pub at: (f64, f64),
    /// Whether that place transmits or receives
    #[arg(long = "as", value_enum, default_value_t = End::Tx)]
    pub end: End,
    #[command(flatten)]
    pub asked: Asked,
    /// File for the map; its ending says what it is: .png, .svg, .csv (the grid) or .geojson (the contours; needs
    /// --origin). The grid goes to standard output for -
    #[arg(long, short, value_name = "FILE", default_value = "map.png")]
    pub output: PathBuf,
    /// Latitude and longitude of (0, 0) of the log, in degrees
    #[arg(long, value_name = "LAT,LON", value_parser = pair, allow_hyphen_values = true)]
    pub origin: Option<(f64, f64)>,
    /// Width of a grid cell; the longer side has 120 cells if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub cell_m: Option<f64>,
    /// Print what was drawn as one JSON object
    #[arg(long)]
    pub json: bool,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.source.work.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        run(self, results)
    }
}

fn run(options: &Options, results: Results) -> anyhow::Result<()> {
    let format = Format::of(&options.output)?;
    let origin = options.origin.map(origin).transpose()?;
    if format == Format::GeoJson && origin.is_none() {
        let message = "a .geojson map needs --origin LAT,LON, the latitude and longitude of (0, 0) of the log";
        return Err(BadInput(message.to_owned()).into());
    }
    let logs = &options.source.logs;
    let target = Target::new(&options.output, format.kind(), &logs.paths(), logs.force)?;
    let log = Survey::open(&options.source)?;
    let asked = options.asked.attempt(&log)?;
    if origin.is_some() {
        check_near_origin(&log)?;
    }
    let mut survey = Survey::learn(log, &options.source)?.rising(&options.asked);
    let (east, north) = options.at;
    let at = Position { depth_m: survey.log.mean_depth_m(), ..Position::new(east, north) };
    let bar = spinner("drawing");
    let events = &survey.log.events;
    let map = SuccessMap::new(&mut survey.agent, events, (at, options.end), &asked, options.cell_m)?;
    let bytes = match format {
        Format::Png => map.figure(&survey.log.events).png()?,
        Format::Svg => map.figure(&survey.log.events).svg(true).into_bytes(),
        Format::Csv => map.csv()?.into_bytes(),
        Format::GeoJson => {
            let mut chart = survey.model().chart;
            chart.geographic = origin;
            serde_json::to_vec_pretty(&map.geojson(&|position| chart.geographic(position)))?
        }
    };
    bar.finish_and_clear();
    let written = target.write(&bytes, results);
    if written.is_ok() {
        note(format_args!("wrote {}", options.output.display()));
    }
    if options.json && !target.is_standard_output() {
        print_json(results, &MapJson::of(options, &survey, &map))?;
    }
    written
}

/// What was drawn.
#[derive(Serialize)]
struct MapJson<'a> {
    schema: u32,
    file: &'a Path,
    at: [f64; 2],
    #[serde(rename = "as")]
    end: String,
    events_used: usize,
    kernel: KernelJson,
    columns: usize,
    rows: usize,
    cell_m: f64,
    share_above: [ShareAbove; 2],
    /// Median width over the map of the intervals that hold nine in ten of the probabilities.
    interval_width: f64,
}

/// Share of the map's area where success is at least this probable.
#[derive(Serialize)]
struct ShareAbove {
    probability: f64,
    share: f64,
}

impl<'a> MapJson<'a> {
    fn of(options: &'a Options, survey: &Survey, map: &SuccessMap) -> Self {
        Self {
            schema: 1,
            file: &options.output,
            at: [options.at.0, options.at.1],
            end: name_of(&options.end),
            events_used: survey.log.events.len(),
            kernel: KernelJson::of(survey.model()),
            columns: map.columns,
            rows: map.rows(),
            cell_m: map.cell_m,
            share_above: CONTOURS.map(|level| ShareAbove { probability: level, share: map.share_above(level) }),
            interval_width: map.interval_width(),
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Png,
    Svg,
    Csv,
    GeoJson,
}

impl Format {
    /// What such a file is known by.
    fn kind(self) -> Kind {
        match self {
            Format::Png => Kind::PNG,
            Format::Svg => Kind::SVG,
            Format::Csv => Kind::GRID,
            Format::GeoJson => Kind::GEO_JSON,
        }
    }

    fn of(path: &Path) -> anyhow::Result<Self> {
        if path == Path::new(STANDARD_OUTPUT) {
            return Ok(Format::Csv);
        }
        match path.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase).as_deref() {
            Some("png") => Ok(Format::Png),
            Some("svg") => Ok(Format::Svg),
            Some("csv") => Ok(Format::Csv),
            Some("geojson") => Ok(Format::GeoJson),
            _ => {
                let message = format!(
                    "cannot tell the kind of map from {}; expected an ending .png, .svg, .csv or .geojson",
                    path.display()
                );
                Err(BadInput(message).into())
            }
        }
    }
}

/// A plane tangent to the Earth is no map of it farther out than this.
const ORIGIN_DISTANCE_MAX_M: f64 = 1e5;

/// Checks that (0, 0) of the log is near its events, as `--origin` needs.
fn check_near_origin(log: &EventLog) -> anyhow::Result<()> {
    let ends = log.events.iter().flat_map(|event| event.link.ends());
    let farthest_m = ends.map(|end| end.east_m.hypot(end.north_m)).fold(0.0, f64::max);
    if farthest_m > ORIGIN_DISTANCE_MAX_M {
        let farthest_km = farthest_m / 1000.0;
        let message = format!(
            "--origin is the place of (0, 0), but events lie up to {farthest_km:.0} km from there; expected at most 100 km (are \
             these UTM coordinates?)"
        );
        return Err(BadInput(message).into());
    }
    Ok(())
}
