//! Files of known kinds, recognised by what is in them.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufReader, Read};
use std::path::Path;

use pingmap_agent::{Geographic, VehicleId};
use pingmap_trial::{FileError, Problem};

use crate::error::ImportError;
use crate::lcm_types::LcmTypes;
use crate::recording::{Arrival, Recording, Recordings};
use crate::tables::Reading;
use crate::told::{Skipped, Told};
use crate::{capture, lcm, mcap_file, moos, sqlite};

/// So much of a file tells what it is.
const HEAD_BYTES: usize = 1 << 16;

/// No definitions of types are longer.
const TYPES_BYTES_MAX: u64 = 1 << 22;

/// What a file of a known kind is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RecordKind {
    /// A log of MOOS.
    MoosLog,
    /// A mission file of MOOS, for its datum.
    MoosMission,
    /// What a host and its Micro-Modem said, with the host's times.
    ModemCapture,
    /// Topics in an MCAP file.
    Mcap,
    /// A bag of ROS 2 in SQLite.
    Sqlite,
    /// A log of LCM.
    Lcm,
    /// Types of the messages in such.
    LcmTypes,
}

impl RecordKind {
    /// What a file is that begins so; `None` for what is of no known kind.
    pub fn of(head: &[u8]) -> Option<Self> {
        if head.starts_with(mcap_file::MAGIC) {
            return Some(Self::Mcap);
        } else if head.starts_with(sqlite::MAGIC) {
            return Some(Self::Sqlite);
        } else if head.starts_with(lcm::MAGIC) {
            return Some(Self::Lcm);
        }
        let head = String::from_utf8_lossy(head);
        if moos::is_one(&head) {
            Some(Self::MoosLog)
        } else if capture::is_one(&head) {
            Some(Self::ModemCapture)
        } else if LcmTypes::are_in(&head) {
            Some(Self::LcmTypes)
        } else {
            moos::datum_of_mission(&head).map(|_| Self::MoosMission)
        }
    }
}

/// What a file was, and what it told besides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taken {
    /// What it was.
    pub kind: RecordKind,
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
    /// Whose it is; `None` where it says so itself.
    pub vehicle: Option<&'a VehicleId>,
    /// What the names of topics begin with that are read; all of them where it is empty.
    pub topics: &'a str,
}

impl<'a> Source<'a> {
    /// A file of somebody, with all its topics.
    pub fn new(path: &'a Path, vehicle: Option<&'a VehicleId>) -> Self {
        Self { path, vehicle, topics: "" }
    }
}

impl Reading {
    /// Takes in types of LCM, if a file is of such; before the logs that need them.
    ///
    /// # Errors
    /// [`ImportError`] where it cannot be read, or says something that is no type.
    pub fn take_types(&mut self, mut reader: impl Read, path: &Path) -> Result<(), ImportError> {
        let fail = |problem: String| ImportError::Content { file: path.display().to_string(), problem };
        let mut bytes = Vec::new();
        let unreadable = |error| FileError { path: path.to_owned(), problem: Problem::Unreadable(error) };
        reader.by_ref().take(HEAD_BYTES as u64).read_to_end(&mut bytes).map_err(unreadable)?;
        if RecordKind::of(&bytes) == Some(RecordKind::LcmTypes) {
            reader.take(TYPES_BYTES_MAX).read_to_end(&mut bytes).map_err(unreadable)?;
            self.lcm_types.read(&String::from_utf8_lossy(&bytes)).map_err(fail)?;
        }
        Ok(())
    }

    /// Takes in a file of a known kind, recognised by its content; `None` where it is of none. It is its source's vehicle's, or whose it says
    /// itself: by `NODE_REPORT_LOCAL`, or by its modem's id where `ids` knows that. SQLite is read from the path, all others from `reader`. O(lines), one at a time.
    ///
    /// # Errors
    /// [`ImportError`] where it cannot be read, does not say whose it is, or when it was.
    pub fn take_record(
        &self,
        reader: impl Read,
        &Source { path, vehicle, topics }: &Source,
        into: &mut Recordings,
    ) -> Result<Option<Taken>, ImportError> {
        let unreadable = |error| FileError { path: path.to_owned(), problem: Problem::Unreadable(error) };
        let fail = |problem: String| ImportError::Content { file: path.display().to_string(), problem };
        let mut reader = BufReader::new(reader);
        let mut head = Vec::new();
        reader.by_ref().take(HEAD_BYTES as u64).read_to_end(&mut head).map_err(unreadable)?;
        let Some(kind) = RecordKind::of(&head) else { return Ok(None) };
        let text = head.as_slice().chain(reader);
        let told = match kind {
            RecordKind::MoosMission => {
                let datum = moos::datum_of_mission(&String::from_utf8_lossy(&head));
                return Ok(Some(Taken { kind, datum, skipped: Skipped::default() }));
            }
            RecordKind::MoosLog => moos::read(text, &self.ids, &self.prefix).map_err(unreadable)?.map_err(fail)?,
            RecordKind::ModemCapture => capture::read(text, &self.ids).map_err(unreadable)?,
            RecordKind::LcmTypes => return Ok(Some(Taken { kind, datum: None, skipped: Skipped::default() })),
            RecordKind::Lcm => lcm::read(text, &self.lcm_types, &self.ids, topics).map_err(fail)?,
            RecordKind::Mcap => mcap_file::read(text, &self.ids, topics).map_err(fail)?,
            // Other things are kept in databases, too.
            RecordKind::Sqlite => match sqlite::read(path, &self.ids, topics).map_err(fail)? {
                Some(told) => told,
                None => return Ok(None),
            },
        };
        let Told { recording, name, datum, skipped } = told;
        let taken = Taken { kind, datum, skipped };
        // A log that somebody kept on shore, who neither moved nor listened, is of nobody.
        if recording == Recording::default() {
            return Ok(Some(taken));
        }
        let by_modem = || recording.modem_ids.iter().find_map(|id| self.ids.listed(id));
        let Some(name) = vehicle.cloned().or(name).or_else(by_modem) else {
            return Err(fail(
                "does not say whose it is; expected NAME= in front of it, or its modem's id in --ids".into(),
            ));
        };
        into.entry(name).or_default().append(recording);
        Ok(Some(taken))
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
