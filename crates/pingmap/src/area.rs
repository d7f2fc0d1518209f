//! The area of a map: a grid of square cells.

use pingmap_agent::Position;

use crate::grid::{Grid, Point};
use crate::output::BadInput;
use crate::tracks::widened;

/// Cells along the longer side of a map.
const CELLS: f64 = 120.0;

/// The most cells a map may have.
const CELLS_MAX: f64 = 4e6;

/// Square cells in rows from the south, each row from the west, in metres of the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    pub east: (f64, f64),
    pub north: (f64, f64),
    pub cell_m: f64,
    pub columns: usize,
    pub rows: usize,
}

impl Area {
    /// Returns the area that contains the positions, with a margin.
    pub fn around(places: impl Iterator<Item = Position>, cell_m: Option<f64>) -> Result<Self, BadInput> {
        let (east, north) = widened(places.map(|place| (place.east_m, place.north_m)));
        Self::of(east, north, cell_m)
    }

    /// Returns the area between two opposite corners.
    pub fn between(a: Position, b: Position, cell_m: Option<f64>) -> Result<Self, BadInput> {
        let sorted = |a: f64, b: f64| (a.min(b), a.max(b));
        let (east, north) = (sorted(a.east_m, b.east_m), sorted(a.north_m, b.north_m));
        if east.0 == east.1 || north.0 == north.1 {
            return Err(BadInput("--bounds: expected two opposite corners of an area".into()));
        }
        Self::of(east, north, cell_m)
    }

    fn of(east: Point, north: Point, cell_m: Option<f64>) -> Result<Self, BadInput> {
        let cell_m = cell_m.unwrap_or((east.1 - east.0).max(north.1 - north.0) / CELLS);
        let cells = |(low, high): Point| ((high - low) / cell_m - 1e-9).ceil().max(1.0);
        let (columns, rows) = (cells(east), cells(north));
        if columns * rows > CELLS_MAX {
            let message = format!("--cell-m {cell_m} makes {columns} x {rows} cells; expected at most {CELLS_MAX}");
            return Err(BadInput(message));
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let east = (east.0, east.0 + columns as f64 * cell_m);
        let north = (north.0, north.0 + rows as f64 * cell_m);
        Ok(Self { east, north, cell_m, columns, rows })
    }

    /// Returns the number of cells.
    pub fn cells(&self) -> usize {
        self.columns * self.rows
    }

    /// Returns the centre of a cell.
    pub fn middle(&self, cell: usize) -> Point {
        let (row, column) = (cell / self.columns, cell % self.columns);
        (self.east.0 + (column as f64 + 0.5) * self.cell_m, self.north.0 + (row as f64 + 0.5) * self.cell_m)
    }

    /// Returns the distance of a point from the nearest edge. It is negative outside the area.
    pub fn edge_m(&self, (x, y): Point) -> f64 {
        (x - self.east.0).min(self.east.1 - x).min(y - self.north.0).min(self.north.1 - y)
    }

    /// Returns true for a cell of the outer rows and columns.
    pub fn is_at_edge(&self, cell: usize) -> bool {
        let (row, column) = (cell / self.columns, cell % self.columns);
        [0, self.rows - 1].contains(&row) || [0, self.columns - 1].contains(&column)
    }

    /// Returns the values of the cells as a grid.
    pub fn grid<'a>(&self, values: &'a [f64]) -> Grid<'a> {
        Grid { values, columns: self.columns, east: self.east, north: self.north }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_cover_the_area_between_two_corners() {
        let area = Area::between(Position::new(100.0, 50.0), Position::new(0.0, 0.0), Some(30.0)).unwrap();
        assert_eq!((area.columns, area.rows, area.cells()), (4, 2, 8));
        assert_eq!((area.east, area.north), ((0.0, 120.0), (0.0, 60.0)));
        assert_eq!((area.middle(0), area.middle(7)), ((15.0, 15.0), (105.0, 45.0)));
        let exact = Area::between(Position::new(0.0, 0.0), Position::new(0.3, 0.1), Some(0.1)).unwrap();
        assert_eq!((exact.columns, exact.rows), (3, 1));
        assert!(Area::between(Position::new(0.0, 0.0), Position::new(5.0, 0.0), None).is_err());
        assert!(Area::between(Position::new(0.0, 0.0), Position::new(1e6, 1e6), Some(1.0)).is_err());
    }
}
