//! A grid of values and its contour lines.

use contour::ContourBuilder;
use geo_types::Coord;

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

impl Grid<'_> {
    /// Returns the contour lines at `level`. Values are interpolated linearly between the centres of the cells.
    pub fn contour_lines(&self, level: f64) -> Vec<Vec<Point>> {
        let (columns, rows) = (self.columns, self.values.len() / self.columns);
        // The only possible error is a number of values that differs from columns times rows.
        let contours = ContourBuilder::new(columns, rows, true).lines(self.values, &[level]).unwrap_or_default();
        let rings = contours.into_iter().flat_map(|contour| contour.into_inner().0.0);
        rings.flat_map(|ring| self.open_lines(ring.0, (columns as f64, rows as f64))).collect()
    }

    /// Splits a ring where it runs along the edge of the grid or around a cell without a value. Coordinates of the ring
    /// are in cells.
    fn open_lines(&self, mut ring: Vec<Coord>, (columns, rows): (f64, f64)) -> Vec<Vec<Point>> {
        let is_inside = |at: &Coord| at.x > 0.0 && at.x < columns && at.y > 0.0 && at.y < rows;
        if let Some(outside) = ring.iter().position(|at| !is_inside(at)) {
            ring.pop();
            ring.rotate_left(outside);
        }
        let between = |(low, high): (f64, f64), share: f64| low + (high - low) * share;
        let point = |at: &Coord| (between(self.east, at.x / columns), between(self.north, at.y / rows));
        let lines = ring.split(|at| !is_inside(at)).filter(|line| line.len() > 1);
        lines.map(|line| line.iter().map(point).collect()).collect()
    }
}
