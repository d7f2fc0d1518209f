//! Positions in tables of navigation, and lists of places.

use pingmap_agent::{Geographic, bounds};

use crate::model::error::ImportError;
use crate::model::reference::Place;
use crate::readers::navigation::is_before_first_fix;
use crate::readers::tables::role_table::RoleTable;
use crate::readers::tables::roles::TableKind;

/// Checks that a table has columns for positions, in degrees or in metres.
pub(crate) fn require_position(row: &RoleTable) -> Result<(), ImportError> {
    let has_degrees = row.has("latitude") || row.has("longitude");
    row.require(TableKind::Navigation, if has_degrees { &["latitude", "longitude"] } else { &["easting", "northing"] })
}

impl RoleTable<'_> {
    /// Reads a latitude and a longitude; `None` if one is empty or NaN, or both are 0.
    pub(crate) fn degrees(&self, latitude: &str, longitude: &str) -> Result<Option<Place>, ImportError> {
        let Some((latitude_deg, longitude_deg)) = self.number(latitude)?.zip(self.number(longitude)?) else {
            return Ok(None);
        };
        if is_before_first_fix(latitude_deg, longitude_deg) {
            return Ok(None);
        }
        let out_of_bounds = || match bounds::LATITUDE_DEG.check(latitude_deg) {
            None => self.bad(latitude, "a latitude from -90 to 90 degrees"),
            Some(_) => self.bad(longitude, "a longitude from -180 to 360 degrees"),
        };
        Ok(Some(Place::Degrees(Geographic::new(latitude_deg, longitude_deg).ok_or_else(out_of_bounds)?)))
    }

    /// Reads an easting and a northing; `None` if one is empty or NaN.
    pub(crate) fn metres(&self, easting: &str, northing: &str) -> Result<Option<Place>, ImportError> {
        let metres = self.number(easting)?.zip(self.number(northing)?);
        Ok(metres.map(|(east_m, north_m)| Place::Metres(east_m, north_m)))
    }

    /// Reads a depth in metres; `None` if it is empty or NaN.
    pub(crate) fn depth_m(&self, depth: &str) -> Result<Option<f64>, ImportError> {
        let depth_m = self.number(depth)?;
        let is_bounded = depth_m.is_none_or(|depth_m| bounds::COORDINATE_M.check(depth_m).is_some());
        is_bounded.then_some(depth_m).ok_or_else(|| self.bad(depth, bounds::COORDINATE_M.words).into())
    }
}

/// Reads the position and the depth of a row; `None` if a coordinate is missing.
pub(crate) fn read_position(row: &RoleTable) -> Result<Option<(Place, Option<f64>)>, ImportError> {
    let place = match row.has("latitude") {
        true => row.degrees("latitude", "longitude")?,
        false => row.metres("easting", "northing")?,
    };
    let depth_m = row.depth_m("depth")?;
    Ok(place.map(|place| (place, depth_m)))
}
