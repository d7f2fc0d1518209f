//! Options, log and output that all plans share.

use std::path::{Path, PathBuf};

use clap::Args;
use pingmap_agent::{Link, LinkQuery, Position};
use pingmap_import::{Reference, Waypoint, read_waypoints};

use crate::area::Area;
use crate::cli_enums::{Join, Layer, Seen, SeenOnce};
use crate::cli_parsers::{not_negative, open_share, print_width};
use crate::data_extent::DataExtent;
use crate::exports::{Line, geojson_of_lines, kml_of_lines};
use crate::figure::{Figure, Image, Room, Series, stacked};
use crate::grid::Point;
use crate::learned_map::{LearnedMap, OpenedLog};
use crate::log::opened;
use crate::map_figure::{FigureContent, figure};
use crate::options::{QueryOptions, RESULT, Source};
use crate::output::{BadInput, Results, csv_of_text, note, spinner};
use crate::output_target::{Overwrite, Target, ending, picture};
use crate::reference::reference;
use crate::success_map::{HATCH_WIDTH, MapQuery, SuccessMap};

#[derive(Args)]
pub struct Common {
    #[command(flatten)]
    pub parties: QueryOptions,
    #[command(flatten)]
    pub source: Source,
    /// Role of the position; a gateway that listens receives
    #[arg(help_heading = None::<&str>, long = "as", value_enum, default_value_t = SeenOnce::Rx)]
    pub seen: SeenOnce,
    /// Required probability that a message is received
    ///
    /// The answer is yes if the lower end of the 90 % interval reaches it, and no if the upper end is below it.
    /// Otherwise it is not known. `plan gateway` compares the share of messages that are received.
    #[arg(help_heading = None::<&str>, long, default_value_t = 0.9, value_parser = open_share)]
    pub probability: f64,
    /// Depth of the other ends, if the log has depths; the mean depth of the log if not given
    #[arg(help_heading = None::<&str>, long, value_name = "METRES", value_parser = not_negative, allow_negative_numbers = true)]
    pub depth: Option<f64>,
    /// Title of the picture
    #[arg(help_heading = RESULT, long, value_name = "TEXT")]
    pub title: Option<String>,
    /// Draw heard and missed events that were received near the position; with --as tx, those sent near it
    #[arg(help_heading = RESULT, long)]
    pub with_events: bool,
    /// File for the plan: .png, .svg, .pdf, .csv, .geojson or .kml
    #[arg(help_heading = RESULT, long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Width of the picture in print, with letters of 9 points where there is room; PNG files then have 300 dots per
    /// inch
    #[arg(help_heading = RESULT, long, value_name = "MM", value_parser = print_width, allow_negative_numbers = true)]
    pub width_mm: Option<f64>,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
}

/// Output format of a plan.
#[derive(Clone, Copy, PartialEq)]
enum Format {
    Picture(Image),
    Csv,
    GeoJson,
    Kml,
}

impl Format {
    fn of(path: &Path) -> Result<Self, BadInput> {
        if let Some(image) = picture(path)? {
            return Ok(Format::Picture(image));
        }
        match ending(path).as_str() {
            "csv" => Ok(Format::Csv),
            "geojson" => Ok(Format::GeoJson),
            "kml" => Ok(Format::Kml),
            _ => Err(BadInput(format!(
                "{}: expected a name that ends in .png, .svg, .pdf, .csv, .geojson or .kml",
                path.display()
            ))),
        }
    }
}

/// A log that was opened for a plan, with its reference system.
pub struct OpenedPlan<'a> {
    common: &'a Common,
    pub log: OpenedLog,
    pub reference: Reference,
    pub depth_m: Option<f64>,
    output: Option<(Format, Target<'a>)>,
}

impl Common {
    /// Opens the log, and checks that the plan can be content. `files` are further inputs, which must not be
    /// overwritten.
    pub fn open(&self, files: &[&Path]) -> anyhow::Result<OpenedPlan<'_>> {
        let inputs: Vec<&Path> = self.source.inputs().into_iter().chain(files.iter().copied()).collect();
        let output = match &self.output {
            None => None,
            Some(path) => {
                let format = Format::of(path)?;
                Some((format, self.overwrite.target(path, &inputs)?))
            }
        };
        let log = LearnedMap::open(&self.source)?;
        let reference = reference(log.reference)?;
        if let (Some((Format::GeoJson | Format::Kml, _)), Some(path)) = (&output, &self.output)
            && !log.reference.is_known()
        {
            let message = "a plan in latitude and longitude needs the position of (0, 0): expected --origin LAT,LON or --crs EPSG:CODE";
            return Err(BadInput(format!("{}: {message}", path.display())).into());
        }
        if self.depth.is_some() && !log.has_depths {
            let message = "--depth: the log has no depths; expected columns tx_depth_m and rx_depth_m";
            return Err(BadInput(message.into()).into());
        }
        let depth_m = self.depth.or(log.mean_depth_m());
        Ok(OpenedPlan { common: self, log, reference, depth_m, output })
    }
}

/// Column names of positions in degrees.
const DEGREES: [&str; 2] = ["latitude_deg", "longitude_deg"];

/// Reads a list of waypoints.
pub fn waypoints(path: &Path) -> anyhow::Result<Vec<Waypoint>> {
    let (reader, name) = opened(path)?;
    Ok(read_waypoints(reader, name)?)
}

/// Options of the queries of a plan.
pub struct QueryTemplate {
    seen: Seen,
    depth_m: Option<f64>,
    attempt: Box<dyn Fn(Link) -> LinkQuery>,
}

impl QueryTemplate {
    /// Returns the queries of a map or plan seen from these positions.
    pub fn of<'a>(&'a self, at: &'a [Position], join: Join, extent: &'a DataExtent) -> MapQuery<'a> {
        let Self { seen, depth_m, ref attempt } = *self;
        MapQuery { at, seen, join, depth_m, heading_deg: None, extent, attempt: &**attempt }
    }
}

/// The learned model, and the options of the queries.
pub struct LearnedPlan<'a> {
    pub(super) common: &'a Common,
    pub learned_map: LearnedMap,
    pub reference: Reference,
    pub queries: QueryTemplate,
    output: Option<(Format, Target<'a>)>,
}

impl<'a> OpenedPlan<'a> {
    /// Learns from the log.
    pub fn learn(self) -> anyhow::Result<LearnedPlan<'a>> {
        let OpenedPlan { common, log, reference, depth_m, output } = self;
        let attempt = Box::new(common.parties.attempt(&log)?);
        let queries = QueryTemplate { seen: common.seen.seen(), depth_m, attempt };
        let learned_map = LearnedMap::learn(log, &common.source)?.capped(&common.parties);
        Ok(LearnedPlan { common, learned_map, reference, queries, output })
    }
}

/// Content of an output file.
pub struct PlanContent<'a> {
    /// Positions that the map is seen from, how they are combined, and the title.
    pub at: &'a [Position],
    pub join: Join,
    pub title: &'a str,
    /// The answer in a sentence.
    pub sentence: &'a str,
    pub lines: &'a [Series<'a>],
    /// Lines and areas for other programs.
    pub shapes: Vec<Line>,
    /// Draws a picture below the map, if there is one.
    pub below: Option<&'a dyn Fn(Room) -> Figure>,
    pub header: &'a [&'a str],
    /// Rows of the table, each with its position.
    pub rows: Vec<(Point, Vec<String>)>,
    /// Positions that the picture must contain, in addition to those of the log.
    pub shown: &'a [Point],
}

impl LearnedPlan<'_> {
    /// Writes the plan, if an output file was requested.
    pub fn write(mut self, content: PlanContent, results: Results) -> anyhow::Result<()> {
        let Some((format, target)) = self.output.take() else { return Ok(()) };
        let bytes = match format {
            Format::Csv => self.table(content)?.into_bytes(),
            Format::GeoJson => geojson_of_lines(&self.reference, &content.shapes)?,
            Format::Kml => kml_of_lines(&self.reference, &content.shapes)?,
            Format::Picture(image) => self.picture(content)?.file(image, self.common.width_mm)?,
        };
        target.write(&bytes, results)?;
        if let Some(path) = &self.common.output {
            note(format_args!("wrote {}", path.display()));
        }
        Ok(())
    }

    /// Formats the rows, with latitude and longitude added if the reference system is known.
    fn table(&self, content: PlanContent) -> anyhow::Result<String> {
        let degrees: &[&str] = if self.reference.system().is_known() { &DEGREES } else { &[] };
        let header = [content.header, degrees].concat();
        let row = |((east_m, north_m), mut row): (Point, Vec<String>)| {
            // A position outside the projection has no latitude and longitude.
            let place = self.reference.geographic(east_m, north_m);
            let degrees =
                place.map(|place| [place.latitude_deg, place.longitude_deg].map(|degrees| degrees.to_string()));
            row.extend(degrees.unwrap_or_default());
            row.truncate(header.len());
            row
        };
        csv_of_text(&header, content.rows.into_iter().map(row))
    }

    fn picture(&mut self, content: PlanContent) -> anyhow::Result<Figure> {
        let bar = spinner("drawing");
        let ends = self.learned_map.log.events.iter().flat_map(|event| event.link.ends());
        let shown = content.shown.iter().map(|&(east_m, north_m)| Position::new(east_m, north_m));
        let area = Area::around(ends.chain(content.at.iter().copied()).chain(shown), None)?;
        let query = self.queries.of(content.at, content.join, &self.learned_map.extent);
        let map = SuccessMap::new(&mut self.learned_map.agent, area, &query)?;
        let known = Some(&self.reference).filter(|reference| reference.system().is_known());
        let &Common { ref title, with_events, width_mm, .. } = self.common;
        let figure_content = FigureContent {
            events: &self.learned_map.log.events,
            log: &self.learned_map.name,
            levels: &[],
            layers: &[Layer::Probability],
            title: Some(title.as_deref().unwrap_or(content.title)),
            sentence: Some(content.sentence),
            reference: known,
            with_events,
            hatch_width: HATCH_WIDTH,
            lines: content.lines,
        };
        let below = content.below;
        let whole = |room| {
            let map = figure(&map, &figure_content, room);
            stacked(std::iter::once(map).chain(below.map(|draw| draw(room))).collect())
        };
        let picture = Figure::fitted(width_mm, whole);
        bar.finish_and_clear();
        Ok(picture)
    }
}
