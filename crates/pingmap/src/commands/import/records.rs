//! Recorded files of known kinds, and folders of them.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use pingmap_agent::{Geographic, VehicleId};
use pingmap_import::{
    Conversion, FileSource, ImportError, Place, RecordKind, RecordReader, Recordings, Reference, SkipCounts, read_head,
};
use pingmap_trial::{FileError, Problem};

use super::archives::{DEPTH_MAX, is_archive, unpack_archive};
use super::unpacked::{Section, Unpacked};
use crate::interruptible::Interruptible;
use crate::log::{self, STANDARD_INPUT};
use crate::output::{BadInput, note, warn};

/// Positions of (0, 0) within this distance in metres count as equal.
const DATUM_M_MAX: f64 = 20.0;

/// A file that was given, or that lies in a given folder or archive.
#[derive(Clone)]
pub struct RecordFile {
    /// Path of the file. For a file in an archive, the path of the archive.
    pub path: PathBuf,
    /// Content of a file in an archive, and of a stream.
    pub section: Option<Section>,
    /// Name of the file in messages. For a file in an archive, the archive's name and its own.
    pub name: PathBuf,
    /// Prefix of the topics that are read.
    pub topics: String,
    pub vehicle: Option<VehicleId>,
    /// Whether the file itself was given. The kind of a given file must be known.
    pub is_given: bool,
    /// Kind of the file, set by [`detect_kinds`].
    pub kind: Option<RecordKind>,
}

impl RecordFile {
    /// Describes a file that was given.
    pub fn given(path: &Path) -> Self {
        let (path, name) = (path.to_owned(), path.to_owned());
        Self { path, section: None, name, topics: String::new(), vehicle: None, is_given: true, kind: None }
    }

    /// Describes a file in this archive. It inherits the vehicle and topics.
    fn containing(&self, path: &Path, section: Section) -> Self {
        Self { section: Some(section), name: self.name.join(path), is_given: false, ..self.clone() }
    }

    /// Opens the file with the error messages of all readers.
    pub fn open(&self) -> Result<Box<dyn Read + Send>, ImportError> {
        match &self.section {
            Some(section) => Ok(Box::new(Interruptible(section.clone()))),
            None => open(&self.path),
        }
    }

    /// Returns the length of the file in bytes, if it is known.
    pub fn length(&self) -> Option<u64> {
        self.section.as_ref().map(|section| section.length).or_else(|| Some(self.path.metadata().ok()?.len()))
    }

    /// Whether the file is standard input or a pipe. Such input is copied to a file first.
    fn is_stream(&self) -> bool {
        let is_pipe = || self.path.metadata().is_ok_and(|metadata| !metadata.is_file());
        self.is_given && (self.path == Path::new(STANDARD_INPUT) || is_pipe())
    }
}

/// Returns the files that are given as `[NAME=]FILE[#TOPIC]`, and all files in given folders, in the order of their
/// names.
pub fn list_files(given: &[String]) -> anyhow::Result<Vec<RecordFile>> {
    let mut files = Vec::new();
    for argument in given {
        let (vehicle, path) = split_vehicle(argument);
        let (path, topics) = split_topics(path);
        let file = RecordFile { topics, vehicle, ..RecordFile::given(path) };
        if path.is_dir() { list_folder(&file, path, DEPTH_MAX, &mut files)? } else { files.push(file) }
    }
    Ok(files)
}

/// Largest depth of archives within archives.
const NESTED_MAX: usize = 4;

/// Replaces archives, also nested ones, by the files that they contain.
pub fn unpack_archives(files: Vec<RecordFile>, unpacked: &mut Unpacked) -> anyhow::Result<Vec<RecordFile>> {
    let mut all = Vec::new();
    unpack(files, NESTED_MAX, &mut all, unpacked)?;
    Ok(all)
}

fn unpack(
    files: Vec<RecordFile>,
    depth: usize,
    all: &mut Vec<RecordFile>,
    unpacked: &mut Unpacked,
) -> anyhow::Result<()> {
    for mut file in files {
        if file.is_stream() {
            let stream = file.open()?;
            if file.path == Path::new(STANDARD_INPUT) {
                file.name = "standard input".into();
            }
            let unreadable = |error| BadInput(format!("{}: cannot be read: {error}", file.name.display()));
            file.section = Some(unpacked.add(stream).map_err(unreadable)?);
        }
        let content = match &file.section {
            _ if depth == 0 => Ok(None),
            Some(section) => unpack_archive(section.clone(), &file.name, unpacked),
            None => unpack_archive(pingmap_trial::open(&file.path).map_err(ImportError::from)?, &file.name, unpacked),
        };
        let fail = |error| BadInput(format!("{}: cannot be unpacked: {error}", file.name.display()));
        match content.map_err(fail) {
            Ok(Some(content)) => {
                let inner = content.into_iter().map(|(path, section)| file.containing(&path, section)).collect();
                unpack(inner, depth - 1, all, unpacked)?;
            }
            Ok(None) => all.push(file),
            // Damaged archives in folders are of unknown kind.
            Err(error) if !file.is_given => {
                warn(error.0);
                all.push(file);
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Lists the files in a folder with their names. The files inherit the vehicle and topics of `parent`.
fn list_folder(parent: &RecordFile, folder: &Path, depth: usize, files: &mut Vec<RecordFile>) -> anyhow::Result<()> {
    let unreadable = |error: std::io::Error| BadInput(format!("{}: cannot be read: {error}", folder.display()));
    if depth == 0 {
        return Err(unreadable(std::io::Error::other(format!("more than {DEPTH_MAX} folders deep"))).into());
    }
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        entries.push(entry.map_err(unreadable)?);
    }
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        // Links to files are followed. Links to folders are not, because they may form a loop.
        if entry.file_type().map_err(unreadable)?.is_dir() {
            list_folder(parent, &path, depth - 1, files)?;
        } else if path.is_file() {
            files.push(RecordFile { name: path.clone(), path, is_given: false, ..parent.clone() });
        }
    }
    Ok(())
}

/// Determines the kind of each file.
pub fn detect_kinds(files: &mut [RecordFile], reader: &RecordReader) -> anyhow::Result<()> {
    for file in files {
        let unreadable = |error| FileError { path: file.name.clone(), problem: Problem::Unreadable(error) };
        file.kind =
            reader.detect_kind(&read_head(file.open()?).map_err(unreadable)?, &file.name, file.vehicle.as_ref());
    }
    Ok(())
}

/// Returns the only file of the first kind that occurs, and prints a note, because no option named the file.
pub fn single_file(files: &[RecordFile], kinds: &[RecordKind], option: &str) -> anyhow::Result<Option<RecordFile>> {
    let occurs = |kind: &&RecordKind| files.iter().any(|file| file.kind == Some(**kind));
    let Some(kind) = kinds.iter().find(occurs) else { return Ok(None) };
    let mut matching = files.iter().filter(|file| file.kind == Some(*kind));
    let Some(first) = matching.next() else { return Ok(None) };
    if let Some(other) = matching.next() {
        let (first, other, words) = (first.name.display(), other.name.display(), kind.description());
        return Err(BadInput(format!(
            "{first} and {other} are files of one kind ({words}); expected one such file, or {option}"
        ))
        .into());
    }
    note(format_args!("{}: {}", first.name.display(), kind.description()));
    Ok(Some(first.clone()))
}

/// Whether a file is read. Files in folders are skipped if their kind is unknown.
pub fn is_read(file: &RecordFile, reader: &RecordReader) -> bool {
    let is_readable =
        |head: Vec<u8>| is_archive(&head) || reader.detect_kind(&head, &file.name, file.vehicle.as_ref()).is_some();
    // A given file may be a pipe, which can be read only once.
    file.is_given || File::open(&file.path).and_then(read_head).map_or(true, is_readable)
}

/// Splits a file name at a `#` that is not part of the name. Returns the file and the prefix of its topics.
fn split_topics(path: &Path) -> (&Path, String) {
    let parts = path.to_str().filter(|_| !path.exists()).and_then(|text| text.rsplit_once('#'));
    parts.map_or((path, String::new()), |(path, topics)| (Path::new(path), topics.to_owned()))
}

/// Results of reading files, in addition to the recordings.
#[derive(Default)]
pub struct Records {
    pub skipped: SkipCounts,
    /// Positions of (0, 0), with the file that contains each.
    pub datums: Vec<(PathBuf, Geographic)>,
    /// Whether any file has positions in metres.
    pub has_metres: bool,
    /// Files in folders whose kind is unknown.
    pub unknown_files: Vec<PathBuf>,
    /// Tables whose kind was determined from their columns, as messages for the user.
    pub detected_tables: Vec<String>,
}

impl Records {
    /// Reads a file into the recordings.
    pub fn read_file(
        &mut self,
        file: &RecordFile,
        content: impl Read,
        reader: &RecordReader,
        recordings: &mut Recordings,
    ) -> anyhow::Result<()> {
        let RecordFile { path, section, name, topics, vehicle, is_given, .. } = file;
        let path = section.is_none().then_some(path.as_path());
        match reader.read_record(content, &FileSource { path, name, vehicle: vehicle.as_ref(), topics }, recordings)? {
            Some(summary) => {
                // The kind of a table follows from its columns and its vehicle from its name. A message shows the user
                // both.
                let owner = summary.vehicle.map_or(String::new(), |vehicle| format!(" of {vehicle}"));
                if matches!(summary.kind, RecordKind::Table(_)) {
                    self.detected_tables.push(format!("{}: {}{owner}", name.display(), summary.kind.description()));
                }
                self.skipped = self.skipped.sum(summary.skipped);
                note_conversions(name, &summary.conversions);
                self.datums.extend(summary.datum.map(|datum| (name.clone(), datum)));
            }
            None if *is_given => {
                let message = "unknown kind of file; expected a MOOS log (.alog) or mission file, Micro-Modem sentences with a time before \
                               each, a ROS 2 bag (MCAP or SQLite), an LCM log with its types (.lcm), or a table of navigation, receptions (auv1.heard.csv) or \
                               transmissions (auv1.sent.csv); --nav, --heard and --sent set the kind";
                return Err(BadInput(format!("{}: {message}", name.display())).into());
            }
            None => self.unknown_files.push(name.clone()),
        }
        Ok(())
    }

    /// Returns the position of (0, 0) that the files contain. Fails if they disagree.
    pub fn datum(&self) -> anyhow::Result<Option<Geographic>> {
        let Some((first, datum)) = self.datums.first() else { return Ok(None) };
        let reference = Reference::with_origin(*datum).map_err(ImportError::from)?;
        for (path, other) in &self.datums {
            let distance_m = reference
                .metres(Place::Degrees(*other))
                .map_or(f64::INFINITY, |(east_m, north_m)| east_m.hypot(north_m));
            if distance_m > DATUM_M_MAX {
                let coordinates = |place: &Geographic| format!("{:.5},{:.5}", place.latitude_deg, place.longitude_deg);
                return Err(BadInput(format!(
                    "{}: (0, 0) is {}, but {} in {}; expected one datum for all files, or --origin, which applies to all files",
                    path.display(),
                    coordinates(other),
                    coordinates(datum),
                    first.display()
                ))
                .into());
            }
        }
        Ok(Some(*datum))
    }
}

/// Opens a file with the error messages of all readers.
pub fn open(path: &Path) -> Result<Box<dyn Read + Send>, ImportError> {
    Ok(log::opened(path)?.0)
}

/// Returns the vehicle before the first `=`, if given, and the file.
pub fn split_vehicle(file: &str) -> (Option<VehicleId>, &Path) {
    match file.split_once('=') {
        Some((name, path)) if !name.is_empty() && !name.contains(['/', '\\']) => {
            (Some(VehicleId::new(name)), Path::new(path))
        }
        _ => (None, Path::new(file)),
    }
}

/// Prints how a table differs from plain CSV.
pub fn note_conversions(name: &Path, conversions: &[Conversion]) {
    if !conversions.is_empty() {
        let conversions: Vec<String> = conversions.iter().map(ToString::to_string).collect();
        note(format_args!("{}: {}", name.display(), conversions.join(", ")));
    }
}
