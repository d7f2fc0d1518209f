//! Figures: a map of success probability, and maps of links. The only folder that names the plotting crate.
//!
//! `kuva` supplies the axes, the title, the colour scale and bar, and the SVG and PNG writers.
//! Everything inside the axes is added to its public `Scene` in pixel coordinates, because its
//! own plots have no fixed colour range, no dashed contours, no outlines and no long legend keys.

mod style;
mod marks;
mod frame;

use kuva::prelude::Layout;
use kuva::render::render::{Primitive, Scene};

use crate::contour::{Grid, Point};
use frame::{Frame, LegendPlace, thin};
pub use style::{Arrows, Figure, Mark, Panel, Series, Style};

const PANEL_TITLE_PX: u32 = 14;
const PANEL_TITLE_ROOM_PX: f64 = 30.0;
const PANEL_GAP_PX: f64 = 8.0;

/// Draws the map of success probability, `side` pixels along its longer side.
pub fn probability_map(
    title: &str,
    grid: &Grid,
    contours: &[f64],
    tracks: &[Series],
    seen_from: (&str, Point),
    side: f64,
) -> Figure {
    let bar = Some("probability of success");
    let mut frame = Frame::map(map_layout(title, grid.east, grid.north), grid.east, grid.north, bar, side);
    frame.heat_map(grid);
    for (n, &level) in contours.iter().enumerate() {
        let dash = if n == 0 { &[5.0, 4.0][..] } else { &[] };
        frame.contour(grid, level, Style { color: "#000000", width: 1.4, dash, mark: Mark::None });
    }
    frame.tracks(tracks);
    let (name, place) = seen_from;
    let star = Style { color: "#d00000", width: 0.0, dash: &[], mark: Mark::Star };
    let (x, y) = frame.pixel(place);
    frame.mark((x, y), 10.0, star);
    frame.label((x, y - 20.0), name);
    frame.finish()
}

/// Draws arrows (transmitter to receiver) and tracks on a map with equal scales.
pub fn link_map(
    title: &str,
    east: (f64, f64),
    north: (f64, f64),
    links: &[Arrows],
    tracks: &[Series],
    side: f64,
) -> Figure {
    let mut frame = Frame::map(map_layout(title, east, north), east, north, None, side);
    let faint = tracks.iter().map(|track| Series { style: Style { width: 0.8, ..track.style }, ..*track });
    frame.tracks(&faint.collect::<Vec<_>>());
    frame.links(links);
    frame.finish()
}

/// Draws maps of the same area one below the other, for one column of a page: axes `side` pixels wide, the legend of
/// the last below everything.
pub fn link_panels(panels: &[Panel], east: (f64, f64), north: (f64, f64), side: f64) -> Figure {
    let side = side * f64::max(1.0, (north.1 - north.0) / (east.1 - east.0));
    let figures = panels.iter().enumerate().map(|(n, panel)| {
        let is_last = n + 1 == panels.len();
        let mut layout = map_layout(panel.title, east, north).with_title_size(PANEL_TITLE_PX);
        if !is_last {
            // The axis of the last panel is that of all.
            layout.x_label = None;
            layout.suppress_x_ticks = true;
            layout.force_margin_bottom = Some(PANEL_GAP_PX);
        }
        layout.force_margin_top = Some(PANEL_TITLE_ROOM_PX);
        let mut frame = Frame::map(layout, east, north, None, side);
        frame.legend_place = if is_last { LegendPlace::Below } else { LegendPlace::Nowhere };
        frame.tracks(panel.tracks);
        frame.links(panel.links);
        frame.finish()
    });
    stacked(figures.collect())
}

/// Puts figures one below the other.
fn stacked(figures: Vec<Figure>) -> Figure {
    let mut figures = figures.into_iter().enumerate();
    let Some((_, Figure(mut whole))) = figures.next() else {
        return Figure(Scene::new(1.0, 1.0));
    };
    for (n, Figure(part)) in figures {
        let transform = Some(format!("translate(0,{})", whole.height));
        whole.elements.push(Primitive::GroupStart { transform, title: None, extra_attrs: None });
        // Every part brings clip paths, whose names must differ.
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

/// Draws curves over a common axis, each with a marker here and there.
pub fn curves(title: &str, x_label: &str, y_label: &str, series: &[Series], size: Point) -> Figure {
    let points = || series.iter().flat_map(|series| series.points);
    let range = |of: fn(&Point) -> f64| {
        let (low, high) = points().map(of).fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        if low < high { (low, high) } else { (low.min(0.0), low.max(0.0) + 1.0) }
    };
    let (x, (low, high)) = (range(|point| point.0), range(|point| point.1));
    let margin = 0.05 * (high - low);
    let y = (low - margin, high + margin);
    let layout = Layout::new(x, y).with_title(title).with_x_label(x_label).with_y_label(y_label);
    let layout =
        layout.with_x_tick_step(round_step((x.1 - x.0) / 10.0)).with_y_tick_step(round_step((y.1 - y.0) / 8.0));
    let mut frame = Frame::new(layout, x, y, None, size);
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

/// Title, axes in metres and ticks of a map.
fn map_layout(title: &str, east: (f64, f64), north: (f64, f64)) -> Layout {
    let step = round_step((east.1 - east.0).max(north.1 - north.0) / 10.0);
    Layout::new(east, north)
        .with_title(title)
        .with_x_label("east (m)")
        .with_y_label("north (m)")
        .with_x_tick_step(step)
        .with_y_tick_step(step)
}

/// The smallest of 1, 2 or 5 times a power of ten that is not below `step`.
fn round_step(step: f64) -> f64 {
    let power = 10.0_f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= step);
    factor.unwrap_or(10.0) * power
}
