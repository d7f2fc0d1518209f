//! Tables of events: messages with both positions and the outcome.

use std::io::Read;
use std::path::Path;

use pingmap_agent::{MessageKind, VehicleId};
use pingmap_trial::Problem;

use crate::model::error::ImportError;
use crate::model::reference::Place;
use crate::readers::record_reader::RecordReader;
use crate::readers::tables::conversion::Conversion;
use crate::readers::tables::role_table::RoleTable;
use crate::readers::tables::roles::TableKind;

/// A message with both positions and the outcome.
#[derive(Debug, Clone, PartialEq)]
pub struct EventRecord {
    /// Time of the transmission, in seconds.
    pub time_s: f64,
    /// The vehicle that transmitted.
    pub transmitter: VehicleId,
    /// The vehicle that received or missed the message.
    pub receiver: VehicleId,
    /// Positions of transmitter and receiver, with depths in metres if known.
    pub ends: [(Place, Option<f64>); 2],
    /// Kind of message, if recorded.
    pub kind: Option<MessageKind>,
    /// Whether the message was received.
    pub success: bool,
}

/// The content of tables of events.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EventRecords {
    /// The events in the order of the files.
    pub events: Vec<EventRecord>,
    /// Number of rows in which a position is missing. They yield no event.
    pub missing_positions: usize,
}

/// The roles of the coordinates of both ends: first and second coordinate, and depth.
const DEGREES: [[&str; 3]; 2] =
    [["tx_latitude", "tx_longitude", "tx_depth"], ["rx_latitude", "rx_longitude", "rx_depth"]];
const METRES: [[&str; 3]; 2] = [["tx_easting", "tx_northing", "tx_depth"], ["rx_easting", "rx_northing", "rx_depth"]];

impl RecordReader {
    /// Reads a table of events: time, transmitter, receiver, both positions in degrees or metres, and the outcome.
    /// Returns its differences from plain CSV. O(rows).
    ///
    /// # Errors
    /// [`ImportError`] with file, line, column, value and what was expected; also for an empty outcome, because its
    /// meaning is unknown.
    pub fn read_events(
        &self,
        reader: impl Read,
        path: &Path,
        records: &mut EventRecords,
    ) -> Result<Vec<Conversion>, ImportError> {
        const KIND: TableKind = TableKind::Events;
        let columns = self.columns.of_table(path, None);
        let mut row = RoleTable::new(reader, path, KIND, &columns)?.in_zone(&self.time_zone);
        row.check_units(path)?;
        row.require(KIND, &["time", "transmitter", "receiver", "success"])?;
        let has_degrees = DEGREES.iter().any(|[latitude, longitude, _]| row.has(latitude) || row.has(longitude));
        let roles = if has_degrees { DEGREES } else { METRES };
        for [first, second, _] in roles {
            row.require(KIND, &[first, second])?;
        }
        let before = records.events.len() + records.missing_positions;
        while row.table.next()? {
            let vehicle = |role| self.ids.resolve(row.text(role)).ok_or_else(|| row.bad(role, "one vehicle"));
            let (transmitter, receiver) = (vehicle("transmitter")?, vehicle("receiver")?);
            let time_s = row.time_s()?;
            let success = row.flag("success")?.ok_or_else(|| row.bad("success", "an outcome, such as 1 or 0"))?;
            let kind = row.table.kind()?;
            let [tx, rx] = roles.map(|roles| read_end(&row, roles, has_degrees));
            match tx?.zip(rx?) {
                Some((tx, rx)) => {
                    let ends = [tx, rx];
                    records.events.push(EventRecord { time_s, transmitter, receiver, ends, kind, success });
                }
                None => records.missing_positions += 1,
            }
        }
        match records.events.len() + records.missing_positions > before {
            true => Ok(row.conversions()),
            false => Err(row.table.error(Problem::Empty { what: "events" }).into()),
        }
    }
}

/// Reads the position of one end; `None` if it is missing.
fn read_end(
    row: &RoleTable,
    [first, second, depth]: [&str; 3],
    has_degrees: bool,
) -> Result<Option<(Place, Option<f64>)>, ImportError> {
    let place = if has_degrees { row.degrees(first, second)? } else { row.metres(first, second)? };
    let depth_m = row.depth_m(depth)?;
    Ok(place.map(|place| (place, depth_m)))
}
