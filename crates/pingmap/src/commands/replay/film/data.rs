//! Data of a film, as `film.js` reads them.

use pingmap_agent::{Event, Position, VehicleId};
use serde::Serialize;

use crate::area::Area;
use crate::figure::{Palette, shade};
use crate::success_map::{Cell, HATCH_WIDTH};
use crate::tracks::style;

/// Steps of the probability of a cell.
const STEPS: f64 = 127.0;

/// Bit of a cell that is not known.
const UNKNOWN: u8 = 128;

/// The data of a film.
#[derive(Serialize)]
pub struct Film {
    pub log: String,
    /// Every vehicle in alphabetical order. Other fields refer to vehicles by their places in this list.
    pub vehicles: Vec<Vehicle>,
    /// Vehicles that have a map: those that received events.
    pub viewers: Vec<usize>,
    pub area: AreaData,
    /// Colours of the probabilities 0/127 to 127/127, as hexadecimal digits.
    pub colors: Vec<String>,
    /// Every event in the order of time.
    pub messages: Vec<Message>,
    pub moments: Vec<Moment>,
}

/// A vehicle, and the style of its track.
#[derive(Serialize)]
pub struct Vehicle {
    name: String,
    color: &'static str,
    dash: &'static [f64],
}

/// Extent in metres of the log, and number of cells.
#[derive(Serialize)]
pub struct AreaData {
    east: (f64, f64),
    north: (f64, f64),
    columns: usize,
    rows: usize,
}

/// One event: time, transmitter, receiver, their positions, and whether the message was heard.
#[derive(Serialize)]
pub struct Message(f64, usize, usize, [f64; 2], [f64; 2], bool);

/// The mission at one time.
#[derive(Serialize)]
pub struct Moment {
    pub time_s: f64,
    /// The time of the log in words.
    pub words: String,
    /// Position of every vehicle.
    pub places: Vec<[f64; 2]>,
    /// The map of every viewer.
    pub maps: Vec<ViewerMap>,
}

/// The map of one vehicle at one time.
#[derive(Serialize)]
pub struct ViewerMap {
    /// Number of events that the vehicle recorded.
    pub own: usize,
    /// Number of events that it received from others.
    pub received: usize,
    /// Number of summary packets that it uses.
    pub packets: usize,
    /// Two hexadecimal digits for each cell, in rows from the south: probability · 127, plus 128 if it is not known.
    pub cells: String,
}

impl Vehicle {
    /// Returns the n-th vehicle with the style of its track in other figures.
    pub fn new(n: usize, id: &VehicleId) -> Self {
        let style = style(n);
        Self { name: id.to_string(), color: style.color, dash: style.dash }
    }
}

impl AreaData {
    pub fn of(area: &Area) -> Self {
        Self { east: area.east, north: area.north, columns: area.columns, rows: area.rows }
    }
}

impl Message {
    /// Returns an event between the vehicles at these places of the list.
    pub fn of(event: &Event, transmitter: usize, receiver: usize) -> Self {
        let [from, to] = event.link.ends().map(metres);
        Self(event.time_s, transmitter, receiver, from, to, event.success)
    }
}

/// Returns east and north to a decimetre.
pub fn metres(place: Position) -> [f64; 2] {
    [place.east_m, place.north_m].map(|metres| (metres * 10.0).round() / 10.0)
}

/// Returns the byte of a cell.
pub fn cell_byte(cell: &Cell) -> u8 {
    let unknown = if cell.width() > HATCH_WIDTH { UNKNOWN } else { 0 };
    (cell.probability.clamp(0.0, 1.0) * STEPS).round() as u8 | unknown
}

/// Returns the colours of all probabilities, those of the maps of other commands.
pub fn colors() -> Vec<String> {
    let color = |step: u8| {
        let (red, green, blue) = shade(f64::from(step) / STEPS, Palette::BlueToYellow);
        format!("{red:02x}{green:02x}{blue:02x}")
    };
    (0..UNKNOWN).map(color).collect()
}
