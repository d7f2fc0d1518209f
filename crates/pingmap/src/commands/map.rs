//! `pingmap map`: maps the probability of success between one or several positions and every cell of an area.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{End, Position};
use pingmap_import::{Place, Reference};
use schemars::JsonSchema;
use serde::Serialize;

use crate::area::Area;
use crate::cli_enums::{Join, Layer, Seen, name_of};
use crate::cli_parsers::{corners, heading, not_negative, open_share, place, positive, print_width};
use crate::exports::{self, Export};
use crate::figure::{Figure, Image};
use crate::learned_map::{LearnedMap, OpenedLog};
use crate::map_figure::{FigureContent, figure};
use crate::model::{InputDigests, KernelJson};
use crate::options::{QueryOptions, RESULT, Source};
use crate::output::{BadInput, Results, note, print_json, spinner, warn};
use crate::output_target::{Overwrite, STANDARD_OUTPUT, ending, picture};
use crate::reference::{PlaceJson, position, positions, reference};
use crate::success_map::{HATCH_WIDTH, LEVELS, MapQuery, Reach, Side, SuccessMap};

/// Draw the probability of success seen from one position, or from several
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap map log.csv --at 700,510 -o map.png\n  pingmap map log.csv --origin 41.52,-70.67 --at 41.522N,70.665W --as worst --layers probability,width -o map.svg\n  pingmap map log.csv --origin 41.52,-70.67 --at 0,0 --at 800,0 --join all --model model.toml -o both.tif"
)]
pub struct Options {
    #[command(flatten)]
    pub view: View,
    #[command(flatten)]
    pub query: QueryOptions,
    #[command(flatten)]
    pub drawing: Drawing,
    #[command(flatten)]
    pub source: Source,
    /// File for the map: .png, .svg, .pdf, .csv, .geojson, .kml or .tif
    ///
    /// The extension selects the format. A CSV file contains the grid; GeoJSON and KML contain areas, contours and
    /// tracks; a GeoTIFF has a band for each number. For - the grid goes to standard output.
    #[arg(help_heading = RESULT, long, short, value_name = "FILE", default_value = "map.png")]
    pub output: PathBuf,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print a description of the map as one JSON object
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

/// The view that a map shows.
#[derive(Args)]
#[command(next_help_heading = "View")]
pub struct View {
    /// Position that the map is seen from; repeat the option for several positions
    ///
    /// A position is in metres of the log, or in degrees such as 41.52N,70.67W, with an optional depth.
    #[arg(long, value_name = "PLACE", value_parser = place, allow_hyphen_values = true, required = true)]
    pub at: Vec<(Place, Option<f64>)>,
    /// Role of the position
    #[arg(long = "as", value_enum, default_value_t = Seen::Tx)]
    pub seen: Seen,
    /// Whether all of several positions are needed, or any
    #[arg(long, value_enum, default_value_t = Join::All)]
    pub join: Join,
    /// Two opposite corners of the area; the area of the log if not given
    #[arg(long, value_name = "CORNER,CORNER", value_parser = corners, allow_hyphen_values = true)]
    pub bounds: Option<(Place, Place)>,
    /// Depth of the cells, if the log has depths; the mean depth of the log if not given
    #[arg(long, value_name = "METRES", value_parser = not_negative, allow_negative_numbers = true)]
    pub depth: Option<f64>,
    /// Heading of the vehicle in the cells, clockwise from north; if not given, the map shows the mean over headings
    #[arg(long, value_name = "DEGREES", value_parser = heading, allow_negative_numbers = true)]
    pub heading: Option<f64>,
    /// Width of a grid cell; the longer side has 120 cells if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub cell_m: Option<f64>,
}

/// Options of the drawing.
#[derive(Args)]
#[command(next_help_heading = "Drawing")]
pub struct Drawing {
    /// Levels of the contours, rising
    #[arg(long, value_name = "P,…", value_delimiter = ',', value_parser = open_share, default_values_t = LEVELS)]
    pub levels: Vec<f64>,
    /// Quantities that the colours show, one picture for each, stacked
    #[arg(long, value_enum, value_delimiter = ',', default_value = "probability")]
    pub layers: Vec<Layer>,
    /// Hatch cells whose 90 % interval is wider than this: there the probability is not known
    #[arg(long, value_name = "WIDTH", value_parser = open_share, default_value_t = HATCH_WIDTH)]
    pub hatch_width: f64,
    /// Draw heard and missed events that were sent near the position; with --as rx, those received near it
    #[arg(long)]
    pub with_events: bool,
    /// Title above the picture
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// Width of the picture in print, with letters of 9 points where there is room; PNG files then have 300 dots per
    /// inch
    #[arg(long, value_name = "MM", value_parser = print_width, allow_negative_numbers = true)]
    pub width_mm: Option<f64>,
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
    let target = options.overwrite.target(&options.output, &options.source.inputs())?.with_json(options.json)?;
    let log = LearnedMap::open(&options.source)?;
    let reference = reference(log.reference)?;
    check(options, format, &log)?;
    let view = &options.view;
    let depth_m = view.depth.or(log.mean_depth_m());
    let at = positions("--at", &view.at, &reference, depth_m)?;
    let area = view.area(&log, &at, &reference)?;
    let attempt = options.query.attempt(&log)?;
    let mut learned_map = LearnedMap::learn(log, &options.source)?.capped(&options.query);
    let bar = spinner("drawing");
    let has_aspects = has_aspects(&learned_map);
    if view.heading.is_some() && !cells_have_aspect(&learned_map, view.seen) {
        warn("--heading changes nothing: the model has no aspect term of the vehicle in the cells");
    }
    let heading_deg = view.heading;
    let extent = &learned_map.extent;
    at.iter().filter(|at| extent.is_far(at)).for_each(|at| warn(format_args!("--at: {}", extent.sentence(at))));
    let query = MapQuery { at: &at, seen: view.seen, join: view.join, depth_m, heading_deg, extent, attempt: &attempt };
    let map = SuccessMap::new(&mut learned_map.agent, area, &query)?;
    let bytes = bytes(format, &map, &learned_map, &reference, &options.drawing)?;
    bar.finish_and_clear();
    let written = target.write(&bytes, results);
    if let (Some(&required), [side]) = (options.drawing.levels.last(), &map.sides[..]) {
        note(map.reach(side, required).sentence());
    }
    if written.is_ok() {
        note(format_args!("wrote {}", options.output.display()));
        if has_aspects && heading_deg.is_none() {
            note("the map shows the mean over headings of both ends; --heading fixes that of the cells");
        }
    }
    if options.json {
        print_json(results, &MapJson::of(options, &learned_map, &map, &reference))?;
    }
    written
}

/// Refuses options that contradict each other or the log.
fn check(options: &Options, format: Format, log: &OpenedLog) -> Result<(), BadInput> {
    if format.is_on_earth() && !log.reference.is_known() {
        return Err(BadInput(format!(
            "{}: the log has no reference system; expected --origin LAT,LON, the position of (0, 0), or --crs EPSG:CODE",
            options.output.display()
        )));
    }
    if !options.drawing.levels.is_sorted_by(|a, b| a < b) {
        return Err(BadInput("--levels: expected rising probabilities".into()));
    }
    if options.view.depth.is_some() && !log.has_depths {
        return Err(BadInput("--depth: the log has no depths; expected columns tx_depth_m and rx_depth_m".into()));
    }
    Ok(())
}

impl View {
    /// Returns the area between the given corners, or around the log and the positions.
    fn area(&self, log: &OpenedLog, at: &[Position], reference: &Reference) -> anyhow::Result<Area> {
        let corner = |corner| position("--bounds", corner, reference);
        Ok(match self.bounds {
            Some((a, b)) => Area::between(corner(a)?, corner(b)?, self.cell_m)?,
            None => {
                let ends = log.events.iter().flat_map(|event| event.link.ends());
                Area::around(ends.chain(at.iter().copied()), self.cell_m)?
            }
        })
    }
}

/// Returns true if the model depends on headings.
fn has_aspects(learned_map: &LearnedMap) -> bool {
    let model = &learned_map.agent.team().model;
    [End::Transmitter, End::Receiver].into_iter().any(|end| model.has_aspect(end))
}

/// Returns true if the model depends on the heading of the vehicle in the cells.
fn cells_have_aspect(learned_map: &LearnedMap, seen: Seen) -> bool {
    let model = &learned_map.agent.team().model;
    match seen {
        Seen::Tx => model.has_aspect(End::Receiver),
        Seen::Rx => model.has_aspect(End::Transmitter),
        Seen::Both | Seen::Worst => has_aspects(learned_map),
    }
}

fn bytes(
    format: Format,
    map: &SuccessMap,
    learned_map: &LearnedMap,
    reference: &Reference,
    drawing: &Drawing,
) -> anyhow::Result<Vec<u8>> {
    let &Drawing { ref levels, ref layers, ref title, with_events, hatch_width, width_mm } = drawing;
    let events = &learned_map.log.events;
    let known = Some(reference).filter(|reference| reference.system().is_known());
    let content = FigureContent {
        events,
        log: &learned_map.name,
        levels,
        layers,
        title: title.as_deref(),
        sentence: None,
        reference: known,
        with_events,
        hatch_width,
        lines: &[],
    };
    let export = Export { map, events, reference, levels, hatch_width };
    match format {
        Format::Picture(image) => Figure::fitted(width_mm, |room| figure(map, &content, room)).file(image, width_mm),
        Format::Csv => exports::csv(&export),
        Format::GeoJson => exports::geojson(&export),
        Format::Kml => exports::kml(&export),
        Format::GeoTiff => exports::geotiff(&export),
    }
}

/// Description of a map in JSON.
#[derive(Serialize, JsonSchema)]
pub struct MapJson<'a> {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    digests: InputDigests,
    /// The file that was written.
    file: &'a Path,
    /// The first position that the map is seen from, in metres of the log.
    at: [f64; 2],
    /// All positions that the map is seen from.
    places: Vec<PlaceJson>,
    /// Whether the model depends on the headings of both ends.
    depends_on_heading: bool,
    /// Heading of the vehicle in the cells, in degrees clockwise from north; null for the mean over headings.
    heading_deg: Option<f64>,
    /// Role of these positions: `tx` transmits, `rx` receives, `both` both roles on two maps, `worst` the less probable
    /// direction.
    #[serde(rename = "as")]
    seen: String,
    /// Combination of several positions: `all` of them are needed, or `any`.
    join: String,
    /// Reference system of the metres; `unknown` if the log does not name it.
    reference_system: String,
    /// Number of events from which the map was learned.
    events_used: usize,
    /// Kernel of the model.
    kernel: KernelJson,
    /// Number of columns, from west to east.
    columns: usize,
    /// Number of rows, from south to north.
    rows: usize,
    /// Side of a cell in metres.
    cell_m: f64,
    /// Western and eastern edge of the map in metres.
    east_m: [f64; 2],
    /// Southern and northern edge of the map in metres.
    north_m: [f64; 2],
    /// Share of the area above each level, for the first side. `interval_width` is also for the first side.
    share_above: Vec<ShareAbove>,
    /// Median width of the cells' 90 % intervals.
    interval_width: f64,
    /// Width of a 90 % interval beyond which a cell is hatched, because its probability is not known.
    hatch_width: f64,
    /// All sides of the map.
    sides: Vec<SideJson>,
}

/// One side of a map: one direction, or the worse direction.
#[derive(Serialize, JsonSchema)]
pub struct SideJson {
    /// Role of the positions: `tx` transmits, `rx` receives, `both` both roles on two maps, `worst` the less probable
    /// direction.
    #[serde(rename = "as")]
    seen: String,
    /// Share of the area above each level.
    share_above: Vec<ShareAbove>,
    /// Median width of the cells' 90 % intervals.
    interval_width: f64,
    /// Share of the area that is hatched.
    share_not_known: f64,
    /// Distances at which the highest level is reached.
    reach: Reach,
}

/// Share of the area in which the probability is at least a level.
#[derive(Serialize, JsonSchema)]
struct ShareAbove {
    /// The level.
    probability: f64,
    /// Share of the area that reaches the level.
    share: f64,
}

impl SideJson {
    fn of(map: &SuccessMap, side: &Side, drawing: &Drawing) -> Self {
        let levels = &drawing.levels;
        let required = levels.last().copied().unwrap_or(LEVELS[1]);
        let share =
            |&level: &f64| ShareAbove { probability: level, share: side.share(|cell| cell.probability >= level) };
        Self {
            seen: name_of(&side.seen),
            share_above: levels.iter().map(share).collect(),
            interval_width: side.interval_width(),
            share_not_known: side.share(|cell| cell.width() > drawing.hatch_width),
            reach: map.reach(side, required),
        }
    }
}

impl<'a> MapJson<'a> {
    fn of(options: &'a Options, learned_map: &LearnedMap, map: &SuccessMap, reference: &Reference) -> Self {
        let SideJson { share_above, interval_width, .. } = SideJson::of(map, &map.sides[0], &options.drawing);
        let area = &map.area;
        Self {
            schema: 2,
            digests: learned_map.digests(),
            file: &options.output,
            at: [map.at[0].east_m, map.at[0].north_m],
            depends_on_heading: has_aspects(learned_map),
            heading_deg: options.view.heading,
            places: map.at.iter().map(|place| PlaceJson::of(place, reference)).collect(),
            seen: name_of(&options.view.seen),
            join: name_of(&map.join),
            reference_system: reference.system().to_string(),
            events_used: learned_map.log.events.len(),
            kernel: KernelJson::of(learned_map.model()),
            columns: area.columns,
            rows: area.rows,
            cell_m: area.cell_m,
            east_m: area.east.into(),
            north_m: area.north.into(),
            share_above,
            interval_width,
            hatch_width: options.drawing.hatch_width,
            sides: map.sides.iter().map(|side| SideJson::of(map, side, &options.drawing)).collect(),
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Picture(Image),
    Csv,
    GeoJson,
    Kml,
    GeoTiff,
}

impl Format {
    /// Whether the format needs positions on Earth.
    fn is_on_earth(self) -> bool {
        matches!(self, Format::GeoJson | Format::Kml | Format::GeoTiff)
    }

    fn of(path: &Path) -> anyhow::Result<Self> {
        if path == Path::new(STANDARD_OUTPUT) {
            return Ok(Format::Csv);
        }
        if let Some(image) = picture(path)? {
            return Ok(Format::Picture(image));
        }
        match ending(path).as_str() {
            "csv" => Ok(Format::Csv),
            "geojson" => Ok(Format::GeoJson),
            "kml" => Ok(Format::Kml),
            "tif" | "tiff" => Ok(Format::GeoTiff),
            _ => {
                let message = format!(
                    "cannot tell the kind of map from {}; expected an ending .png, .svg, .pdf, .csv, .geojson, .kml or .tif",
                    path.display()
                );
                Err(BadInput(message).into())
            }
        }
    }
}
