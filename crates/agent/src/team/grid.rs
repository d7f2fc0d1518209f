//! The grid: cells of position and time. Packets encode positions and times as cells.

use pingmap_packet::{Cell, DEPTH_CELLS, HORIZONTAL_CELLS, TIME_CELLS, WAYPOINT_CELLS, WAYPOINT_DEPTH_CELLS};

use serde::{Deserialize, Serialize};

use crate::types::bounds;
use crate::types::chart::Chart;
use crate::types::event::{Link, Position};
use crate::types::query::Time;

/// The division of a team's chart and mission into cells.
///
/// The chart has 64 × 64 horizontal cells about its origin and 32 depth cells from the surface down. The mission has 63
/// time cells.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Horizontal side of a cell, in metres.
    pub cell_m: f64,
    /// Height of a cell, in metres. A file without it has one metre.
    #[serde(default = "default_depth_cell_m")]
    pub depth_cell_m: f64,
    /// Beginning of the first time cell, in seconds.
    #[serde(default)]
    pub start_s: f64,
    /// Length of a time cell, in seconds. By default it is ten minutes, for a mission of half a day.
    #[serde(default = "default_time_cell_s")]
    pub time_cell_s: f64,
}

fn default_depth_cell_m() -> f64 {
    1.0
}

fn default_time_cell_s() -> f64 {
    600.0
}

/// Number and size of the cells of a chart.
#[derive(Clone, Copy)]
struct Cells {
    /// Number of cells from west to east, and from south to north.
    horizontal: u16,
    /// Number of cells from the surface down.
    vertical: u8,
    side_m: f64,
    height_m: f64,
}

impl Cells {
    /// Returns the cell of a position; `None` outside the chart.
    fn cell(self, chart: &Chart, position: &Position) -> Option<Cell> {
        let (east_m, north_m) = chart.local_m(position);
        let index = |value: f64, cells: u16| (value >= 0.0 && value < f64::from(cells)).then_some(value as u8);
        let horizontal =
            |value_m: f64| index((value_m / self.side_m + f64::from(self.horizontal) / 2.0).floor(), self.horizontal);
        Some(Cell {
            east: horizontal(east_m)?,
            north: horizontal(north_m)?,
            depth: match position.depth_m {
                // A sensor at the surface may report a slightly negative depth.
                Some(depth_m) => index((depth_m / self.height_m).floor().max(0.0), self.vertical.into())?,
                None => 0,
            },
        })
    }

    fn position(self, chart: &Chart, cell: Cell, has_depth: bool) -> Position {
        let centre = |index: u8| (f64::from(index) + 0.5 - f64::from(self.horizontal) / 2.0) * self.side_m;
        Position {
            east_m: chart.origin.east_m + centre(cell.east),
            north_m: chart.origin.north_m + centre(cell.north),
            depth_m: has_depth.then(|| (f64::from(cell.depth) + 0.5) * self.height_m),
            heading_deg: None,
        }
    }
}

impl Grid {
    /// Returns the finest grid that contains all these positions. Cell sizes are rounded up to two significant digits.
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
            time_cell_s: default_time_cell_s(),
        }
    }

    /// Replaces the time cells by the shortest ones that contain all these times. Their length is rounded up to two
    /// significant digits. Times that are not finite are ignored. Without a finite time the grid is unchanged.
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

    /// Returns the cell of a time. Returns 0, which stands for no particular time, outside the grid.
    pub fn time_cell(&self, time_s: f64) -> u8 {
        let index = ((time_s - self.start_s) / self.time_cell_s).floor();
        if (0.0..f64::from(TIME_CELLS - 1)).contains(&index) { index as u8 + 1 } else { 0 }
    }

    /// Returns the middle of a time cell; a typical time for cell 0.
    pub fn when(&self, time_cell: u8) -> Time {
        match time_cell {
            0 => Time::Typical,
            cell => Time::At(self.start_s + (f64::from(cell) - 0.5) * self.time_cell_s),
        }
    }

    /// Returns the cell of a position; `None` outside the grid.
    pub fn cell(&self, chart: &Chart, position: &Position) -> Option<Cell> {
        self.point_cells().cell(chart, position)
    }

    /// Returns the centre of a cell.
    pub fn position(&self, chart: &Chart, cell: Cell, has_depth: bool) -> Position {
        self.point_cells().position(chart, cell, has_depth)
    }

    /// Returns the waypoint cell of a position; `None` outside the grid. Waypoint cells are a quarter as wide and half
    /// as high as the cells of inducing points.
    pub fn waypoint_cell(&self, chart: &Chart, position: &Position) -> Option<Cell> {
        self.waypoint_cells().cell(chart, position)
    }

    /// Returns a waypoint cell and cells around it: a pattern of five by five. The outermost ones are about
    /// `distance_m` away in each axis. The stride is at least one cell.
    pub(crate) fn waypoint_cells_about(&self, cell: Cell, distance_m: f64) -> impl Iterator<Item = Cell> {
        let stride = (distance_m / self.waypoint_cells().side_m / 2.0).clamp(1.0, f64::from(u8::MAX)) as i32;
        let about = move |index: u8| (-2..=2).filter_map(move |n| u8::try_from(i32::from(index) + n * stride).ok());
        about(cell.east).flat_map(move |east| about(cell.north).map(move |north| Cell { east, north, ..cell }))
    }

    /// Returns the centre of a waypoint cell.
    pub fn waypoint_position(&self, chart: &Chart, cell: Cell, has_depth: bool) -> Position {
        self.waypoint_cells().position(chart, cell, has_depth)
    }

    fn point_cells(&self) -> Cells {
        let Self { cell_m: side_m, depth_cell_m: height_m, .. } = *self;
        Cells { horizontal: HORIZONTAL_CELLS.into(), vertical: DEPTH_CELLS, side_m, height_m }
    }

    fn waypoint_cells(&self) -> Cells {
        let side_m = self.cell_m * f64::from(HORIZONTAL_CELLS) / f64::from(WAYPOINT_CELLS);
        let height_m = self.depth_cell_m * f64::from(DEPTH_CELLS) / f64::from(WAYPOINT_DEPTH_CELLS);
        Cells { horizontal: WAYPOINT_CELLS, vertical: WAYPOINT_DEPTH_CELLS, side_m, height_m }
    }

    /// Returns the cells of transmitter and receiver; `None` if either lies outside the grid.
    pub fn cells(&self, chart: &Chart, link: &Link) -> Option<[Cell; 2]> {
        Some([self.cell(chart, &link.transmitter)?, self.cell(chart, &link.receiver)?])
    }
}

/// Returns the smallest number with two significant digits above `value`. Returns 1 for a value that is not positive
/// and finite.
fn round_up(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    ((value / unit).floor() + 1.0) * unit
}
