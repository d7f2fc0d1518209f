//! A figure under construction: axes, the content within them, and a legend.

use kuva::prelude::{Layout, LinePlot, Plot};
use kuva::render::color::Color;
use kuva::render::layout::ComputedLayout;
use kuva::render::render::{Primitive, Scene, TextAnchor, render_multiple};

use super::finished::Figure;
use super::marks::{
    draw_arrow, draw_head, draw_line, draw_mark, shortened, shortened_to, text_at, text_of_size, text_width, ways_once,
};
use super::style::{Arrows, FONT_PX, LegendPlace, Mark, Series, Style};
use crate::grid::{Grid, Point};

const ROW_PX: f64 = 20.0;
const KEY_PX: f64 = 42.0;
const LINK_MARK_PX: f64 = 3.0;

/// Width of a figure from which a legend below the axes has two columns.
const TWO_COLUMNS_PX: f64 = 620.0;

/// Room above the axes for the name of the vertical axis.
const Y_LABEL_ROOM_PX: f64 = 30.0;

/// Distance between arrow heads along a track.
const HEADS_PX: f64 = 110.0;

/// Room at the right of the axes for the colour bar and its numbers.
pub(super) const BAR_ROOM_PX: f64 = 64.0;

/// Largest number of letters of a title.
const TITLE_LETTERS_MAX: usize = 160;

/// Size of the letters of a title, and the height of its lines.
const TITLE_PX: u32 = 14;
const TITLE_ROW_PX: f64 = 19.0;

/// Height of the lines below a title.
const NOTE_ROW_PX: f64 = 16.0;

/// Texts above the axes.
pub(super) struct Heading<'a> {
    pub(super) title: &'a str,
    /// Lines below the title.
    pub(super) notes: &'a [String],
}

/// Largest number of tracks that the legend names.
const TRACKS_NAMED_MAX: usize = 24;

/// A figure under construction.
pub(super) struct Frame {
    pub(super) scene: Scene,
    pub(super) axes: ComputedLayout,
    /// Content within the axes, in pixels.
    pub(super) inside: Vec<Primitive>,
    /// Texts within the axes, on top of all other content.
    pub(super) labels: Vec<Primitive>,
    /// The legend, at the right of the figure.
    pub(super) legend: Vec<Primitive>,
    pub(super) rows: usize,
    /// Room for the colour bar between axes and legend.
    pub(super) bar_px: f64,
    legend_width: f64,
    pub(super) legend_place: LegendPlace,
}

impl Frame {
    /// Creates map axes with equal scales; the longer side has `side` pixels.
    pub(super) fn map(layout: Layout, heading: &Heading, east: Point, north: Point, side: f64) -> Self {
        let (width, height) = (east.1 - east.0, north.1 - north.0);
        let scale = side / width.max(height);
        Self::new(layout, heading, (east, "east (m)"), (north, "north (m)"), (width * scale, height * scale))
    }

    /// Creates axes over the ranges `x` and `y`, with their names. The data area has `size` pixels.
    pub(super) fn new(
        layout: Layout,
        heading: &Heading,
        (x, x_label): (Point, &str),
        (y, y_label): (Point, &str),
        size: Point,
    ) -> Self {
        let mut layout =
            layout.with_x_axis_min(x.0).with_x_axis_max(x.1).with_y_axis_min(y.0).with_y_axis_max(y.1).with_box_axes();
        if !layout.suppress_x_ticks {
            layout = layout.with_x_label(x_label);
        }
        layout.show_colorbar = false;
        // The margins do not depend on the size. They are measured first and then added.
        let margins = ComputedLayout::from_layout(&layout);
        let title = lines_of(
            &shortened_to(heading.title, TITLE_LETTERS_MAX),
            (margins.margin_left + size.0) * f64::from(FONT_PX) / f64::from(TITLE_PX),
        );
        let notes: Vec<String> =
            heading.notes.iter().flat_map(|note| lines_of(note, margins.margin_left + size.0)).collect();
        let heading_px = title.len() as f64 * TITLE_ROW_PX + notes.len() as f64 * NOTE_ROW_PX;
        layout.force_margin_top = Some(heading_px + Y_LABEL_ROOM_PX);
        let margins = ComputedLayout::from_layout(&layout);
        let layout = layout
            .with_width(size.0 + margins.margin_left + margins.margin_right)
            .with_height(size.1 + margins.margin_top + margins.margin_bottom);
        let axes = ComputedLayout::from_layout(&layout);
        // An empty line draws nothing. Without a plot there would be no axes.
        let scene = render_multiple(vec![Plot::from(LinePlot::new())], layout);
        // The name stands horizontally above its axis, because rotated letters are hard to read.
        let mut legend = vec![text_at((8.0, axes.margin_top - 14.0), y_label, TextAnchor::Start)];
        let rows = (0..title.len()).map(|n| TITLE_ROW_PX * (n as f64 + 0.5));
        legend
            .extend(rows.zip(&title).map(|(y, line)| text_of_size((8.0, y + 4.0), line, TextAnchor::Start, TITLE_PX)));
        let below_px = TITLE_ROW_PX * title.len() as f64;
        let rows = (0..notes.len()).map(|n| below_px + NOTE_ROW_PX * (n as f64 + 0.5));
        legend.extend(rows.zip(&notes).map(|(y, line)| text_at((8.0, y + 4.0), line, TextAnchor::Start)));
        Self {
            scene,
            axes,
            inside: Vec::new(),
            labels: Vec::new(),
            legend,
            rows: 0,
            bar_px: 0.0,
            legend_width: 0.0,
            legend_place: LegendPlace::Right,
        }
    }

    /// Returns the pixel of a data point.
    pub(super) fn pixel(&self, (x, y): Point) -> Point {
        (self.axes.map_x(x), self.axes.map_y(y))
    }

    /// Draws and labels the contour lines at `level`.
    pub(super) fn contour(&mut self, grid: &Grid, level: f64, style: Style) {
        let name = format!("{level}");
        let mut longest: Vec<Point> = vec![];
        for line in grid.contour_lines(level) {
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

    /// Draws tracks and adds them to the legend. A track has a few markers, a ring at its start and arrow heads.
    /// Stationary vehicles are drawn on top. If there are very many tracks, all have one style and one entry of the
    /// legend.
    pub(super) fn tracks(&mut self, tracks: &[Series]) {
        let many = tracks.len() > TRACKS_NAMED_MAX;
        let plain = Style { color: "#d7301f", width: 1.0, dash: &[], mark: Mark::Dot };
        let (moving, fixed): (Vec<&Series>, Vec<&Series>) = tracks.iter().partition(|track| track.points.len() > 1);
        for track in moving.into_iter().chain(fixed) {
            let style = if many { plain } else { track.style };
            let points: Vec<Point> = thin(track.points, 2000).map(|&point| self.pixel(point)).collect();
            for piece in ways_once(&points) {
                self.line(&piece, style, 2.5);
            }
            self.directions(&points, style);
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

    /// Draws a ring at the start of a track, and arrow heads along it.
    pub(super) fn directions(&mut self, points: &[Point], style: Style) {
        let [first, _, ..] = points else { return };
        let ring = |r, stroke: &str, width| Primitive::Circle {
            cx: first.0,
            cy: first.1,
            r,
            fill: Color::None,
            fill_opacity: None,
            stroke: Some(stroke.into()),
            stroke_width: Some(width),
        };
        self.inside.extend([ring(8.0, "#ffffff", 3.6), ring(8.0, style.color, 1.8)]);
        let length = |pair: &[Point]| (pair[1].0 - pair[0].0).hypot(pair[1].1 - pair[0].1);
        let whole: f64 = points.windows(2).map(length).sum();
        let (mut gone, mut next) = (0.0, whole.min(HEADS_PX) / 2.0);
        for pair in points.windows(2) {
            let step = length(pair);
            while step > 0.0 && next <= gone + step {
                let along = |share: f64| {
                    (pair[0].0 + (pair[1].0 - pair[0].0) * share, pair[0].1 + (pair[1].1 - pair[0].1) * share)
                };
                let (share, back) = ((next - gone) / step, 1.0 / step);
                draw_head(&mut self.inside, along(share - back), along(share), style);
                next += HEADS_PX;
            }
            gone += step;
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
            // Markers lie on top of all lines of their group.
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

    /// Writes a text centred on a point, on a white background. The text is moved if it would be cut off.
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
        let name = &shortened(name);
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

    /// Returns the position of an entry of the legend: left end and vertical centre.
    pub(super) fn place(&self, entry: usize) -> Point {
        if self.legend_place == LegendPlace::Below {
            // Two columns have room for names of 40 letters.
            let columns = if self.axes.width < TWO_COLUMNS_PX { 1 } else { 2 };
            let (row, column) = (entry / columns, entry % columns);
            let width = (self.axes.width - 16.0) / columns as f64;
            return (16.0 + width * column as f64, self.axes.height + ROW_PX * (row as f64 + 0.5));
        }
        (self.axes.width + 8.0 + self.bar_px, self.axes.margin_top + ROW_PX * (entry as f64 + 0.5))
    }

    /// Assembles the figure.
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
        self.scene.width = (self.scene.width + self.bar_px + legend_width).ceil();
        self.scene.height = self.scene.height.max(bottom).ceil();
        Figure(self.scene)
    }
}

/// Breaks a text into lines of at most this width, between words.
fn lines_of(text: &str, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}")) <= width => *line += &format!(" {word}"),
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Returns about `count` of the points, evenly spread, including the first.
pub(super) fn thin(points: &[Point], count: usize) -> impl Iterator<Item = &Point> {
    points.iter().step_by(points.len().div_ceil(count).max(1))
}

/// Returns the smallest number not below `step` that is 1, 2 or 5 times a power of ten.
pub(super) fn round_step(step: f64) -> f64 {
    let power = 10.0_f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= step);
    factor.unwrap_or(10.0) * power
}
