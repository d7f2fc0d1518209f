//! What a file is, by what is in it; of tables whose they are, by their names.

use std::io::{self, Read};
use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_trial::{REQUIRED_COLUMNS, Table};

use crate::columns::{Named, TableKind};
use crate::lcm_types::LcmTypes;
use crate::tables::Reading;
use crate::{capture, lcm, mcap_file, moos, sqlite};

/// So much of a file tells what it is.
pub(crate) const HEAD_BYTES: u64 = 1 << 16;

/// What a file of a known kind is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RecordKind {
    /// A log of MOOS.
    MoosLog,
    /// A mission file of MOOS, for its datum.
    MoosMission,
    /// What a host and its Micro-Modem said, with the host's times.
    ModemCapture,
    /// Topics in an MCAP file.
    Mcap,
    /// A bag of ROS 2 in SQLite.
    Sqlite,
    /// A log of LCM.
    Lcm,
    /// Types of the messages in such.
    LcmTypes,
    /// A table of navigation, receptions or transmissions.
    Table(TableKind),
    /// Who is meant by modems' ids.
    Ids,
    /// Who may send when.
    Schedule,
}

impl RecordKind {
    /// In a few words.
    pub fn words(self) -> &'static str {
        match self {
            Self::MoosLog => "a log of MOOS",
            Self::MoosMission => "a mission file of MOOS",
            Self::ModemCapture => "what a Micro-Modem and its host said",
            Self::Mcap => "a bag of ROS 2 (MCAP)",
            Self::Sqlite => "a bag of ROS 2 (SQLite)",
            Self::Lcm => "a log of LCM",
            Self::LcmTypes => "types of LCM",
            Self::Table(TableKind::Navigation) => "navigation",
            Self::Table(TableKind::Heard) => "receptions",
            Self::Table(TableKind::Sent) => "transmissions",
            Self::Ids => "who is meant by ids",
            Self::Schedule => "who may send when",
        }
    }
}

/// The beginning of a file.
///
/// # Errors
/// Where it cannot be read.
pub fn head(reader: impl Read) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    reader.take(HEAD_BYTES).read_to_end(&mut head)?;
    Ok(head)
}

impl Reading {
    /// What a file is that begins so, and is called so; `None` for what is of no known kind. The name is asked where a table of times and
    /// vehicles may be of receptions, of transmissions or a schedule as well.
    pub fn kind_of(&self, head: &[u8], name: &Path) -> Option<RecordKind> {
        if head.starts_with(mcap_file::MAGIC) {
            return Some(RecordKind::Mcap);
        } else if head.starts_with(sqlite::MAGIC) {
            return Some(RecordKind::Sqlite);
        } else if head.starts_with(lcm::MAGIC) {
            return Some(RecordKind::Lcm);
        }
        let text = String::from_utf8_lossy(head);
        if moos::is_one(&text) {
            Some(RecordKind::MoosLog)
        } else if capture::is_one(&text) {
            Some(RecordKind::ModemCapture)
        } else if LcmTypes::are_in(&text) {
            Some(RecordKind::LcmTypes)
        } else if moos::datum_of_mission(&text).is_some() {
            Some(RecordKind::MoosMission)
        } else if text.lines().any(|line| line.trim() == "[slots]") {
            Some(RecordKind::Schedule)
        } else {
            self.kind_of_table(head, name)
        }
    }

    fn kind_of_table(&self, head: &[u8], name: &Path) -> Option<RecordKind> {
        let table = Table::new(head, name, &[]).ok()?;
        if table.has("id") && table.has("name") && table.header().len() == 2 {
            return Some(RecordKind::Ids);
        }
        // What pingmap makes of such tables is none of them.
        let is_result = REQUIRED_COLUMNS.iter().all(|column| table.has(column)) || table.has("probability");
        if is_result {
            return None;
        }
        let named = |kind| Named::new(head, name, kind, &self.columns).ok();
        let has = |named: &Option<Named>, roles: &[&str]| {
            named.as_ref().is_some_and(|named| roles.iter().all(|role| named.has(role)))
        };
        let [nav, heard, sent] = [TableKind::Navigation, TableKind::Heard, TableKind::Sent].map(named);
        let is_of = |words: &[&str]| words_of(name).iter().any(|word| words.contains(&word.as_str()));
        let is_placed = has(&nav, &["latitude", "longitude"]) || has(&nav, &["easting", "northing"]);
        if is_placed {
            let is_navigation = has(&nav, &["time"]) && !has(&heard, &["source"]);
            return is_navigation.then_some(RecordKind::Table(TableKind::Navigation));
        } else if has(&sent, &["time", "sent"]) || has(&sent, &["time"]) && is_of(SENT_WORDS) {
            return Some(RecordKind::Table(TableKind::Sent));
        } else if has(&heard, &["time", "source"]) {
            let is_heard = is_of(HEARD_WORDS) || ["vehicle", "good", "frame"].iter().any(|role| has(&heard, &[role]));
            let is_schedule = is_of(SCHEDULE_WORDS).then_some(RecordKind::Schedule);
            return if is_heard { Some(RecordKind::Table(TableKind::Heard)) } else { is_schedule };
        }
        has(&sent, &["time", "destination"]).then_some(RecordKind::Table(TableKind::Sent))
    }

    /// Whose a table is by its name, `auv1.nav.csv`, or by its folder's, `auv1/nav.csv`: what is left without the words for what it
    /// tells and for its day, or who is meant by that.
    pub fn owner(&self, path: &Path) -> Option<VehicleId> {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let folder = || path.parent().and_then(Path::file_name).and_then(|name| name.to_str()).unwrap_or_default();
        let owner = Some(bare(name)).filter(|name| !name.is_empty()).unwrap_or_else(folder);
        (!owner.is_empty()).then(|| self.ids.listed(owner).unwrap_or_else(|| VehicleId::new(owner)))
    }
}

const HEARD_WORDS: &[&str] = &["heard", "rx", "receive", "received", "reception", "receptions", "arrivals"];
const SENT_WORDS: &[&str] = &["sent", "tx", "transmit", "transmitted", "transmission", "transmissions"];
const SCHEDULE_WORDS: &[&str] = &["schedule", "slots", "turns", "tdma"];
const NAVIGATION_WORDS: &[&str] = &["nav", "navigation", "position", "positions", "track", "gps", "fixes"];
const OTHER_WORDS: &[&str] =
    &["csv", "tsv", "txt", "dat", "gz", "log", "logs", "modem", "acomms", "data", "table", "messages"];

/// What stands between the words of a name.
fn is_between(c: char) -> bool {
    matches!(c, '.' | '_' | '-' | ' ')
}

/// The words of a file's name, in small letters.
fn words_of(path: &Path) -> Vec<String> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_lowercase();
    name.split(is_between).map(str::to_owned).collect()
}

/// A name without the words at both ends that tell what is in a file, and without its day.
fn bare(name: &str) -> &str {
    let is_word = |word: &str| {
        let all = [HEARD_WORDS, SENT_WORDS, SCHEDULE_WORDS, NAVIGATION_WORDS, OTHER_WORDS].concat();
        all.contains(&word.to_lowercase().as_str())
    };
    let is_digits =
        |word: &str| !word.is_empty() && word.trim_matches(['T', 'Z']).bytes().all(|c| c.is_ascii_digit() || c == b'T');
    // A day or an hour begins with at least four digits; fewer may be a number of the vehicle.
    let is_day = |word: &str| is_digits(word) && word.len() >= 4;
    let all: Vec<&str> = name.split(is_between).filter(|word| !word.is_empty()).collect();
    let mut words = all.as_slice();
    while let (Some(first), Some(last)) = (words.first(), words.last()) {
        let digits_behind = words.iter().rev().take_while(|word| is_digits(word)).count();
        if is_word(first) {
            words = &words[1..];
        } else if is_word(last) {
            words = &words[..words.len() - 1];
        } else if is_day(first) {
            words = &words[words.iter().take_while(|word| is_digits(word)).count()..];
        } else if let Some(day) = words[words.len() - digits_behind..].iter().position(|word| is_day(word)) {
            words = &words[..words.len() - digits_behind + day];
        } else {
            // Words are parts of the name: from the first to the end of the last.
            let at = |word: &str| word.as_ptr() as usize - name.as_ptr() as usize;
            return &name[at(first)..at(last) + last.len()];
        }
    }
    ""
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::Ids;

    fn kind(text: &str, name: &str) -> Option<RecordKind> {
        Reading::default().kind_of(text.as_bytes(), Path::new(name))
    }

    #[test]
    fn tables_are_known_by_their_columns_and_where_these_leave_it_open_by_their_names() {
        let [nav, heard, sent] = [TableKind::Navigation, TableKind::Heard, TableKind::Sent].map(RecordKind::Table);
        for (text, name, expected) in [
            ("time,lat,lon\n1,2,3\n", "anything", Some(nav)),
            ("# of a day\nTime;X;Y;depth\n", "rx.csv", Some(nav)),
            ("time,source,good\n", "a.csv", Some(heard)),
            ("time,src,receiver\n", "a.csv", Some(heard)),
            ("time,source,destination\n", "auv1.heard.csv", Some(heard)),
            ("time,source,destination\n", "auv1_TX.csv", Some(sent)),
            ("time,destination\n", "a.csv", Some(sent)),
            ("time\n1\n", "sent.csv", Some(sent)),
            ("time_s,source\n", "turns.csv", Some(RecordKind::Schedule)),
            ("start = 1\n[slots]\n", "a", Some(RecordKind::Schedule)),
            ("name;id\n", "a", Some(RecordKind::Ids)),
            // It could be either, or is neither.
            ("time,source,destination\n", "auv1.csv", None),
            ("time\n1\n", "a.csv", None),
            ("name,lat,lon\n", "places.csv", None),
            ("time,source,lat,lon\n", "heard.csv", None),
            ("time_s,tx_id,rx_id,tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m,success\n", "rx.csv", None),
            ("leg,time_s,easting_m,northing_m,probability\n", "nav.csv", None),
            ("Dear all, this is no table\n", "heard.txt", None),
        ] {
            assert_eq!(kind(text, name), expected, "{name}: {text}");
        }
    }

    #[test]
    fn a_table_is_of_whom_it_is_named_after() {
        let reading = Reading {
            ids: Ids::read("id,name\n3,carol\n".as_bytes(), Path::new("ids")).unwrap(),
            ..Reading::default()
        };
        let owner = |path: &str| reading.owner(Path::new(path)).map(|name| name.to_string());
        for (path, expected) in [
            ("mission/auv1.nav.csv", "auv1"),
            ("rx_auv1.csv", "auv1"),
            ("iver-3_42-heard.csv", "iver-3_42"),
            ("auv1/nav.csv", "auv1"),
            ("auv1/2026-05-03_navigation.csv", "auv1"),
            ("auv1_2026-05-03_nav.csv", "auv1"),
            ("auv_2_20260503T120000Z.sent.csv", "auv_2"),
            ("3.heard.csv", "carol"),
        ] {
            assert_eq!(owner(path).as_deref(), Some(expected), "{path}");
        }
        assert_eq!(owner("nav.csv"), None);
    }
}
