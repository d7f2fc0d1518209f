//! Reads arbitrary bytes as a log: unchanged, and behind the beginning of each format.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::VehicleId;
use pingmap_import::{RecordReader, Recordings, Reference, Rules, FileSource, join, resolve_modem_ids};

const BEGINNINGS: [&[u8]; 5] = [b"", b"\x89MCAP0\r\n", b"\xed\xa1\xda\x01", b"%% LOG FILE: a\n%% LOGSTART 5\n1 NODE_REPORT_LOCAL p NAME=a\n", b"1 $CACFG,SRC,1\n"];

/// Definitions of LCM types for the fuzzed logs.
const TYPES: &[u8] = b"struct a { int32_t n; double lat[n]; double lon; string said; b more[n]; } struct b { byte raw[2]; }";

fuzz_target!(|bytes: &[u8]| {
    let mut reading = RecordReader::default();
    let _ = reading.read_lcm_types(bytes, Path::new("types"));
    let _ = reading.read_lcm_types(TYPES, Path::new("types"));
    for beginning in BEGINNINGS {
        let file = [beginning, bytes].concat();
        let mut recordings = Recordings::new();
        for vehicle in ["a", "b"] {
            let vehicle = VehicleId::new(vehicle);
            let source = FileSource::new(Path::new("file"), Some(&vehicle));
            let _ = reading.read_record(file.as_slice(), &source, &mut recordings);
        }
        let _ = resolve_modem_ids(&mut recordings);
        let _ = join(&recordings, None, &Reference::unknown(), &Rules::default());
    }
});
