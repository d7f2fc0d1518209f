//! Reads delimited text line by line. Errors name file, line and column.

use std::cell::Cell;
use std::collections::{HashMap, HashSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use csv::StringRecord;
use pingmap_agent::{Link, MessageKind, Position, VehicleId, bounds};

use crate::delimited::{Delimited, Records};

/// Error of an input file: the position of the problem, and the expected content.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// The problem.
    pub problem: Problem,
}

/// Problem of an input file. Lines count from 1.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The file could not be opened or read.
    #[error("cannot be read: {0}")]
    Unreadable(std::io::Error),
    /// The file is neither UTF-8 nor Windows-1252 text.
    #[error("line {line}: not a text file; expected CSV in UTF-8 or Windows-1252 (save other encodings as UTF-8)")]
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
        /// The header of the file, shortened.
        found: String,
    },
    /// A column occurs more than once in the header.
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
    /// A field has a value that its column does not allow.
    #[error("line {line}, column {column}: found {value:?}; expected {expected}")]
    BadValue {
        /// The line.
        line: u64,
        /// The column.
        column: String,
        /// The field, shortened.
        value: String,
        /// Values that the column allows.
        expected: &'static str,
    },
    /// A remark names an invalid reference system.
    #[error(
        "line {line}: found the reference system {name:?}; expected the latitude and longitude of (0, 0), such as 41.52,-70.67, or EPSG:32619"
    )]
    BadReference {
        /// The line.
        line: u64,
        /// The name in the remark.
        name: String,
    },
    /// The file has no lines after the header.
    #[error("no {what}; expected at least one line after the header")]
    Empty {
        /// Kind of the missing content.
        what: &'static str,
    },
    /// A file of splits has a different number of rows than the log has events.
    #[error("{found} rows of splits; expected one per event of the log: {expected}")]
    WrongLength {
        /// Events in the log.
        expected: usize,
        /// Rows in the file.
        found: usize,
    },
}

/// Opens a file for reading.
///
/// # Errors
/// Returns [`Problem::Unreadable`], for a folder too.
pub fn open(path: &Path) -> Result<std::fs::File, FileError> {
    let unreadable = |error| FileError { path: path.to_owned(), problem: Problem::Unreadable(error) };
    let file = std::fs::File::open(path).map_err(unreadable)?;
    if file.metadata().map_err(unreadable)?.is_dir() {
        return Err(unreadable(std::io::Error::from(std::io::ErrorKind::IsADirectory)));
    }
    Ok(file)
}

/// A text file of records with a header, read line by line. The header determines the delimiter: comma, semicolon or
/// tab. Lines that begin with `#` are remarks. Names of columns are case-insensitive. `Sound speed [m/s]` has the name
/// `sound_speed` as well. Numbers may have decimal commas, unless the delimiter is a comma.
pub struct Table<'a> {
    reader: Records<'a>,
    path: PathBuf,
    header: Vec<String>,
    /// Lines before the header.
    remarks: Vec<String>,
    /// Index of each column by its name in lower case, and by its name without unit and spaces.
    places: HashMap<String, usize>,
    delimiter: u8,
    is_windows_1252: Arc<AtomicBool>,
    has_decimal_commas: Cell<bool>,
    record: StringRecord,
    line: u64,
}

impl<'a> Table<'a> {
    /// Reads the header. `path` stands for the file in errors.
    ///
    /// # Errors
    /// Returns [`FileError`] if the file is not text, lacks required columns, or repeats a column.
    pub fn new(reader: impl Read + 'a, path: &Path, required: &[&str]) -> Result<Self, FileError> {
        let fail = |problem| FileError { path: path.to_owned(), problem };
        let Delimited { records: mut reader, remarks, delimiter, is_windows_1252 } =
            Delimited::new(reader).map_err(|error| fail(Problem::Unreadable(error)))?;
        let header = reader.headers().map_err(|error| fail(problem_of(&error, 1)))?;
        // Spreadsheets put a byte-order mark before the first column.
        let header: Vec<String> = header.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect();
        let mut places = HashMap::with_capacity(header.len());
        for (place, column) in header.iter().enumerate() {
            // A column without a name, such as an index or an empty last column, cannot be requested.
            if !column.is_empty() && places.insert(column.to_lowercase(), place).is_some() {
                return Err(fail(Problem::RepeatedColumn { column: column.clone() }));
            }
        }
        for (place, column) in header.iter().enumerate() {
            let plain = split_unit(&column.to_lowercase()).0.replace([' ', '-'], "_");
            if !plain.is_empty() {
                places.entry(plain).or_insert(place);
            }
        }
        let table = Self {
            reader,
            path: path.to_owned(),
            header,
            remarks,
            places,
            delimiter,
            is_windows_1252,
            has_decimal_commas: Cell::new(false),
            record: StringRecord::new(),
            line: 1,
        };
        table.require(required)?;
        Ok(table)
    }

    /// Checks that columns are present. Names are in lower case.
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

    /// Returns the names of the columns as in the file.
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// Returns the remarks and empty lines before the header as in the file.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// Reads the next line. Returns false at the end.
    ///
    /// # Errors
    /// Returns [`FileError`] if a line is not text or has a wrong number of fields.
    #[expect(clippy::should_implement_trait, reason = "a line is looked at where it is, and not handed out")]
    pub fn next(&mut self) -> Result<bool, FileError> {
        let more = self.reader.read_record(&mut self.record);
        // The reader stands after the line end of the record. Remarks may precede the record, so its start is not the
        // line number.
        let within: usize = self.record.iter().map(|field| field.matches('\n').count()).sum();
        self.line = (self.reader.position().line() - 1).saturating_sub(within as u64);
        let more = more.map_err(|error| self.error(problem_of(&error, self.line)))?;
        let (expected, found) = (self.header.len(), self.record.len());
        if more && found != expected {
            return Err(self.error(Problem::Ragged { line: self.line, expected, found }));
        }
        Ok(more)
    }

    /// Returns an error about this file.
    pub fn error(&self, problem: Problem) -> FileError {
        FileError { path: self.path.clone(), problem }
    }

    /// Returns the number of the current line, from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Whether a column exists. Its name is in lower case.
    pub fn has(&self, column: &str) -> bool {
        self.place(column).is_some()
    }

    fn place(&self, column: &str) -> Option<usize> {
        self.places.get(column).copied()
    }

    /// Returns the field in a column; empty if the column does not exist.
    pub fn field(&self, column: &str) -> &str {
        self.place(column).and_then(|place| self.record.get(place)).unwrap_or_default()
    }

    /// Returns the unit of a column from its header, such as `m` of `Depth [m]`; empty without a unit.
    pub fn unit(&self, column: &str) -> &str {
        self.place(column).map_or("", |place| split_unit(&self.header[place]).1)
    }

    /// Returns the named columns of the header without those that are used.
    pub fn unused_columns<'b>(&self, used: impl Iterator<Item = &'b str>) -> Vec<&str> {
        let used: HashSet<usize> = used.filter_map(|column| self.place(column)).collect();
        let is_unused = |(place, name): &(usize, &String)| !name.is_empty() && !used.contains(place);
        self.header.iter().enumerate().filter(is_unused).map(|(_, name)| name.as_str()).collect()
    }

    /// Returns whether the text was decoded from Windows-1252, up to the present line.
    pub fn is_windows_1252(&self) -> bool {
        self.is_windows_1252.load(Ordering::Relaxed)
    }

    /// Returns whether numbers had decimal commas, up to the present line.
    pub fn has_decimal_commas(&self) -> bool {
        self.has_decimal_commas.get()
    }

    /// Parses a number of this table. It may be infinite or NaN.
    pub fn parse_number(&self, text: &str) -> Option<f64> {
        if let Ok(number) = text.parse() {
            return Some(number);
        }
        let is_comma = self.delimiter != b',' && text.matches(',').count() == 1 && !text.contains('.');
        let number = text.replace(',', ".").parse().ok().filter(|_| is_comma)?;
        self.has_decimal_commas.set(true);
        Some(number)
    }

    /// Returns the fields of the line as in the file.
    pub fn fields(&self) -> Vec<String> {
        self.record.iter().map(str::to_owned).collect()
    }

    /// Returns an error about the field in a column.
    pub fn bad(&self, column: &str, expected: &'static str) -> FileError {
        let (column, value) = (column.to_owned(), shorten(self.field(column)));
        self.error(Problem::BadValue { line: self.line, column, value, expected })
    }

    /// Parses a finite number.
    ///
    /// # Errors
    /// Returns [`Problem::BadValue`] for any other content.
    pub fn number(&self, column: &str) -> Result<f64, FileError> {
        let number = self.parse_number(self.field(column)).filter(|number| number.is_finite());
        number.ok_or_else(|| self.bad(column, "a finite number"))
    }

    pub(crate) fn probability(&self, column: &str) -> Result<f64, FileError> {
        let number = self.parse_number(self.field(column)).filter(|number| (0.0..=1.0).contains(number));
        number.ok_or_else(|| self.bad(column, "a probability from 0 to 1"))
    }

    /// Parses a flag as [`flag`] does.
    ///
    /// # Errors
    /// Returns [`Problem::BadValue`] for any other content.
    pub fn flag(&self, column: &str) -> Result<bool, FileError> {
        self.flag_at(self.place(column).unwrap_or(usize::MAX))
    }

    /// Parses the flag in the n-th column.
    pub(crate) fn flag_at(&self, place: usize) -> Result<bool, FileError> {
        let flag = self.record.get(place).and_then(flag);
        flag.ok_or_else(|| self.bad(&self.header.get(place).map_or(String::new(), |name| name.to_lowercase()), FLAG))
    }

    /// Returns the name of a vehicle.
    ///
    /// # Errors
    /// Returns [`Problem::BadValue`] for an empty name or one with control characters.
    pub fn vehicle(&self, column: &str) -> Result<VehicleId, FileError> {
        let name = self.field(column);
        if name.is_empty() || name.contains(char::is_control) {
            return Err(self.bad(column, "the name of a vehicle, without control characters"));
        }
        Ok(VehicleId::new(name))
    }

    /// Returns the kind of message from `kind`, or from the present columns of `rate`, `band`, `level` and `length`;
    /// `None` if all are empty.
    ///
    /// # Errors
    /// Returns [`Problem::BadValue`] for names with control characters.
    pub fn kind(&self) -> Result<Option<MessageKind>, FileError> {
        self.kind_by(&KIND_COLUMNS[1..])
    }

    /// Returns the kind of message from `kind`, or from the present ones of these columns; `None` if all are empty.
    ///
    /// # Errors
    /// As [`Table::kind`].
    pub fn kind_by(&self, columns: &[&str]) -> Result<Option<MessageKind>, FileError> {
        let name_in = |column: &str| {
            let value = if self.has(column) { self.field(column) } else { "" };
            let is_name = !value.contains(char::is_control);
            is_name.then_some(value).ok_or_else(|| self.bad(column, "a kind of message, without control characters"))
        };
        let kind = name_in("kind")?;
        if !kind.is_empty() {
            return Ok(Some(MessageKind::new(kind)));
        }
        let mut parts = Vec::new();
        for column in columns {
            let value = name_in(column)?;
            parts.extend((!value.is_empty()).then(|| format!("{column} {value}")));
        }
        Ok((!parts.is_empty()).then(|| MessageKind::new(parts.join(", "))))
    }

    /// Parses a coordinate in metres.
    ///
    /// # Errors
    /// Returns [`Problem::BadValue`] for any other content.
    pub fn metres(&self, column: &str) -> Result<f64, FileError> {
        let number = self.parse_number(self.field(column)).and_then(|number| bounds::COORDINATE_M.check(number));
        number.ok_or_else(|| self.bad(column, bounds::COORDINATE_M.words))
    }

    /// Parses a heading in degrees. Returns `None` if there is no such column, or if the field is empty.
    ///
    /// # Errors
    /// Returns [`Problem::BadValue`] for any other content.
    pub(crate) fn heading(&self, column: &str) -> Result<Option<f64>, FileError> {
        if !self.has(column) || self.field(column).is_empty() {
            return Ok(None);
        }
        let number = self.parse_number(self.field(column)).and_then(|number| bounds::HEADING_DEG.check(number));
        number.map(Some).ok_or_else(|| self.bad(column, bounds::HEADING_DEG.words))
    }

    pub(crate) fn link(&self, has_depths: bool) -> Result<Link, FileError> {
        let end = |east, north, depth, heading| {
            let depth_m = if has_depths { Some(self.metres(depth)?) } else { None };
            let heading_deg = self.heading(heading)?;
            Ok(Position { east_m: self.metres(east)?, north_m: self.metres(north)?, depth_m, heading_deg })
        };
        Ok(Link {
            transmitter: end("tx_easting_m", "tx_northing_m", "tx_depth_m", "tx_heading_deg")?,
            receiver: end("rx_easting_m", "rx_northing_m", "rx_depth_m", "rx_heading_deg")?,
        })
    }
}

/// The columns that form the kind of a message: `kind` itself, or the parts that it consists of.
pub const KIND_COLUMNS: [&str; 5] = ["kind", "rate", "band", "level", "length"];

/// Examples of the texts that a flag may have, for error messages.
pub const FLAG: &str = "0 or 1, false or true, no or yes, failed or ok, missed or heard, lost or received";

const TRUE_WORDS: [&str; 14] =
    ["1", "1.0", "true", "t", "yes", "y", "ok", "good", "pass", "success", "heard", "received", "decoded", "delivered"];
const FALSE_WORDS: [&str; 18] = [
    "0",
    "0.0",
    "false",
    "f",
    "no",
    "n",
    "failed",
    "fail",
    "failure",
    "bad",
    "error",
    "missed",
    "lost",
    "not received",
    "not decoded",
    "undelivered",
    "bad_crc",
    "timeout",
];

/// Parses a flag ([`FLAG`]) in upper or lower case.
pub fn flag(text: &str) -> Option<bool> {
    let is_one_of = |words: &[&str]| words.iter().any(|word| text.eq_ignore_ascii_case(word));
    let is_true = is_one_of(&TRUE_WORDS);
    (is_true || is_one_of(&FALSE_WORDS)).then_some(is_true)
}

/// Splits the name of a column and its unit in brackets. The unit is empty if there is none.
fn split_unit(column: &str) -> (&str, &str) {
    let split = |open: char, close: char| {
        let (name, unit) = column.strip_suffix(close)?.rsplit_once(open)?;
        Some((name.trim_end(), unit.trim()))
    };
    split('[', ']').or_else(|| split('(', ')')).unwrap_or((column, ""))
}

/// Converts an error of the CSV reader.
fn problem_of(error: &csv::Error, line: u64) -> Problem {
    match error.kind() {
        csv::ErrorKind::Utf8 { .. } => Problem::NotText { line },
        csv::ErrorKind::Io(error) => Problem::Unreadable(std::io::Error::new(error.kind(), error.to_string())),
        _ => Problem::Unreadable(std::io::Error::other(error.to_string())),
    }
}

/// Returns at most 80 characters of a text.
fn shorten(text: &str) -> String {
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
