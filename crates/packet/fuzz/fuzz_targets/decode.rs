//! Decodes any bytes as an outcome bitmap, a report and a map message. Accepted bytes must be the canonical encoding.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pingmap_packet::{Authenticator, Key, MapMessage, OutcomeBitmap, Report};

fuzz_target!(|bytes: &[u8]| {
    if let [n_bits, a, b, c, d, e, f, g, h, ..] = *bytes {
        let bits = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
        if let Ok(bitmap) = OutcomeBitmap::decode(bits, n_bits.into()) {
            assert_eq!(bitmap.encode(), bits);
        }
    }
    let key = Key::new(*b"the secret of a team of vehicles").expect("no weak key");
    for auth in [None, Some(Authenticator { key: &key, context: b"model" })] {
        if let Ok((layout, report, length)) = Report::decode(bytes, auth) {
            let again = report.encode(layout, auth).expect("decoded values are within bounds");
            assert_eq!(again, bytes[..length]);
        }
        let Ok((layout, message)) = MapMessage::decode(bytes, auth) else { continue };
        let again = message.encode(layout, auth).expect("decoded values are within bounds");
        assert!(again.len() <= layout.frame_bytes);
        let (sent, padding) = bytes.split_at(again.len());
        assert_eq!(sent, again);
        assert!(padding.iter().all(|&byte| byte == 0));
    }
});
