//! Files of known kinds taken in.

use std::io::{BufReader, Read};
use std::path::Path;

use pingmap_agent::{Geographic, VehicleId};
use pingmap_trial::{FileError, Problem};

use crate::model::error::ImportError;
use crate::model::parsed_file::{ParsedFile, SkipCounts};
use crate::model::recording::{Recording, Recordings};
use crate::readers::bags::{mcap_file, sqlite};
use crate::readers::columns::{RoleTable, TableKind};
use crate::readers::file_kind::{RecordKind, read_head};
use crate::readers::lcm::log;
use crate::readers::modem::capture;
use crate::readers::moos;
use crate::readers::record_reader::RecordReader;

/// No definitions of types are longer.
const TYPES_BYTES_MAX: u64 = 1 << 22;

/// What a file was, and what it told besides.
#[derive(Debug, Clone, PartialEq)]
pub struct FileSummary {
    /// What it was.
    pub kind: RecordKind,
    /// Whose it was taken for; `None` where it is of several, or of nobody.
    pub vehicle: Option<VehicleId>,
    /// Where (0, 0) of its metres is, by its own word.
    pub datum: Option<Geographic>,
    /// What of it says nothing for the log.
    pub skipped: SkipCounts,
}

/// Where a file is from.
#[derive(Debug, Clone, Copy)]
pub struct FileSource<'a> {
    /// Where it lies.
    pub path: &'a Path,
    /// What people know it by, and what stands for it in errors.
    pub name: &'a Path,
    /// Whose it is; `None` where it says so itself.
    pub vehicle: Option<&'a VehicleId>,
    /// What the names of topics begin with that are read; all of them where it is empty.
    pub topics: &'a str,
}

impl<'a> FileSource<'a> {
    /// A file of somebody, with all its topics.
    pub fn new(path: &'a Path, vehicle: Option<&'a VehicleId>) -> Self {
        Self { path, name: path, vehicle, topics: "" }
    }
}

impl RecordReader {
    /// Takes in types of LCM, if a file is of such; before the logs that need them.
    ///
    /// # Errors
    /// [`ImportError`] where it cannot be read, or says something that is no type.
    pub fn read_lcm_types(&mut self, mut reader: impl Read, name: &Path) -> Result<(), ImportError> {
        let fail = |problem: String| ImportError::Content { file: name.display().to_string(), problem };
        let unreadable = |error| FileError { path: name.to_owned(), problem: Problem::Unreadable(error) };
        let mut bytes = read_head(&mut reader).map_err(unreadable)?;
        if self.kind_of(&bytes, name) == Some(RecordKind::LcmTypes) {
            reader.take(TYPES_BYTES_MAX).read_to_end(&mut bytes).map_err(unreadable)?;
            self.lcm_types.read(&String::from_utf8_lossy(&bytes)).map_err(fail)?;
        }
        Ok(())
    }

    /// Takes in a file of a known kind, recognised by its content; `None` where it is of none. It is its source's vehicle's, or whose it says
    /// itself: by `NODE_REPORT_LOCAL`, or by its modem's id where `ids` knows that; a table by its column, or by its name. SQLite is read from the path, all
    /// others from `reader`. Ids, schedules and types are only recognised. O(lines), one at a time.
    ///
    /// # Errors
    /// [`ImportError`] where it cannot be read, does not say whose it is, or when it was.
    pub fn read_record(
        &self,
        reader: impl Read,
        source: &FileSource,
        into: &mut Recordings,
    ) -> Result<Option<FileSummary>, ImportError> {
        let &FileSource { path, name, topics, .. } = source;
        let unreadable = |error| FileError { path: name.to_owned(), problem: Problem::Unreadable(error) };
        let fail = |problem: String| ImportError::Content { file: name.display().to_string(), problem };
        let mut reader = BufReader::new(reader);
        let head = read_head(&mut reader).map_err(unreadable)?;
        let Some(kind) = self.kind_of(&head, name) else { return Ok(None) };
        let only = |datum| FileSummary { kind, vehicle: None, datum, skipped: SkipCounts::default() };
        let text = head.as_slice().chain(reader);
        let parsed = match kind {
            RecordKind::MoosMission => return Ok(Some(only(moos::datum_of_mission(&String::from_utf8_lossy(&head))))),
            RecordKind::LcmTypes | RecordKind::ModemIds | RecordKind::Schedule | RecordKind::TeamFile => {
                return Ok(Some(only(None)));
            }
            RecordKind::Table(table) => return self.read_unnamed_table((table, &head), text, source, into).map(Some),
            RecordKind::MoosLog => moos::read(text, &self.ids, &self.moos_prefix).map_err(unreadable)?.map_err(fail)?,
            RecordKind::ModemCapture => capture::read(text, &self.ids).map_err(unreadable)?,
            RecordKind::Lcm => log::read(text, &self.lcm_types, &self.ids, topics).map_err(fail)?,
            RecordKind::Mcap => mcap_file::read(text, &self.ids, topics).map_err(fail)?,
            // Other things are kept in databases, too.
            RecordKind::Sqlite => match sqlite::read(path, &self.ids, topics).map_err(fail)? {
                Some(parsed) => parsed,
                None => return Ok(None),
            },
        };
        let ParsedFile { recording, name: own_name, datum, skipped } = parsed;
        // A log that somebody kept on shore, who neither moved nor listened, is of nobody.
        if recording == Recording::default() {
            return Ok(Some(FileSummary { kind, vehicle: None, datum, skipped }));
        }
        let by_modem = || recording.modem_ids.iter().find_map(|id| self.ids.vehicle_of(id));
        let Some(vehicle) = source.vehicle.cloned().or(own_name).or_else(by_modem) else {
            return Err(fail(
                "does not say whose it is; expected NAME= in front of it, or its modem's id in --ids".into(),
            ));
        };
        into.entry(vehicle.clone()).or_default().append(recording);
        Ok(Some(FileSummary { kind, vehicle: Some(vehicle), datum, skipped }))
    }

    /// A table that nobody said is one.
    fn read_unnamed_table(
        &self,
        (table, head): (TableKind, &[u8]),
        text: impl Read,
        &FileSource { name, vehicle, .. }: &FileSource,
        into: &mut Recordings,
    ) -> Result<FileSummary, ImportError> {
        let names_all = RoleTable::new(head, name, table, &self.columns)?.has("vehicle");
        let vehicle = vehicle.cloned().or_else(|| if names_all { None } else { self.owner(name) });
        if vehicle.is_none() && !names_all {
            return Err(ImportError::Content {
                file: name.display().to_string(),
                problem: "does not say whose it is; expected NAME= in front of it, a name such as auv1.nav.csv, or a column vehicle".into(),
            });
        }
        let skipped = self.read_table(table, (text, name), vehicle.as_ref(), into)?;
        Ok(FileSummary { kind: RecordKind::Table(table), vehicle, datum: None, skipped })
    }
}
