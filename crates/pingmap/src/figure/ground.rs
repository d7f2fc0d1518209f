//! The background of a map: colours with their bar, hatching, graticule, north arrow and scale.

use kuva::prelude::ColorMap;
use kuva::render::color::Color;
use kuva::render::render::{Primitive, TextAnchor};

use super::frame::{BAR_ROOM_PX, Frame, round_step};
use super::marks::{draw_line, polygon, text_at, text_width};
use super::style::{LegendPlace, Mark, Palette, Style};
use crate::grid::{Grid, Point};

/// Number of shades, more than the eye distinguishes. Equal neighbours are joined.
const SHADES: f64 = 200.0;

/// Distance between lines of hatching.
const HATCH_PX: f64 = 9.0;
/// Each line of hatching is white with a dark edge, so that it is visible on light and dark colours.
const HATCH: Style = Style { color: "#ffffff", width: 0.9, dash: &[], mark: Mark::None };
const HATCH_EDGE: Style = Style { color: "#303030", width: 0.6, dash: &[], mark: Mark::None };
const HATCH_EDGE_PX: f64 = 0.9;

const BAR_PX: f64 = 16.0;
const GRATICULE: Style = Style { color: "#ffffff", width: 0.4, dash: &[], mark: Mark::None };
const RING: Style = Style { color: "#000000", width: 0.8, dash: &[1.5, 3.0], mark: Mark::None };

/// Bearings in degrees at which the name of a ring may stand.
const RING_NAMES: [i32; 8] = [60, 300, 120, 240, 0, 90, 180, 270];

/// Largest number of rings around one place.
const RINGS_MAX: f64 = 12.0;

const INK: Style = Style { color: "#000000", width: 1.4, dash: &[], mark: Mark::None };

/// Returns the colour of a value between 0 and 1. The lightness of all palettes is monotonic, so that they are readable
/// in grey and with colour blindness.
pub fn shade(value: f64, palette: Palette) -> (u8, u8, u8) {
    let value = value.clamp(0.0, 1.0);
    let (map, value) = match palette {
        Palette::BlueToYellow => (ColorMap::Cividis, value),
        Palette::VioletToGreen => (ColorMap::Viridis, value),
        Palette::VioletToRed => (ColorMap::Plasma, value),
        Palette::WhiteToBlack => (ColorMap::Grayscale, value),
    };
    map.map_rgb(value).unwrap_or((128, 128, 128))
}

/// Draws edges on whole pixels, without blending with the background.
const CRISP: &str = "shape-rendering=\"crispEdges\"";

impl Frame {
    /// Fills the cells of a grid. Equal neighbours in a row are joined.
    pub(super) fn heat_map(&mut self, grid: &Grid, palette: Palette) {
        let rows = grid.values.len() / grid.columns;
        let (left, top) = self.pixel((grid.east.0, grid.north.1));
        let (right, bottom) = self.pixel((grid.east.1, grid.north.0));
        // Edges lie on whole pixels, so that they are not blended with the background.
        let x_of = |column: usize| (left + column as f64 * (right - left) / grid.columns as f64).round();
        let y_of = |row: usize| (bottom - row as f64 * (bottom - top) / rows as f64).round();
        let (mut x, mut y, mut w, mut h) = (vec![], vec![], vec![], vec![]);
        let mut fills = vec![];
        for (row, values) in grid.values.chunks_exact(grid.columns).enumerate() {
            let shades: Vec<f64> = values.iter().map(|p| (p.clamp(0.0, 1.0) * SHADES).round() / SHADES).collect();
            let mut column = 0;
            for run in shades.chunk_by(|a, b| a == b) {
                if !run[0].is_nan() {
                    let (r, g, b) = shade(run[0], palette);
                    x.push(x_of(column));
                    y.push(y_of(row + 1));
                    // Half a pixel more hides seams if the page is scaled.
                    w.push(x_of(column + run.len()) - x_of(column) + 0.5);
                    h.push(y_of(row) - y_of(row + 1) + 0.5);
                    fills.push(Color::Rgb(r, g, b));
                }
                column += run.len();
            }
        }
        let extra_attrs = Some(CRISP.to_owned());
        self.inside.push(Primitive::GroupStart { transform: None, title: None, extra_attrs });
        self.inside.push(Primitive::RectBatch { x, y, w, h, fills });
        self.inside.push(Primitive::GroupEnd);
    }

    /// Draws the colour bar at the right of the axes, with the same height.
    pub(super) fn color_bar(&mut self, label: &str, palette: Palette) {
        let (top, bottom) = (self.axes.margin_top, self.axes.height - self.axes.margin_bottom);
        let left = self.axes.width - self.axes.margin_right + 18.0;
        let y_of = |share: f64| bottom - share * (bottom - top);
        let steps = 128;
        let edges: Vec<f64> = (0..=steps).map(|n| y_of(f64::from(n) / f64::from(steps)).round()).collect();
        let fills = (0..steps).map(|n| shade((f64::from(n) + 0.5) / f64::from(steps), palette));
        let extra_attrs = Some(CRISP.to_owned());
        self.legend.push(Primitive::GroupStart { transform: None, title: None, extra_attrs });
        self.legend.push(Primitive::RectBatch {
            x: vec![left; steps as usize],
            y: edges[1..].to_vec(),
            w: vec![BAR_PX; steps as usize],
            // As in the map, half a pixel more hides seams.
            h: edges.windows(2).map(|pair| pair[0] - pair[1] + 0.5).collect(),
            fills: fills.map(|(r, g, b)| Color::Rgb(r, g, b)).collect(),
        });
        self.legend.push(Primitive::GroupEnd);
        self.legend.push(outline(Color::None, left, top, (BAR_PX, bottom - top)));
        for n in 0..=5 {
            let (share, y) = (f64::from(n) / 5.0, y_of(f64::from(n) / 5.0));
            draw_line(&mut self.legend, &[(left + BAR_PX, y), (left + BAR_PX + 5.0, y)], INK, 0.0);
            self.legend.push(text_at((left + BAR_PX + 8.0, y), &format!("{share:.1}"), TextAnchor::Start));
        }
        // Horizontal letters are easier to read, and all programs draw them alike.
        self.legend.push(text_at((left + 42.0, top - 14.0), label, TextAnchor::End));
        self.bar_px = BAR_ROOM_PX;
    }

    /// Hatches cells, which are ordered as in the grid: row by row from the south.
    pub(super) fn hatch(&mut self, grid: &Grid, hatched: &[bool]) {
        let rows = grid.values.len() / grid.columns;
        let (left, top) = self.pixel((grid.east.0, grid.north.1));
        let (right, bottom) = self.pixel((grid.east.1, grid.north.0));
        let is_hatched = |(x, y): Point| {
            let column = ((x - left) / (right - left) * grid.columns as f64) as usize;
            let row = ((bottom - y) / (bottom - top) * rows as f64) as usize;
            let inside = (left..right).contains(&x) && y > top && y <= bottom;
            inside && hatched.get(row * grid.columns + column).is_some_and(|&is| is)
        };
        // Lines x + y = const, tested pixel by pixel.
        let mut sum = ((left + top) / HATCH_PX).ceil() * HATCH_PX;
        while sum < right + bottom {
            let (first, last) = ((sum - bottom).max(left), (sum - top).min(right));
            let mut begun = None;
            let mut x = first;
            while x <= last + 1.0 {
                let here = x <= last && is_hatched((x, sum - x));
                match begun {
                    None if here => begun = Some(x),
                    Some(from) if !here => {
                        draw_hatch(&mut self.inside, (from, sum - from), (x, sum - x));
                        begun = None;
                    }
                    _ => {}
                }
                x += 1.0;
            }
            sum += HATCH_PX;
        }
    }

    /// Adds hatching to the legend.
    pub(super) fn hatched_key(&mut self, name: &str, palette: Palette) {
        if self.legend_place == LegendPlace::Nowhere {
            return;
        }
        let (x, y) = self.place(self.rows);
        let (r, g, b) = shade(0.3, palette);
        let (width, height) = (38.0, 12.0);
        let fill = Color::Rgb(r, g, b);
        self.legend.push(outline(fill, x + 2.0, y - 6.0, (width, height)));
        for n in 0..3 {
            let at = x + 2.0 + 13.0 * f64::from(n);
            draw_hatch(&mut self.legend, (at, y + 6.0), (at + 12.0, y - 6.0));
        }
        let none = Style { color: "none", width: 0.0, dash: &[], mark: Mark::None };
        self.key(name, none, false);
    }

    /// Draws rings around places at round distances, each with its distance, up to the corners of the area.
    pub(super) fn rings(&mut self, centres: &[Point], east: Point, north: Point) {
        let longest_m = (east.1 - east.0).max(north.1 - north.0);
        let step_m = round_step(longest_m / 5.0);
        for &(x, y) in centres {
            let farthest_m =
                (x - east.0).abs().max((x - east.1).abs()).hypot((y - north.0).abs().max((y - north.1).abs()));
            for n in 1..=(farthest_m / step_m).min(RINGS_MAX) as usize {
                let range_m = step_m * n as f64;
                let at = |degrees: i32| {
                    let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
                    (x + range_m * sin, y + range_m * cos)
                };
                let ring: Vec<Point> = (0..=180).map(|n| self.pixel(at(2 * n))).collect();
                draw_line(&mut self.inside, &ring, RING, 1.0);
                let is_inside = |&(x, y): &Point| (east.0..=east.1).contains(&x) && (north.0..=north.1).contains(&y);
                // The name stands where the ring lies on the map.
                if let Some(place) = RING_NAMES.into_iter().map(at).find(is_inside) {
                    self.label(self.pixel(place), &metres(range_m));
                }
            }
        }
        if !centres.is_empty() {
            self.key(&format!("distance, every {}", metres(step_m)), RING, false);
        }
    }

    /// Draws lines of equal latitude or longitude, each with its name at the start.
    pub(super) fn graticule(&mut self, lines: &[(String, Vec<Point>)]) {
        for (name, points) in lines {
            let points: Vec<Point> = points.iter().map(|&point| self.pixel(point)).collect();
            draw_line(&mut self.inside, &points, GRATICULE, 0.0);
            if let Some(&(x, y)) = points.first() {
                self.label((x, y), name);
            }
        }
    }

    /// Draws the north arrow and a scale bar over a round number of metres. The scale bar is in the lower left, lower
    /// right or upper right corner, where it covers the fewest of `shown`.
    pub(super) fn north_and_scale(&mut self, metres_wide: f64, shown: &[Point]) {
        let (left, right) = (self.axes.margin_left, self.axes.width - self.axes.margin_right);
        let (top, bottom) = (self.axes.margin_top, self.axes.height - self.axes.margin_bottom);
        let px_per_m = (right - left) / metres_wide;
        let length_m = round_step(metres_wide / 8.0);
        let width = length_m * px_per_m;
        let name = metres(length_m);
        let room = width.max(text_width(&name)) + 16.0;
        let shown: Vec<Point> = shown.iter().map(|&point| self.pixel(point)).collect();
        let covered = |&(x, y): &Point| {
            let is_below =
                |at: &&Point| (x - 8.0..x + room + 8.0).contains(&at.0) && (y - 8.0..y + 38.0).contains(&at.1);
            shown.iter().filter(is_below).count()
        };
        let right_x = right - room - 8.0;
        let corners = [(left + 8.0, bottom - 38.0), (right_x, bottom - 38.0), (right_x, top + 8.0)];
        let (x, y) = corners.into_iter().min_by_key(covered).unwrap_or(corners[0]);
        let ground = Primitive::Rect {
            x,
            y,
            width: room,
            height: 30.0,
            fill: "#ffffff".into(),
            stroke: None,
            stroke_width: None,
            opacity: Some(0.8),
        };
        self.labels.push(ground);
        let (from, to, line) = (x + 8.0, x + 8.0 + width, y + 24.0);
        let ends = [(from, line - 4.0), (from, line), (to, line), (to, line - 4.0)];
        draw_line(&mut self.labels, &ends, INK, 0.0);
        self.labels.push(text_at(((from + to) / 2.0, y + 10.0), &name, TextAnchor::Middle));
        let (x, y) = (left + 20.0, top + 12.0);
        self.labels.push(polygon(
            &[(x, y), (x + 6.0, y + 17.0), (x, y + 13.0), (x - 6.0, y + 17.0)],
            "#000000",
            "#ffffff",
        ));
        self.label((x, y + 28.0), "N");
    }
}

/// Draws one line of hatching.
fn draw_hatch(out: &mut Vec<Primitive>, from: Point, to: Point) {
    draw_line(out, &[from, to], HATCH, 0.0);
    draw_line(out, &[(from.0 + HATCH_EDGE_PX, from.1), (to.0 + HATCH_EDGE_PX, to.1)], HATCH_EDGE, 0.0);
}

/// Formats a round distance.
fn metres(range_m: f64) -> String {
    if range_m >= 1000.0 { format!("{} km", range_m / 1000.0) } else { format!("{range_m} m") }
}

/// Returns a rectangle with an edge.
fn outline(fill: Color, x: f64, y: f64, (width, height): Point) -> Primitive {
    let stroke = Some("#000000".into());
    Primitive::Rect { x, y, width, height, fill, stroke, stroke_width: Some(1.0), opacity: None }
}
