//! Reference systems: the relation between coordinates in metres and positions on Earth.

use std::fmt;
use std::str::FromStr;

use crate::types::bounds;

/// A point on the ellipsoid, in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geographic {
    /// Latitude, in degrees north, −90 to 90.
    pub latitude_deg: f64,
    /// Longitude, in degrees east, −180 to 180.
    pub longitude_deg: f64,
}

impl Geographic {
    /// Returns the point at this latitude and longitude. Returns `None` if one of them is out of bounds.
    ///
    /// Longitudes from 180 to 360 degrees are converted to western longitudes.
    pub fn new(latitude_deg: f64, longitude_deg: f64) -> Option<Self> {
        let latitude_deg = bounds::LATITUDE_DEG.check(latitude_deg)?;
        let is_eastward = longitude_deg > 180.0 && longitude_deg <= 360.0;
        let longitude_deg = if is_eastward { longitude_deg - 360.0 } else { longitude_deg };
        Some(Self { latitude_deg, longitude_deg: bounds::LONGITUDE_DEG.check(longitude_deg)? })
    }

    /// Returns the approximate distance to another point in metres. The error grows with the distance.
    pub fn distance_m(&self, other: &Self) -> f64 {
        // A spherical Earth is accurate enough to distinguish rounding from another origin.
        const METRES_PER_DEGREE: f64 = 111_200.0;
        let north_deg = other.latitude_deg - self.latitude_deg;
        let east_deg = (other.longitude_deg - self.longitude_deg + 180.0).rem_euclid(360.0) - 180.0;
        METRES_PER_DEGREE * north_deg.hypot(east_deg * self.latitude_deg.to_radians().cos())
    }
}

/// The reference system of the coordinates of a log, and of a model that was learned from it.
///
/// It has a text form. This crate does not convert between metres and degrees; programs that draw maps do.
///
/// ```
/// use pingmap_agent::ReferenceSystem;
///
/// let about: ReferenceSystem = "41.52,-70.67".parse()?;
/// let utm: ReferenceSystem = "EPSG:32619".parse()?;
/// assert_eq!((about.to_string().as_str(), utm.to_string().as_str()), ("41.52,-70.67", "EPSG:32619"));
/// # Ok::<(), pingmap_agent::NoReferenceSystem>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum ReferenceSystem {
    /// Metres about an unknown origin.
    #[default]
    Unknown,
    /// Metres east and north of a point. The projection is transverse Mercator about the point, on WGS 84, with scale
    /// factor one. Lengths within 9 km have a relative error below one millionth.
    About(Geographic),
    /// Eastings and northings of a projected system, given by its EPSG code.
    Epsg(u32),
}

/// An error for a text that is not a reference system. The field holds the text.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is not a reference system; expected the latitude and longitude of (0, 0), such as 41.52,-70.67, or EPSG:32619"
)]
pub struct NoReferenceSystem(pub String);

impl ReferenceSystem {
    /// Returns true if the position of the origin on Earth is known.
    pub fn is_known(&self) -> bool {
        *self != ReferenceSystem::Unknown
    }

    /// Returns true if both systems can be equal. Unknown systems agree with every system. Origins agree within one
    /// metre, because they may come from rounded numbers.
    pub fn agrees_with(&self, other: &Self) -> bool {
        match (self, other) {
            (ReferenceSystem::Unknown, _) | (_, ReferenceSystem::Unknown) => true,
            (ReferenceSystem::About(one), ReferenceSystem::About(other)) => one.distance_m(other) <= 1.0,
            _ => self == other,
        }
    }
}

impl fmt::Display for ReferenceSystem {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ReferenceSystem::Unknown => formatter.write_str("unknown"),
            ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => {
                write!(formatter, "{latitude_deg},{longitude_deg}")
            }
            ReferenceSystem::Epsg(code) => write!(formatter, "EPSG:{code}"),
        }
    }
}

impl FromStr for ReferenceSystem {
    type Err = NoReferenceSystem;

    fn from_str(text: &str) -> Result<Self, NoReferenceSystem> {
        let text = text.trim();
        let code = text.split_at_checked(5).filter(|(head, _)| head.eq_ignore_ascii_case("EPSG:"));
        let found = match code {
            Some((_, code)) => code.parse().ok().map(ReferenceSystem::Epsg),
            None if text.eq_ignore_ascii_case("unknown") => Some(ReferenceSystem::Unknown),
            None => text.split_once(',').and_then(|(latitude, longitude)| {
                let degrees = |text: &str| text.trim().parse::<f64>().ok();
                Geographic::new(degrees(latitude)?, degrees(longitude)?).map(ReferenceSystem::About)
            }),
        };
        found.ok_or_else(|| NoReferenceSystem(text.to_owned()))
    }
}
