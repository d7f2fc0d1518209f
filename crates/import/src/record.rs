//! Files of known kinds taken in.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufReader, Read};
use std::path::Path;

use pingmap_agent::{Geographic, VehicleId};
use pingmap_trial::{FileError, Problem};

use crate::columns::{Named, TableKind};
use crate::error::ImportError;
use crate::recognise::{RecordKind, head};
use crate::recording::{Arrival, Recording, Recordings};
use crate::tables::Reading;
use crate::told::{Skipped, Told};
use crate::{capture, lcm, mcap_file, moos, sqlite};

/// No definitions of types are longer.
const TYPES_BYTES_MAX: u64 = 1 << 22;

/// What a file was, and what it told besides.
#[derive(Debug, Clone, PartialEq)]
pub struct Taken {
    /// What it was.
    pub kind: RecordKind,
    /// Whose it was taken for; `None` where it is of several, or of nobody.
    pub vehicle: Option<VehicleId>,
    /// Where (0, 0) of its metres is, by its own word.
    pub datum: Option<Geographic>,
    /// What of it says nothing for the log.
    pub skipped: Skipped,
}

/// Where a file is from.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// Where it lies.
    pub path: &'a Path,
    /// What people know it by, and what stands for it in errors.
    pub name: &'a Path,
    /// Whose it is; `None` where it says so itself.
    pub vehicle: Option<&'a VehicleId>,
    /// What the names of topics begin with that are read; all of them where it is empty.
    pub topics: &'a str,
}

impl<'a> Source<'a> {
    /// A file of somebody, with all its topics.
    pub fn new(path: &'a Path, vehicle: Option<&'a VehicleId>) -> Self {
        Self { path, name: path, vehicle, topics: "" }
    }
}

impl Reading {
    /// Takes in types of LCM, if a file is of such; before the logs that need them.
    ///
    /// # Errors
    /// [`ImportError`] where it cannot be read, or says something that is no type.
    pub fn take_types(&mut self, mut reader: impl Read, name: &Path) -> Result<(), ImportError> {
        let fail = |problem: String| ImportError::Content { file: name.display().to_string(), problem };
        let unreadable = |error| FileError { path: name.to_owned(), problem: Problem::Unreadable(error) };
        let mut bytes = head(&mut reader).map_err(unreadable)?;
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
    pub fn take_record(
        &self,
        reader: impl Read,
        source: &Source,
        into: &mut Recordings,
    ) -> Result<Option<Taken>, ImportError> {
        let &Source { path, name, topics, .. } = source;
        let unreadable = |error| FileError { path: name.to_owned(), problem: Problem::Unreadable(error) };
        let fail = |problem: String| ImportError::Content { file: name.display().to_string(), problem };
        let mut reader = BufReader::new(reader);
        let head = head(&mut reader).map_err(unreadable)?;
        let Some(kind) = self.kind_of(&head, name) else { return Ok(None) };
        let only = |datum| Taken { kind, vehicle: None, datum, skipped: Skipped::default() };
        let text = head.as_slice().chain(reader);
        let told = match kind {
            RecordKind::MoosMission => return Ok(Some(only(moos::datum_of_mission(&String::from_utf8_lossy(&head))))),
            RecordKind::LcmTypes | RecordKind::Ids | RecordKind::Schedule | RecordKind::TeamFile => {
                return Ok(Some(only(None)));
            }
            RecordKind::Table(table) => return self.take_table((table, &head), text, source, into).map(Some),
            RecordKind::MoosLog => moos::read(text, &self.ids, &self.prefix).map_err(unreadable)?.map_err(fail)?,
            RecordKind::ModemCapture => capture::read(text, &self.ids).map_err(unreadable)?,
            RecordKind::Lcm => lcm::read(text, &self.lcm_types, &self.ids, topics).map_err(fail)?,
            RecordKind::Mcap => mcap_file::read(text, &self.ids, topics).map_err(fail)?,
            // Other things are kept in databases, too.
            RecordKind::Sqlite => match sqlite::read(path, &self.ids, topics).map_err(fail)? {
                Some(told) => told,
                None => return Ok(None),
            },
        };
        let Told { recording, name: own_name, datum, skipped } = told;
        // A log that somebody kept on shore, who neither moved nor listened, is of nobody.
        if recording == Recording::default() {
            return Ok(Some(Taken { kind, vehicle: None, datum, skipped }));
        }
        let by_modem = || recording.modem_ids.iter().find_map(|id| self.ids.listed(id));
        let Some(vehicle) = source.vehicle.cloned().or(own_name).or_else(by_modem) else {
            return Err(fail(
                "does not say whose it is; expected NAME= in front of it, or its modem's id in --ids".into(),
            ));
        };
        into.entry(vehicle.clone()).or_default().append(recording);
        Ok(Some(Taken { kind, vehicle: Some(vehicle), datum, skipped }))
    }

    /// A table that nobody said is one.
    fn take_table(
        &self,
        (table, head): (TableKind, &[u8]),
        text: impl Read,
        &Source { name, vehicle, .. }: &Source,
        into: &mut Recordings,
    ) -> Result<Taken, ImportError> {
        let names_all = Named::new(head, name, table, &self.columns)?.has("vehicle");
        let vehicle = vehicle.cloned().or_else(|| if names_all { None } else { self.owner(name) });
        if vehicle.is_none() && !names_all {
            return Err(ImportError::Content {
                file: name.display().to_string(),
                problem: "does not say whose it is; expected NAME= in front of it, a name such as auv1.nav.csv, or a column vehicle".into(),
            });
        }
        let skipped = self.take(table, (text, name), vehicle.as_ref(), into)?;
        Ok(Taken { kind: RecordKind::Table(table), vehicle, datum: None, skipped })
    }
}

/// Puts vehicles in the place of modem ids that they said are theirs, and takes what members of messages say for receptions where they
/// name somebody of whom something was recorded: many things have a source. How many name others, by their names, is returned.
///
/// # Errors
/// [`ImportError::Together`] where two say the same.
pub fn resolve(recordings: &mut Recordings) -> Result<BTreeMap<VehicleId, usize>, ImportError> {
    let mut owners: BTreeMap<VehicleId, VehicleId> = BTreeMap::new();
    for (name, recording) in &*recordings {
        for id in &recording.modem_ids {
            if let Some(other) = owners.insert(VehicleId::new(id), name.clone()) {
                return Err(ImportError::Together(format!(
                    "the modems of {other} and {name} both say that their id is {id}; expected one vehicle for each (are files of one given for two?)"
                )));
            }
        }
    }
    let put = |id: &mut VehicleId| {
        if let Some(owner) = owners.get(id) {
            id.clone_from(owner);
        }
    };
    for recording in recordings.values_mut() {
        let arrivals = recording.arrivals.iter_mut().flatten();
        for arrival in arrivals.chain(recording.said.iter_mut().flatten()) {
            put(&mut arrival.source);
            arrival.destination.as_mut().map(put);
        }
        for sent in recording.sent.iter_mut().flatten() {
            sent.destination.as_mut().map(put);
        }
    }
    let names: BTreeSet<VehicleId> = recordings.keys().cloned().collect();
    let mut strangers = BTreeMap::new();
    for recording in recordings.values_mut() {
        for said in std::mem::take(&mut recording.said) {
            let (known, others): (Vec<Arrival>, Vec<Arrival>) =
                said.into_iter().partition(|arrival| names.contains(&arrival.source));
            others.into_iter().for_each(|arrival| *strangers.entry(arrival.source).or_default() += 1);
            let record = recording.signs.len();
            known.iter().for_each(|arrival| recording.sign(record, arrival.time_s));
            if !known.is_empty() {
                recording.arrivals.get_or_insert_default().extend(known);
            }
        }
    }
    Ok(strangers)
}
