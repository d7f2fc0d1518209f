//! Unpacks archives that are given in place of folders.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use pingmap_import::ImportError;
use pingmap_trial::open;
use tempfile::TempDir;

use crate::output::BadInput;

const GZIP_MARK: &[u8] = &[0x1f, 0x8b];
const ZIP_MARK: &[u8] = b"PK\x03\x04";

/// Offset and content of the mark of tar archives.
const TAR_MARK: (usize, &[u8]) = (257, b"ustar");

/// Unpacks a ZIP or tar archive, or one file compressed with gzip, to a temporary folder. The folder is deleted when
/// the returned value is dropped. Returns `None` for other files. Nothing is written outside the folder. Error messages
/// contain `name`.
pub fn unpack_archive(path: &Path, name: &Path) -> anyhow::Result<Option<TempDir>> {
    let fail = |error: io::Error| BadInput(format!("{}: cannot be unpacked: {error}", name.display()));
    let file = open(path).map_err(ImportError::from)?;
    unpack(name, file).map_err(|error| fail(error).into())
}

/// Whether a file with these first bytes is an archive or compressed.
pub fn is_archive(head: &[u8]) -> bool {
    head.starts_with(GZIP_MARK) || head.starts_with(ZIP_MARK) || is_tar(head)
}

fn unpack(name: &Path, mut file: File) -> io::Result<Option<TempDir>> {
    let head = head(&mut file)?;
    file.rewind()?;
    if !is_archive(&head) {
        return Ok(None);
    }
    let folder = tempfile::tempdir()?;
    if head.starts_with(GZIP_MARK) {
        let content = self::head(&mut MultiGzDecoder::new(BufReader::new(&mut file)))?;
        file.rewind()?;
        let mut plain = MultiGzDecoder::new(BufReader::new(file));
        if is_tar(&content) {
            tar::Archive::new(plain).unpack(folder.path())?;
        } else {
            let name = name.file_stem().unwrap_or(name.as_os_str());
            io::copy(&mut plain, &mut File::create_new(folder.path().join(name))?)?;
        }
    } else if is_tar(&head) {
        tar::Archive::new(BufReader::new(file)).unpack(folder.path())?;
    } else {
        zip::ZipArchive::new(BufReader::new(file))?.extract(folder.path())?;
    }
    Ok(Some(folder))
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
    use std::io::Write;

    use super::*;

    /// Unpacks a file of `bytes` and returns the names of the files in the folder.
    fn names(bytes: &[u8]) -> io::Result<Option<Vec<String>>> {
        let mut file = tempfile::tempfile()?;
        file.write_all(bytes)?;
        file.rewind()?;
        let Some(folder) = unpack(Path::new("logs/all.log.gz"), file)? else { return Ok(None) };
        let entries =
            std::fs::read_dir(folder.path())?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()));
        entries.collect::<io::Result<Vec<String>>>().map(Some)
    }

    fn tar_archive(name: &str) -> Vec<u8> {
        let mut header = tar::Header::new_ustar();
        header.as_mut_bytes()[..name.len()].copy_from_slice(name.as_bytes());
        header.set_size(2);
        header.set_mode(0o644);
        header.set_cksum();
        [header.as_bytes().as_slice(), b"hi", &[0; 510], &[0; 1024]].concat()
    }

    fn zip_archive(name: &str) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(io::Cursor::new(Vec::new()));
        zip.start_file(name, zip::write::SimpleFileOptions::default()).expect("a file");
        zip.write_all(b"hi").expect("written");
        zip.finish().expect("an archive").into_inner()
    }

    fn gzip_file(bytes: &[u8]) -> Vec<u8> {
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(bytes).expect("written");
        gzip.finish().expect("an archive")
    }

    #[test]
    fn archives_of_every_kind_are_unpacked_and_nothing_else_is() {
        for bytes in [tar_archive("a.alog"), zip_archive("a.alog"), gzip_file(&tar_archive("a.alog"))] {
            assert_eq!(names(&bytes).expect("an archive"), Some(vec!["a.alog".to_owned()]));
        }
        // A compressed file is named after its archive, without the extension.
        assert_eq!(names(&gzip_file(b"% a log")).expect("an archive"), Some(vec!["all.log".to_owned()]));
        assert_eq!(names(b"% a log").expect("a file"), None);
        assert_eq!(names(b"").expect("a file"), None);
    }

    #[test]
    fn nothing_is_written_outside_of_the_folder() {
        let outside = std::env::temp_dir().join("pingmap-outside.alog");
        for name in ["../pingmap-outside.alog", "/tmp/pingmap-outside.alog", "a/../../pingmap-outside.alog"] {
            for bytes in [tar_archive(name), zip_archive(name), gzip_file(&tar_archive(name))] {
                // The archive may be refused, or its file may lie within the folder.
                let _ = names(&bytes);
                assert!(!outside.exists(), "{name}");
            }
        }
    }

    /// Archives with a changed byte or a missing end are unpacked or refused, without a panic.
    #[test]
    fn damaged_archives_are_errors() {
        for whole in
            [tar_archive("a.alog"), zip_archive("a.alog"), gzip_file(&tar_archive("a.alog")), gzip_file(b"% a log")]
        {
            let step = whole.len() / 60 + 1;
            for at in (0..whole.len()).step_by(step) {
                let mut changed = whole.clone();
                changed[at] ^= 0x55;
                let _ = (names(&changed), names(&whole[..at]));
            }
        }
    }
}
