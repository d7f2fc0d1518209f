//! Durable renames, and replacement of a file in one step.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::store::error::StoreError;

/// Returns the folder of a file. A bare name lies in the current folder.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

/// Returns the path with a suffix after the whole name.
pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(suffix);
    name.into()
}

/// Checks that files can be created in the folder of a file. Leaves no file there.
pub(crate) fn check_folder(path: &Path) -> Result<(), StoreError> {
    if path.is_dir() {
        return Err(StoreError::IsFolder { path: path.into() });
    }
    tempfile::tempfile_in(folder_of(path)).map(drop).map_err(|e| StoreError::from_io(path, e))
}

/// Returns whether a file would be replaced by writing the file `replaced` with [`replace_file`].
pub(crate) fn is_replaced_by(path: &Path, replaced: &Path) -> bool {
    is_one_file(path, replaced) || is_one_file(path, &with_suffix(replaced, ".new"))
}

/// Returns whether two paths name one file, which may not exist yet.
fn is_one_file(a: &Path, b: &Path) -> bool {
    let folder = |path: &Path| fs::canonicalize(folder_of(path)).ok();
    a == b || a.file_name() == b.file_name() && folder(a).is_some_and(|of_a| Some(of_a) == folder(b))
}

/// Makes the names in the folder of this file durable. Only Unix can do so; Windows needs no such step.
pub(crate) fn sync_folder(path: &Path) -> Result<(), StoreError> {
    if cfg!(unix) {
        File::open(folder_of(path)).and_then(|folder| folder.sync_all()).map_err(|e| StoreError::from_io(path, e))?;
    }
    Ok(())
}

/// Replaces a file in one step. `fill` writes the new content under a temporary name in the same folder. The file at
/// `path` is the old one until the new content is on the medium.
pub(crate) fn replace_file(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), StoreError> {
    let aside = with_suffix(path, ".new");
    let write = || {
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let mut file = File::create(&aside)?;
        fill(&mut file)?;
        file.sync_all()?;
        fs::rename(&aside, path)
    };
    if let Err(error) = write() {
        // A file that remains here is overwritten by the next attempt.
        let _ = fs::remove_file(&aside);
        return Err(StoreError::from_io(path, error));
    }
    sync_folder(path)
}

/// Renames a damaged file to `NAME.damaged-1`, or to the first higher number that is free. Returns the new name.
pub(crate) fn keep_damaged(path: &Path) -> Result<PathBuf, StoreError> {
    let kept_as = free_name(path)?;
    fs::rename(path, &kept_as).map_err(|e| StoreError::from_io(path, e))?;
    sync_folder(path)?;
    Ok(kept_as)
}

/// Copies a damaged file to a name as [`keep_damaged`] does. The file keeps its own name, too.
pub(crate) fn copy_damaged(path: &Path) -> Result<(), StoreError> {
    let bytes = fs::read(path).map_err(|e| StoreError::from_io(path, e))?;
    replace_file(&free_name(path)?, |file| file.write_all(&bytes))
}

fn free_name(path: &Path) -> Result<PathBuf, StoreError> {
    let mut number = 1_u64;
    loop {
        let name = with_suffix(path, &format!(".damaged-{number}"));
        match fs::symlink_metadata(&name) {
            Ok(_) => number += 1,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(name),
            Err(error) => return Err(StoreError::from_io(&name, error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_replacement_that_fails_half_way_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("snapshot");
        fs::write(&path, b"old").unwrap();
        let fill = |file: &mut File| {
            file.write_all(b"half of the n")?;
            Err(io::ErrorKind::StorageFull.into())
        };
        let error = replace_file(&path, fill).unwrap_err();
        assert!(matches!(error, StoreError::Full { .. }), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file remains");
    }
}
