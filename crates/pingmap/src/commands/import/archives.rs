//! Unpacks archives that are given in place of folders.

use std::cell::Cell;
use std::io::{self, BufReader, Read, Seek};
use std::path::{Component, Path, PathBuf};

use flate2::read::MultiGzDecoder;

use super::unpacked::{Section, Unpacked};

const GZIP_MARK: &[u8] = &[0x1f, 0x8b];
const ZIP_MARK: &[u8] = b"PK\x03\x04";

/// Offset and content of the mark of tar archives.
const TAR_MARK: (usize, &[u8]) = (257, b"ustar");

/// Largest number of folders and names in the path of a file.
pub const DEPTH_MAX: usize = 32;

/// Largest length of the headers in front of one file of a tar archive, in bytes.
const TAR_HEADERS_BYTES_MAX: u64 = 1 << 20;

/// Files with their paths in an archive.
type Files = Vec<(PathBuf, Section)>;

/// Whether a file with these first bytes is an archive or compressed.
pub fn is_archive(head: &[u8]) -> bool {
    head.starts_with(GZIP_MARK) || head.starts_with(ZIP_MARK) || is_tar(head)
}

/// Unpacks a ZIP or tar archive, or one file compressed with gzip. Returns its files in the order of their paths, or
/// `None` for other files. Links are ignored.
pub fn unpack_archive(mut file: impl Read + Seek, name: &Path, unpacked: &mut Unpacked) -> io::Result<Option<Files>> {
    let head = head(&mut file)?;
    file.rewind()?;
    let mut files = if head.starts_with(GZIP_MARK) {
        let content = self::head(&mut MultiGzDecoder::new(BufReader::new(&mut file)))?;
        file.rewind()?;
        let plain = MultiGzDecoder::new(BufReader::new(file));
        if is_tar(&content) {
            unpack_tar(plain, unpacked)?
        } else {
            let name = name.file_stem().unwrap_or(name.as_os_str());
            vec![(name.into(), unpacked.add(plain)?)]
        }
    } else if is_tar(&head) {
        unpack_tar(BufReader::new(file), unpacked)?
    } else if head.starts_with(ZIP_MARK) {
        unpack_zip(BufReader::new(file), unpacked)?
    } else {
        return Ok(None);
    };
    files.sort_by(|one, other| one.0.cmp(&other.0));
    Ok(Some(files))
}

fn unpack_zip(file: impl Read + Seek, unpacked: &mut Unpacked) -> io::Result<Files> {
    let (mut archive, mut files) = (zip::ZipArchive::new(file)?, Files::new());
    for index in 0..archive.len() {
        let entry = archive.by_index(index)?;
        if entry.is_file() {
            files.push((checked_path(Path::new(&*entry.name()?))?, unpacked.add(entry)?));
        }
    }
    Ok(files)
}

fn unpack_tar(reader: impl Read, unpacked: &mut Unpacked) -> io::Result<Files> {
    let (left, mut files) = (Cell::new(0), Files::new());
    let mut archive = tar::Archive::new(Bounded { reader, left: &left });
    let mut entries = archive.entries()?;
    loop {
        // The library keeps long headers in memory. The content goes to the unnamed file, which has a limit of its own.
        left.set(TAR_HEADERS_BYTES_MAX);
        let Some(mut entry) = entries.next().transpose()? else { return Ok(files) };
        left.set(u64::MAX);
        let kind = entry.header().entry_type();
        if kind.is_file() || kind.is_contiguous() || kind.is_gnu_sparse() {
            let path = checked_path(&entry.path()?)?;
            files.push((path, unpacked.add(entry)?));
        } else if io::copy(&mut entry.by_ref().take(TAR_HEADERS_BYTES_MAX), &mut io::sink())? == TAR_HEADERS_BYTES_MAX {
            return Err(io::Error::other("a link or folder in it has content"));
        }
    }
}

/// A reader that fails after a number of bytes.
struct Bounded<'a, R> {
    reader: R,
    left: &'a Cell<u64>,
}

impl<R: Read> Read for Bounded<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.reader.read(buffer)?;
        let left = self.left.get().checked_sub(read as u64);
        self.left.set(left.ok_or_else(|| io::Error::other("the headers of a file are longer than 1 MB"))?);
        Ok(read)
    }
}

/// Returns the path of a file within an archive, without control characters. Nothing is written to this path.
fn checked_path(path: &Path) -> io::Result<PathBuf> {
    let mut checked = PathBuf::new();
    for component in path.components() {
        match component {
            Component::Normal(name) => checked.push(name.to_string_lossy().replace(char::is_control, "?")),
            Component::ParentDir => {
                let problem = format!("a file has the path {path:?}; expected one within the archive");
                return Err(io::Error::other(problem));
            }
            Component::CurDir | Component::RootDir | Component::Prefix(_) => {}
        }
    }
    if checked.components().count() > DEPTH_MAX {
        return Err(io::Error::other(format!("a file lies more than {DEPTH_MAX} folders deep; expected fewer")));
    }
    Ok(checked)
}

fn head(reader: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    reader.take(512).read_to_end(&mut head)?;
    Ok(head)
}

fn is_tar(head: &[u8]) -> bool {
    head.get(TAR_MARK.0..).is_some_and(|rest| rest.starts_with(TAR_MARK.1))
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write};

    use super::*;

    /// Unpacks an archive, and returns the paths and the content of its files.
    fn content(bytes: &[u8], limit_bytes: u64) -> io::Result<Option<Vec<(String, String)>>> {
        let mut unpacked = Unpacked::new(limit_bytes);
        let Some(files) = unpack_archive(Cursor::new(bytes), Path::new("logs/all.log.gz"), &mut unpacked)? else {
            return Ok(None);
        };
        let mut text = |(path, mut section): (PathBuf, Section)| {
            let mut text = String::new();
            section.read_to_string(&mut text).map(|_| (path.to_string_lossy().into_owned(), text))
        };
        files.into_iter().map(&mut text).collect::<io::Result<Vec<_>>>().map(Some)
    }

    /// Appends a file with the content `hi`, or a link to it, to a tar archive.
    fn append(tar: &mut Vec<u8>, name: &str, kind: tar::EntryType) {
        let mut header = tar::Header::new_ustar();
        header.as_mut_bytes()[..name.len()].copy_from_slice(name.as_bytes());
        header.set_entry_type(kind);
        header.set_size(if kind.is_file() { 2 } else { 0 });
        header.set_link_name("/etc/passwd").expect("a name");
        header.set_mode(0o644);
        header.set_cksum();
        tar.extend_from_slice(header.as_bytes());
        if kind.is_file() {
            tar.extend_from_slice(b"hi");
            tar.extend_from_slice(&[0; 510]);
        }
    }

    fn tar_archive(names: &[&str]) -> Vec<u8> {
        let mut tar = Vec::new();
        for name in names {
            append(&mut tar, name, tar::EntryType::Regular);
            append(&mut tar, "link.alog", tar::EntryType::Symlink);
            append(&mut tar, "hard.alog", tar::EntryType::Link);
        }
        tar.extend_from_slice(&[0; 1024]);
        tar
    }

    fn zip_archive(names: &[&str]) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for name in names {
            zip.start_file(*name, zip::write::SimpleFileOptions::default()).expect("a file");
            zip.write_all(b"hi").expect("written");
        }
        zip.add_symlink("link.alog", "/etc/passwd", zip::write::SimpleFileOptions::default()).expect("a link");
        zip.finish().expect("an archive").into_inner()
    }

    fn gzip_file(bytes: &[u8]) -> Vec<u8> {
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(bytes).expect("written");
        gzip.finish().expect("an archive")
    }

    fn archives(names: &[&str]) -> [Vec<u8>; 3] {
        [tar_archive(names), zip_archive(names), gzip_file(&tar_archive(names))]
    }

    #[test]
    fn archives_of_every_kind_are_unpacked_without_links_and_nothing_else_is() {
        let file = |name: &str| (name.to_owned(), "hi".to_owned());
        for bytes in archives(&["b/a\u{1b}[2J.alog", "/a.alog", "./b/0.alog"]) {
            let expected = vec![file("a.alog"), file("b/0.alog"), file("b/a?[2J.alog")];
            assert_eq!(content(&bytes, 6).expect("an archive"), Some(expected));
        }
        // A compressed file is named after its archive, without the extension.
        let expected = vec![("all.log".to_owned(), "% a log".to_owned())];
        assert_eq!(content(&gzip_file(b"% a log"), 7).expect("an archive"), Some(expected));
        assert_eq!(content(b"% a log", 0).expect("a file"), None);
        assert_eq!(content(b"", 0).expect("a file"), None);
    }

    #[test]
    fn paths_depth_and_size_have_limits() {
        let deep = "a/".repeat(DEPTH_MAX - 1);
        for (name, limit_bytes, problem) in [
            ("../a.alog", 9, "within the archive"),
            ("a/../../a.alog", 9, "within the archive"),
            (&format!("{deep}b/a.alog"), 9, "folders deep"),
            ("a.alog", 1, "--unpacked-max"),
        ] {
            for bytes in archives(&[name]) {
                let error = content(&bytes, limit_bytes).expect_err(name).to_string();
                assert!(error.contains(problem), "{name}: {error}");
            }
        }
        for bytes in archives(&[&format!("{deep}a.alog")]) {
            assert!(content(&bytes, 2).is_ok());
        }
        let error = content(&gzip_file(&vec![0; 100_000]), 99_999).expect_err("too long").to_string();
        assert!(error.contains("--unpacked-max"), "{error}");
        // A long name of GNU tar, which the library would keep in memory.
        let mut tar = Vec::new();
        append(&mut tar, "long", tar::EntryType::Regular);
        let mut header = tar::Header::new_gnu();
        header.set_entry_type(tar::EntryType::GNULongName);
        header.set_size(1 << 30);
        header.set_cksum();
        tar.extend_from_slice(header.as_bytes());
        tar.extend(vec![b'a'; 4 << 20]);
        let error = content(&gzip_file(&tar), 1 << 30).expect_err("too long").to_string();
        assert!(error.contains("longer than 1 MB"), "{error}");
    }

    /// Archives with a changed byte or a missing end are unpacked or refused, without a panic.
    #[test]
    fn damaged_archives_are_errors() {
        let [tar, zip, tgz] = archives(&["a.alog"]);
        for whole in [tar, zip, tgz, gzip_file(b"% a log")] {
            let step = whole.len() / 60 + 1;
            for at in (0..whole.len()).step_by(step) {
                let mut changed = whole.clone();
                changed[at] ^= 0x55;
                let _ = (content(&changed, 1 << 20), content(&whole[..at], 1 << 20));
            }
        }
    }
}
