//! Reads tables of links for prediction.

use std::io::Read;
use std::path::Path;

use pingmap_agent::{Geographic, Link, LinkQuery, Position, Time};

use crate::table::{FileError, Problem, Table};

/// A table of queries with its other columns.
pub struct AttemptTable {
    /// Names of the columns as in the file.
    pub header: Vec<String>,
    /// Fields of every line.
    pub rows: Vec<Vec<String>>,
    /// Query of every line.
    pub attempts: Vec<LinkQuery>,
}

/// Columns of positions in metres: of the transmitter, then of the receiver.
const METRES: [[&str; 2]; 2] = [["tx_easting_m", "tx_northing_m"], ["rx_easting_m", "rx_northing_m"]];

/// Columns of positions in degrees: of the transmitter, then of the receiver.
const DEGREES: [[&str; 2]; 2] = [["tx_latitude_deg", "tx_longitude_deg"], ["rx_latitude_deg", "rx_longitude_deg"]];

/// Converts a position in degrees to metres of a log; `None` if the log has no reference system.
pub type ToMetres<'a> = &'a dyn Fn(Geographic) -> Option<(f64, f64)>;

/// Reads queries from CSV; errors contain `name`. The position columns of an event log are required, in metres or as
/// `tx_latitude_deg` and so on. Depths are read if both columns are present.
///
/// The columns `tx_id`, `rx_id`, `time_s` and `kind` are optional; `asked` gives the values of missing columns. A
/// vehicle that is not in the log is a new vehicle, as [`pingmap_agent::Vehicle::New`].
///
/// # Errors
/// As [`crate::EventLog::open`], and for degrees that `to_metres` cannot convert.
pub fn read_attempts(
    (reader, name): (impl Read, &Path),
    asked: &LinkQuery,
    to_metres: ToMetres,
) -> Result<AttemptTable, FileError> {
    let mut table = Table::new(reader, name, &[])?;
    let in_degrees = table.has(DEGREES[0][0]) && !table.has(METRES[0][0]);
    let columns = if in_degrees { DEGREES } else { METRES };
    table.require(&columns.concat())?;
    let has_depths = table.has("tx_depth_m") && table.has("rx_depth_m");
    let (mut rows, mut attempts) = (Vec::new(), Vec::new());
    while table.next()? {
        let end = |which: usize| -> Result<Position, FileError> {
            let [first, second] = columns[which];
            let (east_m, north_m) = match in_degrees {
                false => (table.metres(first)?, table.metres(second)?),
                true => {
                    let place = Geographic::new(table.number(first)?, table.number(second)?);
                    place.and_then(to_metres).ok_or_else(|| table.bad(first, DEGREES_EXPECTED))?
                }
            };
            let depth = ["tx_depth_m", "rx_depth_m"][which];
            let depth_m = has_depths.then(|| table.metres(depth)).transpose()?;
            let heading_deg = table.heading(["tx_heading_deg", "rx_heading_deg"][which])?;
            Ok(Position { east_m, north_m, depth_m, heading_deg })
        };
        let link = Link { transmitter: end(0)?, receiver: end(1)? };
        attempts.push(attempt(&table, link, asked)?);
        rows.push(table.fields());
    }
    if attempts.is_empty() {
        return Err(table.error(Problem::Empty { what: "links" }));
    }
    Ok(AttemptTable { header: table.header().to_vec(), rows, attempts })
}

/// Expected value of columns in degrees.
const DEGREES_EXPECTED: &str = "degrees within the reference system of the log, which must be known (--origin, --crs)";

/// Returns the query of a line. `asked` gives the values of missing columns.
fn attempt(table: &Table, link: Link, asked: &LinkQuery) -> Result<LinkQuery, FileError> {
    let mut attempt = LinkQuery { link, ..*asked };
    if table.has("tx_id") {
        attempt.transmitter = (&table.vehicle("tx_id")?).into();
    }
    if table.has("rx_id") {
        attempt.receiver = (&table.vehicle("rx_id")?).into();
    }
    if table.has("time_s") {
        attempt.when = Time::At(table.number("time_s")?);
    }
    if let Some(kind) = table.kind()? {
        attempt.kind = (&kind).into();
    }
    Ok(attempt)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_agent::{Kind, Vehicle};

    fn read(text: &str) -> Result<AttemptTable, String> {
        let nowhere = Position::new(0.0, 0.0);
        let link = Link { transmitter: nowhere, receiver: nowhere };
        let (transmitter, receiver, when, kind) = (Vehicle::Typical, Vehicle::Typical, Time::Typical, Kind::Typical);
        let asked = LinkQuery { transmitter, receiver, when, kind, ..LinkQuery::from(link) };
        let north = |place: Geographic| (place.latitude_deg > 0.0).then_some((place.longitude_deg, 1.0));
        read_attempts((text.as_bytes(), Path::new("links.csv")), &asked, &north).map_err(|error| error.to_string())
    }

    #[test]
    fn other_columns_stay_as_they_are() {
        let text = "Note;TX_easting_m;tx_northing_m;rx_easting_m;rx_northing_m;time_s\na, b;0;1;2;3.50;7\n";
        let table = read(text).unwrap();
        assert_eq!((table.header[0].as_str(), table.rows[0][0].as_str()), ("Note", "a, b"));
        assert_eq!(table.rows[0][4], "3.50");
        let asked = table.attempts[0];
        assert_eq!((asked.link.receiver.north_m, asked.when), (3.5, Time::At(7.0)));
    }

    #[test]
    fn degrees_are_converted_if_the_reference_system_is_known() {
        let header = "tx_latitude_deg,tx_longitude_deg,rx_latitude_deg,rx_longitude_deg\n";
        let table = read(&format!("{header}41,-70,42,-71\n")).unwrap();
        assert_eq!(table.attempts[0].link.receiver, Position::new(-71.0, 1.0));
        for (line, wrong) in [("41,-70,-42,-71", "-42"), ("91,-70,42,-71", "91")] {
            let error = read(&format!("{header}{line}\n")).err().unwrap();
            assert!(error.contains("line 2") && error.contains(wrong) && error.contains("--origin"), "{error}");
        }
        let error = read("tx_latitude_deg,tx_longitude_deg\n1,2\n").err().unwrap();
        assert!(error.contains("rx_latitude_deg"), "{error}");
        assert!(read("a\n1\n").err().unwrap().contains("tx_easting_m"));
    }
}
