//! Parsers of option values: numbers, times and places within bounds.

use pingmap_agent::{Bounds, Fading, ReferenceSystem, bounds};
use pingmap_import::{Place, Reference};

/// The time of a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    End,
    Typical,
    AnotherDay,
    At(f64),
}

impl Moment {
    pub fn parse(text: &str) -> Result<Self, String> {
        match text {
            "end" => Ok(Moment::End),
            "typical" => Ok(Moment::Typical),
            "another-day" => Ok(Moment::AnotherDay),
            number => {
                let number = number.parse().ok().and_then(|number| bounds::TIME_S.check(number));
                let expected =
                    || format!("expected end, typical, another-day or a time in seconds, {}", bounds::TIME_S);
                number.map(Moment::At).ok_or_else(expected)
            }
        }
    }
}

/// Parses a whole number within bounds.
fn count(text: &str, bounds: Bounds) -> Result<usize, String> {
    text.parse().ok().and_then(|number| bounds.check_count(number)).ok_or_else(|| format!("expected {bounds}"))
}

pub fn packets(text: &str) -> Result<usize, String> {
    count(text, bounds::PACKETS)
}

pub fn repeats(text: &str) -> Result<usize, String> {
    count(text, bounds::REPEATS)
}

pub fn events(text: &str) -> Result<usize, String> {
    count(text, bounds::EVENTS)
}

pub fn dense_events(text: &str) -> Result<usize, String> {
    count(text, bounds::DENSE_EVENTS)
}

pub fn inducing_points(text: &str) -> Result<usize, String> {
    count(text, bounds::INDUCING_POINTS)
}

pub fn frame_bytes(text: &str) -> Result<usize, String> {
    count(text, bounds::FRAME_BYTES)
}

/// Bytes left over in a message of the host.
pub fn piggyback_bytes(text: &str) -> Result<usize, String> {
    count(text, bounds::PIGGYBACK_BYTES)
}

/// Parses a whole number. The caller checks its bounds.
pub fn whole_number(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "expected a whole number, not negative".to_owned())
}

/// Parses a number within bounds.
fn number(text: &str, bounds: Bounds) -> Result<f64, String> {
    text.parse().ok().and_then(|number| bounds.check(number)).ok_or_else(|| format!("expected {bounds}"))
}

pub fn sea_state(text: &str) -> Result<f64, String> {
    number(text, bounds::SEA_STATE)
}

pub fn positive(text: &str) -> Result<f64, String> {
    number(text, bounds::POSITIVE)
}

/// Width of print in millimetres.
pub fn print_width(text: &str) -> Result<f64, String> {
    let width = text.parse().ok().filter(|width: &f64| (30.0..=1200.0).contains(width));
    width.ok_or_else(|| "expected a number from 30 to 1200".to_owned())
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    number(text, bounds::NOT_NEGATIVE)
}

pub fn heading(text: &str) -> Result<f64, String> {
    number(text, bounds::HEADING_DEG)
}

pub fn time(text: &str) -> Result<f64, String> {
    number(text, bounds::TIME_S)
}

pub fn mission_s(text: &str) -> Result<f64, String> {
    number(text, bounds::MISSION_S)
}

pub fn site_points(text: &str) -> Result<usize, String> {
    count(text, bounds::SITE_PRIOR_POINTS)
}

pub fn threads(text: &str) -> Result<usize, String> {
    count(text, bounds::THREADS)
}

pub fn share(text: &str) -> Result<f64, String> {
    number(text, bounds::SHARE)
}

pub fn open_share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && *number < 1.0);
    number.ok_or_else(|| "expected a number above 0 and below 1".to_owned())
}

pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().ok().and_then(|x| bounds::COORDINATE_M.check(x)))
        .collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.ok_or_else(|| format!("expected {N} numbers, each at most 1e9 in magnitude, separated by commas"))
}

/// Parses the latitude and longitude of (0, 0).
pub fn origin(text: &str) -> Result<ReferenceSystem, String> {
    let found = text.parse().ok().filter(|system| matches!(system, ReferenceSystem::About(_)));
    found.ok_or_else(|| {
        let (latitude, longitude) = (bounds::LATITUDE_DEG, bounds::LONGITUDE_DEG);
        let swapped = text.split_once(',').map(|(a, b)| format!("{},{}", b.trim(), a.trim()));
        let is_origin = |text: &String| text.parse().is_ok_and(|system| matches!(system, ReferenceSystem::About(_)));
        match swapped.filter(is_origin) {
            Some(swapped) => format!("expected the latitude first: --origin {swapped}"),
            None => format!("expected a latitude ({latitude}) and a longitude ({longitude})"),
        }
    })
}

/// Parses a reference system by its number.
pub fn crs(text: &str) -> Result<ReferenceSystem, String> {
    let reference = Reference::epsg(text).map_err(|error| error.to_string())?;
    Ok(reference.system())
}

/// Parses a place in metres or degrees, with an optional depth.
pub fn place(text: &str) -> Result<(Place, Option<f64>), String> {
    let expected =
        || "expected EAST,NORTH in metres, or degrees such as 41.52N,70.67W, and perhaps a depth in metres".to_owned();
    let parts: Vec<&str> = text.splitn(3, ',').collect();
    let [a, b, depth @ ..] = &parts[..] else { return Err(expected()) };
    let metres = |text: &&str| text.trim().parse::<f64>().ok().and_then(|number| bounds::COORDINATE_M.check(number));
    let depth_m = depth.first().map(|depth| metres(depth).ok_or_else(expected)).transpose()?;
    Ok((format!("{a},{b}").parse().map_err(|_| expected())?, depth_m))
}

/// Parses two opposite corners of an area.
pub fn corners(text: &str) -> Result<(Place, Place), String> {
    let expected = || "expected two opposite corners, such as 0,0,1500,900 or 41.5N,70.7W,41.6N,70.6W".to_owned();
    let parts: Vec<&str> = text.split(',').collect();
    let [a, b, c, d] = parts[..] else { return Err(expected()) };
    let corner = |a: &str, b: &str| format!("{a},{b}").parse::<Place>().map_err(|_| expected());
    match (corner(a, b)?, corner(c, d)?) {
        corners @ ((Place::Metres(..), Place::Metres(..)) | (Place::Degrees(_), Place::Degrees(_))) => Ok(corners),
        _ => Err(expected()),
    }
}

pub fn quadruple(text: &str) -> Result<[f64; 4], String> {
    numbers(text)
}

/// Parses fading: correlation, seconds, metres a second; or `none`.
pub fn fading(text: &str) -> Result<Fading, String> {
    if text == "none" {
        return Ok(Fading::NONE);
    }
    let [correlation, memory_s, drift_m_per_s] = numbers(text).map_err(|error| format!("{error}, or none"))?;
    let fading = Fading { correlation, memory_s, drift_m_per_s };
    match fading.entries().into_iter().find(|(_, value, bounds)| bounds.check(*value).is_none()) {
        Some((_, value, bounds)) => Err(format!("{value}: expected {bounds}")),
        None => Ok(fading),
    }
}
