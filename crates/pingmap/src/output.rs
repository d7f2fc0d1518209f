//! Prints results, warnings and progress.

use std::fmt::Display;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context;
use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, Table, Width};
use indicatif::{ProgressBar, ProgressStyle};
use pingmap_agent::Interrupt;
use pingmap_import::ImportError;
use pingmap_trial::{FileError, ReplayError};
use serde::Serialize;

use crate::warnings::Warnings;

/// An error in the user's input, as a message. Exit status 2.
#[derive(Debug)]
pub struct BadInput(pub String);

impl Display for BadInput {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for BadInput {}

impl BadInput {
    /// Whether bad input caused the error. Other errors are failures of the program or the system.
    pub fn is_behind(error: &anyhow::Error) -> bool {
        error.chain().any(|cause| {
            let nothing_held_out = matches!(cause.downcast_ref(), Some(ReplayError::NothingHeldOut { .. }));
            nothing_held_out || cause.is::<BadInput>() || cause.is::<FileError>() || cause.is::<ImportError>()
        })
    }
}

/// Longest model, team, key and other text file, in bytes.
const TEXT_BYTES_MAX: u64 = 16 << 20;

/// Reads a text file.
pub fn read_text(path: &Path) -> anyhow::Result<String> {
    let fail = |problem: &dyn Display| BadInput(format!("{}: cannot read it: {problem}", path.display()));
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(TEXT_BYTES_MAX + 1).read_to_end(&mut bytes));
    if read.map_err(|error| fail(&error))? as u64 > TEXT_BYTES_MAX {
        return Err(fail(&"it is longer than 16 MB; expected a smaller file").into());
    }
    Ok(String::from_utf8(bytes).map_err(|error| fail(&error))?)
}

/// Whether the reader of standard output closed it.
pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let broken = |cause: &std::io::Error| cause.kind() == std::io::ErrorKind::BrokenPipe;
    error.chain().any(|cause| cause.downcast_ref().is_some_and(broken))
}

/// The writer of results. It also returns the command line that requested them.
pub trait Out: Write + Send {
    /// Returns the arguments of the command line.
    fn command(&self) -> &[String];

    /// Returns all commands and options.
    fn definition(&self) -> clap::Command;
}

/// A writer of results.
pub type Results<'a> = &'a mut dyn Out;

/// Prints a result.
pub fn print(out: Results, text: &str) -> anyhow::Result<()> {
    writeln!(out, "{}", text.trim_end())?;
    Ok(out.flush()?)
}

/// Largest number of columns of printed texts and tables.
const COLUMNS_MAX: usize = 100;

/// Prints a text, and breaks its long lines between words.
pub fn print_text(out: Results, text: &str) -> anyhow::Result<()> {
    print(out, &text.lines().map(wrapped).collect::<Vec<_>>().join("\n"))
}

/// Breaks a long line between words. The parts are indented like the line.
fn wrapped(line: &str) -> String {
    if line.chars().count() <= COLUMNS_MAX {
        return line.to_owned();
    }
    let indent = &line[..line.len() - line.trim_start().len()];
    let mut text = String::new();
    let mut columns = COLUMNS_MAX;
    for word in line.split_whitespace() {
        let width = word.chars().count();
        let separator = if columns + 1 + width > COLUMNS_MAX { format!("\n{indent}") } else { " ".to_owned() };
        columns = if separator == " " { columns + 1 + width } else { indent.len() + width };
        text = text + &separator + word;
    }
    text.trim_start_matches('\n').to_owned()
}

/// Prints one JSON object with the version and the command line added. Keys are in alphabetical order.
pub fn print_json(out: Results, value: &impl Serialize) -> anyhow::Result<()> {
    let text = json_text(out, value)?;
    print(out, &text)
}

/// Returns the text that [`print_json`] prints.
pub fn json_text(out: &dyn Out, value: &impl Serialize) -> anyhow::Result<String> {
    let mut value = serde_json::to_value(value)?;
    if let Some(object) = value.as_object_mut() {
        object.insert("version".into(), env!("CARGO_PKG_VERSION").into());
        object.insert("command".into(), out.command().into());
    }
    Ok(serde_json::to_string_pretty(&value)?)
}

/// Whether notes and progress are suppressed.
static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Suppresses notes and progress from now on. Results, warnings and errors are still printed.
pub fn be_quiet(quiet: bool) {
    IS_QUIET.store(quiet, Ordering::Relaxed);
}

fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Prints a note to standard error, unless notes are suppressed.
pub fn note(text: impl Display) {
    if !is_quiet() {
        eprintln!("{text}");
    }
}

/// Appends a warning to the list of this thread, or prints it to standard error.
pub fn warn(text: impl Display) {
    match Warnings::attached() {
        Some(warnings) => warnings.push(text.to_string()),
        None => eprintln!("warning: {text}"),
    }
}

/// Formats a number and a noun, such as "1 event" or "2 events".
pub fn count(number: usize, noun: &str) -> String {
    if number == 1 { format!("1 {noun}") } else { format!("{number} {noun}s") }
}

/// Formats a table with plain rules. The first column is left-aligned, the others right-aligned. Names and headers are
/// broken between words if the table is too wide.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    table_of(header, rows)
}

/// Formats a table as [`table`] does, with a header of any text type.
pub fn table_of(header: &[impl ToString], rows: &[Vec<String>]) -> String {
    let mut table = Table::new();
    table.load_preset("     --            ").set_header(header.iter().map(|name| name.to_string()));
    table.set_content_arrangement(ContentArrangement::Dynamic).set_width(COLUMNS_MAX as u16);
    rows.iter().for_each(|row| {
        table.add_row(row);
    });
    for column in table.column_iter_mut() {
        let alignment = if column.index == 0 { CellAlignment::Left } else { CellAlignment::Right };
        column.set_cell_alignment(alignment);
        column.set_padding((1, 0));
        let cells = rows.iter().filter_map(|row| row.get(column.index)).map(String::as_str);
        if let Some(width) = width_of_numbers(cells, &header[column.index].to_string()) {
            column.set_constraint(ColumnConstraint::LowerBoundary(Width::Fixed(width as u16 + 1)));
        }
    }
    table.lines().map(|line| line.trim_end().to_owned()).collect::<Vec<_>>().join("\n")
}

/// Returns the smallest width of a column of numbers: that of its numbers and of the words of its header. Other columns
/// have none.
fn width_of_numbers<'a>(cells: impl Iterator<Item = &'a str> + Clone, header: &'a str) -> Option<usize> {
    let are_numbers = !cells.clone().any(|cell| cell.starts_with(char::is_alphabetic));
    let widths = cells.chain(header.split_whitespace()).map(|text| text.chars().count());
    widths.max().filter(|_| are_numbers)
}

/// Returns a progress bar on standard error. It is hidden unless standard error is a terminal.
pub fn progress(steps: u64, what: &'static str) -> ProgressBar {
    let bar = if is_quiet() { ProgressBar::hidden() } else { ProgressBar::new(steps).with_message(what) };
    if let Ok(style) = ProgressStyle::with_template("{msg} [{bar:30}] {pos}/{len} {elapsed} (left: {eta})") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Returns a progress bar that counts bytes.
pub fn progress_of_bytes(bytes: u64, what: &'static str) -> ProgressBar {
    let bar = progress(bytes, what);
    if let Ok(style) = ProgressStyle::with_template("{msg} [{bar:30}] {bytes}/{total_bytes} {elapsed} (left: {eta})") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// Returns a progress indicator for work of unknown length.
pub fn spinner(what: &'static str) -> ProgressBar {
    let bar = if is_quiet() { ProgressBar::hidden() } else { ProgressBar::new_spinner().with_message(what) };
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Runs a function on a pool of `threads` worker threads; 0 uses one per core. The interrupt stops all of them. They
/// have the list of warnings of this thread.
pub fn with_threads(
    threads: usize,
    interrupt: &Interrupt,
    run: impl FnOnce() -> anyhow::Result<()> + Send,
) -> anyhow::Result<()> {
    let (interrupt, warnings) = (interrupt.clone(), Warnings::attached());
    let attach = move |_| {
        interrupt.attach();
        warnings.iter().for_each(Warnings::attach);
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(attach);
    pool.build().context("cannot start worker threads")?.install(run)
}

/// Formats numbers as CSV, each in the shortest form that parses to an equal number.
pub fn csv_text(header: &[&str], rows: &[Vec<f64>]) -> anyhow::Result<String> {
    csv_of_text(header, rows.iter().map(|row| row.iter().map(ToString::to_string).collect::<Vec<_>>()))
}

/// Formats fields as CSV.
pub fn csv_of_text(header: &[impl AsRef<[u8]>], rows: impl IntoIterator<Item = Vec<String>>) -> anyhow::Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header)?;
    for row in rows {
        writer.write_record(row)?;
    }
    Ok(String::from_utf8(writer.into_inner().map_err(|error| error.into_error())?)?)
}
