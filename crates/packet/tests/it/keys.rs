//! Keys: parsing, secrecy, and separation of uses.

use pingmap_packet::*;

const CONTEXT: &[u8] = b"model 7";

fn key() -> Key {
    Key::new(*b"the secret of a team of vehicles").unwrap()
}

/// An authenticated message without information, under this key.
fn frame(key: &Key) -> Vec<u8> {
    let layout = Layout::for_frame(32, false, true).unwrap();
    let message = MapMessage { sender: 3, counter: 0x1234, model: 0, blocks: vec![Block::empty(layout)] };
    message.encode(layout, Some(Authenticator { key, context: CONTEXT })).unwrap()
}

#[test]
fn a_key_is_parsed_from_64_hexadecimal_digits() {
    let digits = "00112233445566778899aAbBcCdDeEfF".repeat(2);
    let bytes: Vec<u8> = (0..32).map(|place| place % 16 * 0x11).collect();
    let parsed = Key::parse(&format!(" {digits}\n")).unwrap();
    assert_eq!(frame(&parsed), frame(&Key::new(bytes.try_into().unwrap()).unwrap()));
}

#[test]
fn the_error_for_an_invalid_key_does_not_contain_the_text() {
    let digits = "0123456789abcdef".repeat(4);
    let signs = "+f".repeat(32);
    let umlauts = "ä".repeat(32);
    let letters = "secretpassphrase".repeat(4);
    for text in ["", "secret", &digits[1..], &format!("{digits}0"), &format!("0x{digits}"), &signs, &umlauts, &letters]
    {
        let error = Key::parse(text).unwrap_err();
        assert!(text.is_empty() || !format!("{error} {error:?}").contains(text), "{error:?}");
    }
}

#[test]
fn a_key_of_equal_bytes_is_refused() {
    for byte in [0, 7, 255] {
        assert_eq!(Key::new([byte; 32]).unwrap_err(), Error::WeakKey);
    }
    assert_eq!(Key::parse(&"ab".repeat(32)).unwrap_err(), Error::WeakKey);
}

#[test]
fn digests_for_different_uses_of_a_key_differ() {
    let key = key();
    let mut unsigned = frame(&key);
    let start = unsigned.len() - 8;
    let tag = unsigned[start..].to_vec();
    unsigned[start..].fill(0);
    let signed: Vec<u8> = [&(CONTEXT.len() as u64).to_le_bytes(), CONTEXT, &unsigned].concat();
    assert_ne!(key.keyed_digest(&signed)[..8], tag);
    assert_ne!(key.keyed_digest(b""), key.fingerprint());
}

#[test]
fn debug_output_does_not_contain_the_key() {
    assert_eq!(format!("{:?} {:#?}", key(), key()), "Key(…) Key(…)");
}
