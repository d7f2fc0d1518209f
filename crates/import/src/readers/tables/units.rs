//! Units in the headers of tables.

/// Returns the number of a role's units in a unit of a table: seconds, metres or degrees. `None` for an unknown unit.
pub(crate) fn factor(role: &str, unit: &str) -> Option<f64> {
    let unit = unit.to_lowercase();
    let quantity = role.rsplit('_').next().unwrap_or_default();
    match quantity {
        _ if unit.is_empty() => Some(1.0),
        "time" => match unit.as_str() {
            "s" | "sec" | "second" | "seconds" | "utc" | "unix" | "epoch" | "iso" | "iso 8601" | "gmt" | "hh:mm:ss" => {
                Some(1.0)
            }
            pattern if pattern.starts_with("yyyy") || pattern.starts_with("dd.mm") => Some(1.0),
            "ms" | "milliseconds" => Some(1e-3),
            "us" | "µs" | "microseconds" => Some(1e-6),
            "ns" | "nanoseconds" => Some(1e-9),
            _ => None,
        },
        "latitude" | "longitude" => {
            let degrees = ["deg", "°", "degree", "degrees", "dd", "decimal degrees", "wgs84", "wgs 84"];
            let plain = unit.replace('_', " ");
            let sides = [" north", " east", " n", " e"];
            let plain = sides.iter().find_map(|side| plain.strip_suffix(side)).unwrap_or(&plain);
            degrees.contains(&plain).then_some(1.0)
        }
        "easting" | "northing" | "depth" => match unit.as_str() {
            "m" | "metre" | "metres" | "meter" | "meters" => Some(1.0),
            "km" => Some(1e3),
            "cm" => Some(1e-2),
            "ft" | "feet" => Some(0.3048),
            _ => None,
        },
        _ => Some(1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_converted_to_seconds_metres_and_degrees() {
        for (role, unit, expected) in [
            ("time", "", Some(1.0)),
            ("time", "MS", Some(1e-3)),
            ("latitude", "°", Some(1.0)),
            ("longitude", "rad", None),
            ("latitude", "degrees_north", Some(1.0)),
            ("longitude", "deg E", Some(1.0)),
            ("time", "YYYY-MM-DD hh:mm:ss", Some(1.0)),
            ("tx_depth", "ft", Some(0.3048)),
            ("easting", "km", Some(1e3)),
            ("depth", "fathoms", None),
            ("source", "id", Some(1.0)),
        ] {
            assert_eq!(factor(role, unit), expected, "{role} {unit}");
        }
    }
}
