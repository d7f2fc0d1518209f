//! Any bytes as a map message or a report: they are refused, or say something that has no other form than these bytes.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pingmap_packet::{Key, MapMessage, Report, Seal};

fuzz_target!(|bytes: &[u8]| {
    let key = Key::new(*b"the secret of a team of vehicles").expect("no weak key");
    for seal in [None, Some(Seal { key: &key, context: b"model" })] {
        if let Ok((layout, report, length)) = Report::decode(bytes, seal) {
            let again = report.encode(layout, seal).expect("what was decoded is within bounds");
            assert_eq!(again, bytes[..length]);
        }
        let Ok((layout, message)) = MapMessage::decode(bytes, seal) else { continue };
        let again = message.encode(layout, seal).expect("what was decoded is within bounds");
        assert!(again.len() <= layout.frame_bytes);
        let (sent, filling) = bytes.split_at(again.len());
        assert_eq!(sent, again);
        assert!(filling.iter().all(|&byte| byte == 0));
    }
});
