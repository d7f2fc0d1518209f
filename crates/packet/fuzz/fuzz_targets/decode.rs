//! Any bytes as a map message, a report or spare bits: they are refused, or say something that has no other form than these bytes.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pingmap_packet::{Key, MapMessage, Recent, Report, Seal};

fuzz_target!(|bytes: &[u8]| {
    if let [n_bits, a, b, c, d, e, f, g, h, ..] = *bytes {
        let bits = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
        if let Ok(recent) = Recent::decode(bits, n_bits.into()) {
            assert_eq!(recent.encode(), bits);
        }
    }
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
