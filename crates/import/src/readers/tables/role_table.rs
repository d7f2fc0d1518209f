//! Tables whose fields are addressed by role.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_trial::{FLAG, FileError, Problem, Table, flag};

use crate::model::error::ImportError;
use crate::model::time::{EpochUnit, TIME, TimeZone, parse_time_in};
use crate::readers::tables::columns::Columns;
use crate::readers::tables::conversion::Conversion;
use crate::readers::tables::roles::TableKind;
use crate::readers::tables::units::factor;

/// Words in the names of columns that hold the outcome of a reception.
const OUTCOME_WORDS: [&str; 12] =
    ["ok", "crc", "decoded", "status", "success", "valid", "outcome", "result", "error", "errors", "lost", "failed"];

/// Columns that form the kind of a message.
const KIND_COLUMNS: [&str; 5] = ["kind", "rate", "band", "level", "length"];

/// A table whose fields are addressed by role.
pub(crate) struct RoleTable<'a> {
    pub(crate) table: Table<'a>,
    /// The column of each role that has one.
    columns: BTreeMap<&'static str, String>,
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
        let mut columns = BTreeMap::new();
        for &(role, names) in kind.roles() {
            let found = match assigned.column(kind, role) {
                Some("") => None,
                Some(column) if table.has(column) => Some(column.to_owned()),
                Some(column) => return Err(missing_columns(&table, vec![column.to_owned()], vec![column.to_owned()])),
                None => names.iter().find(|name| table.has(name)).map(|name| (*name).to_owned()),
            };
            columns.extend(found.map(|column| (role, column)));
        }
        Ok(Self { table, columns, zone: TimeZone::UTC, epoch_unit: Cell::new(EpochUnit::Seconds) })
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
        let is_outcome = |column: &&String| {
            let column = column.to_lowercase();
            let is_used = self.columns.values().any(|used| *used == column);
            !is_used && column.split(|c: char| !c.is_alphanumeric()).any(|word| OUTCOME_WORDS.contains(&word))
        };
        let Some(column) = self.table.header().iter().find(is_outcome) else { return Ok(()) };
        let problem = format!(
            "the column {column} looks like the outcome of a reception; expected --column heard.good={column} to use it, or --column \
             heard.good= if every row is a received message"
        );
        Err(ImportError::Content { file: path.display().to_string(), problem })
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
        let used = self.columns.values().map(String::as_str).chain(KIND_COLUMNS);
        let unused: Vec<String> = self.table.unused_columns(used).into_iter().map(str::to_owned).collect();
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
        let (date, time, unit) = (self.text("date"), self.text("time"), self.table.unit(self.column("time")));
        if let (Some(number), Some(factor)) = (self.table.parse_number(time), factor("time", unit))
            && factor != 1.0
        {
            return Ok(number * factor);
        }
        let parsed = parse_time_in(time, &self.zone).or_else(|| {
            let with_comma = self.table.parse_number(time)?.to_string();
            parse_time_in(&with_comma, &self.zone)
        });
        let with_date = || parse_time_in(&format!("{date} {time}"), &self.zone);
        let (time_s, unit) = parsed.or_else(with_date).ok_or_else(|| self.bad("time", TIME))?;
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
        flag(text).map(Some).ok_or_else(|| self.bad(role, FLAG))
    }
}

fn missing_columns(table: &Table, missing: Vec<String>, expected: Vec<String>) -> ImportError {
    let found = table.header().join(",").chars().take(80).collect();
    table.error(Problem::MissingColumns { missing, expected, found }).into()
}
