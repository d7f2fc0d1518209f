//! Figures: a map of success probability, and maps of links. The only folder that names the plotting crate.
//!
//! `kuva` supplies the axes, the title, the colour scale and bar, and the SVG and PNG writers.
//! Everything inside the axes is added to its public `Scene` in pixel coordinates, because its
//! own plots have no fixed colour range, no dashed contours, no outlines and no long legend keys.

mod marks;

use kuva::backend::raster::RasterBackend;
use kuva::prelude::{ColorMap, Layout, LinePlot, Plot, QuiverPlot, SvgBackend, TickFormat};
use kuva::render::color::Color;
use kuva::render::layout::ComputedLayout;
use kuva::render::render::{Primitive, Scene, TextAnchor, render_multiple};

use crate::contour::{Grid, Point, contour_lines};
use marks::{draw_arrow, draw_line, draw_mark, text_at, text_width};

const FONT_PX: u32 = 12;
const ROW_PX: f64 = 20.0;
const KEY_PX: f64 = 42.0;
const LINK_MARK_PX: f64 = 3.0;
const PANEL_TITLE_PX: u32 = 14;
const PANEL_TITLE_ROOM_PX: f64 = 30.0;
const PANEL_GAP_PX: f64 = 8.0;

/// Of more tracks than this the legend names none.
const TRACKS_NAMED_MAX: usize = 24;

/// The shape of a marker.
#[derive(Clone, Copy, PartialEq)]
pub enum Mark {
    None,
    Dot,
    Square,
    Triangle,
    Diamond,
    Star,
    Cross,
}

/// How a line and its markers look; an empty `dash` is a solid line, a zero `width` is no line.
#[derive(Clone, Copy)]
pub struct Style<'a> {
    pub color: &'a str,
    pub width: f64,
    pub dash: &'a [f64],
    pub mark: Mark,
}

/// A named line with markers.
pub struct Series<'a> {
    pub name: &'a str,
    pub points: &'a [Point],
    pub style: Style<'a>,
}

/// Named lines from the first point of each pair to the second, with the style's marker at the second.
#[derive(Clone, Copy)]
pub struct Arrows<'a> {
    pub name: &'a str,
    pub pairs: &'a [(Point, Point)],
    pub style: Style<'a>,
    /// Whether they have heads.
    pub heads: bool,
}

/// What one of several maps of the same area shows.
pub struct Panel<'a> {
    pub title: &'a str,
    pub tracks: &'a [Series<'a>],
    pub links: &'a [Arrows<'a>],
}

/// A finished figure.
pub struct Figure(Scene);

impl Figure {
    /// The figure as SVG; `embed_font` makes it independent of installed fonts (and 3.2 MB larger).
    pub fn svg(&self, embed_font: bool) -> String {
        let backend = SvgBackend::new().with_embedded_font(embed_font);
        backend.render_scene(&self.0)
    }

    /// The figure as PNG bytes, two pixels per SVG unit.
    pub fn png(&self) -> anyhow::Result<Vec<u8>> {
        self.png_scaled(2.0)
    }

    /// The figure as PNG bytes, so many pixels per SVG unit.
    pub fn png_scaled(&self, scale: f32) -> anyhow::Result<Vec<u8>> {
        let raster = RasterBackend::new().with_scale(scale);
        raster.render_scene(&self.0).map_err(|error| anyhow::anyhow!("cannot draw: {error}"))
    }
}

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

/// Draws maps of the same area one below the other, for one column of a page: axes `side` pixels wide, the legend of the last below
/// everything.
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

/// A figure under construction.
struct Frame {
    scene: Scene,
    axes: ComputedLayout,
    /// What is drawn inside the axes, in pixels.
    inside: Vec<Primitive>,
    /// Texts inside the axes, over everything else there.
    labels: Vec<Primitive>,
    /// What is drawn right of everything else.
    legend: Vec<Primitive>,
    rows: usize,
    legend_width: f64,
    legend_place: LegendPlace,
}

/// Where the legend stands.
#[derive(Clone, Copy, PartialEq)]
enum LegendPlace {
    /// Right of the axes and of the colour bar, one entry below the other.
    Right,
    /// Below the axes, in two columns.
    Below,
    /// There is none.
    Nowhere,
}

impl Frame {
    /// Makes map axes with one metre the same length both ways, the longer side `side` pixels.
    fn map(layout: Layout, east: (f64, f64), north: (f64, f64), bar: Option<&str>, side: f64) -> Self {
        let (width, height) = (east.1 - east.0, north.1 - north.0);
        let scale = side / width.max(height);
        Self::new(layout, east, north, bar, (width * scale, height * scale))
    }

    /// Makes axes over exactly `x` and `y` whose data area is `size` pixels.
    fn new(layout: Layout, x: Point, y: Point, bar: Option<&str>, size: Point) -> Self {
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
    fn pixel(&self, (x, y): Point) -> Point {
        (self.axes.map_x(x), self.axes.map_y(y))
    }

    /// Fills the cells of a grid, joining equal neighbours in a row.
    fn heat_map(&mut self, grid: &Grid) {
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
    fn contour(&mut self, grid: &Grid, level: f64, style: Style) {
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

    /// Draws tracks with a marker here and there, those of who stays in place on top, and adds them to the legend; of very many,
    /// all look alike under one name.
    fn tracks(&mut self, tracks: &[Series]) {
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

    fn links(&mut self, links: &[Arrows]) {
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

    fn line(&mut self, points: &[Point], style: Style, halo: f64) {
        draw_line(&mut self.inside, points, style, halo);
    }

    fn mark(&mut self, at: Point, radius: f64, style: Style) {
        draw_mark(&mut self.inside, at, radius, style);
    }

    /// Writes a text centred on a point, on a white ground, moved so that it is not cut.
    fn label(&mut self, at: Point, text: &str) {
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
    fn key(&mut self, name: &str, style: Style, arrow: bool) {
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
    fn place(&self, entry: usize) -> Point {
        if self.legend_place == LegendPlace::Below {
            let (row, column) = (entry / 2, entry % 2);
            let width = (self.axes.width - 16.0) / 2.0;
            return (16.0 + width * column as f64, self.axes.height + ROW_PX * (row as f64 + 0.5));
        }
        (self.axes.width + 8.0, self.axes.margin_top + ROW_PX * (entry as f64 + 0.5))
    }

    /// Puts the parts together.
    fn finish(mut self) -> Figure {
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
fn thin(points: &[Point], count: usize) -> impl Iterator<Item = &Point> {
    points.iter().step_by(points.len().div_ceil(count).max(1))
}

/// The smallest of 1, 2 or 5 times a power of ten that is not below `step`.
fn round_step(step: f64) -> f64 {
    let power = 10.0_f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= step);
    factor.unwrap_or(10.0) * power
}
