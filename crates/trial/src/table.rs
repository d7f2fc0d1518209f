//! CSV files read line by line, with errors that say where.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use csv::StringRecord;
use pingmap_agent::{Link, MessageKind, Position, VehicleId, bounds};

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
pub(crate) fn open(path: &Path) -> Result<std::fs::File, FileError> {
    let unreadable = |error| FileError { path: path.to_owned(), problem: Problem::Unreadable(error) };
    let file = std::fs::File::open(path).map_err(unreadable)?;
    if file.metadata().map_err(unreadable)?.is_dir() {
        return Err(unreadable(std::io::Error::from(std::io::ErrorKind::IsADirectory)));
    }
    Ok(file)
}

/// A CSV file read line by line, with errors that say where.
pub(crate) struct Table<R> {
    reader: csv::Reader<R>,
    path: PathBuf,
    pub(crate) header: Vec<String>,
    /// Where each column of the header stands.
    places: HashMap<String, usize>,
    record: StringRecord,
    line: u64,
}

impl<R: Read> Table<R> {
    pub(crate) fn new(reader: R, path: &Path, required: &[&str]) -> Result<Self, FileError> {
        // Flexible, so that bytes that are no text are found before a wrong number of fields.
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(reader);
        let fail = |problem| FileError { path: path.to_owned(), problem };
        let header = reader.headers().map_err(|error| fail(problem_of(&error)))?;
        // Spreadsheets put a byte-order mark before the first column.
        let header: Vec<String> = header.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect();
        let mut places = HashMap::with_capacity(header.len());
        for (place, column) in header.iter().enumerate() {
            if places.insert(column.clone(), place).is_some() {
                return Err(fail(Problem::RepeatedColumn { column: column.clone() }));
            }
        }
        let missing = required.iter().filter(|name| !places.contains_key(**name));
        let missing: Vec<String> = missing.map(|name| name.to_string()).collect();
        if !missing.is_empty() {
            let expected = required.iter().map(|name| name.to_string()).collect();
            return Err(fail(Problem::MissingColumns { missing, expected, found: shorten(&header.join(",")) }));
        }
        Ok(Self { reader, path: path.to_owned(), header, places, record: StringRecord::new(), line: 1 })
    }

    /// Goes to the next line; false at the end.
    pub(crate) fn next(&mut self) -> Result<bool, FileError> {
        let more = self.reader.read_record(&mut self.record).map_err(|error| self.error(problem_of(&error)))?;
        self.line = self.record.position().map_or(self.line, |position| position.line());
        let (expected, found) = (self.header.len(), self.record.len());
        if more && found != expected {
            return Err(self.error(Problem::Ragged { line: self.line, expected, found }));
        }
        Ok(more)
    }

    pub(crate) fn error(&self, problem: Problem) -> FileError {
        FileError { path: self.path.clone(), problem }
    }

    pub(crate) fn has(&self, column: &str) -> bool {
        self.place(column).is_some()
    }

    fn place(&self, column: &str) -> Option<usize> {
        self.places.get(column).copied()
    }

    /// The field in a column that is known to exist.
    fn field(&self, column: &str) -> &str {
        self.place(column).and_then(|place| self.record.get(place)).unwrap_or_default()
    }

    fn bad(&self, column: &str, expected: &'static str) -> FileError {
        let (column, value) = (column.to_owned(), shorten(self.field(column)));
        self.error(Problem::BadValue { line: self.line, column, value, expected })
    }

    pub(crate) fn number(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| self.bad(column, "a finite number"))
    }

    pub(crate) fn probability(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().filter(|number| (0.0..=1.0).contains(number));
        number.ok_or_else(|| self.bad(column, "a probability from 0 to 1"))
    }

    pub(crate) fn flag(&self, column: &str) -> Result<bool, FileError> {
        self.flag_at(self.place(column).unwrap_or(usize::MAX))
    }

    /// The flag in the n-th column.
    pub(crate) fn flag_at(&self, place: usize) -> Result<bool, FileError> {
        match self.record.get(place) {
            Some("1") => Ok(true),
            Some("0") => Ok(false),
            _ => Err(self.bad(self.header.get(place).map_or("", String::as_str), "0 or 1")),
        }
    }

    pub(crate) fn vehicle(&self, column: &str) -> Result<VehicleId, FileError> {
        let name = self.field(column);
        if name.is_empty() || name.contains(char::is_control) {
            return Err(self.bad(column, "the name of a vehicle, without control characters"));
        }
        Ok(VehicleId::new(name))
    }

    /// The kind of message, if it is said.
    pub(crate) fn kind(&self) -> Result<Option<MessageKind>, FileError> {
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
        for column in ["rate", "band", "level", "length"] {
            let value = said(column)?;
            parts.extend((!value.is_empty()).then(|| format!("{column} {value}")));
        }
        Ok((!parts.is_empty()).then(|| MessageKind::new(parts.join(", "))))
    }

    fn metres(&self, column: &str) -> Result<f64, FileError> {
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

/// What the CSV reader met, in our words.
fn problem_of(error: &csv::Error) -> Problem {
    let line_of = |position: &Option<csv::Position>| position.as_ref().map_or(1, |position| position.line());
    match error.kind() {
        csv::ErrorKind::Utf8 { pos, .. } => Problem::NotText { line: line_of(pos) },
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
