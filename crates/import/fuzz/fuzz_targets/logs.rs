//! Any bytes as a file of a known kind: as it stands, and with the beginning of each kind before it.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::VehicleId;
use pingmap_import::{Reading, Recordings, Reference, Rules, join, resolve};

const BEGINNINGS: [&[u8]; 3] = [b"", b"%% LOG FILE: a\n%% LOGSTART 5\n1 NODE_REPORT_LOCAL p NAME=a\n", b"1 $CACFG,SRC,1\n"];

fuzz_target!(|bytes: &[u8]| {
    for beginning in BEGINNINGS {
        let file = [beginning, bytes].concat();
        let mut recordings = Recordings::new();
        for vehicle in ["a", "b"] {
            let table = (file.as_slice(), Path::new("file"));
            let _ = Reading::default().take_record(table, Some(&VehicleId::new(vehicle)), &mut recordings);
        }
        let _ = resolve(&mut recordings);
        let _ = join(&recordings, None, &Reference::unknown(), &Rules::default());
    }
});
