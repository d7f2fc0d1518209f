//! Event logs as CSV files.
//!
//! Required columns, in any order: `time_s, tx_id, rx_id, tx_easting_m, tx_northing_m, rx_easting_m, rx_northing_m, success`.
//! Read when present: `true_probability` (for scoring only), `tx_depth_m` and `rx_depth_m` (together: links then have six
//! inputs). Known and not used: `rate`. Anything else is named in [`EventLog::unknown_columns`].

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

use csv::StringRecord;
use pingmap_agent::{Chart, Event, InputSpec, Link, Position, VehicleId};

/// Columns that every event log has.
pub const REQUIRED_COLUMNS: [&str; 8] =
    ["time_s", "tx_id", "rx_id", "tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m", "success"];

/// Columns that mean something where they are present.
const OPTIONAL_COLUMNS: [&str; 4] = ["true_probability", "tx_depth_m", "rx_depth_m", "rate"];

/// Farther than anything on Earth, and near enough that no square overflows.
pub const COORDINATE_MAX_M: f64 = 1e9;

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

/// The events of a trial, in file order.
#[derive(Debug, Clone)]
pub struct EventLog {
    /// The events.
    pub events: Vec<Event>,
    /// The probability with which each event succeeded, where the log knows it. Only ever used for scoring.
    pub true_probability: Option<Vec<f64>>,
    /// Whether both ends have depths.
    pub has_depths: bool,
    /// Columns of the file that mean nothing here, such as depths of one end only.
    pub unknown_columns: Vec<String>,
}

impl EventLog {
    /// Reads a CSV file. O(events), one event at a time.
    ///
    /// # Errors
    /// [`FileError`] with file, line, column, value and what was expected.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let file = open(path)?;
        Self::read(file, path)
    }

    /// Reads CSV from memory or elsewhere; `name` stands for the file in errors.
    ///
    /// # Errors
    /// As [`EventLog::open`].
    pub fn read(reader: impl Read, name: &Path) -> Result<Self, FileError> {
        let mut table = Table::new(reader, name, &REQUIRED_COLUMNS)?;
        let has_depths = table.has("tx_depth_m") && table.has("rx_depth_m");
        let has_probability = table.has("true_probability");
        let known = |column: &String| {
            let lone_depth = column.ends_with("_depth_m") && !has_depths;
            REQUIRED_COLUMNS.contains(&column.as_str()) || OPTIONAL_COLUMNS.contains(&column.as_str()) && !lone_depth
        };
        let unknown_columns = table.header.iter().filter(|column| !known(column)).cloned().collect();
        let mut events = Vec::new();
        let mut probabilities = Vec::new();
        while table.next()? {
            events.push(Event {
                time_s: table.number("time_s")?,
                transmitter_id: table.vehicle("tx_id")?,
                receiver_id: table.vehicle("rx_id")?,
                link: table.link(has_depths)?,
                success: table.flag("success")?,
            });
            if has_probability {
                probabilities.push(table.probability("true_probability")?);
            }
        }
        if events.is_empty() {
            return Err(table.error(Problem::Empty { what: "events" }));
        }
        let true_probability = has_probability.then_some(probabilities);
        Ok(Self { events, true_probability, has_depths, unknown_columns })
    }

    /// Every vehicle that appears as a receiver, in alphabetical order: those that own events.
    pub fn vehicles(&self) -> Vec<VehicleId> {
        let ids: BTreeSet<&VehicleId> = self.events.iter().map(|event| &event.receiver_id).collect();
        ids.into_iter().cloned().collect()
    }

    /// The events at `indices`, in that order.
    pub fn select(&self, indices: &[usize]) -> Self {
        let pick = |values: &Vec<f64>| indices.iter().map(|&n| values[n]).collect();
        Self {
            events: indices.iter().map(|&n| self.events[n].clone()).collect(),
            true_probability: self.true_probability.as_ref().map(pick),
            has_depths: self.has_depths,
            unknown_columns: self.unknown_columns.clone(),
        }
    }

    /// The log as a CSV file that [`EventLog::read`] takes: the required columns, then depths and true probabilities where it has them. Every
    /// number is written with as few digits as identify it.
    pub fn to_csv(&self) -> String {
        let mut header = REQUIRED_COLUMNS.to_vec();
        if self.has_depths {
            header.extend(["tx_depth_m", "rx_depth_m"]);
        }
        if self.true_probability.is_some() {
            header.push("true_probability");
        }
        let mut writer = csv::Writer::from_writer(Vec::new());
        // Writing to memory cannot fail, nor can rows of one length.
        let _ = writer.write_record(&header);
        for (n, event) in self.events.iter().enumerate() {
            let Link { transmitter: tx, receiver: rx } = event.link;
            let (sender, receiver) = (event.transmitter_id.to_string(), event.receiver_id.to_string());
            let mut row = vec![event.time_s.to_string(), sender, receiver];
            row.extend([tx.east_m, tx.north_m, rx.east_m, rx.north_m].map(|metres| metres.to_string()));
            row.push(u8::from(event.success).to_string());
            if self.has_depths {
                row.extend([tx.depth_m, rx.depth_m].map(|depth_m| depth_m.unwrap_or_default().to_string()));
            }
            row.extend(self.true_probability.as_ref().map(|probabilities| probabilities[n].to_string()));
            let _ = writer.write_record(&row);
        }
        writer.into_inner().map_or_else(|_| String::new(), |bytes| String::from_utf8_lossy(&bytes).into_owned())
    }

    /// A chart about the middle of all positions.
    pub fn chart(&self) -> Chart {
        Chart::about(self.events.iter().flat_map(|event| event.link.ends()))
    }

    /// The inputs that these links can yield.
    pub fn inputs(&self) -> InputSpec {
        if self.has_depths { InputSpec::PositionsAndDepths } else { InputSpec::Positions }
    }
}

/// Reads links from CSV: the four position columns of an event log (and depths, where both are present), nothing else required.
///
/// # Errors
/// As [`EventLog::open`].
pub fn read_links(path: &Path) -> Result<Vec<Link>, FileError> {
    let mut table = Table::new(open(path)?, path, &REQUIRED_COLUMNS[3..7])?;
    let has_depths = table.has("tx_depth_m") && table.has("rx_depth_m");
    let mut links = Vec::new();
    while table.next()? {
        links.push(table.link(has_depths)?);
    }
    if links.is_empty() {
        return Err(table.error(Problem::Empty { what: "links" }));
    }
    Ok(links)
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
        if let Some(at) = (1..header.len()).find(|&at| header[..at].contains(&header[at])) {
            return Err(fail(Problem::RepeatedColumn { column: header[at].clone() }));
        }
        let missing: Vec<String> =
            required.iter().filter(|name| !header.iter().any(|h| h == *name)).map(|name| name.to_string()).collect();
        if !missing.is_empty() {
            let expected = required.iter().map(|name| name.to_string()).collect();
            return Err(fail(Problem::MissingColumns { missing, expected, found: shorten(&header.join(",")) }));
        }
        Ok(Self { reader, path: path.to_owned(), header, record: StringRecord::new(), line: 1 })
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

    fn has(&self, column: &str) -> bool {
        self.place(column).is_some()
    }

    fn place(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|name| name == column)
    }

    /// The field in a column that is known to exist.
    fn field(&self, column: &str) -> &str {
        self.place(column).and_then(|place| self.record.get(place)).unwrap_or_default()
    }

    fn bad(&self, column: &str, expected: &'static str) -> FileError {
        let (column, value) = (column.to_owned(), shorten(self.field(column)));
        self.error(Problem::BadValue { line: self.line, column, value, expected })
    }

    fn number(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| self.bad(column, "a finite number"))
    }

    fn probability(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().filter(|number| (0.0..=1.0).contains(number));
        number.ok_or_else(|| self.bad(column, "a probability from 0 to 1"))
    }

    fn flag(&self, column: &str) -> Result<bool, FileError> {
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

    fn vehicle(&self, column: &str) -> Result<VehicleId, FileError> {
        let name = self.field(column);
        if name.is_empty() || name.contains(char::is_control) {
            return Err(self.bad(column, "the name of a vehicle, without control characters"));
        }
        Ok(VehicleId::new(name))
    }

    fn metres(&self, column: &str) -> Result<f64, FileError> {
        let number = self.field(column).parse::<f64>().ok().filter(|number| number.abs() <= COORDINATE_MAX_M);
        number.ok_or_else(|| self.bad(column, "a finite number of metres, at most 1e9 from zero"))
    }

    fn link(&self, has_depths: bool) -> Result<Link, FileError> {
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
