//! Damaged logs: the reader leaves out the damaged places and counts them.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use pingmap_agent::VehicleId;
use pingmap_import::{FileSource, RecordReader, Recording, Recordings, SkipCounts};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// Reads a log as the recording of `auv1`.
fn read(name: &str, log: &[u8]) -> Result<(Recording, SkipCounts), String> {
    let (mut reader, mut recordings, vehicle) = (RecordReader::default(), Recordings::new(), VehicleId::new("auv1"));
    let types = std::fs::read(data("types.lcm")).unwrap();
    reader.read_lcm_types(types.as_slice(), Path::new("types.lcm")).unwrap();
    let source = FileSource { path: None, ..FileSource::new(Path::new(name), Some(&vehicle)) };
    let summary = reader.read_record(log, &source, &mut recordings).map_err(|error| error.to_string())?.unwrap();
    Ok((recordings.remove(&vehicle).unwrap_or_default(), summary.skipped))
}

/// Returns the positions of the events in an LCM log.
fn event_positions(log: &[u8]) -> Vec<usize> {
    (0..log.len()).filter(|&at| log[at..].starts_with(&[0xed, 0xa1, 0xda, 0x01])).collect()
}

#[test]
fn an_lcm_log_is_read_on_behind_damage() {
    let log = std::fs::read(data("auv1.lcmlog")).unwrap();
    let (whole, skipped) = read("a.lcmlog", &log).unwrap();
    assert_eq!(skipped, SkipCounts::default());
    let events = event_positions(&log);
    let middle = events[events.len() / 2];
    let damaged = SkipCounts { damaged: 1, ..SkipCounts::default() };
    // Bytes between two events, of every length around the size of a block: no event is lost.
    for count in [1, 3, 300, (1 << 16) - 1, 1 << 16, (1 << 16) + 1, 1 << 18] {
        for byte in [0, 0xed] {
            let inserted = [&log[..middle], &vec![byte; count], &log[middle..]].concat();
            let (mut found, skipped) = read("a.lcmlog", &inserted).unwrap();
            let spans = std::mem::take(&mut found.lost_spans);
            assert!(matches!(spans[..], [(from_s, to_s)] if from_s <= to_s), "{spans:?}");
            assert_eq!((found, skipped), (whole.clone(), damaged.clone()), "{count} bytes {byte}");
        }
    }
    // A damaged mark, an impossible length, and a possible length that is wrong: one event is lost.
    let lengths = |log: &[u8]| u32::from_be_bytes(log[middle + 24..middle + 28].try_into().unwrap());
    let too_long = (lengths(&log) + 1000).to_be_bytes();
    for (offset, bytes) in [(0, [0; 4]), (24, [0xff; 4]), (24, too_long), (24, 60_000_000_u32.to_be_bytes())] {
        let mut changed = log.clone();
        changed[middle + offset..middle + offset + 4].copy_from_slice(&bytes);
        let (found, skipped) = read("a.lcmlog", &changed).unwrap();
        assert_eq!(skipped, damaged, "{offset} {bytes:?}");
        let counts = |recording: &Recording| {
            let number = |records: Option<usize>| records.unwrap_or(0);
            recording.fixes.len()
                + number(recording.arrivals.as_ref().map(Vec::len))
                + number(recording.transmissions.as_ref().map(Vec::len))
        };
        assert!((1..=2).contains(&(counts(&whole) - counts(&found))), "{offset} {bytes:?}");
    }
    // Only the first four bytes are those of a log.
    let error = read("a.lcmlog", &[&log[..4], &[0; 1000]].concat()).unwrap_err();
    assert!(error.contains("a.lcmlog") && error.contains("not a log of LCM"), "{error}");
}

/// Writes fixes, five to a chunk. The latitude of each fix is 41 degrees and its number in thousandths.
fn mcap_file(compression: Option<Compression>) -> Vec<u8> {
    let options = WriteOptions::new().compression(compression).chunk_size(None);
    let mut file = Cursor::new(Vec::new());
    let mut writer = Writer::with_options(&mut file, options).unwrap();
    let channel = writer.add_channel(0, "/fix", "json", &BTreeMap::new()).unwrap();
    for number in 0..50u64 {
        let text = format!("{{\"latitude\":41.{:03},\"longitude\":-70.5}}", number);
        let time_ns = 2_000_000_000 * (number + 1);
        let header = MessageHeader { channel_id: channel, sequence: 0, log_time: time_ns, publish_time: time_ns };
        writer.write_to_known_channel(&header, text.as_bytes()).unwrap();
        if number % 5 == 4 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

#[test]
fn a_damaged_chunk_of_mcap_is_left_out_and_the_others_are_read() {
    for compression in [None, Some(Compression::Zstd), Some(Compression::Lz4)] {
        let whole = mcap_file(compression);
        let (recording, skipped) = read("a.mcap", &whole).unwrap();
        assert_eq!((recording.fixes.len(), skipped), (50, SkipCounts::default()));
        // The positions of chunks: opcode 6, then the length of the record.
        let (mut chunks, mut at) = (Vec::new(), 8);
        while whole[at] != 0x0f {
            let length = u64::from_le_bytes(whole[at + 1..at + 9].try_into().unwrap()) as usize;
            chunks.extend((whole[at] == 6).then_some(at + 9..at + 9 + length));
            at += 9 + length;
        }
        assert_eq!(chunks.len(), 10);
        for (index, chunk) in chunks.iter().enumerate().skip(1) {
            for (from_end, length, change) in [(20, 1, 1), (40, 1, 0x10), (70, 64, 0)] {
                let mut changed = whole.clone();
                let start = (chunk.end - from_end).max(chunk.start + 60);
                for byte in &mut changed[start..(start + length).min(chunk.end)] {
                    *byte = if change == 0 { 0 } else { *byte ^ change };
                }
                let (found, skipped) = read("a.mcap", &changed).unwrap();
                assert_eq!(skipped, SkipCounts { damaged: 1, ..SkipCounts::default() }, "{compression:?} {index}");
                let mut expected = recording.fixes.clone();
                expected.drain(5 * index..5 * index + 5);
                assert_eq!(found.fixes, expected, "{compression:?} {index} {from_end}");
                // Fix n is at 2(n + 1) seconds. Nothing follows the last chunk.
                let span = (10.0 * index as f64, 10.0 * index as f64 + 12.0);
                let rounded = found.lost_spans.iter().map(|&(from_s, to_s)| (from_s.round(), to_s.round()));
                let expected = (index < 9).then_some(span);
                assert!(rounded.eq(expected), "{compression:?} {index} {from_end}: {:?}", found.lost_spans);
            }
        }
        // Behind a damaged length no record can be found. Those before it are read.
        let mut changed = whole.clone();
        changed[chunks[4].start - 2] = 0xff;
        let (found, skipped) = read("a.mcap", &changed).unwrap();
        assert_eq!((found.fixes.as_slice(), skipped.damaged, skipped.truncated), (&recording.fixes[..20], 1, 0));
        // The messages of the chunk at the end of a truncated file are read as far as they go.
        let (found, skipped) = read("a.mcap", &whole[..chunks[4].end - 1]).unwrap();
        assert!((20..=25).contains(&found.fixes.len()), "{compression:?}");
        assert_eq!((skipped.damaged, skipped.truncated), (0, 1));
    }
}

/// One bit of the latitude of three fixes was changed, and the checksums of their chunks were kept.
#[test]
fn changed_bits_in_a_recorded_mcap_file_are_not_taken_for_positions() {
    let (recording, skipped) = read("auv1.mcap", &std::fs::read(data("mcap-with-damage/auv1.mcap")).unwrap()).unwrap();
    assert!((1..=3).contains(&skipped.damaged), "{skipped:?}");
    let north_m = |fix: &pingmap_import::Fix| match fix.place {
        pingmap_import::Place::Degrees(place) => 111_000.0 * place.latitude_deg,
        pingmap_import::Place::Metres(_, north_m) => north_m,
    };
    let speeds = recording
        .fixes
        .windows(2)
        .map(|pair| (north_m(&pair[1]) - north_m(&pair[0])).abs() / (pair[1].time_s - pair[0].time_s));
    let fastest_m_per_s = speeds.fold(0.0, f64::max);
    assert!(recording.fixes.len() >= 10 && fastest_m_per_s < 5.0, "{} {fastest_m_per_s}", recording.fixes.len());
}

/// Nested types whose fingerprints would take 10^16 steps without memory.
#[test]
fn types_that_contain_each_other_many_times_take_bounded_work() {
    let mut text = "package x;\n".to_owned();
    for level in 0..17 {
        let members: Vec<String> = (0..10).map(|index| format!("a{} m{index};", level + 1)).collect();
        text += &format!("struct a{level} {{ {} }}\n", members.join(" "));
    }
    text += "struct a17 { double lat; }\n";
    let log = std::fs::read(data("auv1.lcmlog")).unwrap();
    let (mut reader, mut recordings, vehicle) = (RecordReader::default(), Recordings::new(), VehicleId::new("auv1"));
    reader.read_lcm_types(text.as_bytes(), Path::new("types.lcm")).unwrap();
    let source = FileSource::new(Path::new("a.lcmlog"), Some(&vehicle));
    let summary = reader.read_record(log.as_slice(), &source, &mut recordings).unwrap().unwrap();
    assert!(summary.skipped.unknown_type > 60, "{summary:?}");
    let error = reader.read_lcm_types(&b"struct a { }"[..], Path::new("empty.lcm")).unwrap_err().to_string();
    assert!(error.contains("empty.lcm") && error.contains("no members"), "{error}");
}
