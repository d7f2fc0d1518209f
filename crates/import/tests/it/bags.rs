//! Reading of bags and LCM logs that the original packages wrote (`data/make.py`), and of damaged copies.

use std::path::{Path, PathBuf};

use pingmap_agent::VehicleId;
use pingmap_import::{
    FileSource, FileSummary, ImportError, Place, RecordKind, RecordReader, Recording, Recordings, resolve_modem_ids,
};
use proptest::prelude::*;

const START_S: f64 = 1_777_809_600.0;

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// Changes some bytes of a file and truncates it.
fn damaged(bytes: &[u8], changes: &[(prop::sample::Index, u8)], end: prop::sample::Index) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for (index, byte) in changes {
        let index = index.index(bytes.len());
        bytes[index] = *byte;
    }
    bytes.truncate(end.index(bytes.len() + 1).max(16));
    bytes
}

/// Reads the topics of a file with a prefix, as the recording of `auv1`.
fn read(bytes: &[u8], path: &Path, topics: &str) -> Result<(Recording, FileSummary), ImportError> {
    let (mut recordings, vehicle) = (Recordings::new(), VehicleId::new("auv1"));
    // Another vehicle with a recording, so that receptions from modem 2 count.
    recordings.insert(VehicleId::new("2"), Recording::default());
    let source = FileSource { topics, ..FileSource::new(path, Some(&vehicle)) };
    let summary = RecordReader::default().read_record(bytes, &source, &mut recordings)?.unwrap();
    resolve_modem_ids(&mut recordings)?;
    Ok((recordings.remove(&vehicle).unwrap_or_default(), summary))
}

fn read_file(name: &str, topics: &str) -> (Recording, FileSummary) {
    let path = path(name);
    read(&std::fs::read(&path).unwrap(), &path, topics).unwrap()
}

/// Checks the modem records in each file: six receptions, six transmissions, and the id at the start.
fn assert_modem_records(recording: &Recording) {
    let arrivals = recording.arrivals.as_ref().unwrap();
    let times: Vec<f64> = arrivals.iter().map(|arrival| arrival.time_s - START_S).collect();
    assert_eq!(times, [3.0, 13.0, 23.0, 33.0, 43.0, 53.0]);
    assert!(arrivals.iter().all(|arrival| arrival.source.as_str() == "2" && arrival.good));
    let transmitted_s: Vec<f64> =
        recording.transmissions.iter().flatten().map(|transmission| transmission.time_s - START_S).collect();
    assert_eq!(transmitted_s, [8.0, 18.0, 28.0, 38.0, 48.0, 58.0]);
    assert_eq!((recording.modem_activity[0].0, recording.modem_ids.len()), (START_S, 1));
}

#[test]
fn an_mcap_file_is_read() {
    let (recording, summary) = read_file("ros2.mcap", "");
    assert_eq!((summary.kind, summary.skipped), (RecordKind::Mcap, Default::default()));
    assert_modem_records(&recording);
    assert_eq!(recording.fixes.len(), 61);
    let Place::Degrees(last) = recording.fixes[60].place else { panic!("degrees") };
    assert!((last.latitude_deg - 41.52 - 120.0 / 111_066.0).abs() < 1e-12 && last.longitude_deg == -70.67);
    assert_eq!(recording.fixes[60].time_s, START_S + 60.0);
    // A prefix selects topics.
    let (recording, _) = read_file("ros2.mcap", "/auv1/modem");
    assert!(recording.fixes.is_empty() && recording.arrivals.is_some());
    let (path, nowhere) = (path("ros2.mcap"), "/auv2");
    let error = read(&std::fs::read(&path).unwrap(), &path, nowhere).unwrap_err().to_string();
    assert!(error.contains("no topic") && error.contains(nowhere), "{error}");
}

#[test]
fn an_sqlite_bag_is_read() {
    let (recording, summary) = read_file("ros2.db3", "");
    assert_eq!((summary.kind, summary.skipped), (RecordKind::Sqlite, Default::default()));
    assert_modem_records(&recording);
    let last = recording.fixes.last().unwrap();
    assert_eq!((last.place, last.depth_m), (Place::Metres(100.0, 120.0), Some(7.5)));
    assert_eq!(recording.fixes.len(), 61);
    let (recording, _) = read_file("ros2.db3", "/auv1/odom");
    assert!(recording.arrivals.is_none() && recording.fixes.len() == 61);
}

#[test]
fn an_lcm_log_is_read_with_its_types() {
    let (log, types) = (std::fs::read(path("auv1.lcmlog")).unwrap(), std::fs::read(path("types.lcm")).unwrap());
    let read_log = |types: &[u8], log: &[u8], topics: &str| {
        let (mut reading, mut recordings, vehicle) =
            (RecordReader::default(), Recordings::new(), VehicleId::new("auv1"));
        reading.read_lcm_types(types, Path::new("types.lcm")).map_err(|error| error.to_string())?;
        let source = FileSource { topics, ..FileSource::new(Path::new("auv1.lcmlog"), Some(&vehicle)) };
        let summary = reading.read_record(log, &source, &mut recordings).map_err(|error| error.to_string())?.unwrap();
        Ok::<_, String>((recordings.remove(&vehicle).unwrap(), summary))
    };
    let (recording, summary) = read_log(&types, &log, "").unwrap();
    assert_eq!((summary.kind, summary.skipped), (RecordKind::Lcm, Default::default()));
    assert_modem_records(&recording);
    let last = recording.fixes.last().unwrap();
    let Place::Degrees(place) = last.place else { panic!("degrees") };
    assert!((place.latitude_deg - 41.52 - 120.0 / 111_066.0).abs() < 1e-12 && last.depth_m == Some(7.5));
    assert_eq!((recording.fixes.len(), last.time_s), (61, START_S + 60.0));
    // Further cases: a prefix of channels, an unknown type, a truncated log, missing types, a damaged log, an invalid
    // definition.
    assert!(read_log(&types, &log, "AUV1_NAV").unwrap().0.arrivals.is_none());
    let (recording, summary) =
        read_log(b"package pm; struct modem_t { int64_t utime; string nmea; }", &log, "").unwrap();
    assert_eq!((recording.fixes.len(), summary.skipped.unknown_type), (0, 61));
    let (recording, summary) = read_log(&types, &log[..log.len() - 5], "").unwrap();
    assert_eq!((recording.fixes.len(), summary.skipped.truncated), (61, 1));
    assert!(read_log(b"", &log, "").unwrap_err().contains(".lcm"));
    let mut garbled = log.clone();
    garbled[20..24].fill(0xff);
    let (recording, summary) = read_log(&types, &garbled, "").unwrap();
    assert_eq!((recording.fixes.len(), summary.skipped.damaged), (60, 1));
    assert!(read_log(&types, &garbled[..60], "").unwrap_err().contains("not a log of LCM"));
    assert!(read_log(b"struct a { int32_t", b"", "").unwrap_err().contains("struct a"));
}

#[test]
fn a_truncated_bag_is_read_and_an_invalid_one_is_refused() {
    let whole = std::fs::read(path("ros2.mcap")).unwrap();
    let (mut fixes_max, mut truncated, lengths) = (0, 0, (8..whole.len()).step_by(97));
    let count = lengths.len();
    for length in lengths {
        match read(&whole[..length], Path::new("cut.mcap"), "") {
            Ok((recording, summary)) => {
                assert!(recording.fixes.len() <= 61, "{length}");
                fixes_max = fixes_max.max(recording.fixes.len());
                truncated += summary.skipped.truncated;
            }
            Err(error) => assert!(error.to_string().contains("cut.mcap"), "{error}"),
        }
    }
    // Only files that lack nothing but a part of the index at their end count as complete. The reader does not use the
    // index.
    assert!(fixes_max == 61 && truncated > count / 3, "{fixes_max} {truncated} of {count}");
    let mut garbled = whole;
    garbled[900..1400].fill(0xa5);
    let error = read(&garbled, Path::new("garbled.mcap"), "").unwrap_err().to_string();
    assert!(error.contains("garbled.mcap") && error.contains("MCAP"), "{error}");
    // Another database is left alone. A damaged or missing one is refused.
    let other = tempfile::tempdir().unwrap();
    let notes = other.path().join("notes.db3");
    rusqlite::Connection::open(&notes).unwrap().execute_batch("CREATE TABLE notes (text TEXT)").unwrap();
    let bytes = std::fs::read(&notes).unwrap();
    let source = FileSource::new(&notes, None);
    let summary = RecordReader::default().read_record(bytes.as_slice(), &source, &mut Recordings::new()).unwrap();
    assert!(summary.is_none(), "{summary:?}");
    let folder = std::env::temp_dir();
    let head = [b"SQLite format 3\0".as_slice(), &[0; 100]].concat();
    let gone = folder.join("pingmap-no-such.db3");
    let error = read(&head, &gone, "").unwrap_err().to_string();
    assert!(error.contains("pingmap-no-such.db3") && error.contains("bag of ROS 2"), "{error}");
    assert!(!gone.exists(), "reading makes no file");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(1000) })]

    /// A damaged file is read or refused by its name, and all numbers in its fixes are finite.
    #[test]
    fn damaged_files_are_read_or_refused(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
        end in any::<prop::sample::Index>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        for name in ["ros2.mcap", "ros2.db3", "auv1.lcmlog", "types.lcm"] {
            let bytes = damaged(&std::fs::read(path(name)).unwrap(), &changes, end);
            // SQLite opens the file by its path.
            let path = folder.path().join(name);
            std::fs::write(&path, &bytes).unwrap();
            let (mut reading, mut recordings, vehicle) = (RecordReader::default(), Recordings::new(), VehicleId::new("auv1"));
            let types = if name == "types.lcm" { bytes.clone() } else { std::fs::read(self::path("types.lcm")).unwrap() };
            let found = reading.read_lcm_types(types.as_slice(), &path);
            let found = found.and_then(|()| reading.read_record(bytes.as_slice(), &FileSource::new(&path, Some(&vehicle)), &mut recordings));
            if let Err(error) = found {
                prop_assert!(error.to_string().contains(name), "{}", error);
            }
            for recording in recordings.values() {
                for fix in &recording.fixes {
                    let numbers = match fix.place {
                        Place::Degrees(place) => [place.latitude_deg, place.longitude_deg],
                        Place::Metres(east_m, north_m) => [east_m, north_m],
                    };
                    prop_assert!(fix.time_s.is_finite() && numbers.iter().all(|number| number.is_finite()));
                }
            }
        }
    }
}
