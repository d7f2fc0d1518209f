//! The roles of columns in tables.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_trial::{FileError, Problem, Table, flag};

use crate::model::error::ImportError;
use crate::model::time::{TIME, parse_time};

/// The subject of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TableKind {
    /// Positions of vehicles.
    Navigation,
    /// Messages that reached vehicles.
    Receptions,
    /// Messages that vehicles transmitted.
    Transmissions,
}

/// The role of a column, and its usual names in lower case. If several names are present, the first of the list is
/// used.
pub type Role = (&'static str, &'static [&'static str]);

const TIME_NAMES: &[&str] = &[
    "time_s",
    "time",
    "timestamp",
    "time_utc",
    "utc",
    "datetime",
    "date_time",
    "unix_time",
    "unix_time_s",
    "t",
    "stamp",
];
const VEHICLE_NAMES: &[&str] = &["vehicle", "vehicle_id", "name", "platform"];
const DESTINATION_NAMES: &[&str] = &["destination", "destination_id", "dest", "dst", "to"];
const FRAMES_NAMES: &[&str] = &["frames", "nframes", "frame_count"];

const NAVIGATION_ROLES: &[Role] = &[
    ("time", TIME_NAMES),
    ("vehicle", VEHICLE_NAMES),
    ("latitude", &["latitude", "latitude_deg", "lat", "lat_deg", "nav_lat"]),
    ("longitude", &["longitude", "longitude_deg", "lon", "lon_deg", "lng", "long", "nav_long", "nav_lon"]),
    ("easting", &["easting_m", "easting", "east_m", "east", "x_m", "x", "nav_x"]),
    ("northing", &["northing_m", "northing", "north_m", "north", "y_m", "y", "nav_y"]),
    ("depth", &["depth_m", "depth", "nav_depth"]),
    ("clock_set", &["clock_set", "gps", "gps_fix"]),
    ("band", &["band", "modem_band"]),
];

const RECEPTION_ROLES: &[Role] = &[
    ("time", TIME_NAMES),
    ("vehicle", &["vehicle", "vehicle_id", "receiver", "rx_id", "rx", "platform"]),
    ("source", &["source", "source_id", "src", "from", "sender", "transmitter", "tx_id", "tx"]),
    ("destination", DESTINATION_NAMES),
    ("good", &["good", "ok", "success", "crc_ok", "decoded"]),
    ("frame", &["frame", "frame_number"]),
    ("frames", FRAMES_NAMES),
];

const TRANSMISSION_ROLES: &[Role] = &[
    ("time", TIME_NAMES),
    (
        "vehicle",
        &["vehicle", "vehicle_id", "source", "source_id", "src", "sender", "transmitter", "tx_id", "tx", "platform"],
    ),
    ("destination", DESTINATION_NAMES),
    ("sent", &["sent", "transmitted"]),
    ("frames", FRAMES_NAMES),
];

impl TableKind {
    /// Returns the first part of a role's full name, such as `heard` in `heard.time`.
    pub fn name(self) -> &'static str {
        match self {
            TableKind::Navigation => "nav",
            TableKind::Receptions => "heard",
            TableKind::Transmissions => "sent",
        }
    }

    /// Returns the roles of its columns.
    pub fn roles(self) -> &'static [Role] {
        match self {
            TableKind::Navigation => NAVIGATION_ROLES,
            TableKind::Receptions => RECEPTION_ROLES,
            TableKind::Transmissions => TRANSMISSION_ROLES,
        }
    }
}

/// Returns the role that a column name has in tables of a kind.
pub(crate) fn column_role(kind: TableKind, name: &str) -> Option<&'static str> {
    let name = name.to_lowercase();
    kind.roles().iter().find(|(_, names)| names.contains(&name.as_str())).map(|(role, _)| *role)
}

/// Columns with unusual names, by kind of table and role.
#[derive(Debug, Clone, Default)]
pub struct Columns(BTreeMap<(TableKind, &'static str), String>);

impl Columns {
    /// Assigns a column to a role, such as `from modem` to `heard.source`. An empty name means that the table has no
    /// such column.
    ///
    /// # Errors
    /// [`ImportError::Role`] for an unknown role.
    pub fn assign(&mut self, role: &str, column: &str) -> Result<(), ImportError> {
        let kinds = [TableKind::Navigation, TableKind::Receptions, TableKind::Transmissions];
        let all_roles = || kinds.iter().flat_map(|kind| kind.roles().iter().map(move |(role, _)| (*kind, *role)));
        let full_name = |(kind, role): (TableKind, &str)| format!("{}.{role}", kind.name());
        let Some(key) = all_roles().find(|key| full_name(*key) == role.trim()) else {
            let expected = all_roles().map(full_name).collect::<Vec<_>>().join(", ");
            return Err(ImportError::Role { role: role.to_owned(), expected });
        };
        self.0.insert(key, column.trim().to_lowercase());
        Ok(())
    }
}

/// A table whose fields are addressed by role.
pub(crate) struct RoleTable<'a> {
    pub(crate) table: Table<'a>,
    /// The column of each role that has one.
    columns: BTreeMap<&'static str, String>,
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
            let found = match assigned.0.get(&(kind, role)) {
                Some(column) if column.is_empty() => None,
                Some(column) if table.has(column) => Some(column.clone()),
                Some(column) => return Err(missing_columns(&table, vec![column.clone()], vec![column.clone()])),
                None => names.iter().find(|name| table.has(name)).map(|name| (*name).to_owned()),
            };
            columns.extend(found.map(|column| (role, column)));
        }
        Ok(Self { table, columns })
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
        parse_time(self.text("time")).ok_or_else(|| self.bad("time", TIME))
    }

    /// Parses a number. An empty field and NaN yield `None`.
    pub(crate) fn number(&self, role: &str) -> Result<Option<f64>, FileError> {
        let text = self.text(role);
        if text.is_empty() || text.eq_ignore_ascii_case("nan") {
            return Ok(None);
        }
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        number.map(Some).ok_or_else(|| self.bad(role, "a finite number, or nothing"))
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
        flag(text).map(Some).ok_or_else(|| self.bad(role, "1 or 0, true or false, yes or no, or nothing"))
    }
}

fn missing_columns(table: &Table, missing: Vec<String>, expected: Vec<String>) -> ImportError {
    let found = table.header().join(",").chars().take(80).collect();
    table.error(Problem::MissingColumns { missing, expected, found }).into()
}
