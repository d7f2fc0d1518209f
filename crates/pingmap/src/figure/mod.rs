//! Figures: maps of success probability, maps of links, and curves. Only this folder uses the plotting crate.
//!
//! `kuva` supplies the axes, the title, the colour map, and the SVG and PNG writers. Everything inside the axes is
//! added to its public `Scene` in pixel coordinates. The crate's own plots have no fixed colour range, no dashed
//! contours, no outlines and no long legend keys.

mod style;
mod finished;
mod marks;
mod frame;
mod ground;
#[cfg(test)]
mod tests;

use kuva::prelude::Layout;
use kuva::render::render::{Primitive, Scene};

use crate::grid::{Grid, Point};
pub use finished::{Figure, Image};
use frame::{Frame, Heading, round_step, thin};
pub use ground::shade;
use marks::shortened;
pub use style::{Arrows, LegendPlace, Mark, Palette, Panel, Room, Series, Style};

/// Smallest distance between the numbers of an axis.
const TICK_PX_MIN: f64 = 55.0;

const PANEL_GAP_PX: f64 = 8.0;

/// Content of a map of an area: a value of every cell, and the layers on top.
pub struct GridMap<'a> {
    pub title: &'a str,
    /// Lines below the title.
    pub notes: &'a [String],
    /// Name of the quantity that the colours show.
    pub bar: &'a str,
    pub palette: Palette,
    pub grid: Grid<'a>,
    pub contours: &'a [f64],
    /// Lines of equal latitude or longitude with their names.
    pub graticule: &'a [(String, Vec<Point>)],
    /// Cells that are hatched, and the meaning of hatching.
    pub hatched: (&'a [bool], &'a str),
    pub tracks: &'a [Series<'a>],
    /// Links of heard and of missed messages.
    pub links: &'a [Arrows<'a>],
    pub places: &'a [(String, Point)],
    /// Lines of a plan, on top of all other layers.
    pub lines: &'a [Series<'a>],
}

/// Draws a map.
pub fn grid_map(map: &GridMap, room: Room) -> Figure {
    let (east, north) = (map.grid.east, map.grid.north);
    let heading = Heading { title: map.title, notes: map.notes };
    let mut frame = Frame::map(map_layout(east, north, room.side), &heading, east, north, room.side);
    frame.legend_place = room.legend;
    frame.heat_map(&map.grid, map.palette);
    frame.color_bar(map.bar, map.palette);
    let (hatched, hatched_name) = map.hatched;
    frame.hatch(&map.grid, hatched);
    frame.graticule(map.graticule);
    for (n, &level) in map.contours.iter().enumerate() {
        let dash = CONTOUR_DASHES[(map.contours.len() - 1 - n) % CONTOUR_DASHES.len()];
        frame.contour(&map.grid, level, Style { color: "#000000", width: 1.4, dash, mark: Mark::None });
    }
    if hatched.contains(&true) {
        frame.hatched_key(hatched_name, map.palette);
    }
    let centres: Vec<Point> = map.places.iter().map(|(_, place)| *place).collect();
    frame.rings(&centres, east, north);
    frame.tracks(map.tracks);
    frame.links(map.links);
    for line in map.lines {
        let points: Vec<Point> = line.points.iter().map(|&point| frame.pixel(point)).collect();
        frame.line(&points, line.style, 2.5);
        if line.style.width > 0.0 && line.style.mark != Mark::None {
            frame.directions(&points, line.style);
        }
        for &point in points.iter().filter(|_| line.style.mark != Mark::None) {
            frame.mark(point, 5.0, line.style);
        }
        frame.key(line.name, line.style, false);
    }
    let star = Style { color: "#d00000", width: 0.0, dash: &[], mark: Mark::Star };
    for (name, place) in map.places {
        let (x, y) = frame.pixel(*place);
        frame.mark((x, y), 10.0, star);
        // A position outside the map gets no name.
        if (east.0..=east.1).contains(&place.0) && (north.0..=north.1).contains(&place.1) {
            frame.label((x, y - 20.0), &shortened(name));
        }
    }
    let begins = map.tracks.iter().chain(map.lines).filter_map(|line| line.points.first().copied());
    let shown: Vec<Point> = begins.chain(map.places.iter().map(|(_, place)| *place)).collect();
    frame.north_and_scale(east.1 - east.0, &shown);
    frame.finish()
}

/// The most probable contour is solid; less probable ones have shorter dashes.
const CONTOUR_DASHES: [&[f64]; 4] = [&[], &[5.0, 4.0], &[2.0, 3.0], &[8.0, 3.0, 2.0, 3.0]];

/// Draws arrows from transmitter to receiver, and tracks, on a map with equal scales.
pub fn link_map(
    title: &str,
    east: (f64, f64),
    north: (f64, f64),
    links: &[Arrows],
    tracks: &[Series],
    side: f64,
) -> Figure {
    let mut frame = Frame::map(map_layout(east, north, side), &Heading { title, notes: &[] }, east, north, side);
    frame.legend_place = Room::SCREEN.legend;
    let faint = tracks.iter().map(|track| Series { style: Style { width: 0.8, ..track.style }, ..*track });
    frame.tracks(&faint.collect::<Vec<_>>());
    frame.links(links);
    let begins: Vec<Point> = tracks.iter().filter_map(|track| track.points.first().copied()).collect();
    frame.north_and_scale(east.1 - east.0, &begins);
    frame.finish()
}

/// Draws maps of one area below each other, for one column of a page. The axes are `side` pixels wide. The legend of
/// the last map is below everything.
pub fn link_panels(panels: &[Panel], east: (f64, f64), north: (f64, f64), side: f64) -> Figure {
    let side = side * f64::max(1.0, (north.1 - north.0) / (east.1 - east.0));
    let figures = panels.iter().enumerate().map(|(n, panel)| {
        let is_last = n + 1 == panels.len();
        let mut layout = map_layout(east, north, side);
        if !is_last {
            // All panels share the axis of the last one.
            layout.suppress_x_ticks = true;
            layout.force_margin_bottom = Some(PANEL_GAP_PX);
        }
        let mut frame = Frame::map(layout, &Heading { title: panel.title, notes: &[] }, east, north, side);
        frame.legend_place = if is_last { LegendPlace::Below } else { LegendPlace::Nowhere };
        frame.tracks(panel.tracks);
        frame.links(panel.links);
        frame.finish()
    });
    stacked(figures.collect())
}

/// Stacks figures vertically.
pub fn stacked(figures: Vec<Figure>) -> Figure {
    let mut figures = figures.into_iter().enumerate();
    let Some((_, Figure(mut whole))) = figures.next() else {
        return Figure(Scene::new(1.0, 1.0));
    };
    for (n, Figure(part)) in figures {
        let transform = Some(format!("translate(0,{})", whole.height));
        whole.elements.push(Primitive::GroupStart { transform, title: None, extra_attrs: None });
        // Every part has clip paths, whose ids must differ.
        let renamed = |id: &str| format!("{id}-{n}");
        let mut ids = Vec::new();
        for mut element in part.elements {
            if let Primitive::ClipStart { id, .. } = &mut element {
                ids.push(id.clone());
                *id = renamed(id);
            }
            whole.elements.push(element);
        }
        let rename = |def: String| {
            ids.iter().fold(def, |def, id| def.replace(&format!("\"{id}\""), &format!("\"{}\"", renamed(id))))
        };
        whole.defs.extend(part.defs.into_iter().map(rename));
        whole.elements.push(Primitive::GroupEnd);
        whole.width = whole.width.max(part.width);
        whole.height += part.height;
    }
    Figure(whole)
}

/// Draws curves over a common axis, each with a few markers.
pub fn curves(title: &str, [x_label, y_label]: [&str; 2], series: &[Series], room: Room, height: f64) -> Figure {
    let points = || series.iter().flat_map(|series| series.points);
    let range = |of: fn(&Point) -> f64| {
        let (low, high) = points().map(of).fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        if low < high { (low, high) } else { (low.min(0.0), low.max(0.0) + 1.0) }
    };
    let (x, (low, high)) = (range(|point| point.0), range(|point| point.1));
    let margin = 0.05 * (high - low);
    let y = (low - margin, high + margin);
    let layout = Layout::new(x, y)
        .with_x_tick_step(round_step((x.1 - x.0) / room.side * TICK_PX_MIN))
        .with_y_tick_step(round_step((y.1 - y.0) / 8.0));
    let heading = Heading { title, notes: &[] };
    let mut frame = Frame::new(layout, &heading, (x, x_label), (y, y_label), (room.side, height));
    frame.legend_place = room.legend;
    for series in series {
        let line: Vec<Point> = series.points.iter().map(|&point| frame.pixel(point)).collect();
        frame.line(&line, series.style, 0.0);
        for &point in thin(&line, 12) {
            frame.mark(point, 4.0, series.style);
        }
        frame.key(series.name, series.style, false);
    }
    frame.finish()
}

/// Returns axes in metres and ticks of a map. The tick step leaves room between the numbers.
fn map_layout(east: Point, north: Point, side: f64) -> Layout {
    let step = round_step((east.1 - east.0).max(north.1 - north.0) / side * TICK_PX_MIN);
    Layout::new(east, north).with_x_tick_step(step).with_y_tick_step(step)
}
