//! Kinds of tables, and the roles and usual names of their columns.

/// The subject of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TableKind {
    /// Positions of vehicles.
    Navigation,
    /// Messages that reached vehicles.
    Receptions,
    /// Messages that vehicles transmitted.
    Transmissions,
    /// Messages with both positions and the outcome.
    Events,
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
const DATE_NAMES: &[&str] = &["date", "day", "datum"];
const VEHICLE_NAMES: &[&str] = &["vehicle", "vehicle_id", "name", "platform"];
const DESTINATION_NAMES: &[&str] = &["destination", "destination_id", "dest", "dst", "to"];
const GOOD_NAMES: &[&str] = &["good", "ok", "success", "crc_ok", "rx_ok", "decoded", "received", "valid", "status"];
const FRAMES_NAMES: &[&str] = &["frames", "nframes", "frame_count"];

const NAVIGATION_ROLES: &[Role] = &[
    ("time", TIME_NAMES),
    ("date", DATE_NAMES),
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
    ("date", DATE_NAMES),
    ("vehicle", &["vehicle", "vehicle_id", "receiver", "rx_id", "rx", "platform"]),
    ("source", &["source", "source_id", "src", "from", "sender", "transmitter", "tx_id", "tx"]),
    ("destination", DESTINATION_NAMES),
    ("good", GOOD_NAMES),
    ("frame", &["frame", "frame_number"]),
    ("frames", FRAMES_NAMES),
];

const TRANSMISSION_ROLES: &[Role] = &[
    ("time", TIME_NAMES),
    ("date", DATE_NAMES),
    (
        "vehicle",
        &["vehicle", "vehicle_id", "source", "source_id", "src", "sender", "transmitter", "tx_id", "tx", "platform"],
    ),
    ("destination", DESTINATION_NAMES),
    ("sent", &["sent", "transmitted"]),
    ("frames", FRAMES_NAMES),
];

const EVENT_ROLES: &[Role] = &[
    ("time", TIME_NAMES),
    ("date", DATE_NAMES),
    ("transmitter", &["tx_id", "tx", "transmitter", "transmitter_id", "sender", "source", "source_id", "src", "from"]),
    ("receiver", &["rx_id", "rx", "receiver", "receiver_id", "listener", "destination", "dest", "dst", "to"]),
    (
        "success",
        &[
            "success",
            "heard",
            "received",
            "ok",
            "rx_ok",
            "crc_ok",
            "decoded",
            "delivered",
            "good",
            "outcome",
            "result",
            "status",
        ],
    ),
    ("tx_latitude", &["tx_latitude_deg", "tx_latitude", "tx_lat"]),
    ("tx_longitude", &["tx_longitude_deg", "tx_longitude", "tx_lon", "tx_long", "tx_lng"]),
    ("rx_latitude", &["rx_latitude_deg", "rx_latitude", "rx_lat"]),
    ("rx_longitude", &["rx_longitude_deg", "rx_longitude", "rx_lon", "rx_long", "rx_lng"]),
    ("tx_easting", &["tx_easting_m", "tx_easting", "tx_east", "tx_x"]),
    ("tx_northing", &["tx_northing_m", "tx_northing", "tx_north", "tx_y"]),
    ("rx_easting", &["rx_easting_m", "rx_easting", "rx_east", "rx_x"]),
    ("rx_northing", &["rx_northing_m", "rx_northing", "rx_north", "rx_y"]),
    ("tx_depth", &["tx_depth_m", "tx_depth", "tx_z"]),
    ("rx_depth", &["rx_depth_m", "rx_depth", "rx_z"]),
];

impl TableKind {
    /// Returns the first part of a role's full name, such as `heard` in `heard.time`.
    pub fn name(self) -> &'static str {
        match self {
            TableKind::Navigation => "nav",
            TableKind::Receptions => "heard",
            TableKind::Transmissions => "sent",
            TableKind::Events => "events",
        }
    }

    /// Returns the roles of its columns.
    pub fn roles(self) -> &'static [Role] {
        match self {
            TableKind::Navigation => NAVIGATION_ROLES,
            TableKind::Receptions => RECEPTION_ROLES,
            TableKind::Transmissions => TRANSMISSION_ROLES,
            TableKind::Events => EVENT_ROLES,
        }
    }
}

/// Returns the role that a column name has in tables of a kind.
pub(crate) fn column_role(kind: TableKind, name: &str) -> Option<&'static str> {
    let name = name.to_lowercase();
    kind.roles().iter().find(|(_, names)| names.contains(&name.as_str())).map(|(role, _)| *role)
}
