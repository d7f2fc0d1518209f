//! `pingmap map`: the probability of success seen from one place.

use std::collections::BTreeMap;
use std::path::Path;

use dgpc::Posterior;
use pingmap_agent::{Event, Geographic, Link, Model, Position, VehicleId};
use pingmap_trial::EventLog;
use serde_json::json;

use crate::cli::{self, End, name_of};
use crate::contour::{Grid, Point, contour_lines};
use crate::figure::{self, Mark, Series, Style};
use crate::learn::kernel_json;
use crate::output::{BadInput, note, print_json, spinner, use_threads, write_file};
use crate::predict::csv_text;
use crate::survey::{Survey, mean_depth_m};

/// Probabilities whose contours are drawn.
pub const CONTOURS: [f64; 2] = [0.5, 0.9];

/// Cells along the longer side of a map.
const CELLS: f64 = 120.0;

/// The most cells a map may have.
const CELLS_MAX: f64 = 4e6;

/// Pixels along the longer side of a figure.
pub const SIDE: f64 = 640.0;

pub fn run(options: &cli::Map) -> anyhow::Result<()> {
    use_threads(options.source.work.threads)?;
    let format = Format::of(&options.output)?;
    let origin = options.origin.map(geographic).transpose()?;
    if format == Format::GeoJson && origin.is_none() {
        let message = "a .geojson map needs --origin LAT,LON, the latitude and longitude of (0, 0) of the log";
        return Err(BadInput(message.to_owned()).into());
    }
    let survey = Survey::learn(&options.source)?;
    if origin.is_some() {
        check_near_origin(&survey.log)?;
    }
    let (east, north) = options.at;
    let at = Position { depth_m: mean_depth_m(&survey.log), ..Position::new(east, north) };
    let bar = spinner("drawing");
    let map = SuccessMap::new(&survey.posterior, survey.model(), &survey.log.events, at, options.end, options.cell_m)?;
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
    write_file(&options.output, &bytes)?;
    bar.finish_and_clear();
    note(format_args!("wrote {}", options.output.display()));
    if options.json {
        print_json(&json!({
            "schema": 1, "file": options.output, "at": [east, north], "as": name_of(&options.end),
            "events_used": survey.log.events.len(),
            "kernel": kernel_json(survey.model()),
            "columns": map.columns, "rows": map.values.len() / map.columns, "cell_m": map.cell_m,
            "share_above": CONTOURS.map(|level| json!({ "probability": level, "share": map.share_above(level) })),
        }))?;
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Png,
    Svg,
    Csv,
    GeoJson,
}

impl Format {
    fn of(path: &Path) -> anyhow::Result<Self> {
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

fn geographic((latitude_deg, longitude_deg): (f64, f64)) -> anyhow::Result<Geographic> {
    if latitude_deg.abs() >= 90.0 || longitude_deg.abs() > 180.0 {
        let message = format!(
            "--origin {latitude_deg},{longitude_deg}: expected a latitude between -90 and 90 and a longitude from -180 to 180"
        );
        return Err(BadInput(message).into());
    }
    Ok(Geographic { latitude_deg, longitude_deg })
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

/// Probability of success between one place and every cell of a grid.
pub struct SuccessMap {
    at: Position,
    end: End,
    /// Row by row from the south, each row from the west.
    values: Vec<f64>,
    columns: usize,
    east: (f64, f64),
    north: (f64, f64),
    cell_m: f64,
}

impl SuccessMap {
    /// Predicts every cell of a grid over the area of the log and the place itself. O(cells · n²).
    pub fn new(
        posterior: &Posterior,
        model: &Model,
        events: &[Event],
        at: Position,
        end: End,
        cell_m: Option<f64>,
    ) -> anyhow::Result<Self> {
        let (east, north) = extent(events, &at);
        let cell_m = cell_m.unwrap_or((east.1 - east.0).max(north.1 - north.0) / CELLS);
        let cells = |(low, high): (f64, f64)| ((high - low) / cell_m).ceil().max(1.0);
        let (columns, rows) = (cells(east), cells(north));
        if columns * rows > CELLS_MAX {
            let message = format!("--cell-m {cell_m} makes {columns} x {rows} cells; expected at most {CELLS_MAX}");
            return Err(BadInput(message).into());
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let east = (east.0, east.0 + columns as f64 * cell_m);
        let north = (north.0, north.0 + rows as f64 * cell_m);
        let mut values = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            let links: Vec<Link> = (0..columns)
                .map(|column| {
                    let cell = Position {
                        east_m: east.0 + (column as f64 + 0.5) * cell_m,
                        north_m: north.0 + (row as f64 + 0.5) * cell_m,
                        depth_m: at.depth_m,
                    };
                    match end {
                        End::Tx => Link { transmitter: at, receiver: cell },
                        End::Rx => Link { transmitter: cell, receiver: at },
                    }
                })
                .collect();
            values.extend(posterior.probability(&model.inputs(&links)?)?);
        }
        Ok(Self { at, end, values, columns, east, north, cell_m })
    }

    fn grid(&self) -> Grid<'_> {
        Grid { values: &self.values, columns: self.columns, east: self.east, north: self.north }
    }

    /// Share of the map's area where success is at least this probable.
    pub fn share_above(&self, level: f64) -> f64 {
        self.values.iter().filter(|&&p| p >= level).count() as f64 / self.values.len() as f64
    }

    /// The map as a picture, with the tracks of everybody in the log.
    pub fn figure(&self, events: &[Event]) -> figure::Figure {
        let (title, name) = match self.end {
            End::Tx => ("Will a message sent from here get through?", "transmitter"),
            End::Rx => ("Will a message sent to here get through?", "receiver"),
        };
        let tracks = tracks(events);
        let series = tracks_as_series(&tracks);
        figure::probability_map(
            title,
            &self.grid(),
            &CONTOURS,
            &series,
            (name, (self.at.east_m, self.at.north_m)),
            SIDE,
        )
    }

    /// The grid as CSV: the middle of every cell, and the probability there.
    fn csv(&self) -> anyhow::Result<String> {
        let row = |(n, &p): (usize, &f64)| {
            let (column, row) = ((n % self.columns) as f64, (n / self.columns) as f64);
            vec![self.east.0 + (column + 0.5) * self.cell_m, self.north.0 + (row + 0.5) * self.cell_m, p]
        };
        let rows: Vec<Vec<f64>> = self.values.iter().enumerate().map(row).collect();
        csv_text(&["easting_m", "northing_m", "probability"], &rows)
    }

    /// The contours and the place as GeoJSON.
    fn geojson(&self, geographic: &dyn Fn(&Position) -> Option<Geographic>) -> serde_json::Value {
        let coordinates = |(east_m, north_m): Point| {
            let place = geographic(&Position::new(east_m, north_m));
            place.map(|place| json!([place.longitude_deg, place.latitude_deg]))
        };
        let contour = |level: f64| {
            let lines: Vec<Vec<_>> = contour_lines(&self.grid(), level)
                .into_iter()
                .map(|line| line.into_iter().filter_map(coordinates).collect())
                .collect();
            json!({
                "type": "Feature", "properties": { "probability": level },
                "geometry": { "type": "MultiLineString", "coordinates": lines },
            })
        };
        let place = json!({
            "type": "Feature", "properties": { "seen_from": name_of(&self.end) },
            "geometry": { "type": "Point", "coordinates": coordinates((self.at.east_m, self.at.north_m)) },
        });
        let features: Vec<_> = CONTOURS.into_iter().map(contour).chain([place]).collect();
        json!({ "type": "FeatureCollection", "features": features })
    }
}

/// The area of a log and a place, with a margin of a twentieth and at least 50 m; never narrower than half its length, so
/// that a straight survey line still makes a picture.
pub fn extent(events: &[Event], at: &Position) -> (Point, Point) {
    let ends = events.iter().flat_map(|event| event.link.ends());
    widened(ends.chain([*at]).map(|end| (end.east_m, end.north_m)))
}

/// The area of some places, with such a margin.
pub fn widened(places: impl Iterator<Item = Point>) -> (Point, Point) {
    let (mut east, mut north) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
    for place in places {
        east = (east.0.min(place.0), east.1.max(place.0));
        north = (north.0.min(place.1), north.1.max(place.1));
    }
    let longest = (east.1 - east.0).max(north.1 - north.0);
    let widen = |(low, high): (f64, f64)| {
        let margin = f64::max(f64::max(50.0, 0.05 * longest), 0.5 * (0.5 * longest - (high - low)));
        (low - margin, high + margin)
    };
    (widen(east), widen(north))
}

/// Everybody's positions in time, transmitting or receiving; who stays in place has one.
pub fn tracks(events: &[Event]) -> BTreeMap<&VehicleId, Vec<Point>> {
    let mut in_time: Vec<&Event> = events.iter().collect();
    in_time.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let mut tracks: BTreeMap<&VehicleId, Vec<Point>> = BTreeMap::new();
    for event in in_time {
        let Link { transmitter, receiver } = &event.link;
        for (id, end) in [(&event.transmitter_id, transmitter), (&event.receiver_id, receiver)] {
            let track = tracks.entry(id).or_default();
            let point = (end.east_m, end.north_m);
            if track.last() != Some(&point) {
                track.push(point);
            }
        }
    }
    tracks
}

/// Colours that differ in lightness, dashes and markers.
const COLORS: [&str; 4] = ["#d7301f", "#1b9e77", "#984ea3", "#ff7f00"];
const DASHES: [&[f64]; 4] = [&[], &[8.0, 4.0], &[2.0, 3.0], &[10.0, 3.0, 2.0, 3.0]];
const MARKS: [Mark; 4] = [Mark::Square, Mark::Triangle, Mark::Diamond, Mark::Dot];

/// The style of the n-th vehicle: of the first sixteen no two share colour and marker, nor colour and dashes.
pub fn style(n: usize) -> Style<'static> {
    let round = n / COLORS.len();
    let pick = |shift: usize| (n + shift) % COLORS.len();
    Style { color: COLORS[pick(0)], width: 1.6, dash: DASHES[pick(2 * round + round / 2)], mark: MARKS[pick(round)] }
}

/// Tracks ready to be drawn.
pub fn tracks_as_series<'a>(tracks: &'a BTreeMap<&VehicleId, Vec<Point>>) -> Vec<Series<'a>> {
    let series = tracks.iter().enumerate();
    series.map(|(n, (id, points))| Series { name: id.as_str(), points, style: style(n) }).collect()
}
