//! Lists of places from a mission planner: waypoints, or candidate positions of a station.

use std::io::Read;
use std::path::Path;

use pingmap_agent::bounds;

use crate::model::error::ImportError;
use crate::model::reference::Place;
use crate::readers::tables::columns::Columns;
use crate::readers::tables::position::{read_position, require_position};
use crate::readers::tables::role_table::RoleTable;
use crate::readers::tables::roles::TableKind;
use pingmap_trial::Problem;

/// A place in a list.
#[derive(Debug, Clone, PartialEq)]
pub struct Waypoint {
    /// Name of the place, if stated.
    pub name: Option<String>,
    /// Planned time of arrival in seconds, if stated.
    pub time_s: Option<f64>,
    /// Horizontal position.
    pub place: Place,
    /// Depth in metres, if stated.
    pub depth_m: Option<f64>,
}

/// Reads a list of places from a table with the column names of navigation. Only the position is required. The column
/// `name` holds the name of each place.
///
/// # Errors
/// [`ImportError`] with file, line, column, value and what was expected; also for a list without places.
pub fn read_waypoints(reader: impl Read, path: &Path) -> Result<Vec<Waypoint>, ImportError> {
    let mut row = RoleTable::new(reader, path, TableKind::Navigation, &Columns::default())?;
    row.check_units(path)?;
    require_position(&row)?;
    let mut waypoints = Vec::new();
    while row.table.next()? {
        let position = read_position(&row)?;
        let has_degrees = row.has("latitude");
        let (place, depth_m) =
            position.ok_or_else(|| row.bad(if has_degrees { "latitude" } else { "easting" }, "a place"))?;
        if let Place::Metres(east_m, north_m) = place {
            for (role, number) in [("easting", east_m), ("northing", north_m)] {
                bounds::COORDINATE_M.check(number).ok_or_else(|| row.bad(role, bounds::COORDINATE_M.words))?;
            }
        }
        let name = Some(row.text("vehicle")).filter(|name| !name.is_empty()).map(str::to_owned);
        let time_s = if row.text("time").is_empty() { None } else { Some(row.time_s()?) };
        waypoints.push(Waypoint { name, time_s, place, depth_m });
    }
    match waypoints.is_empty() {
        true => Err(row.table.error(Problem::Empty { what: "places" }).into()),
        false => Ok(waypoints),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Waypoint>, String> {
        read_waypoints(text.as_bytes(), Path::new("places.csv")).map_err(|error| error.to_string())
    }

    #[test]
    fn places_have_the_column_names_of_navigation() {
        let found = read("name,lat,lon,depth\nbuoy,41.5,-70.5,3\n,41.6,-70.5,\n").unwrap();
        assert_eq!((found[0].name.as_deref(), found[0].depth_m, found[0].time_s), (Some("buoy"), Some(3.0), None));
        assert_eq!((found.len(), &found[1].name, found[1].depth_m), (2, &None, None));
        let found = read("t;x;y\n2026-05-03T12:00:00Z;1;2\n").unwrap();
        assert_eq!((found[0].place, found[0].time_s), (Place::Metres(1.0, 2.0), Some(1_777_809_600.0)));
    }

    #[test]
    fn an_invalid_place_is_refused_with_its_line() {
        for (text, message) in [
            ("x,y\n", "no places"),
            ("x\n1\n", "northing_m"),
            ("x,y\n1,2\n1,\n", "line 3"),
            ("x,y\n1,1e12\n", "1e12"),
            ("lat,lon\n91,0\n", "91"),
            ("x,y,time_s\n1,2,noon\n", "noon"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(message), "{text}: {error}");
        }
    }
}
