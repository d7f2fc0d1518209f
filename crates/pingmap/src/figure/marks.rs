//! Lines, arrows, markers and texts in pixels.

use std::collections::HashMap;

use kuva::prelude::{Layout, LegendEntry, LegendShape};
use kuva::render::render::{PathData, Primitive, TextAnchor};

use super::style::{FONT_PX, Mark, Style};
use crate::grid::Point;

/// Draws a line over a white `halo`. The dashes are cut here, because the PNG writer would restart the pattern at every
/// vertex and would not scale it.
pub(super) fn draw_line(out: &mut Vec<Primitive>, points: &[Point], style: Style, halo: f64) {
    let mut stroke = |points: Vec<Point>, color: &str, stroke_width: f64| {
        out.push(Primitive::PolyLine { points, stroke: color.into(), stroke_width, stroke_dasharray: None });
    };
    if style.width <= 0.0 || points.len() < 2 {
        return;
    }
    if halo > 0.0 {
        stroke(points.to_vec(), "#ffffff", style.width + halo);
    }
    if style.dash.is_empty() {
        stroke(points.to_vec(), style.color, style.width);
        return;
    }
    let (mut piece, mut part, mut left) = (vec![points[0]], 0_usize, style.dash[0]);
    for pair in points.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        let mut length = (to.0 - from.0).hypot(to.1 - from.1);
        while length > left {
            let share = left / length;
            from = (from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share);
            piece.push(from);
            if part.is_multiple_of(2) {
                stroke(std::mem::take(&mut piece), style.color, style.width);
            }
            length -= left;
            part += 1;
            left = style.dash[part % style.dash.len()];
            piece = vec![from];
        }
        left -= length;
        piece.push(to);
    }
    if part.is_multiple_of(2) {
        stroke(piece, style.color, style.width);
    }
}

/// Step at which tracks are compared, and the distance in pixels within which two points coincide.
const STEP_PX: f64 = 3.0;
const SAME_PX: f64 = 2.4;

/// Returns the pieces of a track that are not drawn yet. A dashed line that is drawn twice would fill its own gaps.
/// O(n) for n steps.
pub(super) fn ways_once(points: &[Point]) -> Vec<Vec<Point>> {
    let mut seen: HashMap<(i64, i64), Vec<(usize, Point)>> = HashMap::new();
    let cell = |(x, y): Point| ((x / SAME_PX).floor() as i64, (y / SAME_PX).floor() as i64);
    let (mut pieces, mut piece) = (Vec::new(), Vec::new());
    for (number, point) in steps(points).into_iter().enumerate() {
        let (column, row) = cell(point);
        let around = (-1..=1).flat_map(|x| (-1..=1).map(move |y| (column + x, row + y)));
        let near = |&(earlier, other): &(usize, Point)| {
            // The latest steps are the current piece itself.
            earlier + 6 < number && (other.0 - point.0).hypot(other.1 - point.1) < SAME_PX
        };
        let is_old = around.filter_map(|cell| seen.get(&cell)).flatten().any(near);
        seen.entry((column, row)).or_default().push((number, point));
        piece.push(point);
        if is_old {
            pieces.extend((piece.len() > 2).then(|| std::mem::take(&mut piece)));
            piece = vec![point];
        }
    }
    pieces.extend((piece.len() > 1).then_some(piece));
    pieces
}

/// Returns the corners of a line, and points between them.
fn steps(points: &[Point]) -> Vec<Point> {
    let mut steps: Vec<Point> = points.first().copied().into_iter().collect();
    for pair in points.windows(2) {
        let count = ((pair[1].0 - pair[0].0).hypot(pair[1].1 - pair[0].1) / STEP_PX).ceil().max(1.0) as usize;
        let at = |n: usize| {
            let share = n as f64 / count as f64;
            (pair[0].0 + (pair[1].0 - pair[0].0) * share, pair[0].1 + (pair[1].1 - pair[0].1) * share)
        };
        steps.extend((1..=count).map(at));
    }
    steps
}

/// Draws the head of an arrow that ends at `to`.
pub(super) fn draw_head(out: &mut Vec<Primitive>, from: Point, to: Point, style: Style) {
    let length = (to.0 - from.0).hypot(to.1 - from.1);
    let (x, y) = ((to.0 - from.0) / length, (to.1 - from.1) / length);
    let (tip, base) = ((to.0 + 5.0 * x, to.1 + 5.0 * y), (to.0 - 5.0 * x, to.1 - 5.0 * y));
    out.push(polygon(
        &[tip, (base.0 - 5.0 * y, base.1 + 5.0 * x), to, (base.0 + 5.0 * y, base.1 - 5.0 * x)],
        style.color,
        "#ffffff",
    ));
}

/// Largest number of letters of a name.
const NAME_LETTERS_MAX: usize = 40;

/// Shortens a long name by leaving out its middle.
pub(super) fn shortened(name: &str) -> String {
    shortened_to(name, NAME_LETTERS_MAX)
}

/// Shortens a text to at most `letters_max` letters.
pub(super) fn shortened_to(text: &str, letters_max: usize) -> String {
    let letters: Vec<char> = text.chars().collect();
    if letters.len() <= letters_max {
        return text.to_owned();
    }
    let half = letters_max / 2 - 1;
    letters[..half].iter().chain(&['…']).chain(&letters[letters.len() - half..]).collect()
}

/// Draws an arrow with a filled head.
pub(super) fn draw_arrow(out: &mut Vec<Primitive>, from: Point, to: Point, style: Style) {
    let length = (to.0 - from.0).hypot(to.1 - from.1);
    if length < 1.0 {
        return;
    }
    let head = 11.0_f64.min(length);
    let (x, y) = ((to.0 - from.0) / length, (to.1 - from.1) / length);
    let base = (to.0 - x * head, to.1 - y * head);
    draw_line(out, &[from, base], style, 0.0);
    let side = 0.4 * head;
    let corners = [to, (base.0 - y * side, base.1 + x * side), (base.0 + y * side, base.1 - x * side)];
    out.push(polygon(&corners, style.color, style.color));
}

/// Draws a marker with an outline that is visible on dark and light backgrounds.
pub(super) fn draw_mark(out: &mut Vec<Primitive>, (x, y): Point, radius: f64, style: Style) {
    let corners = |count: usize, turn: f64, inner: f64| -> Vec<Point> {
        let corner = |k: usize| {
            let angle = std::f64::consts::TAU * (k as f64 / count as f64 + turn);
            let r = if k.is_multiple_of(2) { radius * 1.3 } else { radius * 1.3 * inner };
            (x + r * angle.sin(), y - r * angle.cos())
        };
        (0..count).map(corner).collect()
    };
    let shape = match style.mark {
        Mark::None => return,
        Mark::Dot => {
            out.push(Primitive::Circle {
                cx: x,
                cy: y,
                r: radius,
                fill: style.color.into(),
                fill_opacity: None,
                stroke: Some("#ffffff".into()),
                stroke_width: Some(1.4),
            });
            return;
        }
        Mark::Square => corners(4, 0.125, 1.0),
        Mark::Triangle => corners(3, 0.0, 1.0),
        Mark::Diamond => corners(4, 0.0, 1.0),
        Mark::Star => corners(10, 0.0, 0.42),
        Mark::Cross => {
            for (halo, color) in [(2.2, "#ffffff"), (0.0, style.color)] {
                for side in [-1.0, 1.0] {
                    out.push(Primitive::PolyLine {
                        points: vec![(x - radius, y - side * radius), (x + radius, y + side * radius)],
                        stroke: color.into(),
                        stroke_width: 1.6 + halo,
                        stroke_dasharray: None,
                    });
                }
            }
            return;
        }
    };
    out.push(polygon(&shape, style.color, "#ffffff"));
}

pub(super) fn polygon(corners: &[Point], fill: &str, edge: &str) -> Primitive {
    let steps: Vec<String> = corners.iter().map(|(x, y)| format!("{x:.2},{y:.2}")).collect();
    Primitive::Path(Box::new(PathData {
        d: format!("M{} Z", steps.join(" L")),
        fill: Some(fill.into()),
        stroke: edge.into(),
        stroke_width: 1.2,
        opacity: None,
        stroke_dasharray: None,
    }))
}

pub(super) fn text_at(at: Point, text: &str, anchor: TextAnchor) -> Primitive {
    text_of_size(at, text, anchor, FONT_PX)
}

pub(super) fn text_of_size((x, y): Point, text: &str, anchor: TextAnchor, size: u32) -> Primitive {
    Primitive::Text {
        x,
        y: y + 0.365 * f64::from(size),
        content: text.into(),
        size,
        anchor,
        rotate: None,
        bold: false,
        color: None,
    }
}

/// Returns the width of a text. `kuva` uses its private measure for the width of legends, from which this is computed.
pub(super) fn text_width(text: &str) -> f64 {
    let entry = LegendEntry { label: text.into(), color: String::new(), shape: LegendShape::Line, dasharray: None };
    Layout::new((0.0, 1.0), (0.0, 1.0)).with_legend_entries(vec![entry]).legend_width - 41.0
}
