//! Which columns of a table mean what.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pingmap_trial::{FileError, Problem, Table, flag};

use crate::error::ImportError;
use crate::time::{TIME, parse_time};

/// What a table tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TableKind {
    /// Where vehicles were.
    Navigation,
    /// What reached them.
    Heard,
    /// What they sent.
    Sent,
}

/// What a column can tell, and how it is called where nobody says otherwise, in lower case; of several the first that is there.
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

const NAVIGATION: &[Role] = &[
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

const HEARD: &[Role] = &[
    ("time", TIME_NAMES),
    ("vehicle", &["vehicle", "vehicle_id", "receiver", "rx_id", "rx", "platform"]),
    ("source", &["source", "source_id", "src", "from", "sender", "transmitter", "tx_id", "tx"]),
    ("destination", DESTINATION_NAMES),
    ("good", &["good", "ok", "success", "crc_ok", "decoded"]),
    ("frame", &["frame", "frame_number"]),
    ("frames", FRAMES_NAMES),
];

const SENT: &[Role] = &[
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
    /// The word for it before the point in `heard.time`.
    pub fn name(self) -> &'static str {
        match self {
            TableKind::Navigation => "nav",
            TableKind::Heard => "heard",
            TableKind::Sent => "sent",
        }
    }

    /// What its columns can tell.
    pub fn roles(self) -> &'static [Role] {
        match self {
            TableKind::Navigation => NAVIGATION,
            TableKind::Heard => HEARD,
            TableKind::Sent => SENT,
        }
    }
}

/// What a name tells in a table of this kind.
pub(crate) fn role_of(kind: TableKind, name: &str) -> Option<&'static str> {
    let name = name.to_lowercase();
    kind.roles().iter().find(|(_, names)| names.contains(&name.as_str())).map(|(role, _)| *role)
}

/// How columns are called that are called otherwise.
#[derive(Debug, Clone, Default)]
pub struct Columns(BTreeMap<(TableKind, &'static str), String>);

impl Columns {
    /// Says that a column tells something: `heard.source`, `from modem`; no column where its name is empty.
    ///
    /// # Errors
    /// [`ImportError::Role`] for what no column tells.
    pub fn name(&mut self, what: &str, column: &str) -> Result<(), ImportError> {
        let kinds = [TableKind::Navigation, TableKind::Heard, TableKind::Sent];
        let all = || kinds.iter().flat_map(|kind| kind.roles().iter().map(move |(role, _)| (*kind, *role)));
        let of = |(kind, role): (TableKind, &str)| format!("{}.{role}", kind.name());
        let Some(key) = all().find(|key| of(*key) == what.trim()) else {
            let expected = all().map(of).collect::<Vec<_>>().join(", ");
            return Err(ImportError::Role { given: what.to_owned(), expected });
        };
        self.0.insert(key, column.trim().to_lowercase());
        Ok(())
    }
}

/// A table whose columns are known by what they tell.
pub(crate) struct Named<'a> {
    pub(crate) table: Table<'a>,
    /// The column of each role that has one.
    places: BTreeMap<&'static str, String>,
}

impl<'a> Named<'a> {
    pub(crate) fn new(
        reader: impl Read + 'a,
        path: &Path,
        kind: TableKind,
        columns: &Columns,
    ) -> Result<Self, ImportError> {
        let table = Table::new(reader, path, &[])?;
        let mut places = BTreeMap::new();
        for &(role, names) in kind.roles() {
            let found = match columns.0.get(&(kind, role)) {
                Some(column) if column.is_empty() => None,
                Some(column) if table.has(column) => Some(column.clone()),
                Some(column) => return Err(lacking(&table, vec![column.clone()], vec![column.clone()])),
                None => names.iter().find(|name| table.has(name)).map(|name| (*name).to_owned()),
            };
            places.extend(found.map(|column| (role, column)));
        }
        Ok(Self { table, places })
    }

    /// Fails where a role has no column.
    pub(crate) fn require(&self, kind: TableKind, roles: &[&str]) -> Result<(), ImportError> {
        let lacks = |role: &&&str| !self.has(role);
        let names =
            |role: &str| kind.roles().iter().find(|(name, _)| *name == role).map_or(&[][..], |(_, names)| names);
        let missing: Vec<String> = roles.iter().filter(lacks).map(|role| names(role)[0].to_owned()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let expected = roles.iter().map(|role| format!("one of {} for {}.{role}", names(role).join(", "), kind.name()));
        Err(lacking(&self.table, missing, expected.collect()))
    }

    pub(crate) fn has(&self, role: &str) -> bool {
        self.places.contains_key(role)
    }

    fn column(&self, role: &str) -> &str {
        self.places.get(role).map_or("", String::as_str)
    }

    /// What stands there; empty where there is no such column.
    pub(crate) fn text(&self, role: &str) -> &str {
        self.table.field(self.column(role))
    }

    pub(crate) fn bad(&self, role: &str, expected: &'static str) -> FileError {
        self.table.bad(self.column(role), expected)
    }

    pub(crate) fn time_s(&self) -> Result<f64, FileError> {
        parse_time(self.text("time")).ok_or_else(|| self.bad("time", TIME))
    }

    /// A number, where there is one: nothing and NaN are none.
    pub(crate) fn number(&self, role: &str) -> Result<Option<f64>, FileError> {
        let text = self.text(role);
        if text.is_empty() || text.eq_ignore_ascii_case("nan") {
            return Ok(None);
        }
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        number.map(Some).ok_or_else(|| self.bad(role, "a finite number, or nothing"))
    }

    /// A whole number, where there is one.
    pub(crate) fn whole(&self, role: &str) -> Result<Option<u32>, FileError> {
        let whole = |number: f64| (number.fract() == 0.0 && (1.0..=1e6).contains(&number)).then_some(number as u32);
        let number = self.number(role)?;
        number
            .map(|number| whole(number).ok_or_else(|| self.bad(role, "a whole number from 1, or nothing")))
            .transpose()
    }

    /// Yes or no, where something is said.
    pub(crate) fn flag(&self, role: &str) -> Result<Option<bool>, FileError> {
        let text = self.text(role);
        if text.is_empty() {
            return Ok(None);
        }
        flag(text).map(Some).ok_or_else(|| self.bad(role, "1 or 0, true or false, yes or no, or nothing"))
    }
}

fn lacking(table: &Table, missing: Vec<String>, expected: Vec<String>) -> ImportError {
    let found = table.header().join(",").chars().take(80).collect();
    table.error(Problem::MissingColumns { missing, expected, found }).into()
}
