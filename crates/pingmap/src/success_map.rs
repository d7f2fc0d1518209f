//! A map of success probability, seen from one place.

use pingmap_agent::{Agent, Attempt, Event, Geographic, Link, Position};
use serde_json::json;

use crate::contour::{Grid, Point, contour_lines};
use crate::figure::{Figure, probability_map};
use crate::output::{BadInput, csv_text};
use crate::tracks;
use crate::values::{End, name_of};

/// Probabilities whose contours are drawn.
pub const CONTOURS: [f64; 2] = [0.5, 0.9];

/// Cells along the longer side of a map.
const CELLS: f64 = 120.0;

/// The most cells a map may have.
const CELLS_MAX: f64 = 4e6;

/// Pixels along the longer side of a figure.
pub const SIDE: f64 = 640.0;

/// Probability of success between one place and every cell of a grid.
pub struct SuccessMap {
    at: Position,
    end: End,
    /// Row by row from the south, each row from the west.
    values: Vec<f64>,
    /// Where nine in ten of the probabilities lie, in the same order.
    intervals: Vec<(f64, f64)>,
    pub columns: usize,
    east: (f64, f64),
    north: (f64, f64),
    pub cell_m: f64,
}

impl SuccessMap {
    /// Predicts every cell of a grid over the area of the log and the place itself, as attempts that `asked` makes of links. O(cells · n²).
    pub fn new(
        agent: &mut Agent,
        events: &[Event],
        (at, end): (Position, End),
        asked: &dyn Fn(Link) -> Attempt,
        cell_m: Option<f64>,
    ) -> anyhow::Result<Self> {
        let (east, north) = tracks::extent(events, &at);
        let cell_m = cell_m.unwrap_or((east.1 - east.0).max(north.1 - north.0) / CELLS);
        let cells = |(low, high): (f64, f64)| ((high - low) / cell_m).ceil().max(1.0);
        let (columns, rows) = (cells(east), cells(north));
        if columns * rows > CELLS_MAX {
            let message = format!("--cell-m {cell_m} makes {columns} x {rows} cells; expected at most {CELLS_MAX}");
            return Err(BadInput(message).into());
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let east = (east.0, east.0 + columns as f64 * cell_m);
        let north = (north.0, north.0 + rows as f64 * cell_m);
        let link = |row: usize, column: usize| {
            let cell = Position {
                east_m: east.0 + (column as f64 + 0.5) * cell_m,
                north_m: north.0 + (row as f64 + 0.5) * cell_m,
                depth_m: at.depth_m,
            };
            match end {
                End::Tx => Link { transmitter: at, receiver: cell },
                End::Rx => Link { transmitter: cell, receiver: at },
            }
        };
        let wide = agent.wide_posterior()?;
        let (mut values, mut intervals) = (Vec::with_capacity(columns * rows), Vec::with_capacity(columns * rows));
        for row in 0..rows {
            let attempts: Vec<Attempt> = (0..columns).map(|column| asked(link(row, column))).collect();
            values.extend(agent.probabilities(&attempts)?);
            intervals.extend(agent.intervals(&wide, &attempts)?);
        }
        Ok(Self { at, end, values, intervals, columns, east, north, cell_m })
    }

    /// Rows of the grid.
    pub fn rows(&self) -> usize {
        self.values.len() / self.columns
    }

    fn grid(&self) -> Grid<'_> {
        Grid { values: &self.values, columns: self.columns, east: self.east, north: self.north }
    }

    /// Share of the map's area where success is at least this probable.
    pub fn share_above(&self, level: f64) -> f64 {
        self.values.iter().filter(|&&p| p >= level).count() as f64 / self.values.len() as f64
    }

    /// Median width of the intervals.
    pub fn interval_width(&self) -> f64 {
        let mut widths: Vec<f64> = self.intervals.iter().map(|(low, high)| high - low).collect();
        widths.sort_by(f64::total_cmp);
        widths[widths.len() / 2]
    }

    /// The map as a picture, with the tracks of everybody in the log.
    pub fn figure(&self, events: &[Event]) -> Figure {
        let (title, name) = match self.end {
            End::Tx => ("Will a message sent from here get through?", "transmitter"),
            End::Rx => ("Will a message sent to here get through?", "receiver"),
        };
        let tracks = tracks::tracks(events);
        let series = tracks::tracks_as_series(&tracks);
        probability_map(title, &self.grid(), &CONTOURS, &series, (name, (self.at.east_m, self.at.north_m)), SIDE)
    }

    /// The grid as CSV: the middle of every cell, and the probability there with its interval.
    pub fn csv(&self) -> anyhow::Result<String> {
        let row = |(n, (&p, &(low, high))): (usize, (&f64, &(f64, f64)))| {
            let (column, row) = ((n % self.columns) as f64, (n / self.columns) as f64);
            vec![self.east.0 + (column + 0.5) * self.cell_m, self.north.0 + (row + 0.5) * self.cell_m, p, low, high]
        };
        let rows: Vec<Vec<f64>> = self.values.iter().zip(&self.intervals).enumerate().map(row).collect();
        csv_text(&["easting_m", "northing_m", "probability", "probability_low", "probability_high"], &rows)
    }

    /// The contours and the place as GeoJSON.
    pub fn geojson(&self, geographic: &dyn Fn(&Position) -> Option<Geographic>) -> serde_json::Value {
        let coordinates = |(east_m, north_m): Point| {
            let place = geographic(&Position::new(east_m, north_m));
            place.map(|place| json!([place.longitude_deg, place.latitude_deg]))
        };
        let contour = |level: f64| {
            let lines: Vec<Vec<_>> = contour_lines(&self.grid(), level)
                .into_iter()
                .map(|line| line.into_iter().filter_map(coordinates).collect())
                .collect();
            json!({
                "type": "Feature", "properties": { "probability": level },
                "geometry": { "type": "MultiLineString", "coordinates": lines },
            })
        };
        let place = json!({
            "type": "Feature", "properties": { "seen_from": name_of(&self.end) },
            "geometry": { "type": "Point", "coordinates": coordinates((self.at.east_m, self.at.north_m)) },
        });
        let features: Vec<_> = CONTOURS.into_iter().map(contour).chain([place]).collect();
        json!({ "type": "FeatureCollection", "features": features })
    }
}
