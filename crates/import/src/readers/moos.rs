//! MOOS logs (`.alog`). Each row has a time, a variable, its writer, and a value.

use std::io::{self, BufRead};

use pingmap_agent::{Geographic, VehicleId};

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::{ParsedFile, SkipCounts};
use crate::model::recording::Recording;
use crate::readers::lines::Lines;
use crate::readers::modem::goby::ModemTransmission;
use crate::readers::modem::micromodem::Micromodem;
use crate::readers::modem::nmea::Sentence;
use crate::readers::navigation::Navigation;
use crate::readers::sink::Sink;

/// The usual prefix of the modem's variables.
pub const MOOS_PREFIX: &str = "ACOMMS_";

/// A time later than this many seconds before the start of the log is absolute. Other times count from the start.
const BEFORE_START_S: f64 = 1000.0;

/// A start of the log before this time (September 2001) shows a clock that was not set, in seconds.
const SET_CLOCK_S_MIN: f64 = 1e9;

/// A time beyond this is absolute even in a log without a start, in seconds.
const ABSOLUTE_S_MIN: f64 = 1e8;

/// Returns whether a file starts like a MOOS log.
pub(crate) fn is_alog(head: &str) -> bool {
    let mut lines = head.lines().filter(|line| !line.trim().is_empty());
    let first = lines.next().unwrap_or("");
    first.starts_with("%%") && head.lines().any(|line| line.contains("LOGSTART") || line.contains("LOG FILE"))
}

/// Returns the datum in a mission file, from its lines `LatOrigin = …` and `LongOrigin = …`.
pub(crate) fn mission_datum(head: &str) -> Option<Geographic> {
    let value = |key: &str| {
        let value_in_line = |line: &str| {
            let (name, value) = line.split("//").next()?.split_once('=')?;
            name.trim().eq_ignore_ascii_case(key).then(|| value.trim().parse::<f64>().ok())?
        };
        head.lines().find_map(value_in_line)
    };
    Geographic::new(value("LatOrigin")?, value("LongOrigin")?)
}

/// Reads a log. The variables of its modem start with `prefix`. Invalid rows are counted and skipped.
///
/// Needs O(rows) time. Memory holds one row, the receptions and transmissions, and at most one fix per second.
///
/// # Errors
/// The outer error reports a file that cannot be read. The inner error, as text, reports a log with relative times but
/// without a start.
pub(crate) fn read(reader: impl BufRead, ids: &ModemIds, prefix: &str) -> io::Result<Result<ParsedFile, String>> {
    let mut lines = Lines::new(reader);
    let mut log = AlogParser { prefix: prefix.to_owned(), ..AlogParser::default() };
    while let Some(line) = lines.next()? {
        if let Some(remark) = line.strip_prefix("%%") {
            log.absorb_header(remark);
        } else if let Some((time_s, variable, value)) = split_row(line) {
            let Some(time_s) = log.time_s(time_s) else {
                return Ok(Err(format!(
                    "line {}: the time {time_s} s counts from the start of the log, which no line states; expected %% LOGSTART and seconds",
                    lines.number
                )));
            };
            log.absorb(time_s, variable, value, ids);
        } else if !line.trim().is_empty() {
            log.garbled += 1;
        }
    }
    Ok(Ok(log.finish(ids)))
}

/// Splits a row into its time, its variable and its value. The writer is left out.
fn split_row(line: &str) -> Option<(f64, &str, &str)> {
    let (time, rest) = split_word(line.trim_start())?;
    let (variable, rest) = split_word(rest)?;
    let (_, value) = split_word(rest).unwrap_or((rest, ""));
    Some((parse_seconds(time)?, variable, value.trim_end()))
}

/// Parses a number of seconds.
fn parse_seconds(text: &str) -> Option<f64> {
    text.parse().ok().filter(|time_s: &f64| time_s.abs() < 1e11)
}

/// Splits off the first word.
fn split_word(text: &str) -> Option<(&str, &str)> {
    let end = text.find(char::is_whitespace)?;
    Some((&text[..end], text[end..].trim_start()))
}

#[derive(Default)]
struct AlogParser {
    prefix: String,
    start_s: Option<f64>,
    /// Whether the times of a log with an unset clock are absolute, by its first row.
    is_absolute: Option<bool>,
    /// Whether values start with a letter for their type (data type marking).
    is_marked: bool,
    name: Option<VehicleId>,
    navigation: Navigation,
    node_reports: Navigation,
    modem: Micromodem,
    /// Records from the modem's own sentences, and those from its host's messages.
    recording: Recording,
    host_recording: Recording,
    garbled: usize,
}

impl AlogParser {
    fn absorb_header(&mut self, remark: &str) {
        let mut words = remark.split_whitespace();
        match words.next() {
            Some("LOGSTART") => self.start_s = words.next().and_then(parse_seconds).or(self.start_s),
            Some("DATATYPE") => self.is_marked = words.next() == Some("MARKING") && words.next() == Some("ON"),
            _ => {}
        }
    }

    /// Converts a time of the log to absolute time; `None` if the log does not state its start.
    ///
    /// A clock that was set after the start of the log makes relative times large. The first row is early enough to
    /// tell whether times are relative.
    fn time_s(&mut self, time_s: f64) -> Option<f64> {
        match self.start_s {
            Some(start_s) if start_s < SET_CLOCK_S_MIN => {
                let seems_absolute = start_s > BEFORE_START_S && time_s + BEFORE_START_S > start_s;
                let is_absolute = *self.is_absolute.get_or_insert(seems_absolute);
                Some(if is_absolute { time_s } else { start_s + time_s })
            }
            Some(start_s) if time_s + BEFORE_START_S > start_s => Some(time_s),
            Some(start_s) => Some(start_s + time_s),
            None => (time_s > ABSOLUTE_S_MIN).then_some(time_s),
        }
    }

    fn absorb(&mut self, time_s: f64, variable: &str, value: &str, ids: &ModemIds) {
        let is_marked = self.is_marked && value.as_bytes().get(1) == Some(&b':');
        let value = if is_marked { &value[2..] } else { value };
        if let Some(name) = variable.strip_prefix("NAV_") {
            self.garbled += usize::from(!self.navigation.absorb_coordinate(time_s, name, value));
        } else if variable == "NODE_REPORT_LOCAL" {
            self.absorb_node_report(time_s, value);
        } else if let Some(name) = variable.strip_prefix(self.prefix.as_str()) {
            match name {
                "NMEA_IN" | "NMEA_OUT" => match Sentence::parse(value) {
                    Some(sentence) => {
                        self.modem.absorb(time_s, &sentence, Sink { recording: &mut self.recording, ids });
                    }
                    None => self.garbled += 1,
                },
                "MODEM_RECEIVE" | "MODEM_TRANSMIT" => {
                    self.host_recording.arrivals.get_or_insert_default();
                    self.host_recording.transmissions.get_or_insert_default();
                    let (transmission, mut sink) =
                        (ModemTransmission::parse(value), Sink { recording: &mut self.host_recording, ids });
                    if name == "MODEM_RECEIVE" {
                        transmission.record_reception(time_s, &mut sink);
                    } else {
                        transmission.record_transmission(time_s, &mut sink);
                    }
                }
                _ => {}
            }
        }
    }

    /// Absorbs the vehicle's own node report: its name and position.
    fn absorb_node_report(&mut self, time_s: f64, value: &str) {
        for (key, value) in value.split(',').filter_map(|part| part.split_once('=')) {
            let name = match key.trim() {
                "NAME" => {
                    self.name = Some(VehicleId::new(value.trim()));
                    continue;
                }
                "DEP" => "DEPTH",
                "LON" => "LONG",
                key => key,
            };
            self.node_reports.absorb_coordinate(time_s, name, value.trim());
        }
    }

    fn finish(mut self, ids: &ModemIds) -> ParsedFile {
        let mut skipped = SkipCounts { garbled: self.garbled, ..SkipCounts::default() };
        self.modem.finish(Sink { recording: &mut self.recording, ids }, &mut skipped);
        // The messages of the host repeat the modem's own sentences, so the sentences take precedence.
        let mut recording = if self.modem.has_sentences { self.recording } else { self.host_recording };
        let navigation = if self.navigation.is_empty() { self.node_reports } else { self.navigation };
        let datum = navigation.datum();
        skipped.missing_positions += navigation.missing;
        recording.fixes = navigation.into_fixes();
        ParsedFile { recording, name: self.name, datum, skipped }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::reference::Place;

    fn parse(text: &str) -> Result<ParsedFile, String> {
        read(text.as_bytes(), &ModemIds::default(), MOOS_PREFIX).unwrap()
    }

    #[test]
    fn times_are_absolute_or_relative_to_the_start() {
        let first_s = |text: &str| parse(text).unwrap().recording.fixes[0].time_s;
        let rows = |times: [&str; 2]| format!("{} NAV_X p 1\n{} NAV_Y p 2\n", times[0], times[1]);
        let header = "%%%%\n%% LOG FILE: a.alog\n%% LOGSTART  1777809600.5\n%%%%\n";
        assert_eq!(first_s(&format!("{header}{}", rows(["-2.5", "-2.25"]))), 1_777_809_598.25);
        assert_eq!(first_s(&format!("{header}{}", rows(["1777809610", "1777809610"]))), 1_777_809_610.0);
        assert_eq!(first_s(&rows(["1777809610", "1777809610"])), 1_777_809_610.0);
        // The clock was set after the start of the log, from 1970 or 1980. The second log has absolute times.
        let last_s = |start: &str, first: &str, last: &str| {
            let rows = format!("{first} DB_CLIENTS MOOSDB p,\n{last} NAV_X p 1\n{last} NAV_Y p 2\n");
            first_s(&format!("%% LOG FILE: a.alog\n%% LOGSTART {start}\n{rows}"))
        };
        assert_eq!(last_s("23.5", "0.6", "1777809576.5"), 1_777_809_600.0);
        assert_eq!(last_s("315532800.5", "315532800.75", "1777809600"), 1_777_809_600.0);
        assert_eq!(last_s("315532800.5", "-0.25", "1462276799.5"), 1_777_809_600.0);
        assert!(parse("%% LOGSTART NaN\n3 NAV_X p 1\n").is_err());
        let error = parse(&rows(["3", "4"])).unwrap_err();
        assert!(error.contains("line 1") && error.contains("LOGSTART"), "{error}");
    }

    #[test]
    fn values_may_have_a_type_mark_and_reports_of_others_are_ignored() {
        let text = "%% LOGSTART 1777809600\n%% DATATYPE MARKING ON\n\
            1.0 NAV_X pNav:x D:10.5\n1.0 NAV_Y pNav D:-4\n1.0 NAV_DEPTH pNav D:7\n\
            2.0 NODE_REPORT_LOCAL pNode S:NAME=ada,X=1,Y=2,LAT=41.5,LON=-70.6\n\
            2.5 NODE_REPORT uF S:NAME=bob,X=9,Y=9\nnot a row\n";
        let parsed = parse(text).unwrap();
        assert_eq!(parsed.name, Some(VehicleId::new("ada")));
        let fix = parsed.recording.fixes[0];
        assert_eq!((fix.place, fix.depth_m), (Place::Metres(10.5, -4.0), None));
        assert_eq!((parsed.recording.fixes.len(), parsed.skipped.garbled), (1, 1));
        assert!(parsed.recording.arrivals.is_none() && parsed.recording.transmissions.is_none());
    }

    #[test]
    fn a_mission_file_states_its_datum() {
        let text = "ServerHost = localhost\nLatOrigin  = 43.8253 // the bay\nlongorigin = -70.3304\n";
        assert_eq!(mission_datum(text), Some(Geographic { latitude_deg: 43.8253, longitude_deg: -70.3304 }));
        assert_eq!(mission_datum("LatOrigin = 43"), None);
    }
}
