//! Tables of navigation, receptions and transmissions.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_agent::{Geographic, VehicleId, bounds};

use crate::model::error::ImportError;
use crate::model::parsed_file::SkipCounts;
use crate::model::recording::{Arrival, Fix, Recording, Recordings, TransmissionRecord};
use crate::model::reference::Place;
use crate::readers::columns::{RoleTable, TableKind};
use crate::readers::record_reader::RecordReader;

impl RecordReader {
    /// Reads a table. Its rows belong to `vehicle`, or to the vehicles in its column `vehicle`. O(rows) time; holds one
    /// row.
    ///
    /// # Errors
    /// [`ImportError`] with file, line, column, value and what was expected.
    pub fn read_table(
        &self,
        kind: TableKind,
        (reader, path): (impl Read, &Path),
        vehicle: Option<&VehicleId>,
        recordings: &mut Recordings,
    ) -> Result<SkipCounts, ImportError> {
        let mut row = RoleTable::new(reader, path, kind, &self.columns)?;
        row.require(kind, &["time"])?;
        if vehicle.is_none() {
            row.require(kind, &["vehicle"])?;
        }
        let mut skipped = SkipCounts::default();
        // The modem may be off between two files, so each file has its own entry of activity.
        let records: BTreeMap<VehicleId, usize> =
            recordings.iter().map(|(name, recording)| (name.clone(), recording.modem_activity.len())).collect();
        if let (Some(vehicle), true) = (vehicle, kind != TableKind::Navigation) {
            // A table without rows is a record, too: nothing was received or transmitted.
            start_record(kind, recordings.entry(vehicle.clone()).or_default());
        }
        self.require_columns(kind, &row)?;
        while row.table.next()? {
            let owner = match vehicle {
                Some(vehicle) => vehicle.clone(),
                None => self.ids.resolve(row.text("vehicle")).ok_or_else(|| row.bad("vehicle", "one vehicle"))?,
            };
            let record = records.get(&owner).copied().unwrap_or(0);
            let recording = recordings.entry(owner).or_default();
            start_record(kind, recording);
            match kind {
                TableKind::Navigation => add_fix(&row, recording, &mut skipped)?,
                TableKind::Receptions => self.add_arrival(&row, (recording, record), &mut skipped)?,
                TableKind::Transmissions => self.add_transmission(&row, recording, &mut skipped)?,
            }
        }
        Ok(skipped)
    }

    fn require_columns(&self, kind: TableKind, row: &RoleTable) -> Result<(), ImportError> {
        match kind {
            TableKind::Navigation => require_position(row),
            TableKind::Receptions => row.require(kind, &["source"]),
            TableKind::Transmissions => Ok(()),
        }
    }

    fn add_arrival(
        &self,
        row: &RoleTable,
        (recording, record): (&mut Recording, usize),
        skipped: &mut SkipCounts,
    ) -> Result<(), ImportError> {
        let time_s = row.time_s()?;
        recording.extend_activity(record, time_s);
        let good = row.flag("good")?.unwrap_or(true);
        let id = row.text("source");
        // A row without a source shows that the modem was active, and nothing else.
        if id.is_empty() {
            skipped.unattributed += usize::from(!good);
            return Ok(());
        }
        let source = self.ids.resolve(id).ok_or_else(|| row.bad("source", "one vehicle, not a broadcast"))?;
        let arrival = Arrival {
            time_s,
            source,
            destination: self.ids.resolve(row.text("destination")),
            frame: row.positive_integer("frame")?,
            frames: row.positive_integer("frames")?,
            good,
            // The column `level` is left out: a receiver notes the level of arrival, not that of the transmission.
            kind: row.table.kind_by(&["rate", "band", "length"])?,
        };
        recording.arrivals.get_or_insert_default().push(arrival);
        Ok(())
    }

    fn add_transmission(
        &self,
        row: &RoleTable,
        recording: &mut Recording,
        skipped: &mut SkipCounts,
    ) -> Result<(), ImportError> {
        if row.flag("sent")? == Some(false) {
            skipped.failed_transmissions += 1;
            return Ok(());
        }
        let transmission = TransmissionRecord {
            time_s: row.time_s()?,
            destination: self.ids.resolve(row.text("destination")),
            frames: row.positive_integer("frames")?,
            kind: row.table.kind()?,
            band: Some(row.table.field("band").to_owned()).filter(|band| !band.is_empty()),
        };
        recording.transmissions.get_or_insert_default().push(transmission);
        Ok(())
    }
}

fn start_record(kind: TableKind, recording: &mut Recording) {
    match kind {
        TableKind::Navigation => {}
        TableKind::Receptions => drop(recording.arrivals.get_or_insert_default()),
        TableKind::Transmissions => drop(recording.transmissions.get_or_insert_default()),
    }
}

fn add_fix(row: &RoleTable, recording: &mut Recording, skipped: &mut SkipCounts) -> Result<(), ImportError> {
    let time_s = row.time_s()?;
    if row.has("clock_set") {
        recording.clock_syncs.push((time_s, row.flag("clock_set")?.unwrap_or(false)));
    }
    if !row.text("band").is_empty() {
        recording.set_band(time_s, row.text("band").to_owned());
    }
    let Some((place, depth_m)) = read_position(row)? else {
        skipped.missing_positions += 1;
        return Ok(());
    };
    recording.fixes.push(Fix { time_s, place, depth_m });
    Ok(())
}

/// Checks that a table has columns for positions, in degrees or in metres.
pub(crate) fn require_position(row: &RoleTable) -> Result<(), ImportError> {
    let has_degrees = row.has("latitude") || row.has("longitude");
    row.require(TableKind::Navigation, if has_degrees { &["latitude", "longitude"] } else { &["easting", "northing"] })
}

/// Reads the position and the depth of a row; `None` if a coordinate is empty.
pub(crate) fn read_position(row: &RoleTable) -> Result<Option<(Place, Option<f64>)>, ImportError> {
    let has_degrees = row.has("latitude");
    let (first, second) = if has_degrees { ("latitude", "longitude") } else { ("easting", "northing") };
    let (Some(a), Some(b)) = (row.number(first)?, row.number(second)?) else { return Ok(None) };
    let place = if has_degrees {
        let place =
            Geographic::new(a, b).ok_or_else(|| row.bad(first, "degrees: latitudes to 90, longitudes to 180"))?;
        Place::Degrees(place)
    } else {
        Place::Metres(a, b)
    };
    let depth_m = row.number("depth")?;
    if depth_m.is_some_and(|depth_m| bounds::COORDINATE_M.check(depth_m).is_none()) {
        return Err(row.bad("depth", bounds::COORDINATE_M.words).into());
    }
    Ok(Some((place, depth_m)))
}
