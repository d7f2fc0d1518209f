//! Reads arbitrary bytes as a table of each kind, as modem ids and as a schedule.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::VehicleId;
use pingmap_import::{ModemIds, RecordReader, Recordings, Reference, Rules, Schedule, TableKind, join};

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("file");
    let mut recordings = Recordings::new();
    for kind in [TableKind::Navigation, TableKind::Receptions, TableKind::Transmissions] {
        for vehicle in [None, Some(&VehicleId::new("a"))] {
            let _ = RecordReader::default().read_table(kind, (bytes, path), vehicle, &mut recordings);
        }
    }
    let ids = ModemIds::read(bytes, path).unwrap_or_default();
    let schedule = Schedule::read(bytes, path, &ids).ok();
    let _ = join(&recordings, schedule.as_ref(), &Reference::unknown(), &Rules::default());
});
