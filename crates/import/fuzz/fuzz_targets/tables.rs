//! Any bytes as a table of each kind, as ids and as a schedule.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::VehicleId;
use pingmap_import::{Ids, Reading, Recordings, Reference, Rules, Schedule, TableKind, join};

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("file");
    let mut recordings = Recordings::new();
    for kind in [TableKind::Navigation, TableKind::Heard, TableKind::Sent] {
        for vehicle in [None, Some(&VehicleId::new("a"))] {
            let _ = Reading::default().take(kind, (bytes, path), vehicle, &mut recordings);
        }
    }
    let ids = Ids::read(bytes, path).unwrap_or_default();
    let schedule = Schedule::read(bytes, path, &ids).ok();
    let _ = join(&recordings, schedule.as_ref(), &Reference::unknown(), &Rules::default());
});
