//! A figure under construction: axes, what is drawn inside them, and a legend.

use kuva::prelude::{ColorMap, Layout, LinePlot, Plot, QuiverPlot, TickFormat};
use kuva::render::color::Color;
use kuva::render::layout::ComputedLayout;
use kuva::render::render::{Primitive, Scene, TextAnchor, render_multiple};

use super::marks::{draw_arrow, draw_line, draw_mark, text_at, text_width};
use super::style::{Arrows, Figure, Mark, Series, Style};
use crate::contour::{Grid, Point, contour_lines};

const ROW_PX: f64 = 20.0;
const KEY_PX: f64 = 42.0;
const LINK_MARK_PX: f64 = 3.0;

/// Of more tracks than this the legend names none.
const TRACKS_NAMED_MAX: usize = 24;

/// A figure under construction.
pub(super) struct Frame {
    pub(super) scene: Scene,
    pub(super) axes: ComputedLayout,
    /// What is drawn inside the axes, in pixels.
    inside: Vec<Primitive>,
    /// Texts inside the axes, over everything else there.
    labels: Vec<Primitive>,
    /// What is drawn right of everything else.
    legend: Vec<Primitive>,
    rows: usize,
    legend_width: f64,
    pub(super) legend_place: LegendPlace,
}

/// Where the legend stands.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum LegendPlace {
    /// Right of the axes and of the colour bar, one entry below the other.
    Right,
    /// Below the axes, in two columns.
    Below,
    /// There is none.
    Nowhere,
}

impl Frame {
    /// Makes map axes with one metre the same length both ways, the longer side `side` pixels.
    pub(super) fn map(layout: Layout, east: (f64, f64), north: (f64, f64), bar: Option<&str>, side: f64) -> Self {
        let (width, height) = (east.1 - east.0, north.1 - north.0);
        let scale = side / width.max(height);
        Self::new(layout, east, north, bar, (width * scale, height * scale))
    }

    /// Makes axes over exactly `x` and `y` whose data area is `size` pixels.
    pub(super) fn new(layout: Layout, x: Point, y: Point, bar: Option<&str>, size: Point) -> Self {
        let mut layout = layout
            .with_x_axis_min(x.0)
            .with_x_axis_max(x.1)
            .with_y_axis_min(y.0)
            .with_y_axis_max(y.1)
            .with_colorbar_tick_format(TickFormat::Fixed(1))
            .with_box_axes();
        layout.show_colorbar = bar.is_some();
        // The margins do not depend on the size, so measure them first and add them.
        let margins = ComputedLayout::from_layout(&layout);
        let layout = layout
            .with_width(size.0 + margins.margin_left + margins.margin_right)
            .with_height(size.1 + margins.margin_top + margins.margin_bottom);
        // A vector plot without vectors draws nothing but a colour bar with a fixed range; an
        // empty line draws nothing at all (without any plot there would be no axes).
        let plot: Plot = match bar {
            Some(label) => QuiverPlot::new()
                .with_color_map(ColorMap::Cividis)
                .with_color_range(0.0, 1.0)
                .with_color_legend_label(label)
                .into(),
            None => LinePlot::new().into(),
        };
        let axes = ComputedLayout::from_layout(&layout);
        let scene = render_multiple(vec![plot], layout);
        let (inside, labels, legend) = (Vec::new(), Vec::new(), Vec::new());
        Self { scene, axes, inside, labels, legend, rows: 0, legend_width: 0.0, legend_place: LegendPlace::Right }
    }

    /// Where a data point is on the page.
    pub(super) fn pixel(&self, (x, y): Point) -> Point {
        (self.axes.map_x(x), self.axes.map_y(y))
    }

    /// Fills the cells of a grid, joining equal neighbours in a row.
    pub(super) fn heat_map(&mut self, grid: &Grid) {
        let rows = grid.values.len() / grid.columns;
        let (left, top) = self.pixel((grid.east.0, grid.north.1));
        let (right, bottom) = self.pixel((grid.east.1, grid.north.0));
        let (width, height) = ((right - left) / grid.columns as f64, (bottom - top) / rows as f64);
        let (mut x, mut y, mut w, mut h) = (vec![], vec![], vec![], vec![]);
        let mut fills = vec![];
        for (row, values) in grid.values.chunks_exact(grid.columns).enumerate() {
            // A hundred shades are about what the eye tells apart, and they join into longer runs.
            let shades: Vec<f64> = values.iter().map(|p| (p.clamp(0.0, 1.0) * 100.0).round() / 100.0).collect();
            let mut column = 0;
            for run in shades.chunk_by(|a, b| a == b) {
                let shade = Some(run[0]).filter(|p| !p.is_nan());
                if let Some((r, g, b)) = shade.and_then(|p| ColorMap::Cividis.map_rgb(p)) {
                    x.push(left + column as f64 * width);
                    y.push(bottom - (row + 1) as f64 * height);
                    // Half a pixel more hides the seams between cells.
                    w.push(run.len() as f64 * width + 0.5);
                    h.push(height + 0.5);
                    fills.push(Color::Rgb(r, g, b));
                }
                column += run.len();
            }
        }
        self.inside.push(Primitive::RectBatch { x, y, w, h, fills });
    }

    /// Draws and labels the lines on which the grid has the value `level`.
    pub(super) fn contour(&mut self, grid: &Grid, level: f64, style: Style) {
        let name = format!("{level}");
        let mut longest: Vec<Point> = vec![];
        for line in contour_lines(grid, level) {
            let line: Vec<Point> = line.iter().map(|&point| self.pixel(point)).collect();
            self.line(&line, style, 2.0);
            if line.len() > longest.len() {
                longest = line;
            }
        }
        match longest.get(longest.len() / 2) {
            Some(&middle) => {
                self.label(middle, &name);
                self.key(&format!("contour {name}"), style, false);
            }
            None => self.key(&format!("contour {name} (nowhere)"), style, false),
        }
    }

    /// Draws tracks with a marker here and there, those of who stays in place on top, and adds them to the legend; of
    /// very many, all look alike under one name.
    pub(super) fn tracks(&mut self, tracks: &[Series]) {
        let many = tracks.len() > TRACKS_NAMED_MAX;
        let plain = Style { color: "#d7301f", width: 1.0, dash: &[], mark: Mark::Dot };
        let (moving, fixed): (Vec<&Series>, Vec<&Series>) = tracks.iter().partition(|track| track.points.len() > 1);
        for track in moving.into_iter().chain(fixed) {
            let style = if many { plain } else { track.style };
            let points: Vec<Point> = thin(track.points, 2000).map(|&point| self.pixel(point)).collect();
            self.line(&points, style, 2.5);
            let radius = if points.len() > 1 { 4.5 } else { 6.5 };
            for &point in thin(&points, 12) {
                self.mark(point, radius, style);
            }
        }
        if many {
            self.key(&format!("{} vehicles", tracks.len()), plain, false);
        } else {
            tracks.iter().for_each(|track| self.key(track.name, track.style, false));
        }
    }

    pub(super) fn links(&mut self, links: &[Arrows]) {
        for group in links {
            for &(from, to) in group.pairs {
                let (from, to) = (self.pixel(from), self.pixel(to));
                if group.heads {
                    draw_arrow(&mut self.inside, from, to, group.style);
                } else {
                    draw_line(&mut self.inside, &[from, to], group.style, 0.0);
                }
            }
            // Markers lie over all lines of their group.
            for &(_, to) in group.pairs {
                let at = self.pixel(to);
                self.mark(at, LINK_MARK_PX, group.style);
            }
            self.key(group.name, group.style, group.heads);
        }
    }

    pub(super) fn line(&mut self, points: &[Point], style: Style, halo: f64) {
        draw_line(&mut self.inside, points, style, halo);
    }

    pub(super) fn mark(&mut self, at: Point, radius: f64, style: Style) {
        draw_mark(&mut self.inside, at, radius, style);
    }

    /// Writes a text centred on a point, on a white ground, moved so that it is not cut.
    pub(super) fn label(&mut self, at: Point, text: &str) {
        let (half, axes) = (text_width(text) / 2.0 + 3.0, &self.axes);
        let (left, right) = (axes.margin_left, axes.width - axes.margin_right);
        let (top, bottom) = (axes.margin_top, axes.height - axes.margin_bottom);
        let x = at.0.min(right - half - 2.0).max(left + half + 2.0);
        let y = at.1.min(bottom - 11.0).max(top + 11.0);
        self.labels.push(Primitive::Rect {
            x: x - half,
            y: y - 8.0,
            width: 2.0 * half,
            height: 16.0,
            fill: "#ffffff".into(),
            stroke: None,
            stroke_width: None,
            opacity: Some(0.8),
        });
        self.labels.push(text_at((x, y), text, TextAnchor::Middle));
    }

    /// Adds an entry to the legend.
    pub(super) fn key(&mut self, name: &str, style: Style, arrow: bool) {
        if self.legend_place == LegendPlace::Nowhere {
            return;
        }
        let (x, y) = self.place(self.rows);
        let ends = [(x, y), (x + KEY_PX, y)];
        if arrow {
            draw_arrow(&mut self.legend, ends[0], ends[1], style);
        } else {
            draw_line(&mut self.legend, &ends, style, 0.0);
        }
        let radius = if style.width > 0.0 { 4.5 } else { 3.5 };
        draw_mark(&mut self.legend, (if arrow { x + KEY_PX } else { x + KEY_PX / 2.0 }, y), radius, style);
        self.legend.push(text_at((x + KEY_PX + 8.0, y), name, TextAnchor::Start));
        self.legend_width = self.legend_width.max(KEY_PX + 28.0 + text_width(name));
        self.rows += 1;
    }

    /// Where an entry of the legend begins: left end and middle.
    pub(super) fn place(&self, entry: usize) -> Point {
        if self.legend_place == LegendPlace::Below {
            let (row, column) = (entry / 2, entry % 2);
            let width = (self.axes.width - 16.0) / 2.0;
            return (16.0 + width * column as f64, self.axes.height + ROW_PX * (row as f64 + 0.5));
        }
        (self.axes.width + 8.0, self.axes.margin_top + ROW_PX * (entry as f64 + 0.5))
    }

    /// Puts the parts together.
    pub(super) fn finish(mut self) -> Figure {
        let (_, last) = self.place(self.rows.saturating_sub(1));
        let bottom = if self.rows > 0 { last + ROW_PX } else { 0.0 };
        let legend_width = if self.legend_place == LegendPlace::Right { self.legend_width } else { 0.0 };
        let axes = &self.axes;
        let frame = Primitive::Rect {
            x: axes.margin_left,
            y: axes.margin_top,
            width: axes.plot_width(),
            height: axes.plot_height(),
            fill: Color::None,
            stroke: Some("#000000".into()),
            stroke_width: Some(1.0),
            opacity: None,
        };
        let elements = &mut self.scene.elements;
        let clip_end = elements.iter().rposition(|part| matches!(part, Primitive::ClipEnd));
        let at = clip_end.unwrap_or(elements.len());
        elements.splice(at..at, self.inside.into_iter().chain(self.labels));
        elements.push(frame);
        elements.append(&mut self.legend);
        self.scene.width = (self.scene.width + legend_width).ceil();
        self.scene.height = self.scene.height.max(bottom).ceil();
        Figure(self.scene)
    }
}

/// At most about `count` of the points, evenly spread, the first among them.
pub(super) fn thin(points: &[Point], count: usize) -> impl Iterator<Item = &Point> {
    points.iter().step_by(points.len().div_ceil(count).max(1))
}
