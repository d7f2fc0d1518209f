//! Event logs as text files with delimiters: commas, semicolons or tabs. Lines that begin with `#` are remarks.
//!
//! Required columns, in any order: `time_s, tx_id, rx_id, tx_easting_m, tx_northing_m, rx_easting_m, rx_northing_m,
//! success`.
//!
//! Optional columns: `true_probability` (for scoring only), `tx_depth_m` and `rx_depth_m`, `tx_heading_deg` and
//! `rx_heading_deg`, and `kind`. With both depths, links have six inputs. An unknown heading is the course of the
//! vehicle. Without `kind`, the columns `rate`, `band`, `level` and `length` form the kind of
//! message. Other columns are listed in [`EventLog::unknown_columns`].
//!
//! A remark before the header may name the reference system: `# reference system: 41.52,-70.67` (latitude and longitude
//! of (0, 0)) or `# reference system: EPSG:32619`.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

use pingmap_agent::{Chart, Event, InputSpec, Link, Position, ReferenceSystem, VehicleId};
use pingmap_packet::to_hex;

use crate::table::{FileError, Problem, Table, open};

/// Required columns of an event log.
pub const REQUIRED_COLUMNS: [&str; 8] =
    ["time_s", "tx_id", "rx_id", "tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m", "success"];

/// Optional columns of an event log.
const OPTIONAL_COLUMNS: [&str; 10] = [
    "true_probability",
    "tx_depth_m",
    "rx_depth_m",
    "tx_heading_deg",
    "rx_heading_deg",
    "kind",
    "rate",
    "band",
    "level",
    "length",
];

/// The events of a trial, in file order.
#[derive(Debug, Clone)]
pub struct EventLog {
    /// The events.
    pub events: Vec<Event>,
    /// True probability of each event, if the log has the column. Used only for scoring.
    pub true_probability: Option<Vec<f64>>,
    /// Whether both ends have depths.
    pub has_depths: bool,
    /// Whether the log has a column of headings. Headings without a column are courses.
    pub has_headings: bool,
    /// Columns of the file that are not used, such as the depth of one end only.
    pub unknown_columns: Vec<String>,
    /// Reference system of the positions.
    pub reference: ReferenceSystem,
}

/// Start of the remark that names a reference system.
const REFERENCE_REMARK: &str = "# reference system:";

impl EventLog {
    /// Reads a CSV file, one event at a time. O(events).
    ///
    /// # Errors
    /// Returns [`FileError`] with file, line, column, value and the expected value.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let file = open(path)?;
        Self::read(file, path)
    }

    /// Reads CSV from any reader. `name` stands for the file in errors.
    ///
    /// # Errors
    /// As [`EventLog::open`].
    pub fn read(reader: impl Read, name: &Path) -> Result<Self, FileError> {
        let mut table = Table::new(reader, name, &REQUIRED_COLUMNS)?;
        let has_depths = table.has("tx_depth_m") && table.has("rx_depth_m");
        let has_headings = table.has("tx_heading_deg") || table.has("rx_heading_deg");
        let has_probability = table.has("true_probability");
        let known = |column: &String| {
            let lone_depth = column.ends_with("_depth_m") && !has_depths;
            REQUIRED_COLUMNS.contains(&column.as_str()) || OPTIONAL_COLUMNS.contains(&column.as_str()) && !lone_depth
        };
        let unknown_columns = table
            .header()
            .iter()
            .filter(|column| !column.is_empty() && !known(&column.to_lowercase()))
            .cloned()
            .collect();
        let reference = reference(&table)?;
        let mut events = Vec::new();
        let mut probabilities = Vec::new();
        while table.next()? {
            events.push(Event {
                time_s: table.number("time_s")?,
                transmitter_id: table.vehicle("tx_id")?,
                receiver_id: table.vehicle("rx_id")?,
                link: table.link(has_depths)?,
                kind: table.kind()?,
                success: table.flag("success")?,
            });
            if has_probability {
                probabilities.push(table.probability("true_probability")?);
            }
        }
        if events.is_empty() {
            return Err(table.error(Problem::Empty { what: "events" }));
        }
        let true_probability = has_probability.then_some(probabilities);
        let mut log = Self { events, true_probability, has_depths, has_headings, unknown_columns, reference };
        log.derive_headings();
        Ok(log)
    }

    /// Appends the events of another log in the same coordinates. True probabilities are kept only if both logs have
    /// them. The reference system of the other log is adopted if that of this log is unknown.
    pub fn append(&mut self, other: Self) {
        self.true_probability = self.true_probability.take().zip(other.true_probability).map(|(mut own, more)| {
            own.extend(more);
            own
        });
        self.events.extend(other.events);
        let unknown: Vec<String> =
            other.unknown_columns.into_iter().filter(|column| !self.unknown_columns.contains(column)).collect();
        self.unknown_columns.extend(unknown);
        self.has_depths &= other.has_depths;
        self.has_headings |= other.has_headings;
        if !self.reference.is_known() {
            self.reference = other.reference;
        }
    }

    /// Returns every vehicle that is a receiver of an event, in alphabetical order.
    pub fn vehicles(&self) -> Vec<VehicleId> {
        let ids: BTreeSet<&VehicleId> = self.events.iter().map(|event| &event.receiver_id).collect();
        ids.into_iter().cloned().collect()
    }

    /// Returns the times and positions of a vehicle, from all its transmissions and receptions.
    pub fn track(&self, id: &VehicleId) -> impl Iterator<Item = (f64, Position)> {
        let at = move |event: &Event| match () {
            () if event.receiver_id == *id => Some((event.time_s, event.link.receiver)),
            () if event.transmitter_id == *id => Some((event.time_s, event.link.transmitter)),
            () => None,
        };
        self.events.iter().filter_map(at)
    }

    /// Returns a log with the events at `indices`, in that order.
    pub fn select(&self, indices: &[usize]) -> Self {
        let pick = |values: &Vec<f64>| indices.iter().map(|&n| values[n]).collect();
        Self {
            events: indices.iter().map(|&n| self.events[n].clone()).collect(),
            true_probability: self.true_probability.as_ref().map(pick),
            has_depths: self.has_depths,
            has_headings: self.has_headings,
            unknown_columns: self.unknown_columns.clone(),
            reference: self.reference,
        }
    }

    /// Returns the log as CSV that [`EventLog::read`] can read. Depths, headings, kinds and true probabilities follow
    /// the required columns if the log has them. A remark names the reference system if known. Numbers have the fewest
    /// digits that identify them.
    pub fn to_csv(&self) -> String {
        let mut header = REQUIRED_COLUMNS.to_vec();
        if self.has_depths {
            header.extend(["tx_depth_m", "rx_depth_m"]);
        }
        if self.has_headings {
            header.extend(["tx_heading_deg", "rx_heading_deg"]);
        }
        let has_kinds = self.events.iter().any(|event| event.kind.is_some());
        if has_kinds {
            header.push("kind");
        }
        if self.true_probability.is_some() {
            header.push("true_probability");
        }
        let remark = format!("{REFERENCE_REMARK} {}\n", self.reference);
        let head = if self.reference.is_known() { remark } else { String::new() };
        let mut writer = csv::Writer::from_writer(head.into_bytes());
        // Writing to memory does not fail, and all rows have one length.
        let _ = writer.write_record(&header);
        for (n, event) in self.events.iter().enumerate() {
            let Link { transmitter: tx, receiver: rx } = event.link;
            let (sender, receiver) = (event.transmitter_id.to_string(), event.receiver_id.to_string());
            let mut row = vec![event.time_s.to_string(), sender, receiver];
            row.extend([tx.east_m, tx.north_m, rx.east_m, rx.north_m].map(|metres| metres.to_string()));
            row.push(u8::from(event.success).to_string());
            if self.has_depths {
                row.extend([tx.depth_m, rx.depth_m].map(|depth_m| depth_m.unwrap_or_default().to_string()));
            }
            if self.has_headings {
                let text = |heading_deg: Option<f64>| heading_deg.map_or_else(String::new, |deg| deg.to_string());
                row.extend([tx.heading_deg, rx.heading_deg].map(text));
            }
            if has_kinds {
                row.push(event.kind.as_ref().map(|kind| kind.to_string()).unwrap_or_default());
            }
            row.extend(self.true_probability.as_ref().map(|probabilities| probabilities[n].to_string()));
            let _ = writer.write_record(&row);
        }
        writer.into_inner().map_or_else(|_| String::new(), |bytes| String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Returns a digest of 32 hexadecimal digits. It does not depend on the file, other columns or the order of lines.
    /// The digest is the first half of the BLAKE3 digest of time, names, positions, outcome and kind of every event.
    /// Headings count unless they are courses.
    pub fn digest(&self) -> String {
        let mut events: Vec<&Event> = self.events.iter().collect();
        events.sort_by(|a, b| a.canonical_order(b));
        let mut bytes = Vec::new();
        for event in events {
            bytes.extend(event.time_s.to_le_bytes());
            for name in [&event.transmitter_id, &event.receiver_id] {
                bytes.extend((name.as_str().len() as u64).to_le_bytes());
                bytes.extend(name.as_str().as_bytes());
            }
            for end in event.link.ends() {
                // A position without a depth is encoded as an infinite depth, which no log can contain.
                let numbers = [end.east_m, end.north_m, end.depth_m.unwrap_or(f64::INFINITY)];
                bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
                if self.has_headings {
                    bytes.extend(end.heading_deg.unwrap_or(f64::INFINITY).to_le_bytes());
                }
            }
            bytes.push(event.success.into());
            bytes.extend(event.kind.iter().flat_map(|kind| kind.as_str().as_bytes()));
        }
        to_hex(&pingmap_packet::digest(&bytes)[..16])
    }

    /// Mean depth of all ends, in metres; `None` without depths.
    pub fn mean_depth_m(&self) -> Option<f64> {
        let ends = self.events.iter().flat_map(|event| event.link.ends());
        let depths: Vec<f64> = ends.filter_map(|end| end.depth_m).collect();
        (!depths.is_empty()).then(|| depths.iter().sum::<f64>() / depths.len() as f64)
    }

    /// Returns the part of the log with this receiver.
    pub fn owned_by(&self, vehicle: &VehicleId) -> Self {
        let own = |n: &usize| self.events[*n].receiver_id == *vehicle;
        self.select(&(0..self.events.len()).filter(own).collect::<Vec<_>>())
    }

    /// Returns a chart about the centre of all positions.
    pub fn chart(&self) -> Chart {
        let reference = self.reference;
        Chart { reference, ..Chart::about(self.events.iter().flat_map(|event| event.link.ends())) }
    }

    /// Returns the inputs that the links have.
    pub fn inputs(&self) -> InputSpec {
        if self.has_depths { InputSpec::PositionsAndDepths } else { InputSpec::Positions }
    }
}

/// Returns the reference system that the remarks before the header name.
fn reference(table: &Table) -> Result<ReferenceSystem, FileError> {
    for (line, remark) in (1..).zip(table.remarks()) {
        if let Some(name) = remark.strip_prefix(REFERENCE_REMARK) {
            let bad = || Problem::BadReference { line, name: name.trim().to_owned() };
            return name.parse().map_err(|_| table.error(bad()));
        }
    }
    Ok(ReferenceSystem::Unknown)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(more: &str, values: &str) -> EventLog {
        let text =
            format!("{}{more}\n10,a,b,0,0,100,0,1{values}\n20,b,a,0,0,100,0,0{values}\n", REQUIRED_COLUMNS.join(","));
        EventLog::read(text.as_bytes(), Path::new("log.csv")).unwrap()
    }

    fn kind(log: &EventLog) -> Option<&str> {
        log.events[1].kind.as_ref().map(|kind| kind.as_str())
    }

    #[test]
    fn kinds_of_messages_are_read_and_written() {
        let plain = read("", "");
        assert_eq!(kind(&plain), None);
        assert!(!plain.to_csv().contains("kind"));
        let named = read(",kind", ",fast 25 kHz");
        assert_eq!((kind(&named), named.unknown_columns.len()), (Some("fast 25 kHz"), 0));
        let made = read(",length,rate", ",32,80");
        assert_eq!(kind(&made), Some("rate 80, length 32"));
        assert_eq!(kind(&read(",rate,kind", ",80,fast")), Some("fast"));
        assert_eq!(kind(&read(",kind", ",")), None);
        for log in [&named, &made] {
            let again = EventLog::read(log.to_csv().as_bytes(), Path::new("again.csv")).unwrap();
            assert_eq!((&again.events, again.digest()), (&log.events, log.digest()));
            assert_ne!(log.digest(), plain.digest());
        }
        let broken = format!("{},kind\n10,a,b,0,0,100,0,1,\u{7}\n", REQUIRED_COLUMNS.join(","));
        let error = EventLog::read(broken.as_bytes(), Path::new("log.csv")).unwrap_err().to_string();
        assert!(error.contains("line 2") && error.contains("kind of message"), "{error}");
    }

    #[test]
    fn logs_with_any_line_ends_and_delimiters_are_read_with_right_line_numbers() {
        let plain = read("", "");
        let header = REQUIRED_COLUMNS.join(";").to_uppercase();
        let text = format!("# a mission\r\n\r\n{header}\r\n10;a;b;0;0;100;0;True\r\n# noon\r\n20;b;a;0;0;100;0;no\r\n");
        let log = EventLog::read(text.as_bytes(), Path::new("log.csv")).unwrap();
        assert_eq!(log.events, plain.events);
        let error = |text: &str| EventLog::read(text.as_bytes(), Path::new("log.csv")).unwrap_err().to_string();
        for ends in ["\n", "\r\n"] {
            let broken = text.replace("\r\n", ends).replace("20;", "x;");
            assert!(error(&broken).contains("line 6, column time_s"), "{}", error(&broken));
            let broken = text.replace("\r\n", ends).replace("True", "maybe");
            assert!(error(&broken).contains("line 4, column success: found \"maybe\""), "{}", error(&broken));
        }
    }
}
