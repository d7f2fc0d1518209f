//! Writes files atomically and durably.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::Context;

/// Prefix of the names of temporary files; a random suffix follows.
const PREFIX: &str = ".pingmap-";

/// A temporary file that has not been modified for this long was left by a killed run.
const STALE: Duration = Duration::from_secs(3600);

/// Creates a folder before the work whose results it will contain.
pub fn make_folder(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))
}

/// Writes a file atomically: the bytes go to a temporary file, are synchronised to disk, and the file is renamed into
/// place. A reader therefore never sees a partial file, not even after a power failure.
///
/// A symbolic link is kept, and its target is replaced or created. A replaced file keeps its permissions. A file with
/// several hard links is overwritten in place, so that all its names show the new content. A device or pipe is written
/// to directly.
pub fn write_file(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    replace(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Checks that a file could be written to a folder, and leaves no file there.
pub fn try_folder(path: &Path, folder: &Path) -> io::Result<()> {
    match path.metadata() {
        Ok(known) if !known.is_file() || hard_links(&known) > 1 => OpenOptions::new().write(true).open(path).map(drop),
        _ => temporary_file().tempfile_in(folder).map(drop),
    }
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A pipe behind /dev/stdout has no path that could be followed.
    if path.metadata().is_ok_and(|metadata| !metadata.is_file()) {
        return in_place(path, bytes);
    }
    let target = behind_links(path)?;
    let known = target.metadata().ok();
    if known.as_ref().is_some_and(|metadata| hard_links(metadata) > 1) {
        return in_place(&target, bytes);
    }
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    clean_up(folder);
    let mut file = temporary_file().tempfile_in(folder)?;
    file.write_all(bytes)?;
    if let Some(metadata) = known {
        file.as_file().set_permissions(metadata.permissions())?;
    }
    file.as_file().sync_all()?;
    file.persist(&target).map_err(|error| error.error)?;
    sync_folder(folder);
    Ok(())
}

/// Follows symbolic links to the final path, even if that path does not exist yet.
fn behind_links(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_owned();
    // The system follows at most 40 links, too.
    for _ in 0..40 {
        let Ok(next) = std::fs::read_link(&target) else { return Ok(target) };
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    Err(io::Error::other("too many symbolic links"))
}

/// Overwrites a file, device or pipe without renaming.
fn in_place(target: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).open(target)?;
    if file.metadata()?.is_file() {
        file.set_len(0)?;
        file.write_all(bytes)?;
        return file.sync_all();
    }
    file.write_all(bytes)
}

/// Whether a file name is that of a temporary file: the prefix, and six letters or digits.
fn is_temporary(name: &str) -> bool {
    let random = name.strip_prefix(PREFIX).unwrap_or_default();
    random.len() == 6 && random.bytes().all(|letter| letter.is_ascii_alphanumeric())
}

/// Removes temporary files that killed runs left. Files that cannot be removed stay.
fn clean_up(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let now = SystemTime::now();
    for entry in entries.flatten().filter(|entry| is_temporary(&entry.file_name().to_string_lossy())) {
        let touched = entry.metadata().ok().filter(std::fs::Metadata::is_file).and_then(|data| data.modified().ok());
        if touched.and_then(|touched| now.duration_since(touched).ok()).is_some_and(|age| age > STALE) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Returns a builder of temporary files. Temporary files are private by default, but the permissions of a result follow
/// the umask.
#[cfg(unix)]
fn temporary_file() -> tempfile::Builder<'static, 'static> {
    use std::os::unix::fs::PermissionsExt;
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).permissions(std::fs::Permissions::from_mode(0o666));
    builder
}

#[cfg(not(unix))]
fn temporary_file() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    builder
}

/// Returns the number of hard links to a file.
#[cfg(unix)]
fn hard_links(metadata: &std::fs::Metadata) -> u64 {
    use std::os::unix::fs::MetadataExt;
    metadata.nlink()
}

#[cfg(not(unix))]
fn hard_links(_: &std::fs::Metadata) -> u64 {
    1
}

/// Synchronises the folder to disk, so that the new name survives a power failure. Errors are ignored, since the file
/// is in place already.
fn sync_folder(folder: &Path) {
    if cfg!(unix) {
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(path: &Path) -> String {
        std::fs::read_to_string(path).expect("a file")
    }

    #[test]
    fn old_temporary_files_are_removed_and_young_ones_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let names = [".pingmap-aB3dE6", ".pingmap-aB3dE7", "old", ".pingmap-notes.txt"];
        let [old, young, other, notes] = names.map(|name| folder.path().join(name));
        for path in [&old, &young, &other, &notes] {
            std::fs::write(path, "x").expect("a file");
        }
        for path in [&old, &other, &notes] {
            let long_ago = SystemTime::now() - 2 * STALE;
            File::options().write(true).open(path).and_then(|file| file.set_modified(long_ago)).expect("a time");
        }
        write_file(&folder.path().join("result"), b"y").expect("written");
        assert!(!old.exists() && young.exists() && other.exists() && notes.exists());
        // The pattern matches the names of this crate's temporary files.
        let own = temporary_file().tempfile_in(folder.path()).expect("a file");
        assert!(is_temporary(&own.path().file_name().expect("a name").to_string_lossy()), "{own:?}");
    }

    #[cfg(unix)]
    #[test]
    fn links_and_permissions_stay() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().expect("a folder");
        let [real, link, dangling, hard] = ["real", "link", "dangling", "hard"].map(|name| folder.path().join(name));
        std::fs::write(&real, "a long first content").expect("a file");
        std::fs::set_permissions(&real, std::fs::Permissions::from_mode(0o640)).expect("permissions");
        symlink("real", &link).expect("a link");
        write_file(&link, b"second").expect("written");
        assert!(link.symlink_metadata().expect("there").is_symlink());
        assert_eq!((read(&real), read(&link)), ("second".into(), "second".into()));
        assert_eq!(real.metadata().expect("there").permissions().mode() & 0o777, 0o640);
        // A link whose target does not exist creates the target.
        symlink("new", &dangling).expect("a link");
        write_file(&dangling, b"third").expect("written");
        assert!(dangling.symlink_metadata().expect("there").is_symlink());
        assert_eq!(read(&folder.path().join("new")), "third");
        // All hard links of a file show the new content.
        std::fs::hard_link(&real, &hard).expect("a link");
        write_file(&hard, b"4").expect("written");
        assert_eq!((read(&real), read(&hard)), ("4".into(), "4".into()));
        // A link to itself is an error, not an endless loop.
        let ring = folder.path().join("ring");
        symlink("ring", &ring).expect("a link");
        assert!(write_file(&ring, b"5").is_err());
    }
}
