//! Outcomes in spare bits.

#![allow(clippy::unwrap_used)]

use pingmap_packet::{Error, Recent};
use proptest::prelude::*;

proptest! {
    #[test]
    fn bits_read_back_and_every_value_says_something(bits in any::<u64>(), n_bits in 7..=64usize) {
        let bits = bits >> (64 - n_bits);
        let recent = Recent::decode(bits, n_bits).unwrap();
        prop_assert_eq!(recent.outcomes.len(), n_bits - 6);
        prop_assert_eq!(recent.encode(), bits);
        if n_bits < 64 {
            let beyond = Recent::decode(bits | 1 << n_bits, n_bits);
            let is_refused = matches!(beyond, Err(Error::OutOfBounds { .. }));
            prop_assert!(is_refused);
        }
    }
}

#[test]
fn two_bytes_hold_ten_outcomes() {
    // Slot 200 is number 8 of 64; heard, then missed twice, …
    let outcomes = [true, false, false, true, true, false, true, false, false, true].to_vec();
    let recent = Recent { newest: 200 % 64, outcomes };
    assert_eq!(recent.encode().to_le_bytes()[..3], [0x48, 0x96, 0]);
    for n_bits in [0, 6, 65, usize::MAX] {
        assert!(matches!(Recent::decode(0, n_bits), Err(Error::OutOfBounds { .. })), "{n_bits}");
    }
}
