//! Output targets. A target is checked before the work, so that no file is overwritten by mistake and errors come
//! early.

use std::fs::Metadata;
use std::path::Path;

use anyhow::Context;
use clap::Args;

use crate::figure::Image;
use crate::files::{make_folder, try_folder, write_file};
use crate::output::{BadInput, Results, note, print_text};

/// The file name that stands for standard output.
pub const STANDARD_OUTPUT: &str = "-";

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

/// Help heading of the options that select the output.
pub const RESULT: &str = "Result";

/// Files that a report may contain.
const REPORT_FILES: [&str; 4] = ["map.png", "packets.png", "online.png", "index.html"];

/// Permission to replace existing files.
#[derive(Args, Clone, Copy)]
pub struct Overwrite {
    /// Replace existing files
    #[arg(help_heading = RESULT, long)]
    overwrite: bool,
}

impl Overwrite {
    /// Checks that a file can be written, is not an input, and does not exist unless it may be replaced.
    pub fn target<'a>(self, path: &'a Path, inputs: &[&Path]) -> anyhow::Result<Target<'a>> {
        if path == Path::new(STANDARD_OUTPUT) {
            return Ok(Target { path });
        }
        let name = path.display();
        if inputs.iter().any(|input| is_same(input, path)) {
            let message = format!("{name} is read and would be written; expected another name for the result");
            return Err(BadInput(message).into());
        }
        match path.metadata() {
            Ok(metadata) if metadata.is_dir() => {
                return Err(BadInput(format!("{name} is a folder; expected a file")).into());
            }
            Ok(metadata) if metadata.is_file() && !self.overwrite => {
                let message = format!("{name} exists; expected another name, or --overwrite to replace the file");
                return Err(BadInput(message).into());
            }
            _ => {}
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(anyhow::anyhow!("cannot write {name}: there is no folder {}", folder.display()));
        }
        try_folder(path, folder).with_context(|| format!("cannot write {name}"))?;
        Ok(Target { path })
    }

    /// Creates the folder of a report, and checks the files of the report as [`Overwrite::target`] does.
    pub fn report_folder(self, folder: &Path, inputs: &[&Path]) -> anyhow::Result<()> {
        make_folder(folder)?;
        REPORT_FILES.iter().try_for_each(|name| self.target(&folder.join(name), inputs).map(drop))
    }

    /// Refuses a folder that contains files, unless they may be replaced.
    pub fn empty_folder(self, folder: &Path) -> anyhow::Result<()> {
        if !folder.exists() || self.overwrite {
            return Ok(());
        }
        let name = folder.display();
        let mut entries = std::fs::read_dir(folder).with_context(|| format!("cannot look into {name}"))?;
        match entries.next() {
            None => Ok(()),
            Some(_) => {
                let message = "is not empty; expected another folder, or --overwrite to replace its files";
                Err(BadInput(format!("{name} {message}")).into())
            }
        }
    }
}

/// Path of a result that can be written.
pub struct Target<'a> {
    path: &'a Path,
}

impl Target<'_> {
    /// Refuses standard output as the target if a JSON object is printed there, too.
    pub fn with_json(self, json: bool) -> anyhow::Result<Self> {
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
    pub fn print_message(&self, text: &str, results: Results) -> anyhow::Result<()> {
        if self.is_standard_output() {
            note(text);
            return Ok(());
        }
        print_text(results, text)
    }
}

/// Whether two paths lead to one file, also through symbolic or hard links.
fn is_same(a: &Path, b: &Path) -> bool {
    match (a.metadata(), b.metadata()) {
        (Ok(metadata_a), Ok(metadata_b)) => match (identity(&metadata_a), identity(&metadata_b)) {
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
