//! Tables of navigation, receptions and transmissions.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_agent::VehicleId;

use crate::model::error::ImportError;
use crate::model::parsed_file::SkipCounts;
use crate::model::recording::{Arrival, Fix, Recording, Recordings, TransmissionRecord};
use crate::readers::record_reader::RecordReader;
use crate::readers::tables::conversion::Conversion;
use crate::readers::tables::position::{read_position, require_position};
use crate::readers::tables::role_table::RoleTable;
use crate::readers::tables::roles::TableKind;

/// Summary of a table that was read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TableSummary {
    /// Number of its rows that yield no record.
    pub skipped: SkipCounts,
    /// Its differences from plain CSV.
    pub conversions: Vec<Conversion>,
}

impl RecordReader {
    /// Reads a table of navigation, receptions or transmissions. O(rows) time; holds one row.
    ///
    /// Its rows belong to `vehicle`, or to the vehicles in its column `vehicle`.
    ///
    /// # Errors
    /// [`ImportError`] with file, line, column, value and what was expected.
    pub fn read_table(
        &self,
        kind: TableKind,
        (reader, path): (impl Read, &Path),
        vehicle: Option<&VehicleId>,
        recordings: &mut Recordings,
    ) -> Result<TableSummary, ImportError> {
        let columns = self.columns.of_table(path, self.table_owner(path, vehicle).as_ref());
        let mut row = RoleTable::new(reader, path, kind, &columns)?.in_zone(&self.time_zone);
        row.check_units(path)?;
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
        require_columns(kind, &row)?;
        if kind == TableKind::Receptions {
            row.check_outcome(path, &columns)?;
        }
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
                TableKind::Events => {}
            }
        }
        Ok(TableSummary { skipped, conversions: row.conversions() })
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

fn require_columns(kind: TableKind, row: &RoleTable) -> Result<(), ImportError> {
    match kind {
        TableKind::Navigation => require_position(row),
        TableKind::Receptions => row.require(kind, &["source"]),
        TableKind::Transmissions => Ok(()),
        TableKind::Events => {
            let problem = "a table of events is read by read_events; expected navigation, receptions or transmissions";
            Err(ImportError::Inconsistent(problem.into()))
        }
    }
}

fn start_record(kind: TableKind, recording: &mut Recording) {
    match kind {
        TableKind::Navigation | TableKind::Events => {}
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
