//! Figures of a map.

use pingmap_agent::{Event, Geographic, Position};
use pingmap_import::{Place, Reference, date_in_words};

use crate::cli_enums::{Join, Layer, Seen};
use crate::figure::{Arrows, Figure, GridMap, Mark, Palette, Room, Series, Style, grid_map, stacked};
use crate::grid::Point;
use crate::success_map::{Cell, Side, SuccessMap};
use crate::tracks;

/// Content and options of the figure of a map.
pub struct FigureContent<'a> {
    pub events: &'a [Event],
    /// Name of the log.
    pub log: &'a str,
    pub levels: &'a [f64],
    pub layers: &'a [Layer],
    pub title: Option<&'a str>,
    /// Result for the planner; if not given, the distance within which the highest level is reached.
    pub sentence: Option<&'a str>,
    /// Reference system of the metres, if known.
    pub reference: Option<&'a Reference>,
    /// Whether the events near the position are drawn.
    pub with_events: bool,
    /// Cells with a wider interval are hatched.
    pub hatch_width: f64,
    /// Lines of a plan, drawn over everything else.
    pub lines: &'a [Series<'a>],
}

/// Draws the map with the tracks of all vehicles. Each side and layer gets a panel of the size `room`; panels are
/// stacked.
pub fn figure(map: &SuccessMap, content: &FigureContent, room: Room) -> Figure {
    let pictures = map.sides.iter().flat_map(|side| content.layers.iter().map(move |&layer| (side, layer)));
    stacked(pictures.map(|(side, layer)| picture(map, side, layer, content, room)).collect())
}

fn picture(map: &SuccessMap, side: &Side, layer: Layer, content: &FigureContent, room: Room) -> Figure {
    let tracks = tracks::tracks(content.events);
    let near_m = near_m(map);
    let [heard, missed] = links(map, side.seen, near_m, content);
    let end = match side.seen {
        Seen::Tx => "sent",
        Seen::Rx => "received",
        Seen::Worst | Seen::Both => "sent or received",
    };
    let names = [("heard", &heard), ("missed", &missed)].map(|(outcome, pairs)| {
        let none = if pairs.is_empty() { " (none)" } else { "" };
        format!("{outcome}, {end} within {near_m:.0} m{none}")
    });
    let arrows = |name, pairs, mark, color| Arrows {
        name,
        pairs,
        style: Style { color, width: 0.0, dash: &[], mark },
        heads: false,
    };
    let links = [arrows(&names[0], &heard, Mark::Dot, "#d0f0ff"), arrows(&names[1], &missed, Mark::Cross, "#000000")];
    let values = side.values(|cell| number(layer, cell));
    let hatched: Vec<bool> = side.cells.iter().map(|cell| cell.width() > content.hatch_width).collect();
    let title = content.title.map_or_else(|| title(map, side.seen, layer), str::to_owned);
    let sentence = content.sentence.map(str::to_owned);
    let sentence = sentence.or(content.levels.last().map(|&required| map.reach(side, required).sentence()));
    let notes: Vec<String> = [source(map, content)].into_iter().chain(sentence).collect();
    let is_probability = layer != Layer::Width;
    let picture = GridMap {
        title: &title,
        notes: &notes,
        bar: bar(layer),
        palette: palette(layer),
        grid: map.area.grid(&values),
        graticule: &content.reference.map(|reference| graticule(map, reference)).unwrap_or_default(),
        contours: if is_probability { content.levels } else { &[] },
        hatched: (&hatched, &format!("not known: interval wider than {}", content.hatch_width)),
        tracks: &tracks::tracks_as_series(&tracks),
        links: if content.with_events { &links } else { &[] },
        places: &places(map, side.seen),
        lines: content.lines,
    };
    grid_map(&picture, room)
}

/// Names the log, the positions that the map is seen from, and the date.
fn source(map: &SuccessMap, content: &FigureContent) -> String {
    let place = |at: &Position| {
        let degrees = content.reference.and_then(|reference| reference.geographic(at.east_m, at.north_m));
        degrees.map_or_else(
            || format!("({:.0}, {:.0}) m", at.east_m, at.north_m),
            |at| format!("{} {}", minutes(at.latitude_deg, ["N", "S"]), minutes(at.longitude_deg, ["E", "W"])),
        )
    };
    let places: Vec<String> = map.at.iter().map(place).collect();
    let times = || content.events.iter().map(|event| event.time_s);
    let (first, last) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
    let dates: Vec<String> = [first, last].into_iter().filter_map(date_in_words).collect();
    let dates = match &dates[..] {
        [first, last] if first == last => format!(", {first}"),
        [first, last] => format!(", {first} to {last}"),
        _ => String::new(),
    };
    format!("{}: {}{dates}", content.log, places.join(" and "))
}

/// Largest distance of a drawn event from the positions that the map is seen from, as a share of the longer side.
const NEAR_SHARE: f64 = 0.1;

fn near_m(map: &SuccessMap) -> f64 {
    let (east, north) = (map.area.east, map.area.north);
    NEAR_SHARE * (east.1 - east.0).max(north.1 - north.0)
}

/// Approximate number of graticule lines in each direction.
const LINES: f64 = 4.0;

/// Points along each line of the graticule.
const POINTS: usize = 64;

/// Returns parallels and meridians over the area at round minutes, each with its label.
fn graticule(map: &SuccessMap, reference: &Reference) -> Vec<(String, Vec<Point>)> {
    let (east, north) = (map.area.east, map.area.north);
    let corners = [(east.0, north.0), (east.1, north.0), (east.0, north.1), (east.1, north.1)];
    let corners: Vec<Geographic> =
        corners.into_iter().filter_map(|(east_m, north_m)| reference.geographic(east_m, north_m)).collect();
    let span = |of: fn(&Geographic) -> f64| {
        corners.iter().map(of).fold((f64::MAX, f64::MIN), |(low, high), degrees| (low.min(degrees), high.max(degrees)))
    };
    let (latitudes, longitudes) = (span(|place| place.latitude_deg), span(|place| place.longitude_deg));
    // Areas across the antimeridian get no graticule.
    if corners.len() < 4 || longitudes.1 - longitudes.0 > 180.0 {
        return Vec::new();
    }
    let line = |place: &dyn Fn(f64) -> Option<Geographic>| -> Vec<Point> {
        let points = (0..=POINTS).filter_map(|n| place(n as f64 / POINTS as f64));
        let points = points.filter_map(|place| reference.metres(Place::Degrees(place)));
        points.filter(|(x, y)| (east.0..=east.1).contains(x) && (north.0..=north.1).contains(y)).collect()
    };
    let between = |(low, high): Point, share: f64| low + (high - low) * share;
    let meridian = |degrees: f64| {
        // Meridians start in the north and parallels in the east, away from the numbers of the axes.
        let points = line(&|share| Geographic::new(between(latitudes, 1.0 - share), degrees));
        (minutes(degrees, ["E", "W"]), points)
    };
    let parallel = |degrees: f64| {
        let points = line(&|share| Geographic::new(degrees, between(longitudes, 1.0 - share)));
        (minutes(degrees, ["N", "S"]), points)
    };
    round(latitudes).into_iter().map(parallel).chain(round(longitudes).into_iter().map(meridian)).collect()
}

/// Returns round numbers of degrees between two limits.
fn round((low, high): Point) -> Vec<f64> {
    // In minutes: hundredths, tenths and whole minutes, then whole degrees.
    const STEPS: [f64; 14] = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0];
    let wanted = (high - low) * 60.0 / LINES;
    let step = STEPS.into_iter().find(|step| *step >= wanted).unwrap_or(600.0);
    let first = (low * 60.0 / step).ceil() as i64;
    let last = (high * 60.0 / step).floor() as i64;
    (first..=last).map(|n| n as f64 * step / 60.0).collect()
}

/// Formats an angle in degrees and decimal minutes, as on charts.
fn minutes(degrees: f64, [positive, negative]: [&str; 2]) -> String {
    let half = if degrees < 0.0 { negative } else { positive };
    let hundredths = (degrees.abs() * 6000.0).round() as u64;
    let (whole, minutes) = (hundredths / 6000, (hundredths % 6000) as f64 / 100.0);
    format!("{whole}°{minutes}′{half}")
}

fn number(layer: Layer, cell: &Cell) -> f64 {
    match layer {
        Layer::Probability => cell.probability,
        Layer::Lower => cell.lower,
        Layer::Upper => cell.upper,
        Layer::Width => cell.width(),
    }
}

fn bar(layer: Layer) -> &'static str {
    match layer {
        Layer::Probability => "probability",
        Layer::Lower => "lower end",
        Layer::Upper => "upper end",
        Layer::Width => "width",
    }
}

fn palette(layer: Layer) -> Palette {
    match layer {
        Layer::Probability => Palette::BlueToYellow,
        Layer::Lower => Palette::VioletToGreen,
        Layer::Upper => Palette::VioletToRed,
        Layer::Width => Palette::WhiteToBlack,
    }
}

fn title(map: &SuccessMap, seen: Seen, layer: Layer) -> String {
    let which = match (map.at.len(), map.join) {
        (1, _) => "here",
        (_, Join::All) => "all of these",
        (_, Join::Any) => "any of these",
    };
    let message = match seen {
        Seen::Tx => format!("a message from {which} is heard"),
        Seen::Rx => format!("a message to {which} is heard"),
        Seen::Worst | Seen::Both => format!("messages to and from {which} are heard"),
    };
    match layer {
        Layer::Probability => format!("Probability that {message}"),
        Layer::Lower => format!("Lower end of the 90 % interval of the probability that {message}"),
        Layer::Upper => format!("Upper end of the 90 % interval of the probability that {message}"),
        Layer::Width => format!("Width of the 90 % interval of the probability that {message}"),
    }
}

fn places(map: &SuccessMap, seen: Seen) -> Vec<(String, Point)> {
    let name = match seen {
        Seen::Tx => "transmitter",
        Seen::Rx => "receiver",
        Seen::Worst | Seen::Both => "here",
    };
    map.at.iter().map(|place| (name.to_owned(), (place.east_m, place.north_m))).collect()
}

/// Returns the links of heard and of missed messages whose end at the star is near it. Links lead from the star to the
/// other end.
fn links(map: &SuccessMap, seen: Seen, near_m: f64, content: &FigureContent) -> [Vec<(Point, Point)>; 2] {
    let is_near =
        |end: &Position| map.at.iter().any(|at| (at.east_m - end.east_m).hypot(at.north_m - end.north_m) <= near_m);
    let pair = |event: &Event| {
        let [from, to] = event.link.ends();
        let ends = match seen {
            Seen::Tx => is_near(&from).then_some((from, to)),
            Seen::Rx => is_near(&to).then_some((to, from)),
            Seen::Worst | Seen::Both if is_near(&from) => Some((from, to)),
            Seen::Worst | Seen::Both => is_near(&to).then_some((to, from)),
        };
        let point = |end: Position| (end.east_m, end.north_m);
        ends.map(|(star, other)| (event.success, (point(star), point(other))))
    };
    let (heard, missed): (Vec<_>, Vec<_>) = content.events.iter().filter_map(pair).partition(|(success, _)| *success);
    [heard, missed].map(|events: Vec<_>| events.into_iter().map(|(_, pair)| pair).collect())
}
