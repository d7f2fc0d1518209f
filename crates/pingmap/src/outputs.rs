//! Output targets. A target is checked before the work, so that no file is overwritten by mistake and errors come
//! early.

use std::fs::{File, Metadata};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::Context;

use crate::figure::Image;
use crate::files::{make_folder, try_folder, write_file};
use crate::output::{BadInput, Results, note, print};

/// The file name that stands for standard output.
pub const STANDARD_OUTPUT: &str = "-";

/// Bytes at the start and at the end of a file that are searched for signs of its writer.
const LOOKED_AT_BYTES: u64 = 1 << 20;
const LAST_BYTES: u64 = 1 << 16;

/// A kind of file that pingmap writes. It is recognised by the first megabyte and the end of the text.
#[derive(Clone, Copy)]
pub struct Kind(fn(&str) -> bool);

impl Kind {
    pub const EVENT_LOG: Kind = Kind(is_event_log);
    pub const SPLITS: Kind = Kind(is_splits);
    pub const PREDICTIONS: Kind = Kind(|text| {
        let header = text.lines().next().unwrap_or_default();
        header.contains("probability,lower,upper,log_odds_mean") || header.contains("mean,variance,probability")
    });
    pub const PREDICTIONS_JSON: Kind = Kind(|text| text.starts_with('{') && text.contains("\"predictions\""));
    pub const GRID: Kind = Kind(|text| {
        text.starts_with("easting_m,northing_m,")
            && text.lines().next().is_some_and(|header| header.contains("probability"))
    });
    pub const PLAN: Kind = Kind(|text| {
        let header = text.lines().next().unwrap_or_default();
        ["bearing_deg,range_m,", "leg,time_s,", "name,easting_m,northing_m,share,"]
            .iter()
            .any(|columns| header.starts_with(columns))
    });
    pub const PNG: Kind = Kind(|text| text.contains("PNG") && text.contains("kuva"));
    pub const SVG: Kind = Kind(|text| text.starts_with("<svg") && text.contains("kuva"));
    pub const PDF: Kind = Kind(|text| text.starts_with("%PDF") && text.contains("kuva"));
    pub const GEO_JSON: Kind = Kind(|text| {
        let is_ours = text.contains("\"generator\": \"pingmap\"") || text.contains("\"seen_from\"");
        text.starts_with('{') && is_ours
    });
    pub const KML: Kind = Kind(|text| text.contains("<kml") && text.contains("Written by pingmap"));
    pub const GEO_TIFF: Kind = Kind(|text| text.starts_with("II*") && text.contains("pingmap"));
    pub const MODEL: Kind = Kind(|text| text.starts_with("# A model of how links behave: "));
    pub const TEAM: Kind = Kind(|text| text.starts_with("schema = ") && text.contains("model_file = "));
    pub const PAGE: Kind = Kind(|text| text.starts_with("<!DOCTYPE html>") && text.contains("<title>pingmap"));
    pub const MANUAL: Kind = Kind(|text| text.contains("\n.TH pingmap"));
    pub const REPRODUCTION: Kind = Kind(|text| text.contains("Written by `pingmap reproduce"));

    pub fn of(image: Image) -> Self {
        match image {
            Image::Png => Kind::PNG,
            Image::Svg => Kind::SVG,
            Image::Pdf => Kind::PDF,
        }
    }

    fn is_of(self, path: &Path) -> anyhow::Result<bool> {
        let (mut bytes, mut file) = (Vec::new(), File::open(path)?);
        file.by_ref().take(LOOKED_AT_BYTES).read_to_end(&mut bytes)?;
        let length = file.metadata()?.len();
        if length > LOOKED_AT_BYTES {
            // The end of a large file may contain a sign of its writer, too.
            file.seek(SeekFrom::Start((length - LAST_BYTES).max(LOOKED_AT_BYTES)))?;
            file.read_to_end(&mut bytes)?;
        }
        Ok(bytes.is_empty() || self.0(&String::from_utf8_lossy(&bytes)))
    }
}

/// Returns the extension of a file name in lower case.
pub fn ending(path: &Path) -> String {
    path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_lowercase()
}

/// Returns the image format that the extension requests, if any.
pub fn picture(path: &Path) -> Result<Option<Image>, BadInput> {
    match Image::of(&ending(path)) {
        Some(image) if !image.is_possible() => Err(BadInput(format!(
            "{}: this pingmap was built without PDF; expected .svg or .png, or a build with --features pdf",
            path.display()
        ))),
        image => Ok(image),
    }
}

/// Whether a text has the columns of an event log, with or without a line about the reference system.
fn is_event_log(text: &str) -> bool {
    let header = text.lines().find(|line| !line.starts_with("# reference system:"));
    header.is_some_and(|header| header.starts_with("time_s,tx_id,rx_id,tx_easting_m,"))
}

/// Whether all lines after the header contain only zeros and ones.
fn is_splits(text: &str) -> bool {
    let mut lines = text.lines().skip(1).peekable();
    lines.peek().is_some() && lines.all(|line| !line.is_empty() && line.bytes().all(|byte| b"01,".contains(&byte)))
}

/// Path of a result.
pub struct Target<'a> {
    path: &'a Path,
}

impl<'a> Target<'a> {
    /// Checks that a file can be written, is not an input, and was written by pingmap if it exists. With `overwrite`
    /// the last check is skipped.
    pub fn new(path: &'a Path, kind: Kind, inputs: &[&Path], overwrite: bool) -> anyhow::Result<Self> {
        if path == Path::new(STANDARD_OUTPUT) {
            return Ok(Self { path });
        }
        let name = path.display();
        if inputs.iter().any(|input| is_same(input, path)) {
            return Err(
                BadInput(format!("{name} is read and would be written; expected another name for the result")).into()
            );
        }
        match path.metadata() {
            Ok(known) if known.is_dir() => return Err(BadInput(format!("{name} is a folder; expected a file")).into()),
            Ok(known) if known.is_file() => {
                let is_ours = overwrite
                    || kind.is_of(path).with_context(|| format!("cannot look at {name}, which would be replaced"))?;
                if !is_ours {
                    let message =
                        "is there and was not written by pingmap; expected another name, or --overwrite to replace it";
                    return Err(BadInput(format!("{name} {message}")).into());
                }
            }
            // A device or pipe, or a new file.
            _ => {}
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(anyhow::anyhow!("cannot write {name}: there is no folder {}", folder.display()));
        }
        try_folder(path, folder).with_context(|| format!("cannot write {name}"))?;
        Ok(Self { path })
    }

    /// Creates the folder of a report and checks its page and figures.
    pub fn page(folder: &Path, overwrite: bool) -> anyhow::Result<()> {
        make_folder(folder)?;
        for picture in ["map.png", "packets.png", "online.png"] {
            Target::new(&folder.join(picture), Kind::PNG, &[], overwrite)?;
        }
        Target::new(&folder.join("index.html"), Kind::PAGE, &[], overwrite).map(drop)
    }

    /// Refuses standard output as the target if a JSON object is printed there, too.
    pub fn beside_json(self, json: bool) -> anyhow::Result<Self> {
        if json && self.is_standard_output() {
            let message =
                "--json and -o - both write to standard output; expected one of them, or another name for the result";
            return Err(BadInput(message.into()).into());
        }
        Ok(self)
    }

    /// Whether the result goes to standard output.
    pub fn is_standard_output(&self) -> bool {
        self.path == Path::new(STANDARD_OUTPUT)
    }

    /// Writes the result to the file or to standard output.
    pub fn write(&self, bytes: &[u8], results: Results) -> anyhow::Result<()> {
        if self.is_standard_output() {
            results.write_all(bytes)?;
            return Ok(results.flush()?);
        }
        write_file(self.path, bytes)
    }

    /// Writes a text, or prints it if writing fails, so that the result of long work is not lost.
    pub fn write_or_print(&self, text: &str, results: Results) -> anyhow::Result<()> {
        let written = self.write(text.as_bytes(), results);
        if written.is_err() && !self.is_standard_output() {
            results.write_all(text.as_bytes())?;
            results.flush()?;
        }
        written
    }

    /// Prints a message about the result: to standard output, or to standard error if the result goes to standard
    /// output.
    pub fn tell(&self, text: &str, results: Results) -> anyhow::Result<()> {
        if self.is_standard_output() {
            note(text);
            return Ok(());
        }
        print(results, text)
    }
}

/// Whether two paths lead to one file, also through symbolic or hard links.
fn is_same(a: &Path, b: &Path) -> bool {
    match (a.metadata(), b.metadata()) {
        (Ok(known_a), Ok(known_b)) => match (identity(&known_a), identity(&known_b)) {
            (Some(a), Some(b)) => a == b,
            _ => a.canonicalize().ok() == b.canonicalize().ok(),
        },
        _ => false,
    }
}

/// Returns device and inode of a file, on systems that have them.
#[cfg(unix)]
fn identity(file: &Metadata) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    Some((file.dev(), file.ino()))
}

#[cfg(not(unix))]
fn identity(_: &Metadata) -> Option<(u64, u64)> {
    None
}
