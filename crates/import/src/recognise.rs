//! What a file is, by what is in it; of tables whose they are, by their names.

use std::io::{self, Read};
use std::path::{Component, Path};

use pingmap_agent::VehicleId;
use pingmap_trial::Table;

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
    /// The same among other things that a team agreed on.
    TeamFile,
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
            Self::TeamFile => "a team file, with who may send when",
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
        } else if let Some(agreed) = toml::from_str::<toml::Table>(&text).ok().filter(|file| file.contains_key("slots"))
        {
            let is_team = agreed.contains_key("model_file");
            Some(if is_team { RecordKind::TeamFile } else { RecordKind::Schedule })
        } else {
            self.kind_of_table(head, name)
        }
    }

    fn kind_of_table(&self, head: &[u8], name: &Path) -> Option<RecordKind> {
        let table = Table::new(head, name, &[]).ok()?;
        if table.has("id") && table.has("name") && table.header().len() == 2 {
            return Some(RecordKind::Ids);
        }
        // What pingmap makes of such tables, or is asked about, is none of them; nor is what somebody put aside.
        let is_of_links = LINK_COLUMNS.iter().any(|column| table.has(column));
        let is_aside = name.to_str().is_some_and(|name| [".bak", ".orig", "~"].iter().any(|end| name.ends_with(end)));
        if is_of_links || table.has("probability") || is_aside {
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

    /// Whose a table is by its name, `auv1.nav.csv`, or by that of the folder or archive it lies in, `auv1/logs/nav.csv`: what is left without
    /// the words for what it tells and for its day, or who is meant by that.
    pub fn owner(&self, path: &Path) -> Option<VehicleId> {
        let names = path.components().rev().filter_map(|part| match part {
            Component::Normal(name) => name.to_str(),
            _ => None,
        });
        let owner = names.map(bare).find(|name| !name.is_empty()).unwrap_or_default();
        (!owner.is_empty()).then(|| self.ids.listed(owner).unwrap_or_else(|| VehicleId::new(owner)))
    }
}

/// Only logs of events and links have places of both ends.
const LINK_COLUMNS: [&str; 4] = ["tx_easting_m", "rx_easting_m", "tx_latitude_deg", "rx_latitude_deg"];

const HEARD_WORDS: &[&str] = &["heard", "rx", "receive", "received", "reception", "receptions", "arrivals"];
const SENT_WORDS: &[&str] = &["sent", "tx", "transmit", "transmitted", "transmission", "transmissions"];
const SCHEDULE_WORDS: &[&str] = &["schedule", "slots", "turns", "tdma"];
const NAVIGATION_WORDS: &[&str] = &["nav", "navigation", "position", "positions", "track", "gps", "fixes"];
const OTHER_WORDS: &[&str] = &[
    "csv", "tsv", "txt", "dat", "gz", "zip", "tar", "tgz", "log", "logs", "modem", "acomms", "data", "table",
    "messages", "copy", "(copy)",
];

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
        let word = word.to_lowercase();
        let all = [HEARD_WORDS, SENT_WORDS, SCHEDULE_WORDS, NAVIGATION_WORDS, OTHER_WORDS];
        all.iter().any(|words| words.contains(&word.as_str()))
    };
    let all: Vec<&str> = name.split(is_between).filter(|word| !word.is_empty()).collect();
    let mut words = all.as_slice();
    while let (Some(first), Some(last)) = (words.first(), words.last()) {
        if is_word(first) {
            words = &words[1..];
        } else if is_word(last) {
            words = &words[..words.len() - 1];
        } else if day(words) > 0 {
            words = &words[day(words)..];
        } else if let Some(at) = (0..words.len()).find(|&at| at + day(&words[at..]) == words.len()) {
            words = &words[..at];
        } else {
            // Words are parts of the name: from the first to the end of the last.
            let at = |word: &str| word.as_ptr() as usize - name.as_ptr() as usize;
            return &name[at(first)..at(last) + last.len()];
        }
    }
    ""
}

/// How many words at the beginning are a day, and the hour behind it: `20260503`, `20260503T120000Z`, `2026 05 03`, `2026 05 03T12 00 00`. Other
/// numbers are those of vehicles.
fn day(words: &[&str]) -> usize {
    let digits = |word: &str, lengths: &[usize]| {
        let plain: String = word.chars().filter(|letter| !matches!(letter, 'T' | 'Z')).collect();
        lengths.contains(&plain.len()) && plain.bytes().all(|byte| byte.is_ascii_digit())
    };
    let is = |at: usize, lengths: &[usize]| words.get(at).is_some_and(|word| digits(word, lengths));
    let is_year = words.first().is_some_and(|word| word.starts_with("19") || word.starts_with("20"));
    let of_day = match () {
        () if is_year && is(0, &[8, 12, 14]) => 1,
        () if is_year && is(0, &[4]) && is(1, &[2]) && is(2, &[2, 4]) => 3,
        () => return 0,
    };
    match () {
        () if is(of_day, &[4, 6]) => of_day + 1,
        () if is(of_day, &[2]) && is(of_day + 1, &[2]) => of_day + 2 + usize::from(is(of_day + 2, &[2])),
        () => of_day,
    }
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
            ("iver3-3011.nav.csv", "iver3-3011"),
            ("20260503_1.nav.csv", "1"),
            ("auv1_2026-05-03T12-00-00.nav.csv", "auv1"),
            ("auv1_20260503_120000_rx.csv", "auv1"),
            ("auv1/logs/nav.csv", "auv1"),
            ("auv1/nav.csv.gz/nav.csv", "auv1"),
            ("auv1.zip/2026-05-03/nav.csv", "auv1"),
        ] {
            assert_eq!(owner(path).as_deref(), Some(expected), "{path}");
        }
        assert_eq!(owner("nav.csv"), None);
    }
}
