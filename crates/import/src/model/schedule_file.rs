//! Readers of schedules: team files, tables, and configurations of Goby.

use std::io::Read;
use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_trial::Table;
use serde::Deserialize;

use crate::model::error::ImportError;
use crate::model::goby_mac::{is_mac_config, read_mac_config};
use crate::model::modem_ids::ModemIds;
use crate::model::schedule::{DAY_S, Schedule};
use crate::model::time::{TIME, parse_time};

/// Shortest slot, in seconds.
const DURATION_S_MIN: f64 = 0.01;

/// A time in a TOML file: seconds, or a date and time.
#[derive(Deserialize)]
#[serde(untagged)]
enum Time {
    Seconds(f64),
    Whole(i64),
    Text(String),
    Date(toml::value::Datetime),
}

impl Time {
    fn seconds(&self, key: &str) -> Result<f64, String> {
        let text = match self {
            Time::Seconds(seconds) => seconds.to_string(),
            Time::Whole(seconds) => seconds.to_string(),
            Time::Text(text) => text.clone(),
            Time::Date(date) => date.to_string(),
        };
        parse_time(&text).ok_or_else(|| format!("{key}: found {text:?}; expected {TIME}"))
    }
}

/// The part of a team file that holds the slots. All other parts are ignored.
#[derive(Deserialize)]
struct TeamFile {
    slots: SlotTable,
}

#[derive(Deserialize)]
struct SlotTable {
    start_s: Time,
    duration_s: f64,
    #[serde(default)]
    at_will: bool,
    #[serde(default)]
    restarts_daily: bool,
    order: Vec<String>,
    #[serde(default)]
    changes: Vec<OrderChange>,
}

#[derive(Deserialize)]
struct OrderChange {
    from_s: Time,
    order: Vec<String>,
}

/// Longest file of a schedule, in bytes.
const TEXT_BYTES_MAX: u64 = 16 << 20;

impl Schedule {
    /// Reads `[slots]` of a team file, a TOML file with `[slots]` only, a table with the columns `time_s` and `source`,
    /// or the configuration of Goby's medium access control.
    ///
    /// # Errors
    /// [`ImportError`] with the value that was found and what was expected.
    pub fn read(reader: impl Read, path: &Path, ids: &ModemIds) -> Result<Self, ImportError> {
        let fail = |problem: String| ImportError::Content { file: path.display().to_string(), problem };
        let mut text = String::new();
        let read = reader.take(TEXT_BYTES_MAX + 1).read_to_string(&mut text);
        if read.map_err(|error| fail(format!("cannot be read as text: {error}")))? as u64 > TEXT_BYTES_MAX {
            return Err(fail("longer than 16 MB; expected a schedule or a team file".into()));
        }
        match toml::from_str::<TeamFile>(&text) {
            Ok(TeamFile { slots }) => Self::from_slot_table(&slots, ids).map_err(fail),
            Err(_) if is_mac_config(&text) => read_mac_config(&text, ids).map_err(fail),
            Err(_) if !text.contains('=') => Self::from_table(&text, path, ids),
            Err(error) => Err(fail(format!(
                "{}; expected [slots] with start_s, duration_s and order, or a table with the columns time_s and source",
                error.to_string().trim_end()
            ))),
        }
    }

    fn from_slot_table(slots: &SlotTable, ids: &ModemIds) -> Result<Self, String> {
        if slots.at_will {
            return Err(
                "at_will: a team without fixed slots has no schedule; expected records of its transmissions (--sent)"
                    .into(),
            );
        }
        if !(DURATION_S_MIN..=DAY_S).contains(&slots.duration_s) {
            return Err(format!("duration_s: found {}; expected {DURATION_S_MIN} s to a day", slots.duration_s));
        }
        let name = |name: &String| ids.resolve(name).unwrap_or_else(|| VehicleId::new(""));
        let mut orders = vec![(slots.start_s.seconds("start_s")?, slots.order.iter().map(name).collect::<Vec<_>>())];
        for change in &slots.changes {
            orders.push((change.from_s.seconds("from_s")?, change.order.iter().map(name).collect()));
        }
        if orders.iter().any(|(_, order)| order.is_empty()) {
            return Err("order: found no member; expected the members in the order of their slots".into());
        }
        orders.sort_by(|a, b| a.0.total_cmp(&b.0));
        let SlotTable { duration_s, restarts_daily, .. } = *slots;
        Ok(Self::Cyclic { duration_s, restarts_daily, orders })
    }

    fn from_table(text: &str, path: &Path, ids: &ModemIds) -> Result<Self, ImportError> {
        let mut table = Table::new(text.as_bytes(), path, &["time_s", "source"])?;
        let mut slots = Vec::new();
        while table.next()? {
            let time_s = parse_time(table.field("time_s")).ok_or_else(|| table.bad("time_s", TIME))?;
            let source = ids.resolve(table.field("source")).ok_or_else(|| table.bad("source", "one vehicle"))?;
            slots.push((time_s, source));
        }
        slots.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Self::Explicit(slots))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Schedule, ImportError> {
        let ids = ModemIds::read("id,name\n1,a\n2,b\n".as_bytes(), Path::new("ids.csv")).unwrap();
        Schedule::read(text.as_bytes(), Path::new("slots.toml"), &ids)
    }

    fn starts(schedule: &Schedule, sender: &str, from_s: f64, to_s: f64) -> Vec<f64> {
        schedule.slot_starts_s(&VehicleId::new(sender), from_s, to_s)
    }

    #[test]
    fn slots_follow_the_order_of_a_cycle_and_its_changes() {
        let text = "[slots]\nstart_s = 100\nduration_s = 10\norder = ['1', '', 'b']\n[[slots.changes]]\nfrom_s = 145\norder = ['b']\n";
        let schedule = read(text).unwrap();
        assert_eq!(starts(&schedule, "a", 0.0, 300.0), [100.0, 130.0]);
        assert_eq!(starts(&schedule, "b", 0.0, 166.0), [120.0, 145.0, 155.0, 165.0]);
        assert_eq!(starts(&schedule, "b", 150.0, 166.0), [155.0, 165.0]);
        assert!(starts(&schedule, "c", 0.0, 1e9).is_empty());
        assert_eq!(schedule.senders().count(), 3);
    }

    #[test]
    fn cycles_may_restart_at_midnight() {
        let text = "[slots]\nstart_s = '1970-01-01T23:59:40'\nduration_s = 15\norder = ['a', 'b', 'c']\nrestarts_daily = true\n";
        let schedule = read(text).unwrap();
        assert_eq!(starts(&schedule, "a", 0.0, 86_450.0), [86_380.0, 86_400.0, 86_445.0]);
        assert_eq!(starts(&schedule, "b", 0.0, 86_450.0), [86_395.0, 86_415.0]);
        // The search starts at the requested day, not at the first day of the schedule.
        assert_eq!(starts(&schedule, "c", 86_430.0, 86_450.0), [86_430.0]);
        // A TOML date needs no quotation marks.
        assert_eq!(read(&text.replace('\'', "").replace("[a, b, c]", "['a', 'b', 'c']")).unwrap(), schedule);
    }

    #[test]
    fn a_table_may_list_the_slots() {
        let schedule = read("time_s,source\n20,2\n10,a\n30,b\n").unwrap();
        assert_eq!((starts(&schedule, "a", 0.0, 99.0), starts(&schedule, "b", 25.0, 99.0)), (vec![10.0], vec![30.0]));
    }

    #[test]
    fn an_invalid_schedule_is_refused() {
        for (text, words) in [
            ("[slots]\nstart_s = 0\nduration_s = 0\norder = ['a']", "0.01 s to a day"),
            ("[slots]\nstart_s = 0\nduration_s = 10\norder = []", "members in the order of their slots"),
            ("[slots]\nstart_s = 'noon'\nduration_s = 10\norder = ['a']", "start_s"),
            ("[slots]\nduration_s = 10\norder = ['a']", "start_s"),
            ("[slots]\nstart_s = 0\nduration_s = 10\nat_will = true\norder = ['a']", "--sent"),
            ("when,who\n1,a\n", "time_s"),
            ("mac { type: MAC_POLLED slot { src: 1 slot_seconds: 9 } }", "found MAC_POLLED"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("slots.toml"), "{text}: {error}");
        }
    }
}
