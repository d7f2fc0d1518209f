//! Reading of files whose kind is detected.

use std::io::{BufReader, Read};
use std::path::Path;

use pingmap_agent::{Geographic, VehicleId};
use pingmap_trial::{FileError, Problem};

use crate::model::error::ImportError;
use crate::model::parsed_file::{ParsedFile, SkipCounts};
use crate::model::recording::{Recording, Recordings};
use crate::readers::bags::bag_parser::BagParser;
use crate::readers::bags::{mcap_file, sqlite};
use crate::readers::file_kind::{RecordKind, read_head};
use crate::readers::lcm::log;
use crate::readers::modem::capture;
use crate::readers::moos;
use crate::readers::record_reader::RecordReader;
use crate::readers::table_records::TableSummary;
use crate::readers::tables::conversion::Conversion;
use crate::readers::tables::role_table::RoleTable;
use crate::readers::tables::roles::TableKind;

/// Longest file of LCM types, in bytes.
const TYPES_BYTES_MAX: u64 = 1 << 22;

/// Summary of a file that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct FileSummary {
    /// Kind of the file.
    pub kind: RecordKind,
    /// The vehicle to which its records were added; `None` for several vehicles, or none.
    pub vehicle: Option<VehicleId>,
    /// Datum of its metres, if the file determines it.
    pub datum: Option<Geographic>,
    /// Number of its lines and messages that yield no record.
    pub skipped: SkipCounts,
    /// Differences of a table from plain CSV.
    pub conversions: Vec<Conversion>,
}

/// A file, and how to read it.
#[derive(Debug, Clone, Copy)]
pub struct FileSource<'a> {
    /// Path of the file; `None` if it has none, for example in an archive.
    pub path: Option<&'a Path>,
    /// Name of the file for people and in errors.
    pub name: &'a Path,
    /// Owner of the file; `None` if the file states it.
    pub vehicle: Option<&'a VehicleId>,
    /// Prefix of the topics to read; empty for all topics.
    pub topics: &'a str,
}

impl<'a> FileSource<'a> {
    /// Describes a file of a vehicle with all its topics.
    pub fn new(path: &'a Path, vehicle: Option<&'a VehicleId>) -> Self {
        Self { path: Some(path), name: path, vehicle, topics: "" }
    }
}

impl RecordReader {
    /// Reads LCM types if a file contains them. Must precede the logs that use the types.
    ///
    /// # Errors
    /// [`ImportError`] if the file cannot be read, or a definition is invalid.
    pub fn read_lcm_types(&mut self, mut reader: impl Read, name: &Path) -> Result<(), ImportError> {
        let fail = |problem: String| ImportError::Content { file: name.display().to_string(), problem };
        let unreadable = |error| FileError { path: name.to_owned(), problem: Problem::Unreadable(error) };
        let mut bytes = read_head(&mut reader).map_err(unreadable)?;
        if self.detect_kind(&bytes, name, None) == Some(RecordKind::LcmTypes) {
            reader.take(TYPES_BYTES_MAX).read_to_end(&mut bytes).map_err(unreadable)?;
            self.lcm_types.read(&String::from_utf8_lossy(&bytes)).map_err(fail)?;
        }
        Ok(())
    }

    /// Detects the kind of a file and reads it; `None` for an unknown kind.
    ///
    /// The owner of the records is `source.vehicle`, or the vehicle that the file states. A MOOS log states it in
    /// `NODE_REPORT_LOCAL`. Another log states the id of its modem, which `ids` resolves. A table states it in a column
    /// or in its name.
    ///
    /// SQLite is read from the path if there is one, other formats from `reader`. Ids, schedules and types are only
    /// detected. O(lines) time; holds one line or message.
    ///
    /// # Errors
    /// [`ImportError`] if the file cannot be read, or does not state its owner or its times.
    pub fn read_record(
        &self,
        reader: impl Read,
        source: &FileSource,
        recordings: &mut Recordings,
    ) -> Result<Option<FileSummary>, ImportError> {
        let &FileSource { path, name, topics, .. } = source;
        let unreadable = |error| FileError { path: name.to_owned(), problem: Problem::Unreadable(error) };
        let fail = |problem: String| ImportError::Content { file: name.display().to_string(), problem };
        let mut reader = BufReader::new(reader);
        let head = read_head(&mut reader).map_err(unreadable)?;
        let Some(kind) = self.detect_kind(&head, name, source.vehicle) else { return Ok(None) };
        let summary =
            |datum| FileSummary { kind, vehicle: None, datum, skipped: SkipCounts::default(), conversions: Vec::new() };
        let text = head.as_slice().chain(reader);
        let parsed = match kind {
            RecordKind::MoosMission => return Ok(Some(summary(moos::mission_datum(&String::from_utf8_lossy(&head))))),
            RecordKind::SqliteLog
            | RecordKind::LcmTypes
            | RecordKind::ModemIds
            | RecordKind::Schedule
            | RecordKind::TeamFile => {
                return Ok(Some(summary(None)));
            }
            RecordKind::Table(table) => {
                return self.read_detected_table((table, &head), text, source, recordings).map(Some);
            }
            RecordKind::MoosLog => moos::read(text, &self.ids, &self.moos_prefix).map_err(unreadable)?.map_err(fail)?,
            RecordKind::ModemCapture => capture::read(text, &self.ids).map_err(unreadable)?,
            RecordKind::Lcm => log::read(text, &self.lcm_types, &self.ids, topics).map_err(fail)?,
            RecordKind::Mcap => mcap_file::read(text, &self.ids, topics).map_err(fail)?,
            // A database may hold other data than a bag.
            RecordKind::Sqlite => match sqlite::read(text, path, BagParser::new(&self.ids, topics)).map_err(fail)? {
                Some(parsed) => parsed,
                None => return Ok(None),
            },
        };
        let ParsedFile { recording, name: own_name, datum, skipped } = parsed;
        // A log without any record needs no owner: for example one from the shore, without navigation and receptions.
        if recording == Recording::default() {
            return Ok(Some(FileSummary { skipped, ..summary(datum) }));
        }
        let modem_owner = || recording.modem_ids.iter().find_map(|id| self.ids.lookup(id));
        let Some(vehicle) = source.vehicle.cloned().or(own_name).or_else(modem_owner) else {
            return Err(fail(
                "does not state its vehicle; expected NAME= in front of it, or its modem's id in --ids".into(),
            ));
        };
        recordings.entry(vehicle.clone()).or_default().append(recording);
        Ok(Some(FileSummary { vehicle: Some(vehicle), skipped, ..summary(datum) }))
    }

    /// Reads a table whose kind was detected.
    fn read_detected_table(
        &self,
        (table, head): (TableKind, &[u8]),
        text: impl Read,
        &FileSource { name, vehicle, .. }: &FileSource,
        recordings: &mut Recordings,
    ) -> Result<FileSummary, ImportError> {
        let columns = self.columns.of_table(name, self.table_owner(name, vehicle).as_ref());
        let has_vehicle_column = RoleTable::new(head, name, table, &columns)?.has("vehicle");
        let vehicle = vehicle.cloned().or_else(|| if has_vehicle_column { None } else { self.owner(name) });
        if vehicle.is_none() && !has_vehicle_column {
            return Err(ImportError::Content {
                file: name.display().to_string(),
                problem: "does not state its vehicle; expected NAME= in front of it, a name such as auv1.nav.csv, or a column vehicle".into(),
            });
        }
        let TableSummary { skipped, conversions } =
            self.read_table(table, (text, name), vehicle.as_ref(), recordings)?;
        Ok(FileSummary { kind: RecordKind::Table(table), vehicle, datum: None, skipped, conversions })
    }
}
