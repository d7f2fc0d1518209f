//! Detection of the owner of a table by the names of its file and folders.

use std::path::{Component, Path};

use pingmap_agent::VehicleId;

use crate::readers::record_reader::RecordReader;

impl RecordReader {
    /// Returns the owner of a table by its file name, such as `auv1.nav.csv`, or by its folder or archive, such as
    /// `auv1/logs/nav.csv`.
    ///
    /// Words for the content and for the date are removed from a name. The rest is the owner, or a modem id of the
    /// owner.
    pub fn owner(&self, path: &Path) -> Option<VehicleId> {
        let names = path.components().rev().filter_map(|part| match part {
            Component::Normal(name) => name.to_str(),
            _ => None,
        });
        let owner = names.map(strip_generic_words).find(|name| !name.is_empty()).unwrap_or_default();
        (!owner.is_empty()).then(|| self.ids.lookup(owner).unwrap_or_else(|| VehicleId::new(owner)))
    }

    /// Returns the given vehicle, else the owner of the table by its path.
    pub(crate) fn table_owner(&self, path: &Path, vehicle: Option<&VehicleId>) -> Option<VehicleId> {
        vehicle.cloned().or_else(|| self.owner(path))
    }
}

pub(crate) const RECEPTION_WORDS: &[&str] =
    &["heard", "rx", "receive", "received", "reception", "receptions", "arrivals"];
pub(crate) const TRANSMISSION_WORDS: &[&str] =
    &["sent", "tx", "transmit", "transmitted", "transmission", "transmissions"];
pub(crate) const SCHEDULE_WORDS: &[&str] = &["schedule", "slots", "turns", "tdma"];
const NAVIGATION_WORDS: &[&str] = &["nav", "navigation", "position", "positions", "track", "gps", "fixes"];
const OTHER_WORDS: &[&str] = &[
    "csv", "tsv", "txt", "dat", "gz", "zip", "tar", "tgz", "log", "logs", "modem", "acomms", "data", "table",
    "messages", "copy", "(copy)",
];

/// Returns whether a character separates the words of a name.
fn is_separator(c: char) -> bool {
    matches!(c, '.' | '_' | '-' | ' ')
}

/// Returns the words of a file name, in lower case.
pub(crate) fn split_words(path: &Path) -> Vec<String> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_lowercase();
    name.split(is_separator).map(str::to_owned).collect()
}

/// Removes the words for the content and the date from both ends of a name.
fn strip_generic_words(name: &str) -> &str {
    let is_word = |word: &str| {
        let word = word.to_lowercase();
        let generic_words = [RECEPTION_WORDS, TRANSMISSION_WORDS, SCHEDULE_WORDS, NAVIGATION_WORDS, OTHER_WORDS];
        generic_words.iter().any(|words| words.contains(&word.as_str()))
    };
    let words_in_name: Vec<&str> = name.split(is_separator).filter(|word| !word.is_empty()).collect();
    let mut words = words_in_name.as_slice();
    while let (Some(first), Some(last)) = (words.first(), words.last()) {
        if is_word(first) {
            words = &words[1..];
        } else if is_word(last) {
            words = &words[..words.len() - 1];
        } else if date_length(words) > 0 {
            words = &words[date_length(words)..];
        } else if let Some(index) = (0..words.len()).find(|&index| index + date_length(&words[index..]) == words.len())
        {
            words = &words[..index];
        } else {
            // All words are slices of the name, so the result extends from the first to the end of the last.
            let index = |word: &str| word.as_ptr() as usize - name.as_ptr() as usize;
            return &name[index(first)..index(last) + last.len()];
        }
    }
    ""
}

/// Returns the number of words at the beginning that form a date, with a time of day if present.
///
/// Dates are `20260503`, `20260503T120000Z`, `2026 05 03` and `2026 05 03T12 00 00`. Other numbers belong to names of
/// vehicles.
fn date_length(words: &[&str]) -> usize {
    let matches_digits = |word: &str, lengths: &[usize]| {
        let plain: String = word.chars().filter(|letter| !matches!(letter, 'T' | 'Z')).collect();
        lengths.contains(&plain.len()) && plain.bytes().all(|byte| byte.is_ascii_digit())
    };
    let has_digits =
        |index: usize, lengths: &[usize]| words.get(index).is_some_and(|word| matches_digits(word, lengths));
    let is_year = words.first().is_some_and(|word| word.starts_with("19") || word.starts_with("20"));
    let date_words = match () {
        () if is_year && has_digits(0, &[8, 12, 14]) => 1,
        () if is_year && has_digits(0, &[4]) && has_digits(1, &[2]) && has_digits(2, &[2, 4]) => 3,
        () => return 0,
    };
    match () {
        () if has_digits(date_words, &[4, 6]) => date_words + 1,
        () if has_digits(date_words, &[2]) && has_digits(date_words + 1, &[2]) => {
            date_words + 2 + usize::from(has_digits(date_words + 2, &[2]))
        }
        () => date_words,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::modem_ids::ModemIds;

    #[test]
    fn the_owner_of_a_table_follows_from_its_path() {
        let reading = RecordReader {
            ids: ModemIds::read("id,name\n3,carol\n".as_bytes(), Path::new("ids")).unwrap(),
            ..RecordReader::default()
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
