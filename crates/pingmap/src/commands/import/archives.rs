//! Archives that were given as if they were folders.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

use flate2::read::MultiGzDecoder;
use pingmap_import::ImportError;
use pingmap_trial::open;
use tempfile::TempDir;

use crate::output::BadInput;

/// Where a tar archive says that it is one.
const TAR_MARK: (usize, &[u8]) = (257, b"ustar");

/// Unpacks a ZIP or tar archive, compressed with gzip or not, or a single file that is compressed so, to a folder that goes with
/// what is returned; `None` for a file that is none of these. Nothing is written outside of that folder.
pub fn unpacked(path: &Path) -> anyhow::Result<Option<TempDir>> {
    let fail = |error: io::Error| BadInput(format!("{}: cannot be unpacked: {error}", path.display()));
    let file = open(path).map_err(ImportError::from)?;
    unpack(path, file).map_err(|error| fail(error).into())
}

fn unpack(path: &Path, mut file: File) -> io::Result<Option<TempDir>> {
    let head = head(&mut file)?;
    file.rewind()?;
    let is_gzip = head.starts_with(&[0x1f, 0x8b]);
    if !is_gzip && !head.starts_with(b"PK\x03\x04") && !is_tar(&head) {
        return Ok(None);
    }
    // Its name stands in the names of the files in it, for errors to say where they are from.
    let mut prefix = path.file_name().map_or_else(OsString::new, OsString::from);
    prefix.push("-");
    let folder = tempfile::Builder::new().prefix(&prefix).tempdir()?;
    if is_gzip {
        let content = self::head(&mut MultiGzDecoder::new(BufReader::new(&mut file)))?;
        file.rewind()?;
        let mut plain = MultiGzDecoder::new(BufReader::new(file));
        if is_tar(&content) {
            tar::Archive::new(plain).unpack(folder.path())?;
        } else {
            let name = path.file_stem().unwrap_or(path.as_os_str());
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
