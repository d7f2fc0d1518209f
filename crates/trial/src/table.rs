//! Delimited text files read line by line, with errors that say where.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use csv::StringRecord;
use pingmap_agent::{Link, MessageKind, Position, VehicleId, bounds};

use crate::delimited::{Records, records};

/// Why a file could not be read: where, and what was expected.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: Problem,
}

/// What can be wrong with an input file. Lines count from 1.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// It could not be opened or read.
    #[error("cannot be read: {0}")]
    Unreadable(std::io::Error),
    /// It is not UTF-8 text.
    #[error("line {line}: not a text file; expected CSV in UTF-8")]
    NotText {
        /// The first line with other bytes.
        line: u64,
    },
    /// Columns are missing from the header.
    #[error(
        "line 1: the header lacks the column{} {}; expected {} in any order, found {found}",
        if missing.len() == 1 { "" } else { "s" }, missing.join(", "), expected.join(", ")
    )]
    MissingColumns {
        /// The columns that are missing.
        missing: Vec<String>,
        /// All columns that are required.
        expected: Vec<String>,
        /// The header as it stands, shortened.
        found: String,
    },
    /// A column stands in the header twice.
    #[error("line 1: the header has the column {column} more than once; expected each column once")]
    RepeatedColumn {
        /// The column.
        column: String,
    },
    /// A line has more or fewer fields than the header.
    #[error("line {line}: {found} fields; expected {expected}, as in the header")]
    Ragged {
        /// The line.
        line: u64,
        /// Fields in the header.
        expected: usize,
        /// Fields in the line.
        found: usize,
    },
    /// A field holds something else than its column says.
    #[error("line {line}, column {column}: found {value:?}; expected {expected}")]
    BadValue {
        /// The line.
        line: u64,
        /// The column.
        column: String,
        /// The field, shortened.
        value: String,
        /// What the column holds.
        expected: &'static str,
    },
    /// A remark names a reference system that is none.
    #[error(
        "line {line}: found the reference system {name:?}; expected the latitude and longitude of (0, 0), such as 41.52,-70.67, or EPSG:32619"
    )]
    BadReference {
        /// The line.
        line: u64,
        /// What it says.
        name: String,
    },
    /// There is a header and nothing else, or nothing at all.
    #[error("no {what}; expected at least one line after the header")]
    Empty {
        /// What there is none of.
        what: &'static str,
    },
    /// A file of splits has another number of rows than the log has events.
    #[error("{found} rows of splits; expected one per event of the log: {expected}")]
    WrongLength {
        /// Events in the log.
        expected: usize,
        /// Rows in the file.
        found: usize,
    },
}

/// Opens a file to read.
///
/// # Errors
/// [`Problem::Unreadable`], for a folder too.
pub fn open(path: &Path) -> Result<std::fs::File, FileError> {
    let unreadable = |error| FileError { path: path.to_owned(), problem: Problem::Unreadable(error) };
    let file = std::fs::File::open(path).map_err(unreadable)?;
    if file.metadata().map_err(unreadable)?.is_dir() {
        return Err(unreadable(std::io::Error::from(std::io::ErrorKind::IsADirectory)));
    }
    Ok(file)
}

/// A text file of records with a header, read line by line, with errors that say where. Fields are separated by commas, semicolons or
/// tabs, whichever its header has; lines that begin with `#` are remarks; columns are known by their names in upper or lower case.
pub struct Table<'a> {
    reader: Records<'a>,
    path: PathBuf,
    header: Vec<String>,
    /// The lines before the header.
    remarks: Vec<String>,
    /// Where each column of the header stands, by its name in lower case.
    places: HashMap<String, usize>,
    record: StringRecord,
    line: u64,
}

impl<'a> Table<'a> {
    /// Reads the header; `path` stands for the file in errors.
    ///
    /// # Errors
    /// [`FileError`] where it is no text, lacks columns that are required, or has one twice.
    pub fn new(reader: impl Read + 'a, path: &Path, required: &[&str]) -> Result<Self, FileError> {
        let fail = |problem| FileError { path: path.to_owned(), problem };
        let (mut reader, remarks) = records(reader).map_err(|error| fail(Problem::Unreadable(error)))?;
        let header = reader.headers().map_err(|error| fail(problem_of(&error, 1)))?;
        // Spreadsheets put a byte-order mark before the first column.
        let header: Vec<String> = header.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect();
        let mut places = HashMap::with_capacity(header.len());
        for (place, column) in header.iter().enumerate() {
            // What has no name (an index, or a separator at the end of lines) is never asked for.
            if !column.is_empty() && places.insert(column.to_lowercase(), place).is_some() {
                return Err(fail(Problem::RepeatedColumn { column: column.clone() }));
            }
        }
        let table =
            Self { reader, path: path.to_owned(), header, remarks, places, record: StringRecord::new(), line: 1 };
        table.require(required)?;
        Ok(table)
    }

    /// Fails where columns are missing, given in lower case.
    ///
    /// # Errors
    /// [`Problem::MissingColumns`].
    pub fn require(&self, required: &[&str]) -> Result<(), FileError> {
        let missing: Vec<String> =
            required.iter().filter(|name| !self.has(name)).map(|name| name.to_string()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let expected = required.iter().map(|name| name.to_string()).collect();
        Err(self.error(Problem::MissingColumns { missing, expected, found: shorten(&self.header.join(",")) }))
    }

    /// The names of the columns as they stand in the file.
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// The remarks and empty lines before the header, as they stand in the file.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// Goes to the next line; false at the end.
    ///
    /// # Errors
    /// [`FileError`] where a line is no text or has more or fewer fields than the header.
    #[expect(clippy::should_implement_trait, reason = "a line is looked at where it is, and not handed out")]
    pub fn next(&mut self) -> Result<bool, FileError> {
        let more = self.reader.read_record(&mut self.record);
        // Every line was ended, so the reader stands behind that of the record; where it began there may have been remarks.
        let within: usize = self.record.iter().map(|field| field.matches('\n').count()).sum();
        self.line = (self.reader.position().line() - 1).saturating_sub(within as u64);
        let more = more.map_err(|error| self.error(problem_of(&error, self.line)))?;
        let (expected, found) = (self.header.len(), self.record.len());
        if more && found != expected {
            return Err(self.error(Problem::Ragged { line: self.line, expected, found }));
        }
        Ok(more)
    }

    /// An error about this file.
    pub fn error(&self, problem: Problem) -> FileError {
        FileError { path: self.path.clone(), problem }
    }

    /// The number of the line, from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Whether there is a column of this name, given in lower case.
    pub fn has(&self, column: &str) -> bool {
        self.place(column).is_some()
    }

    fn place(&self, column: &str) -> Option<usize> {
        self.places.get(column).copied()
    }

    /// The field in a column; empty where there is no such column.
    pub fn field(&self, column: &str) -> &str {
        self.place(column).and_then(|place| self.record.get(place)).unwrap_or_default()
    }

    /// The fields of the line as they stand in the file.
    pub fn fields(&self) -> Vec<String> {
        self.record.iter().map(str::to_owned).collect()
    }

    /// What this field holds is not what its column should.
    pub fn bad(&self, column: &str, expected: &'static str) -> FileError {
        let (column, value) = (column.to_owned(), shorten(self.field(column)));
        self.error(Problem::BadValue { line: self.line, column, value, expected })
    }

    /// A finite number.
    ///
    /// # Errors
    /// [`Problem::BadValue`] for anything else, as all that follow.
    pub fn number(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| self.bad(column, "a finite number"))
    }

    pub(crate) fn probability(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().filter(|number| (0.0..=1.0).contains(number));
        number.ok_or_else(|| self.bad(column, "a probability from 0 to 1"))
    }

    /// Yes or no, as [`flag`] reads it.
    ///
    /// # Errors
    /// [`Problem::BadValue`] for anything else.
    pub fn flag(&self, column: &str) -> Result<bool, FileError> {
        self.flag_at(self.place(column).unwrap_or(usize::MAX))
    }

    /// The flag in the n-th column.
    pub(crate) fn flag_at(&self, place: usize) -> Result<bool, FileError> {
        let flag = self.record.get(place).and_then(flag);
        flag.ok_or_else(|| self.bad(&self.header.get(place).map_or(String::new(), |name| name.to_lowercase()), FLAG))
    }

    /// The name of a vehicle.
    ///
    /// # Errors
    /// [`Problem::BadValue`] without one.
    pub fn vehicle(&self, column: &str) -> Result<VehicleId, FileError> {
        let name = self.field(column);
        if name.is_empty() || name.contains(char::is_control) {
            return Err(self.bad(column, "the name of a vehicle, without control characters"));
        }
        Ok(VehicleId::new(name))
    }

    /// The kind of message, if it is said: by `kind`, or by what there is of `rate`, `band`, `level` and `length`.
    ///
    /// # Errors
    /// [`Problem::BadValue`] for names with control characters.
    pub fn kind(&self) -> Result<Option<MessageKind>, FileError> {
        self.kind_by(&["rate", "band", "level", "length"])
    }

    /// The same by `kind`, or by what there is of these columns.
    ///
    /// # Errors
    /// As [`Table::kind`].
    pub fn kind_by(&self, columns: &[&str]) -> Result<Option<MessageKind>, FileError> {
        let said = |column: &str| {
            let value = if self.has(column) { self.field(column) } else { "" };
            let is_name = !value.contains(char::is_control);
            is_name.then_some(value).ok_or_else(|| self.bad(column, "a kind of message, without control characters"))
        };
        let kind = said("kind")?;
        if !kind.is_empty() {
            return Ok(Some(MessageKind::new(kind)));
        }
        let mut parts = Vec::new();
        for column in columns {
            let value = said(column)?;
            parts.extend((!value.is_empty()).then(|| format!("{column} {value}")));
        }
        Ok((!parts.is_empty()).then(|| MessageKind::new(parts.join(", "))))
    }

    /// A coordinate in metres.
    ///
    /// # Errors
    /// [`Problem::BadValue`] for what is none.
    pub fn metres(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().and_then(|number| bounds::COORDINATE_M.check(number));
        number.ok_or_else(|| self.bad(column, bounds::COORDINATE_M.words))
    }

    pub(crate) fn link(&self, has_depths: bool) -> Result<Link, FileError> {
        let end = |east, north, depth| {
            let depth_m = if has_depths { Some(self.metres(depth)?) } else { None };
            Ok(Position { east_m: self.metres(east)?, north_m: self.metres(north)?, depth_m })
        };
        Ok(Link {
            transmitter: end("tx_easting_m", "tx_northing_m", "tx_depth_m")?,
            receiver: end("rx_easting_m", "rx_northing_m", "rx_depth_m")?,
        })
    }
}

/// What a flag may be.
const FLAG: &str = "0 or 1, no or yes, false or true";

/// Yes or no: 1, 1.0, true, yes; 0, 0.0, false, no; in upper or lower case.
pub fn flag(text: &str) -> Option<bool> {
    let is_one_of = |words: [&str; 4]| words.iter().any(|word| text.eq_ignore_ascii_case(word));
    let yes = is_one_of(["1", "1.0", "true", "yes"]);
    (yes || is_one_of(["0", "0.0", "false", "no"])).then_some(yes)
}

/// What the CSV reader met, in our words.
fn problem_of(error: &csv::Error, line: u64) -> Problem {
    match error.kind() {
        csv::ErrorKind::Utf8 { .. } => Problem::NotText { line },
        csv::ErrorKind::Io(error) => Problem::Unreadable(std::io::Error::new(error.kind(), error.to_string())),
        _ => Problem::Unreadable(std::io::Error::other(error.to_string())),
    }
}

/// At most 80 characters of a text.
fn shorten(text: &str) -> String {
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
