//! Tables whose fields are addressed by role.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::Path;

use pingmap_trial::{FLAG, FileError, KIND_COLUMNS, Problem, Table, flag};

use crate::model::error::ImportError;
use crate::model::time::{EpochUnit, TIME_IN_ZONE, TimeZone, parse_time_in};
use crate::readers::tables::columns::Columns;
use crate::readers::tables::conversion::Conversion;
use crate::readers::tables::roles::TableKind;
use crate::readers::tables::units::factor;

/// Words in the names of columns that hold the outcome of a reception.
const OUTCOME_WORDS: [&str; 8] = ["ok", "crc", "decoded", "status", "success", "valid", "outcome", "result"];

/// Words in the names of columns that are 1 for messages that were not received.
const FAILURE_WORDS: [&str; 5] = ["error", "errors", "lost", "failed", "missed"];

/// Columns whose numbers have no known meaning: 0 may be a success.
const CODE_COLUMNS: [&str; 3] = ["status", "result", "outcome"];

/// Returns the words in the name of a column, in lower case.
fn words(column: &str) -> impl Iterator<Item = String> {
    let words: Vec<String> = column.to_lowercase().split(|c: char| !c.is_alphanumeric()).map(str::to_owned).collect();
    words.into_iter()
}

/// A table whose fields are addressed by role.
pub(crate) struct RoleTable<'a> {
    pub(crate) table: Table<'a>,
    /// The column of each role that has one.
    columns: BTreeMap<&'static str, String>,
    /// The roles whose column the user assigned.
    assigned: BTreeSet<&'static str>,
    /// The zone of dates and times that name none.
    zone: TimeZone,
    /// The largest unit of epochs, up to the present row.
    epoch_unit: Cell<EpochUnit>,
}

impl<'a> RoleTable<'a> {
    /// Reads the header of a table and finds the column of each role.
    pub(crate) fn new(
        reader: impl Read + 'a,
        path: &Path,
        kind: TableKind,
        assigned: &Columns,
    ) -> Result<Self, ImportError> {
        let table = Table::new(reader, path, &[])?;
        let (mut columns, mut roles) = (BTreeMap::new(), BTreeSet::new());
        for &(role, names) in kind.roles() {
            roles.extend(assigned.column(kind, role).map(|_| role));
            let found = match assigned.column(kind, role) {
                Some("") => None,
                Some(column) if table.has(column) => Some(column.to_owned()),
                Some(column) => return Err(missing_columns(&table, vec![column.to_owned()], vec![column.to_owned()])),
                None => names.iter().find(|name| table.has(name)).map(|name| (*name).to_owned()),
            };
            columns.extend(found.map(|column| (role, column)));
        }
        Ok(Self { table, columns, assigned: roles, zone: TimeZone::UTC, epoch_unit: Cell::new(EpochUnit::Seconds) })
    }

    /// Sets the zone of dates and times that name none.
    pub(crate) fn in_zone(self, zone: &TimeZone) -> Self {
        Self { zone: zone.clone(), ..self }
    }

    /// Checks that the units in the header are known.
    ///
    /// # Errors
    /// [`ImportError::Content`] with the column and its unit.
    pub(crate) fn check_units(&self, path: &Path) -> Result<(), ImportError> {
        let has_unknown_unit =
            |(role, column): &(&&'static str, &String)| factor(role, self.table.unit(column)).is_none();
        let Some((_, column)) = self.columns.iter().find(has_unknown_unit) else { return Ok(()) };
        let problem = format!(
            "the column {column} has the unit {}; expected s, ms, us or ns for times, deg for latitudes and longitudes, and m, km, cm or ft \
             for lengths",
            self.table.unit(column)
        );
        Err(ImportError::Content { file: path.display().to_string(), problem })
    }

    /// Checks that no column of receptions looks like an outcome and has no role.
    ///
    /// # Errors
    /// [`ImportError::Content`] with the column, and the options that use or ignore it.
    pub(crate) fn check_outcome(&self, path: &Path, assigned: &Columns) -> Result<(), ImportError> {
        if self.has("good") || assigned.column(TableKind::Receptions, "good").is_some() {
            return Ok(());
        }
        let has_word = |column: &str, known: &[&str]| words(column).any(|word| known.contains(&word.as_str()));
        let is_outcome = |column: &&str| has_word(column, &OUTCOME_WORDS) || has_word(column, &FAILURE_WORDS);
        let Some(column) = self.unused_columns().into_iter().find(is_outcome) else { return Ok(()) };
        let file = path.file_name().unwrap_or_default().display();
        let use_it = match has_word(column, &FAILURE_WORDS) {
            true => "a column that is 1 for received messages".to_owned(),
            false => format!("--column {file}:heard.good={column} to use it"),
        };
        let problem = format!(
            "the column {column} looks like the outcome of a reception; expected {use_it}, or --column {file}:heard.good= if every row is a \
             received message"
        );
        Err(ImportError::Content { file: path.display().to_string(), problem })
    }

    /// Returns the columns without a role that form no kind of message either.
    fn unused_columns(&self) -> Vec<&str> {
        self.table.unused_columns(self.columns.values().map(String::as_str).chain(KIND_COLUMNS))
    }

    /// Returns how the table differs from plain CSV, up to the present row.
    pub(crate) fn conversions(&self) -> Vec<Conversion> {
        let unit = self.epoch_unit.get();
        let conversions = [
            (self.table.is_windows_1252(), Conversion::Windows1252),
            (self.table.has_decimal_commas(), Conversion::DecimalCommas),
            (unit != EpochUnit::Seconds, Conversion::Epoch(unit)),
        ];
        let applying = conversions.into_iter().filter(|(applies, _)| *applies).map(|(_, conversion)| conversion);
        let unused: Vec<String> = self.unused_columns().into_iter().map(str::to_owned).collect();
        applying.chain((!unused.is_empty()).then_some(Conversion::UnusedColumns(unused))).collect()
    }

    /// Fails if a role has no column.
    pub(crate) fn require(&self, kind: TableKind, roles: &[&str]) -> Result<(), ImportError> {
        let is_missing = |role: &&&str| !self.has(role);
        let names =
            |role: &str| kind.roles().iter().find(|(name, _)| *name == role).map_or(&[][..], |(_, names)| names);
        let missing: Vec<String> = roles.iter().filter(is_missing).map(|role| names(role)[0].to_owned()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let expected = roles.iter().map(|role| format!("one of {} for {}.{role}", names(role).join(", "), kind.name()));
        Err(missing_columns(&self.table, missing, expected.collect()))
    }

    pub(crate) fn has(&self, role: &str) -> bool {
        self.columns.contains_key(role)
    }

    fn column(&self, role: &str) -> &str {
        self.columns.get(role).map_or("", String::as_str)
    }

    /// Returns the text of a field; empty if the role has no column.
    pub(crate) fn text(&self, role: &str) -> &str {
        self.table.field(self.column(role))
    }

    /// Makes an error about the field of a role in the current row.
    pub(crate) fn bad(&self, role: &str, expected: &'static str) -> FileError {
        self.table.bad(self.column(role), expected)
    }

    /// Parses the time of the current row, in seconds.
    pub(crate) fn time_s(&self) -> Result<f64, FileError> {
        let (date, time, column) = (self.text("date"), self.text("time"), self.column("time"));
        let unit = self.table.unit(column).to_lowercase();
        let number = self.table.parse_number(time);
        let invalid = || self.bad("time", TIME_IN_ZONE);
        if let (Some(number), Some(factor)) = (number, factor("time", &unit))
            && factor != 1.0
        {
            return if number.is_finite() { Ok(number * factor) } else { Err(invalid()) };
        }
        let is_utc = ["utc", "gmt"].contains(&unit.as_str()) || ["utc", "time_utc"].contains(&column);
        let zone = if is_utc { &TimeZone::UTC } else { &self.zone };
        let text = match number {
            Some(number) if date.is_empty() => number.to_string(),
            // A time of day, or a time with a date of its own.
            None if date.is_empty() || time.contains(['-', 'T']) => time.to_owned(),
            _ => format!("{date} {time}"),
        };
        let (time_s, unit) = parse_time_in(&text, zone).ok_or_else(invalid)?;
        self.epoch_unit.set(self.epoch_unit.get().max(unit));
        Ok(time_s)
    }

    /// Parses a number, and converts it from the unit of the column. An empty field and NaN yield `None`.
    pub(crate) fn number(&self, role: &str) -> Result<Option<f64>, FileError> {
        let text = self.text(role);
        if text.is_empty() || text.eq_ignore_ascii_case("nan") {
            return Ok(None);
        }
        let number = self.table.parse_number(text).filter(|number| number.is_finite());
        let number = number.ok_or_else(|| self.bad(role, "a finite number, or nothing"))?;
        Ok(Some(number * factor(role, self.table.unit(self.column(role))).unwrap_or(1.0)))
    }

    /// Parses a positive integer. An empty field yields `None`.
    pub(crate) fn positive_integer(&self, role: &str) -> Result<Option<u32>, FileError> {
        let integer = |number: f64| (number.fract() == 0.0 && (1.0..=1e6).contains(&number)).then_some(number as u32);
        let number = self.number(role)?;
        number
            .map(|number| integer(number).ok_or_else(|| self.bad(role, "a whole number from 1, or nothing")))
            .transpose()
    }

    /// Parses a flag. An empty field yields `None`.
    pub(crate) fn flag(&self, role: &str) -> Result<Option<bool>, FileError> {
        let text = self.text(role);
        if text.is_empty() {
            return Ok(None);
        }
        let is_code = CODE_COLUMNS.contains(&self.column(role)) && !self.assigned.contains(role);
        if is_code && text.parse::<f64>().is_ok() {
            return Err(self.bad(
                role,
                "a word such as ok or failed; --column names another column, or this one if 1 is a success",
            ));
        }
        flag(text).map(Some).ok_or_else(|| self.bad(role, FLAG))
    }
}

fn missing_columns(table: &Table, missing: Vec<String>, expected: Vec<String>) -> ImportError {
    let found = table.header().join(",").chars().take(80).collect();
    table.error(Problem::MissingColumns { missing, expected, found }).into()
}
