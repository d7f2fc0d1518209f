//! Detection of the kind of a file by its content.

use std::io::{self, Read};
use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_trial::Table;

use crate::model::goby_mac::is_mac_config;
use crate::readers::bags::{mcap_file, sqlite, sqlite_wal};
use crate::readers::file_owner::{RECEPTION_WORDS, SCHEDULE_WORDS, TRANSMISSION_WORDS, split_words};
use crate::readers::lcm::events;
use crate::readers::lcm::types::LcmTypes;
use crate::readers::modem::capture;
use crate::readers::moos;
use crate::readers::record_reader::RecordReader;
use crate::readers::tables::role_table::RoleTable;
use crate::readers::tables::roles::TableKind;

/// Number of bytes at the beginning of a file that determine its kind.
pub(crate) const HEAD_BYTES: u64 = 1 << 16;

/// The kind of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RecordKind {
    /// A MOOS log.
    MoosLog,
    /// A MOOS mission file, which states the datum.
    MoosMission,
    /// The sentences between a host and its Micro-Modem, with the host's times.
    ModemCapture,
    /// A ROS 2 bag, or other topics, in an MCAP file.
    Mcap,
    /// A ROS 2 bag in an SQLite file.
    Sqlite,
    /// The write-ahead log of an SQLite file, or its index. The bag is read with it.
    SqliteLog,
    /// An LCM log.
    Lcm,
    /// Definitions of LCM message types.
    LcmTypes,
    /// A table of navigation, receptions or transmissions.
    Table(TableKind),
    /// A table of the vehicles behind modem ids.
    ModemIds,
    /// A TDMA schedule.
    Schedule,
    /// A team file, which contains a schedule.
    TeamFile,
}

impl RecordKind {
    /// Describes the kind in a few words.
    pub fn description(self) -> &'static str {
        match self {
            Self::MoosLog => "MOOS log",
            Self::MoosMission => "MOOS mission file",
            Self::ModemCapture => "Micro-Modem sentences",
            Self::Mcap => "ROS 2 bag (MCAP)",
            Self::Sqlite => "ROS 2 bag (SQLite)",
            Self::SqliteLog => "write-ahead log of an SQLite bag",
            Self::Lcm => "LCM log",
            Self::LcmTypes => "LCM message types",
            Self::Table(TableKind::Navigation) => "navigation",
            Self::Table(TableKind::Receptions) => "receptions",
            Self::Table(TableKind::Transmissions) => "transmissions",
            Self::Table(TableKind::Events) => "events",
            Self::ModemIds => "vehicle of each modem id",
            Self::Schedule => "schedule",
            Self::TeamFile => "team file with a schedule",
        }
    }
}

/// Reads the beginning of a file.
///
/// # Errors
/// If the file cannot be read.
pub fn read_head(reader: impl Read) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    reader.take(HEAD_BYTES).read_to_end(&mut head)?;
    Ok(head)
}

impl RecordReader {
    /// Detects the kind of a file from its beginning; `None` for an unknown kind.
    ///
    /// `vehicle` is the owner if it is known; otherwise the name of the file may state it.
    ///
    /// The content decides. A table of times and vehicles may hold receptions, transmissions or a schedule; then the
    /// file name decides.
    pub fn detect_kind(&self, head: &[u8], name: &Path, vehicle: Option<&VehicleId>) -> Option<RecordKind> {
        if head.starts_with(mcap_file::MAGIC) {
            return Some(RecordKind::Mcap);
        } else if head.starts_with(sqlite::MAGIC) {
            return Some(RecordKind::Sqlite);
        } else if sqlite_wal::MAGICS.iter().any(|magic| head.starts_with(magic)) {
            return Some(RecordKind::SqliteLog);
        } else if head.starts_with(events::MAGIC) {
            return Some(RecordKind::Lcm);
        }
        let text = String::from_utf8_lossy(head);
        if moos::is_alog(&text) {
            Some(RecordKind::MoosLog)
        } else if capture::is_capture(&text) {
            Some(RecordKind::ModemCapture)
        } else if LcmTypes::is_definition(&text) {
            Some(RecordKind::LcmTypes)
        } else if moos::mission_datum(&text).is_some() {
            Some(RecordKind::MoosMission)
        } else if let Some(config) = toml::from_str::<toml::Table>(&text).ok().filter(|file| file.contains_key("slots"))
        {
            let is_team = config.contains_key("model_file");
            Some(if is_team { RecordKind::TeamFile } else { RecordKind::Schedule })
        } else if is_mac_config(&text) {
            Some(RecordKind::Schedule)
        } else {
            self.detect_table_kind(head, name, vehicle)
        }
    }

    fn detect_table_kind(&self, head: &[u8], name: &Path, vehicle: Option<&VehicleId>) -> Option<RecordKind> {
        let table = Table::new(head, name, &[]).ok()?;
        if table.has("id") && table.has("name") && table.header().len() == 2 {
            return Some(RecordKind::ModemIds);
        }
        // Event logs and predictions, which pingmap writes itself, are not recordings. Backup files are skipped.
        let is_link_table = LINK_COLUMNS.iter().any(|column| table.has(column));
        let is_backup = name.to_str().is_some_and(|name| [".bak", ".orig", "~"].iter().any(|end| name.ends_with(end)));
        if is_link_table || table.has("probability") || is_backup {
            return None;
        }
        // A missing column is reported when the table is read.
        let columns = self.columns.of_table(name, self.table_owner(name, vehicle).as_ref()).present_in(&table);
        let role_table = |kind| RoleTable::new(head, name, kind, &columns).ok();
        let has = |table: &Option<RoleTable>, roles: &[&str]| {
            table.as_ref().is_some_and(|table| roles.iter().all(|role| table.has(role)))
        };
        let [navigation, receptions, transmissions] =
            [TableKind::Navigation, TableKind::Receptions, TableKind::Transmissions].map(role_table);
        let has_word = |words: &[&str]| split_words(name).iter().any(|word| words.contains(&word.as_str()));
        let has_position = has(&navigation, &["latitude", "longitude"]) || has(&navigation, &["easting", "northing"]);
        if has_position {
            let is_navigation = has(&navigation, &["time"]) && !has(&receptions, &["source"]);
            return is_navigation.then_some(RecordKind::Table(TableKind::Navigation));
        } else if has(&transmissions, &["time", "sent"])
            || has(&transmissions, &["time"]) && has_word(TRANSMISSION_WORDS)
        {
            return Some(RecordKind::Table(TableKind::Transmissions));
        } else if has(&receptions, &["time", "source"]) {
            let is_reception_table =
                has_word(RECEPTION_WORDS) || ["vehicle", "good", "frame"].iter().any(|role| has(&receptions, &[role]));
            let is_schedule = has_word(SCHEDULE_WORDS).then_some(RecordKind::Schedule);
            return if is_reception_table { Some(RecordKind::Table(TableKind::Receptions)) } else { is_schedule };
        }
        has(&transmissions, &["time", "destination"]).then_some(RecordKind::Table(TableKind::Transmissions))
    }
}

/// Columns that occur only in tables of events and links, which have the positions of both ends.
const LINK_COLUMNS: [&str; 4] = ["tx_easting_m", "rx_easting_m", "tx_latitude_deg", "rx_latitude_deg"];

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(text: &str, name: &str) -> Option<RecordKind> {
        RecordReader::default().detect_kind(text.as_bytes(), Path::new(name), None)
    }

    #[test]
    fn the_kind_of_a_table_follows_from_its_columns_or_else_its_name() {
        let [navigation, receptions, transmissions] =
            [TableKind::Navigation, TableKind::Receptions, TableKind::Transmissions].map(RecordKind::Table);
        for (text, name, expected) in [
            ("time,lat,lon\n1,2,3\n", "anything", Some(navigation)),
            ("# of a day\nTime;X;Y;depth\n", "rx.csv", Some(navigation)),
            ("time,source,good\n", "a.csv", Some(receptions)),
            ("time,src,receiver\n", "a.csv", Some(receptions)),
            ("time,source,destination\n", "auv1.heard.csv", Some(receptions)),
            ("time,source,destination\n", "auv1_TX.csv", Some(transmissions)),
            ("time,destination\n", "a.csv", Some(transmissions)),
            ("time\n1\n", "sent.csv", Some(transmissions)),
            ("time_s,source\n", "turns.csv", Some(RecordKind::Schedule)),
            ("start = 1\n[slots]\n", "a", Some(RecordKind::Schedule)),
            ("mac { type: MAC_FIXED_DECENTRALIZED slot { } }", "auv.pb.cfg", Some(RecordKind::Schedule)),
            ("name;id\n", "a", Some(RecordKind::ModemIds)),
            // The columns fit several kinds, or none.
            ("time,source,destination\n", "auv1.csv", None),
            ("time\n1\n", "a.csv", None),
            ("name,lat,lon\n", "places.csv", None),
            ("time,source,lat,lon\n", "heard.csv", None),
            ("time_s,tx_id,rx_id,tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m,success\n", "rx.csv", None),
            ("leg,time_s,easting_m,northing_m,probability\n", "nav.csv", None),
            ("time_s,tx_id,rx_id,tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n", "heard.csv", None),
            ("time_s,tx_id,rx_id,tx_latitude_deg,tx_longitude_deg\n", "links.csv", None),
            ("time,source,good\n", "a.heard.csv~", None),
            ("members = []\nmodel_file = 'm'\n[slots]\n", "team.toml", Some(RecordKind::TeamFile)),
            ("    [slots]\nas in this text\n", "README.md", None),
            ("Dear all, this is no table\n", "heard.txt", None),
        ] {
            assert_eq!(kind(text, name), expected, "{name}: {text}");
        }
    }
}
