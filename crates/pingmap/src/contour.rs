//! Contour lines of a grid by marching squares. Segments are joined into whole lines, so that lines can be dashed and
//! labelled.

use std::collections::HashMap;

/// A point: metres east and north on a map, or pixels on the page.
pub type Point = (f64, f64);

/// A regular grid of probabilities in rows from the south, each row from the west. A cell whose value is not a number
/// stays white.
pub struct Grid<'a> {
    pub values: &'a [f64],
    pub columns: usize,
    pub east: (f64, f64),
    pub north: (f64, f64),
}

/// Returns the contour lines at `level`. Values are interpolated linearly between the centres of the cells.
pub fn contour_lines(grid: &Grid, level: f64) -> Vec<Vec<Point>> {
    let (columns, rows) = (grid.columns, grid.values.len() / grid.columns);
    let value = |column: usize, row: usize| grid.values[row * columns + column];
    let center = |column: f64, row: f64| {
        let share = ((column + 0.5) / columns as f64, (row + 0.5) / rows as f64);
        let (east, north) = (grid.east, grid.north);
        (east.0 + (east.1 - east.0) * share.0, north.0 + (north.1 - north.0) * share.1)
    };
    // An edge runs from a cell centre to the next one east or north of it.
    type Edge = (usize, usize, bool);
    let crossing = |(column, row, upward): Edge| {
        let next = if upward { value(column, row + 1) } else { value(column + 1, row) };
        let share = (level - value(column, row)) / (next - value(column, row));
        let (x, y) = (column as f64, row as f64);
        if upward { center(x, y + share) } else { center(x + share, y) }
    };
    let mut links: HashMap<Edge, Vec<Edge>> = HashMap::new();
    let mut starts: Vec<Edge> = vec![];
    for row in 0..rows.saturating_sub(1) {
        for column in 0..columns.saturating_sub(1) {
            // South, east, north and west edge of the square, and its corners in that order.
            let edges = [(column, row, false), (column + 1, row, true), (column, row + 1, false), (column, row, true)];
            let corners =
                [value(column, row), value(column + 1, row), value(column + 1, row + 1), value(column, row + 1)];
            if corners.iter().any(|v| v.is_nan()) {
                continue;
            }
            let high = corners.map(|v| v >= level);
            let mut cut: Vec<Edge> = (0..4).filter(|&k| high[k] != high[(k + 1) % 4]).map(|k| edges[k]).collect();
            // At a saddle the mean of the corners decides which corners are connected.
            if cut.len() == 4 && (corners.iter().sum::<f64>() / 4.0 >= level) != high[0] {
                cut.rotate_left(1);
            }
            for pair in cut.chunks_exact(2) {
                links.entry(pair[0]).or_default().push(pair[1]);
                links.entry(pair[1]).or_default().push(pair[0]);
                starts.extend(pair);
            }
        }
    }
    // Open lines come first, each from one of its ends. The remaining lines are closed loops.
    starts.sort_by_key(|edge| links[edge].len());
    let mut lines = vec![];
    for start in starts {
        let (mut line, mut edge) = (vec![crossing(start)], start);
        while let Some(next) = links.get_mut(&edge).and_then(Vec::pop) {
            if let Some(back) = links.get_mut(&next)
                && let Some(at) = back.iter().position(|&other| other == edge)
            {
                back.swap_remove(at);
            }
            line.push(crossing(next));
            edge = next;
        }
        if line.len() > 1 {
            lines.push(line);
        }
    }
    lines
}
