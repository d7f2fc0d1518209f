//! Captures of the sentences between a host and its modem. Each line has a time before its sentence.

use std::borrow::Cow;
use std::io::{self, BufRead};

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::ParsedFile;
use crate::model::time::parse_time;
use crate::readers::lines::Lines;
use crate::readers::modem::micromodem::Micromodem;
use crate::readers::modem::nmea::Sentence;
use crate::readers::sink::Sink;

/// The names of months in Goby's times.
const MONTHS: [&str; 12] = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];

/// A number behind a program's name is a time of day if it is later than this (1973), in seconds.
const TIME_OF_DAY_S_MIN: f64 = 1e8;

/// Reads a capture. Lines without a sentence are skipped. Those with an invalid sentence or time are counted. O(lines)
/// time; holds one line.
pub(crate) fn read(reader: impl BufRead, ids: &ModemIds) -> io::Result<ParsedFile> {
    let (mut lines, mut modem, mut parsed) = (Lines::new(reader), Micromodem::default(), ParsedFile::default());
    while let Some(line) = lines.next()? {
        let Some((prefix, _)) = line.split_once('$') else { continue };
        match (leading_time(prefix), Sentence::parse(line)) {
            (Some(time_s), Some(sentence)) if sentence.name.starts_with("GP") || sentence.name.starts_with("GN") => {
                parsed.recording.clock_syncs.extend(has_fix(&sentence).map(|has_fix| (time_s, has_fix)));
            }
            (Some(time_s), Some(sentence)) => {
                modem.absorb(time_s, &sentence, Sink { recording: &mut parsed.recording, ids });
            }
            _ => parsed.skipped.garbled += 1,
        }
    }
    modem.finish(Sink { recording: &mut parsed.recording, ids }, &mut parsed.skipped);
    Ok(parsed)
}

/// Returns whether a satellite receiver has a fix, if the sentence states it. A fix sets the clock of the host.
fn has_fix(sentence: &Sentence) -> Option<bool> {
    match sentence.name.get(2..)? {
        "RMC" => Some(sentence.field(1) == "A"),
        "GGA" => Some(!matches!(sentence.field(5), "" | "0")),
        _ => None,
    }
}

/// Parses the time before a sentence, such as `1777809600.25`, `[2026-05-03T12:00:00Z]` or `2026-05-03 12:00:00Z,RX,`.
/// Any text may follow the time.
///
/// The name of a program may precede a time of day in brackets, as in Goby's `pAcommsHandler [2026-May-03 12:00:00]`.
pub(crate) fn leading_time(prefix: &str) -> Option<f64> {
    let time_in_brackets = || time_at_start(prefix.split_once(" [")?.1).filter(|time_s| *time_s > TIME_OF_DAY_S_MIN);
    time_at_start(prefix).or_else(time_in_brackets)
}

/// Parses the time at the start of a text.
fn time_at_start(prefix: &str) -> Option<f64> {
    let prefix = prefix.trim_start_matches([' ', '\t', '[', '(', '"']);
    let is_end = |c: char| c.is_whitespace() || matches!(c, ',' | ';' | ']' | ')' | '"' | '<' | '>' | '|');
    let (first, rest) = prefix.split_at(prefix.find(is_end).unwrap_or(prefix.len()));
    let second = || {
        let rest = rest.strip_prefix(' ')?;
        let (time, rest) = rest.split_at(rest.find(is_end).unwrap_or(rest.len()));
        parse_with_fraction(&format!("{}T{time}", numeric_date(first)), rest)
    };
    // A date without a time would be midnight, so the next word is tried first.
    second().or_else(|| parse_with_fraction(first, rest)).or_else(|| parse_time(first.trim_end_matches(':')))
}

/// Replaces the name of the month in a date such as `2026-May-03` by its number.
fn numeric_date(date: &str) -> Cow<'_, str> {
    let parts = date.split_once('-').and_then(|(year, rest)| Some((year, rest.split_once('-')?)));
    let month = parts.and_then(|(_, (name, _))| MONTHS.iter().position(|month| *month == name));
    match (parts, month) {
        (Some((year, (_, day))), Some(month)) => format!("{year}-{:02}-{day}", month + 1).into(),
        _ => date.into(),
    }
}

/// Parses a time, and a fraction of three or six digits behind a comma. Digits in a field of their own are no fraction.
fn parse_with_fraction(time: &str, suffix: &str) -> Option<f64> {
    let fraction = suffix.strip_prefix(',').unwrap_or("");
    let (fraction, rest) = fraction.split_at(fraction.find(|c: char| !c.is_ascii_digit()).unwrap_or(fraction.len()));
    let is_fraction =
        matches!(fraction.len(), 3 | 6) && time.contains('T') && !time.contains('.') && !rest.starts_with([',', ';']);
    let whole = is_fraction.then(|| parse_time(&format!("{time}.{fraction}"))).flatten();
    whole.or_else(|| parse_time(time))
}

/// Returns whether the beginning of a file has a line with a time and a modem sentence.
pub(crate) fn is_capture(head: &str) -> bool {
    head.lines().any(|line| {
        let sentence = Sentence::parse(line).filter(|sentence| matches!(sentence.name.get(..2), Some("CA" | "CC")));
        sentence.is_some() && line.split_once('$').is_some_and(|(prefix, _)| leading_time(prefix).is_some())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_many_formats_are_parsed() {
        for prefix in [
            "1777809600.25 ",
            "[1777809600.25] ",
            "2026-05-03T12:00:00.25Z\t",
            "2026-05-03T12:00:00.25Z\tINFO\tmodem\t",
            "2026-05-03 12:00:00.25Z,RX,",
            "\"2026-05-03T12:00:00.25\",\"",
            "1777809600.25: ",
            "1777809600.25 < ",
            "2026-05-03 12:00:00,250 INFO ",
            "2026-05-03T12:00:00,250 ",
            "pAcommsHandler [2026-May-03 12:00:00.250000] {goby::acomms::modemdriver::in::1}: D: ",
            "[ 2026-May-03 12:00:00.250000 ]       {goby::acomms::modemdriver::in::1}: D: ",
            "\u{1b}[36mgoby acomms\u{1b}[00m [2026-May-03 12:00:00.250000]: ",
            "[ INFO] [1777809600.250000000]: ",
        ] {
            assert_eq!(leading_time(prefix), Some(1_777_809_600.25), "{prefix:?}");
        }
        assert_eq!(leading_time("2026-05-03 12:00:00,1,"), leading_time("2026-05-03 12:00:00 "));
        assert_eq!(leading_time("goby [2026-Dec-03 12:00:00]: "), parse_time("2026-12-03T12:00:00"));
        for prefix in
            ["", "RX ", "12:00:00 ", "[", "\u{fffd}", "note [3] ", "goby [2026-Mai-03 12:00:00] ", "a [", "-- [--"]
        {
            assert_eq!(leading_time(prefix), None, "{prefix:?}");
        }
    }
}
