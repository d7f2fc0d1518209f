//! Parsing and formatting of times.

use std::str::FromStr;

use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::{self, Offset};

/// Larger numbers are no seconds. Each further unit since 1970 is a thousand times larger: milliseconds, microseconds,
/// nanoseconds.
const SECONDS_MAX: f64 = 1e11;

/// Number of parts of a second in each unit of an epoch, from seconds on.
const EPOCH_UNITS: [(f64, EpochUnit); 4] = [
    (1.0, EpochUnit::Seconds),
    (1e3, EpochUnit::Milliseconds),
    (1e6, EpochUnit::Microseconds),
    (1e9, EpochUnit::Nanoseconds),
];

/// The formats that [`parse_time`] accepts, for error messages.
pub const TIME: &str =
    "seconds, or a date and time such as 2026-05-03T12:00:00.5Z or 03.05.2026 12:00:00 (UTC without a zone)";

/// Times of the years 1990 to 2100. Larger numbers that are no such time in any unit are no epochs, for example
/// `20260503120000`.
const EPOCH_S: std::ops::Range<f64> = 631_152_000.0..4_102_444_800.0;

/// The formats that times in tables may have, for error messages.
pub(crate) const TIME_IN_ZONE: &str = "seconds, or a date and time such as 2026-05-03T12:00:00.5Z or 03.05.2026 12:00:00, in UTC or \
    --time-zone (times that occur twice or never in the zone need an offset)";

/// The unit of a number that counts from the beginning of 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EpochUnit {
    /// Seconds, or any text that is not a number.
    Seconds,
    /// Milliseconds.
    Milliseconds,
    /// Microseconds.
    Microseconds,
    /// Nanoseconds.
    Nanoseconds,
}

impl EpochUnit {
    /// Returns the name of the unit.
    pub fn name(self) -> &'static str {
        match self {
            EpochUnit::Seconds => "seconds",
            EpochUnit::Milliseconds => "milliseconds",
            EpochUnit::Microseconds => "microseconds",
            EpochUnit::Nanoseconds => "nanoseconds",
        }
    }
}

/// The zone of dates and times that name none.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeZone(tz::TimeZone);

impl TimeZone {
    /// Coordinated Universal Time.
    pub const UTC: Self = Self(tz::TimeZone::UTC);
}

impl FromStr for TimeZone {
    type Err = &'static str;

    /// Parses a name such as `Europe/Berlin`, or an offset from UTC such as `+02:00`.
    fn from_str(text: &str) -> Result<Self, &'static str> {
        let zone = match text.starts_with(['+', '-']) {
            true => parse_offset(text).map(tz::TimeZone::fixed),
            false => tz::TimeZone::get(text).ok(),
        };
        zone.map(Self).ok_or("expected a time zone such as Europe/Berlin, or an offset such as +02:00")
    }
}

/// Parses an offset of hours and minutes.
fn parse_offset(text: &str) -> Option<Offset> {
    let (hours, minutes) = text[1..].split_once(':').unwrap_or((&text[1..], "0"));
    let (hours, minutes): (i32, i32) = (hours.parse().ok()?, minutes.parse().ok()?);
    let seconds = 3600 * hours + 60 * minutes;
    let is_valid = (0..=15).contains(&hours) && (0..60).contains(&minutes);
    Offset::from_seconds(if text.starts_with('-') { -seconds } else { seconds }).ok().filter(|_| is_valid)
}

/// Parses a time to seconds. A number is used as it is. A date and time (ISO 8601, or day.month.year) counts from the
/// beginning of 1970. The time zone is UTC unless the text names another.
///
/// Numbers beyond 10¹¹ are milliseconds, microseconds or nanoseconds since 1970.
///
/// ```
/// use pingmap_import::parse_time;
///
/// assert_eq!(parse_time("12.5"), Some(12.5));
/// assert_eq!(parse_time("1970-01-02 00:00:01.5"), Some(86401.5));
/// assert_eq!(parse_time("02.01.1970 00:00:01,5"), Some(86401.5));
/// assert_eq!(parse_time("1970-01-02T01:00:00+01:00"), Some(86400.0));
/// assert_eq!(parse_time("1777809600250"), Some(1777809600.25)); // milliseconds
/// ```
pub fn parse_time(text: &str) -> Option<f64> {
    parse_time_in(text, &TimeZone::UTC).map(|(time_s, _)| time_s)
}

/// Parses a time as [`parse_time`] does, in a zone unless the text names another. Also returns the unit of a number.
pub(crate) fn parse_time_in(text: &str, zone: &TimeZone) -> Option<(f64, EpochUnit)> {
    let text = text.trim();
    if let Ok(number) = text.parse::<f64>() {
        let (parts, unit) = EPOCH_UNITS.into_iter().find(|(parts, _)| number.abs() <= SECONDS_MAX * parts)?;
        let is_plausible = unit == EpochUnit::Seconds || EPOCH_S.contains(&(number / parts));
        return is_plausible.then_some((number / parts, unit));
    }
    let civil = || {
        let civil = text.parse::<DateTime>().ok().or_else(|| day_first(text))?;
        zone.0.to_ambiguous_timestamp(civil).unambiguous().ok()
    };
    let stamp = text.parse::<Timestamp>().ok().or_else(civil)?;
    Some((stamp.as_second() as f64 + f64::from(stamp.subsec_nanosecond()) * 1e-9, EpochUnit::Seconds))
}

/// Parses a date such as 03.05.2026 with a time.
fn day_first(text: &str) -> Option<DateTime> {
    DateTime::strptime("%d.%m.%Y %H:%M:%S%.f", text.replace(',', ".")).ok()
}

/// Formats a time as a date and time beyond 10⁸ s (March 1973), else in seconds.
pub fn time_in_words(time_s: f64) -> String {
    utc(time_s).map_or_else(|| format!("{time_s:.1} s"), |stamp| stamp.to_string())
}

/// Returns the date in UTC of a time beyond 10⁸ s (March 1973). Other times are not times of day.
pub fn date_in_words(time_s: f64) -> Option<String> {
    utc(time_s).map(|stamp| stamp.strftime("%Y-%m-%d").to_string())
}

fn utc(time_s: f64) -> Option<Timestamp> {
    let nanoseconds = (time_s * 1e3).round() as i128 * 1_000_000;
    Timestamp::from_nanosecond(nanoseconds).ok().filter(|_| time_s.abs() > 1e8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_times_are_rejected() {
        for text in [
            "",
            "noon",
            "nan",
            "inf",
            "2026-13-01T00:00:00Z",
            "12:00:00",
            "1e21",
            "20260503120000",
            "31.04.2026 12:00:00",
            "5/3/2026 12:00:00",
        ] {
            assert_eq!(parse_time(text), None, "{text}");
        }
        assert_eq!(parse_time("2026-05-03T12:00:00Z"), Some(1_777_809_600.0));
    }

    #[test]
    fn numbers_are_seconds_or_the_unit_that_fits_the_epoch() {
        for (text, unit) in [
            ("1777809600", EpochUnit::Seconds),
            ("1777809600000", EpochUnit::Milliseconds),
            ("1777809600000000", EpochUnit::Microseconds),
            ("1777809600000000000", EpochUnit::Nanoseconds),
        ] {
            assert_eq!(parse_time_in(text, &TimeZone::UTC), Some((1_777_809_600.0, unit)));
        }
    }

    #[test]
    fn zones_apply_to_texts_that_name_none() {
        let time_s = |text, zone: &str| parse_time_in(text, &zone.parse().unwrap()).unwrap().0;
        for (text, zone) in [
            ("2026-05-03 14:00:00", "Europe/Berlin"),
            ("03.05.2026 14:00:00", "+02:00"),
            ("03.05.2026 08:30:00", "-03:30"),
            ("2026-05-03T12:00:00Z", "Europe/Berlin"),
            ("2026-01-01T00:00:00Z", "UTC"),
        ] {
            let expected = if zone == "UTC" { 1_767_225_600.0 } else { 1_777_809_600.0 };
            assert_eq!(time_s(text, zone), expected, "{text} {zone}");
        }
        // The clocks were set back at 3:00 and forward at 2:00.
        for never_or_twice in ["2026-10-25 02:30:00", "2026-03-29 02:30:00"] {
            assert_eq!(parse_time_in(never_or_twice, &"Europe/Berlin".parse().unwrap()), None);
        }
        for wrong in ["", "Europe/Nowhere", "+25:00", "+1:99", "+x", "-"] {
            assert!(wrong.parse::<TimeZone>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn formatted_times_are_parsed_back() {
        assert_eq!(time_in_words(1_777_809_600.25), "2026-05-03T12:00:00.25Z");
        assert_eq!(time_in_words(-3.0), "-3.0 s");
        assert_eq!(date_in_words(1_777_809_600.25).as_deref(), Some("2026-05-03"));
        assert_eq!(date_in_words(3.0), None);
        assert_eq!(parse_time(&time_in_words(1_777_809_600.25)), Some(1_777_809_600.25));
    }
}
