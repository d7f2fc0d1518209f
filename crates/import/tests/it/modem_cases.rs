//! Whole imports of small recorded missions, one for each kind of modem record.

use std::fs::{File, read_dir};
use std::path::Path;

use pingmap_import::{
    FileSource, ImportResult, ModemIds, RecordReader, Recordings, Reference, Rules, SkipCounts, join, resolve_modem_ids,
};

/// Reads all files of a folder in `tests/data`, with its table of ids.
fn read_case(name: &str) -> (Recordings, SkipCounts) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    let ids_path = folder.join("ids.csv");
    let ids = ModemIds::read(File::open(&ids_path).unwrap(), &ids_path).unwrap();
    let reader = RecordReader { ids, ..RecordReader::default() };
    let (mut recordings, mut skipped) = (Recordings::new(), SkipCounts::default());
    let mut paths: Vec<_> = read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        let source = FileSource::new(&path, None);
        let summary = reader.read_record(File::open(&path).unwrap(), &source, &mut recordings).unwrap();
        skipped = skipped.sum(summary.unwrap_or_else(|| panic!("unknown kind: {}", path.display())).skipped);
    }
    resolve_modem_ids(&mut recordings).unwrap();
    (recordings, skipped)
}

fn import_case(name: &str) -> ImportResult {
    join(&read_case(name).0, None, &Reference::unknown(), &Rules::default()).unwrap()
}

/// Counts the events that were heard and missed.
fn heard_and_missed(imported: &ImportResult) -> (usize, usize) {
    let heard = imported.log.events.iter().filter(|event| event.success).count();
    (heard, imported.log.events.len() - heard)
}

#[test]
fn an_acknowledgement_does_not_exclude_the_message_that_it_answers() {
    let (recordings, _) = read_case("ack-after-hearing");
    let replies: Vec<_> = recordings.values().flat_map(|recording| &recording.replies).collect();
    assert_eq!(replies.len(), 57);
    assert!(replies.iter().all(|reply| (reply.start_s - reply.decoded_s - 0.3).abs() < 0.01));
    assert_eq!(heard_and_missed(&import_case("ack-after-hearing")), (57, 33));
}

#[test]
fn flexible_packets_are_transmissions_and_receptions() {
    for name in ["flexible-packets", "flexible-beside-cycles"] {
        let imported = import_case(name);
        assert_eq!((heard_and_missed(&imported), imported.evidence.recorded), ((51, 29), 80), "{name}");
        assert_eq!(imported.left_out.unexpected.len(), 0, "{name}");
    }
    let (recordings, _) = read_case("flexible-packets");
    let transmissions = recordings.values().flat_map(|recording| recording.transmissions.as_ref().unwrap());
    let kinds = transmissions.map(|transmission| transmission.kind.as_ref().unwrap().to_string());
    assert!(kinds.clone().all(|kind| kind == "rate 5") && kinds.count() == 80);
    // The statistics of a broken packet state the rate of its mini frames.
    let arrivals = || recordings.values().flat_map(|recording| recording.arrivals.as_ref().unwrap());
    assert!(arrivals().all(|arrival| arrival.kind.is_some() == arrival.good));
    assert_eq!((arrivals().count(), arrivals().filter(|arrival| arrival.good).count()), (61, 51));
}

#[test]
fn a_debug_log_of_goby_is_a_capture() {
    let imported = import_case("goby-debug-log");
    assert_eq!((heard_and_missed(&imported), imported.evidence.recorded), ((42, 18), 60));
}

#[test]
fn times_of_a_moos_log_with_an_unset_clock_count_from_its_start() {
    let imported = import_case("logstart-in-1970");
    let offsets: Vec<f64> =
        imported.clocks.iter().flat_map(|clock| &clock.segments).map(|segment| segment.offset_s).collect();
    assert!(offsets.len() == 2 && offsets.iter().all(|offset_s| offset_s.abs() < 0.01), "{offsets:?}");
    assert_eq!(imported.left_out.unexpected.len(), 0);
    assert_eq!(heard_and_missed(&imported), (90, 68));
}
