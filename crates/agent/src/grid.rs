//! Chart and time in whole cells, as packets name places and times.

use pingmap_packet::{Cell, DEPTH_CELLS, HORIZONTAL_CELLS, KNOT_CELLS, KNOT_DEPTH_CELLS, TIME_CELLS};

use crate::attempt::When;
use crate::bounds;
use crate::chart::Chart;
use crate::event::{Link, Position};

/// How a team's chart is cut into cells: 64 × 64 about the chart's origin, and 32 from the surface down; and how its
/// mission is: 63 cells of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Side of a cell east and north, in metres.
    pub cell_m: f64,
    /// Height of a cell, in metres.
    pub depth_cell_m: f64,
    /// When the first cell of time begins, in seconds.
    pub start_s: f64,
    /// Length of a cell of time, in seconds.
    pub time_cell_s: f64,
}

/// Where nothing is said of the time: cells of ten minutes, for a mission of half a day.
pub(crate) const TIME_CELL_S: f64 = 600.0;

/// How many cells a chart has, and how large they are.
#[derive(Clone, Copy)]
struct Cells {
    /// East and north.
    across: u16,
    /// From the surface down.
    down: u8,
    side_m: f64,
    height_m: f64,
}

impl Cells {
    /// The cell of a position, if there is one.
    fn cell(self, chart: &Chart, position: &Position) -> Option<Cell> {
        let (east_m, north_m) = chart.local_m(position);
        let place = |value: f64, cells: u16| (value >= 0.0 && value < f64::from(cells)).then_some(value as u8);
        let across = |value_m: f64| place((value_m / self.side_m + f64::from(self.across) / 2.0).floor(), self.across);
        Some(Cell {
            east: across(east_m)?,
            north: across(north_m)?,
            depth: match position.depth_m {
                // Floats and buoys lie on the surface, or a little above what a sensor calls it.
                Some(depth_m) => place((depth_m / self.height_m).floor().max(0.0), self.down.into())?,
                None => 0,
            },
        })
    }

    /// The middle of a cell.
    fn position(self, chart: &Chart, cell: Cell, has_depth: bool) -> Position {
        let middle = |place: u8| (f64::from(place) + 0.5 - f64::from(self.across) / 2.0) * self.side_m;
        Position {
            east_m: chart.origin.east_m + middle(cell.east),
            north_m: chart.origin.north_m + middle(cell.north),
            depth_m: has_depth.then(|| (f64::from(cell.depth) + 0.5) * self.height_m),
        }
    }
}

impl Grid {
    /// The finest grid of two-digit cells that holds all these positions.
    pub fn covering(chart: &Chart, positions: impl IntoIterator<Item = Position>) -> Self {
        let (mut reach_m, mut depth_max_m) = (0.0f64, 0.0f64);
        for position in positions {
            let (east_m, north_m) = chart.local_m(&position);
            reach_m = reach_m.max(east_m.abs()).max(north_m.abs());
            depth_max_m = depth_max_m.max(position.depth_m.unwrap_or(0.0));
        }
        Self {
            cell_m: round_up(2.0 * reach_m / f64::from(HORIZONTAL_CELLS)),
            depth_cell_m: round_up(depth_max_m / f64::from(DEPTH_CELLS)),
            start_s: 0.0,
            time_cell_s: TIME_CELL_S,
        }
    }

    /// The same cells of the chart, and the finest of two-digit length that hold all these times. Times that are not
    /// finite are not looked at; without any other the cells of time stay.
    #[must_use]
    pub fn spanning(self, times_s: impl IntoIterator<Item = f64>) -> Self {
        let finite = times_s.into_iter().filter(|time_s| time_s.is_finite());
        let span = finite.fold(None, |span: Option<(f64, f64)>, time_s| {
            let (first_s, last_s) = span.unwrap_or((time_s, time_s));
            Some((first_s.min(time_s), last_s.max(time_s)))
        });
        span.map_or(self, |(first_s, last_s)| {
            let time_cell_s = round_up((last_s - first_s) / f64::from(TIME_CELLS - 1));
            let time_cell_s = time_cell_s.clamp(bounds::SLOT_S.min, bounds::SLOT_S.max);
            Self { start_s: first_s, time_cell_s, ..self }
        })
    }

    /// The cell of a time; 0, that of no certain time, for one that the grid does not hold.
    pub fn time_cell(&self, time_s: f64) -> u8 {
        let place = ((time_s - self.start_s) / self.time_cell_s).floor();
        if (0.0..f64::from(TIME_CELLS - 1)).contains(&place) { place as u8 + 1 } else { 0 }
    }

    /// The middle of a cell of time.
    pub fn when(&self, time_cell: u8) -> When {
        match time_cell {
            0 => When::Typical,
            cell => When::At(self.start_s + (f64::from(cell) - 0.5) * self.time_cell_s),
        }
    }

    /// The cell of a position, if the grid holds it.
    pub fn cell(&self, chart: &Chart, position: &Position) -> Option<Cell> {
        self.cells_of_points().cell(chart, position)
    }

    /// The middle of a cell.
    pub fn position(&self, chart: &Chart, cell: Cell, has_depth: bool) -> Position {
        self.cells_of_points().position(chart, cell, has_depth)
    }

    /// The cell of a position in which a knot of a track lies: a quarter as wide, and half as high.
    pub fn knot_cell(&self, chart: &Chart, position: &Position) -> Option<Cell> {
        self.cells_of_knots().cell(chart, position)
    }

    /// Cells of knots about one, and it: five in a row and a column, the last of them about so far away, or next to one another.
    pub(crate) fn knot_cells_about(&self, cell: Cell, away_m: f64) -> impl Iterator<Item = Cell> {
        let stride = (away_m / self.cells_of_knots().side_m / 2.0).clamp(1.0, f64::from(u8::MAX)) as i32;
        let about = move |place: u8| (-2..=2).filter_map(move |n| u8::try_from(i32::from(place) + n * stride).ok());
        about(cell.east).flat_map(move |east| about(cell.north).map(move |north| Cell { east, north, ..cell }))
    }

    /// The middle of a cell of knots.
    pub fn knot_position(&self, chart: &Chart, cell: Cell, has_depth: bool) -> Position {
        self.cells_of_knots().position(chart, cell, has_depth)
    }

    fn cells_of_points(&self) -> Cells {
        let Self { cell_m: side_m, depth_cell_m: height_m, .. } = *self;
        Cells { across: HORIZONTAL_CELLS.into(), down: DEPTH_CELLS, side_m, height_m }
    }

    fn cells_of_knots(&self) -> Cells {
        let side_m = self.cell_m * f64::from(HORIZONTAL_CELLS) / f64::from(KNOT_CELLS);
        let height_m = self.depth_cell_m * f64::from(DEPTH_CELLS) / f64::from(KNOT_DEPTH_CELLS);
        Cells { across: KNOT_CELLS, down: KNOT_DEPTH_CELLS, side_m, height_m }
    }

    /// The cells of both ends, if the grid holds them.
    pub fn cells(&self, chart: &Chart, link: &Link) -> Option<[Cell; 2]> {
        Some([self.cell(chart, &link.transmitter)?, self.cell(chart, &link.receiver)?])
    }
}

/// The smallest number of two digits that is greater; 1 where there is nothing to cover.
fn round_up(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    ((value / unit).floor() + 1.0) * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_lies_in_the_cell_that_is_sent_for_it() {
        let corners = [(-812.0, 1499.0), (703.0, -1500.0), (0.0, 0.0)].map(|(east, north): (f64, f64)| Position {
            depth_m: Some(east.abs() / 10.0),
            ..Position::new(5e5 + east, 4e6 + north)
        });
        let chart = Chart::about(corners);
        let grid = Grid::covering(&chart, corners);
        for corner in corners {
            let cell = grid.cell(&chart, &corner).expect("the grid covers it");
            let middle = grid.position(&chart, cell, true);
            let off = |a: f64, b: f64| (a - b).abs();
            assert!(off(middle.east_m, corner.east_m) <= 0.5 * grid.cell_m + 1e-9, "{middle:?} {corner:?}");
            assert!(off(middle.north_m, corner.north_m) <= 0.5 * grid.cell_m + 1e-9);
            let depths = (middle.depth_m.unwrap_or(0.0), corner.depth_m.unwrap_or(0.0));
            assert!(off(depths.0, depths.1) <= 0.5 * grid.depth_cell_m + 1e-9, "{depths:?}");
            assert_eq!(grid.cell(&chart, &middle), Some(cell));
            let knot = grid.knot_position(&chart, grid.knot_cell(&chart, &corner).expect("and so it does"), true);
            assert!(
                off(knot.east_m, corner.east_m).max(off(knot.north_m, corner.north_m)) <= 0.125 * grid.cell_m + 1e-9
            );
            assert!(off(knot.depth_m.unwrap_or(0.0), corner.depth_m.unwrap_or(0.0)) <= 0.25 * grid.depth_cell_m + 1e-9);
        }
        assert_eq!(grid.cell(&chart, &Position::new(5e5 + 40.0 * grid.cell_m, 4e6)), None);
        assert!(grid.cell_m * 32.0 < 1.1 * 1600.0, "{grid:?}");
    }

    #[test]
    fn nowhere_is_covered_too() {
        let grid = Grid::covering(&Chart::about([]), []);
        assert_eq!(grid, Grid { cell_m: 1.0, depth_cell_m: 1.0, start_s: 0.0, time_cell_s: TIME_CELL_S });
        assert_eq!(grid.spanning([f64::NAN, f64::INFINITY]), grid);
    }

    #[test]
    fn every_time_lies_in_the_cell_that_is_sent_for_it() {
        let times = [1.76e9, 1.76e9 + 11.0, 1.76e9 + 8765.4];
        let grid = Grid::covering(&Chart::about([]), []).spanning(times);
        assert_eq!(grid.time_cell_s, 140.0);
        for time_s in times {
            let cell = grid.time_cell(time_s);
            let When::At(middle_s) = grid.when(cell) else { panic!("{time_s} is in no cell") };
            assert!((middle_s - time_s).abs() <= 0.5 * grid.time_cell_s, "{middle_s} {time_s}");
            assert_eq!(grid.time_cell(middle_s), cell);
        }
        for beyond_s in [1.76e9 - 1.0, 1.76e9 + 9000.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(grid.time_cell(beyond_s), 0);
        }
        assert_eq!(grid.when(0), When::Typical);
    }
}
