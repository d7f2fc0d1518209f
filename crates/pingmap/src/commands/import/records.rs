//! Files of known kinds, and folders of such.

use std::io::Read;
use std::path::{Path, PathBuf};

use pingmap_agent::{Geographic, VehicleId};
use pingmap_import::{ImportError, Place, Reading, RecordKind, Recordings, Reference, Skipped, Source};
use pingmap_trial::open;
use tempfile::TempDir;

use super::archives::unpacked;
use crate::output::BadInput;

/// So much of a file tells of what kind it is.
const HEAD_BYTES: u64 = 1 << 16;

/// Places of (0, 0) that lie no farther apart than this are the same, in metres.
const DATUM_M_MAX: f64 = 20.0;

/// A file that was given, or lies in a folder that was.
pub struct RecordFile {
    pub path: PathBuf,
    /// What the names of topics begin with that are read.
    pub topics: String,
    pub vehicle: Option<VehicleId>,
    /// Whether it was given itself: it should be of a known kind.
    pub is_given: bool,
}

/// Every file of those that are given as `[NAME=]FILE[#TOPIC]`, and of the folders among them, in the order of their names.
pub fn all(given: &[String]) -> anyhow::Result<Vec<RecordFile>> {
    let mut files = Vec::new();
    for given in given {
        let (vehicle, path) = whose(given);
        let (path, topics) = of_topics(path);
        if path.is_dir() {
            let before = files.len();
            in_folder(path, &vehicle, &mut files)?;
            files[before..].iter_mut().for_each(|inside| inside.topics.clone_from(&topics));
        } else {
            files.push(RecordFile { path: path.to_owned(), topics, vehicle, is_given: true });
        }
    }
    Ok(files)
}

/// Archives lie within archives to this depth at most.
const NESTED_MAX: usize = 4;

/// The same files with all that is in archives among them, and in archives within those, in their places; and the folders
/// where that was unpacked.
pub fn with_archives(files: Vec<RecordFile>) -> anyhow::Result<(Vec<RecordFile>, Vec<TempDir>)> {
    let (mut all, mut folders) = (Vec::new(), Vec::new());
    unpack(files, NESTED_MAX, &mut all, &mut folders)?;
    Ok((all, folders))
}

fn unpack(
    files: Vec<RecordFile>,
    depth: usize,
    all: &mut Vec<RecordFile>,
    folders: &mut Vec<TempDir>,
) -> anyhow::Result<()> {
    for file in files {
        let folder = if depth > 0 { unpacked(&file.path)? } else { None };
        let Some(folder) = folder else {
            all.push(file);
            continue;
        };
        let mut inside = Vec::new();
        in_folder(folder.path(), &file.vehicle, &mut inside)?;
        inside.iter_mut().for_each(|inner| inner.topics.clone_from(&file.topics));
        folders.push(folder);
        unpack(inside, depth - 1, all, folders)?;
    }
    Ok(())
}

fn in_folder(folder: &Path, vehicle: &Option<VehicleId>, files: &mut Vec<RecordFile>) -> anyhow::Result<()> {
    let unreadable = |error: std::io::Error| BadInput(format!("{}: cannot be read: {error}", folder.display()));
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        paths.push(entry.map_err(unreadable)?);
    }
    paths.sort_by_key(std::fs::DirEntry::file_name);
    for entry in paths {
        // A link to a file is one; what a link to a folder points to may be this folder itself.
        let kind = entry.file_type().map_err(unreadable)?;
        if kind.is_dir() {
            in_folder(&entry.path(), vehicle, files)?;
        } else if entry.path().is_file() {
            let (path, vehicle) = (entry.path(), vehicle.clone());
            files.push(RecordFile { path, topics: String::new(), vehicle, is_given: false });
        }
    }
    Ok(())
}

/// Whether a file is read: in folders those of no known kind are left alone.
pub fn is_read(file: &RecordFile) -> bool {
    let mut head = Vec::new();
    let looked = std::fs::File::open(&file.path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut head));
    file.is_given || looked.is_err() || RecordKind::of(&head).is_some()
}

/// The file, and what the names of its topics begin with, behind a `#` that is not part of its own name.
fn of_topics(path: &Path) -> (&Path, String) {
    let parts = path.to_str().filter(|_| !path.exists()).and_then(|text| text.rsplit_once('#'));
    parts.map_or((path, String::new()), |(path, topics)| (Path::new(path), topics.to_owned()))
}

/// What files of known kinds told besides what vehicles recorded.
#[derive(Default)]
pub struct Records {
    pub skipped: Skipped,
    /// Where (0, 0) is, by which file.
    pub datums: Vec<(PathBuf, Geographic)>,
    /// Whether any of them has places in metres.
    pub has_metres: bool,
    /// Files in folders that are of no known kind.
    pub left_alone: Vec<PathBuf>,
}

impl Records {
    /// Takes in a file.
    pub fn take(
        &mut self,
        file: &RecordFile,
        reader: impl std::io::Read,
        reading: &Reading,
        recordings: &mut Recordings,
    ) -> anyhow::Result<()> {
        let RecordFile { path, topics, vehicle, is_given } = file;
        match reading.take_record(reader, &Source { path, vehicle: vehicle.as_ref(), topics }, recordings)? {
            Some(taken) => {
                self.skipped = self.skipped.and(taken.skipped);
                self.datums.extend(taken.datum.map(|datum| (path.clone(), datum)));
            }
            None if *is_given => {
                let message = "of no known kind; expected a log (.alog) or mission file of MOOS, or sentences of a Micro-Modem with a time in front \
                               of each, a bag of ROS 2 (MCAP or SQLite), a log of LCM with its types (.lcm); tables belong behind --nav, --heard and --sent";
                return Err(BadInput(format!("{}: {message}", path.display())).into());
            }
            None => self.left_alone.push(path.clone()),
        }
        Ok(())
    }

    /// Where (0, 0) is, where files say so.
    pub fn datum(&self) -> anyhow::Result<Option<Geographic>> {
        let Some((first, datum)) = self.datums.first() else { return Ok(None) };
        let reference = Reference::about(*datum).map_err(ImportError::from)?;
        for (path, other) in &self.datums {
            let off_m = reference
                .metres(Place::Degrees(*other))
                .map_or(f64::INFINITY, |(east_m, north_m)| east_m.hypot(north_m));
            if off_m > DATUM_M_MAX {
                let at = |place: &Geographic| format!("{:.5},{:.5}", place.latitude_deg, place.longitude_deg);
                return Err(BadInput(format!(
                    "{}: (0, 0) is {}, and {} in {}; expected one datum for all, or --origin, which holds for metres of all files",
                    path.display(),
                    at(other),
                    at(datum),
                    first.display()
                ))
                .into());
            }
        }
        Ok(Some(*datum))
    }
}

/// Opened here, for every reader to say the same of files that are not there.
pub fn opened(path: &Path) -> Result<std::fs::File, ImportError> {
    Ok(open(path)?)
}

/// The vehicle before the first `=`, if there is one, and the file.
pub fn whose(file: &str) -> (Option<VehicleId>, &Path) {
    match file.split_once('=') {
        Some((name, path)) if !name.is_empty() && !name.contains(['/', '\\']) => {
            (Some(VehicleId::new(name)), Path::new(path))
        }
        _ => (None, Path::new(file)),
    }
}
