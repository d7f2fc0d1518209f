//! Zones of the Universal Transverse Mercator system (UTM).

use pingmap_agent::Geographic;

/// A zone of the Universal Transverse Mercator system, or of its polar companion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UtmZone {
    /// Number of the zone from 1; `None` near a pole.
    zone: Option<u32>,
    is_north: bool,
}

impl UtmZone {
    /// Returns the zone that contains a place, without the exceptions around Norway.
    pub fn at(place: Geographic) -> Self {
        let is_polar = !(-80.0..=84.0).contains(&place.latitude_deg);
        let zone = ((place.longitude_deg + 180.0) / 6.0) as u32 % 60 + 1;
        Self { zone: (!is_polar).then_some(zone), is_north: place.latitude_deg >= 0.0 }
    }
}

impl std::fmt::Display for UtmZone {
    /// Writes the EPSG code and the name of the zone.
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (hemisphere, first_code) = if self.is_north { ("north", 32600) } else { ("south", 32700) };
        match self.zone {
            Some(zone) => write!(formatter, "EPSG:{} (UTM zone {zone} {hemisphere})", first_code + zone),
            None => write!(formatter, "EPSG:{} (UPS {hemisphere})", first_code + 61),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_have_their_codes() {
        let name = |latitude_deg, longitude_deg| {
            UtmZone::at(Geographic::new(latitude_deg, longitude_deg).unwrap()).to_string()
        };
        assert_eq!(name(43.6, -70.3), "EPSG:32619 (UTM zone 19 north)");
        assert_eq!(name(-17.2, 180.0), "EPSG:32701 (UTM zone 1 south)");
        assert_eq!(
            (name(85.0, 0.0), name(-81.0, 0.0)),
            ("EPSG:32661 (UPS north)".into(), "EPSG:32761 (UPS south)".into())
        );
    }
}
