//! `pingmap map`: the probability of success seen from a place, or from several.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_import::{Place, Reference};
use schemars::JsonSchema;
use serde::Serialize;

use crate::area::Area;
use crate::exports::{self, Export};
use crate::figure::{Figure, Image};
use crate::map_figure::{Drawn, figure};
use crate::model::{KernelJson, MadeOf};
use crate::names::{Join, Layer, Seen, name_of};
use crate::options::{Asked as Parties, RESULT, Source};
use crate::output::{BadInput, Results, note, print_json, spinner};
use crate::outputs::{Kind, STANDARD_OUTPUT, Target, ending, picture};
use crate::reference::{PlaceJson, position, positions, reference};
use crate::success_map::{Asked, LEVELS, LITTLE_KNOWN, Side, SuccessMap};
use crate::survey::Survey;
use crate::values::{corners, not_negative, open_share, place, positive, print_width};

/// Draw the probability of success seen from a place, or from several
#[derive(Args)]
#[command(
    after_help = "Examples:\n  pingmap map log.csv --at 700,510 -o map.png\n  pingmap map log.csv --at 41.52N,70.67W --as worst --layers probability,width -o map.svg\n  pingmap map log.csv --at 0,0 --at 800,0 --join all --model model.toml -o both.tif"
)]
pub struct Options {
    #[command(flatten)]
    pub view: View,
    #[command(flatten)]
    pub asked: Parties,
    #[command(flatten)]
    pub drawing: Drawing,
    #[command(flatten)]
    pub source: Source,
    /// File for the map; its ending says what it is: .png, .svg, .pdf, .csv (the grid), .geojson, .kml (areas, contours and tracks) or .tif
    /// (GeoTIFF, a band for each number). The grid goes to standard output for -
    #[arg(help_heading = RESULT, long, short, value_name = "FILE", default_value = "map.png")]
    pub output: PathBuf,
    /// Print what was drawn as one JSON object
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

/// What is looked at.
#[derive(Args)]
#[command(next_help_heading = "View")]
pub struct View {
    /// A place the map is seen from: metres of the log, or degrees such as 41.52N,70.67W, and perhaps a depth. Several: seen from all
    #[arg(long, value_name = "PLACE", value_parser = place, allow_hyphen_values = true, required = true)]
    pub at: Vec<(Place, Option<f64>)>,
    /// Whether that place transmits, receives, or does both: as two maps, or as one of the worse direction
    #[arg(long = "as", value_enum, default_value_t = Seen::Tx)]
    pub seen: Seen,
    /// Of several places: whether all of them count at once, or any
    #[arg(long, value_enum, default_value_t = Join::All)]
    pub join: Join,
    /// Two opposite corners of the area, as places; that of the log if not given
    #[arg(long, value_name = "CORNER,CORNER", value_parser = corners, allow_hyphen_values = true)]
    pub bounds: Option<(Place, Place)>,
    /// Depth of what is elsewhere on the map, where the log has depths; their mean if not given
    #[arg(long, value_name = "METRES", value_parser = not_negative, allow_negative_numbers = true)]
    pub depth: Option<f64>,
    /// Width of a grid cell; the longer side has 120 cells if not given
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    pub cell_m: Option<f64>,
}

/// How it is drawn.
#[derive(Args)]
#[command(next_help_heading = "Drawing")]
pub struct Drawing {
    /// Probabilities whose contours are drawn, rising
    #[arg(long, value_name = "P,…", value_delimiter = ',', value_parser = open_share, default_values_t = LEVELS)]
    pub levels: Vec<f64>,
    /// What the colours of a picture say, one below the other
    #[arg(long, value_enum, value_delimiter = ',', default_value = "probability")]
    pub layers: Vec<Layer>,
    /// Draw where messages were heard and missed
    #[arg(long)]
    pub with_events: bool,
    /// What stands above the picture
    #[arg(long, value_name = "TEXT")]
    pub title: Option<String>,
    /// How wide the picture is to be in print, with letters of 9 points where there is room; PNG then have 300 dots an inch
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
    let logs = &options.source.logs;
    let target = Target::new(&options.output, format.kind(), &options.source.inputs(), logs.overwrite)?
        .beside_json(options.json)?;
    let log = Survey::open(&options.source)?;
    let reference = reference(log.reference)?;
    if format.is_on_earth() && !log.reference.is_known() {
        let message = format!(
            "{}: nobody said where the log's metres are; expected --origin LAT,LON, the place of (0, 0), or --crs EPSG:CODE",
            options.output.display()
        );
        return Err(BadInput(message).into());
    }
    let (view, drawing) = (&options.view, &options.drawing);
    if !drawing.levels.is_sorted_by(|a, b| a < b) {
        return Err(BadInput("--levels: expected rising probabilities".into()).into());
    }
    if view.depth.is_some() && !log.has_depths {
        return Err(
            BadInput("--depth: the log has no depths; expected columns tx_depth_m and rx_depth_m".into()).into()
        );
    }
    let depth_m = view.depth.or(log.mean_depth_m());
    let at = positions("--at", &view.at, &reference, depth_m)?;
    let area = match &view.bounds {
        Some((a, b)) => {
            Area::between(position("--bounds", *a, &reference)?, position("--bounds", *b, &reference)?, view.cell_m)?
        }
        None => {
            Area::around(log.events.iter().flat_map(|event| event.link.ends()).chain(at.iter().copied()), view.cell_m)?
        }
    };
    let attempt = options.asked.attempt(&log)?;
    let mut survey = Survey::learn(log, &options.source)?.capped(&options.asked);
    let bar = spinner("drawing");
    let asked = Asked { at: &at, seen: view.seen, join: view.join, depth_m, attempt: &attempt };
    let map = SuccessMap::new(&mut survey.agent, area, &asked)?;
    let bytes = bytes(format, &map, &survey, &reference, drawing)?;
    bar.finish_and_clear();
    let written = target.write(&bytes, results);
    if written.is_ok() {
        note(format_args!("wrote {}", options.output.display()));
    }
    if options.json {
        print_json(results, &MapJson::of(options, &survey, &map, &reference))?;
    }
    written
}

fn bytes(
    format: Format,
    map: &SuccessMap,
    survey: &Survey,
    reference: &Reference,
    drawing: &Drawing,
) -> anyhow::Result<Vec<u8>> {
    let &Drawing { ref levels, ref layers, ref title, with_events, width_mm } = drawing;
    let events = &survey.log.events;
    let known = Some(reference).filter(|reference| reference.system().is_known());
    let drawn = Drawn { events, levels, layers, title: title.as_deref(), reference: known, with_events, lines: &[] };
    let export = Export { map, events, reference, levels };
    match format {
        Format::Picture(image) => Figure::fitted(width_mm, |room| figure(map, &drawn, room)).file(image, width_mm),
        Format::Csv => exports::csv(&export),
        Format::GeoJson => exports::geojson(&export),
        Format::Kml => exports::kml(&export),
        Format::GeoTiff => exports::geotiff(&export),
    }
}

/// What was drawn.
#[derive(Serialize, JsonSchema)]
pub struct MapJson<'a> {
    /// Version of this object.
    schema: u32,
    #[serde(flatten)]
    made_of: MadeOf,
    /// The file that was written.
    file: &'a Path,
    /// The first place it is seen from, in metres of the log.
    at: [f64; 2],
    /// All of them.
    places: Vec<PlaceJson>,
    /// Who sends: `tx` the place asked about, `rx` the others, `both` each in turn, `worst` whichever direction is worse.
    #[serde(rename = "as")]
    seen: String,
    /// Of several places: whether `all` of them are to hear, or `any`.
    join: String,
    /// What metres mean; `unknown` where nobody said so.
    reference_system: String,
    /// How many events the answer rests on.
    events_used: usize,
    /// The kernel that all was computed with.
    kernel: KernelJson,
    /// Cells from west to east.
    columns: usize,
    /// Cells from south to north.
    rows: usize,
    /// Side of a cell.
    cell_m: f64,
    /// Where it begins and ends, west to east.
    east_m: [f64; 2],
    /// Where it begins and ends, south to north.
    north_m: [f64; 2],
    /// Of the first side, as what follows.
    share_above: Vec<ShareAbove>,
    /// Median width over the map of the intervals that hold nine in ten of the probabilities.
    interval_width: f64,
    /// Share of the area of which little is known beyond the prior.
    share_little_known: f64,
    /// Every direction that was asked for.
    sides: Vec<SideJson>,
}

/// One direction.
#[derive(Serialize, JsonSchema)]
pub struct SideJson {
    /// Who sends: `tx` the place asked about, `rx` the others, `both` each in turn, `worst` whichever direction is worse.
    #[serde(rename = "as")]
    seen: String,
    /// How much of the area has a probability at least as high as each level.
    share_above: Vec<ShareAbove>,
    /// Median width over the map of the intervals that hold nine in ten of the probabilities.
    interval_width: f64,
    /// Share of the area of which little is known beyond the prior.
    share_little_known: f64,
}

/// Share of the map's area where success is at least this probable.
#[derive(Serialize, JsonSchema)]
struct ShareAbove {
    /// The level.
    probability: f64,
    /// How much of the area reaches it.
    share: f64,
}

impl SideJson {
    fn of(side: &Side, levels: &[f64]) -> Self {
        let share =
            |&level: &f64| ShareAbove { probability: level, share: side.share(|cell| cell.probability >= level) };
        Self {
            seen: name_of(&side.seen),
            share_above: levels.iter().map(share).collect(),
            interval_width: side.interval_width(),
            share_little_known: side.share(|cell| cell.explained < LITTLE_KNOWN),
        }
    }
}

impl<'a> MapJson<'a> {
    fn of(options: &'a Options, survey: &Survey, map: &SuccessMap, reference: &Reference) -> Self {
        let levels = &options.drawing.levels;
        let SideJson { share_above, interval_width, share_little_known, .. } = SideJson::of(&map.sides[0], levels);
        let area = &map.area;
        Self {
            schema: 1,
            made_of: survey.made_of(),
            file: &options.output,
            at: [map.at[0].east_m, map.at[0].north_m],
            places: map.at.iter().map(|place| PlaceJson::of(place, reference)).collect(),
            seen: name_of(&options.view.seen),
            join: name_of(&map.join),
            reference_system: reference.system().to_string(),
            events_used: survey.log.events.len(),
            kernel: KernelJson::of(survey.model()),
            columns: area.columns,
            rows: area.rows,
            cell_m: area.cell_m,
            east_m: area.east.into(),
            north_m: area.north.into(),
            share_above,
            interval_width,
            share_little_known,
            sides: map.sides.iter().map(|side| SideJson::of(side, levels)).collect(),
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
    /// What such a file is known by.
    fn kind(self) -> Kind {
        match self {
            Format::Picture(image) => Kind::of(image),
            Format::Csv => Kind::GRID,
            Format::GeoJson => Kind::GEO_JSON,
            Format::Kml => Kind::KML,
            Format::GeoTiff => Kind::GEO_TIFF,
        }
    }

    /// Whether it says where on Earth things are.
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
