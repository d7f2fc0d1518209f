//! Checks of all input files together.

use std::path::Path;

use pingmap_import::{RecordKind, Recordings};

use super::records::RecordFile;
use crate::output::BadInput;

/// Refuses write-ahead logs of SQLite that are not read: those without their bag, and those in archives.
pub fn check_sqlite_logs(files: &[RecordFile]) -> Result<(), BadInput> {
    for file in files.iter().filter(|file| file.kind == Some(RecordKind::SqliteLog)) {
        let name = file.name.to_string_lossy();
        let bag = name.strip_suffix("-wal").or(name.strip_suffix("-shm")).unwrap_or_default();
        let has_bag = files.iter().any(|other| other.kind == Some(RecordKind::Sqlite) && other.name == Path::new(bag));
        let problem = match () {
            () if file.is_given && !has_bag => "expected the bag to which it belongs",
            () if has_bag && file.section.is_some() && name.ends_with("-wal") => {
                "its messages cannot be read from an archive; expected an unpacked folder"
            }
            () => continue,
        };
        return Err(BadInput(format!("{name}: write-ahead log of an SQLite bag; {problem}")));
    }
    Ok(())
}

/// Largest number of vehicles in all files.
const VEHICLES_MAX: usize = 256;

/// Fails if there are too many vehicles after a file was read.
pub fn check_vehicles(file: &Path, recordings: &Recordings) -> Result<(), BadInput> {
    if recordings.len() <= VEHICLES_MAX {
        return Ok(());
    }
    Err(BadInput(format!(
        "{}: with it the files name {} vehicles; expected at most {VEHICLES_MAX} (--column nav.vehicle=NAME sets the column)",
        file.display(),
        recordings.len()
    )))
}
