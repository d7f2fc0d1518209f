//! Outcome bitmaps: every value decodes, and encodes to the same bits.

use pingmap_packet::{Error, OutcomeBitmap};
use proptest::prelude::*;

proptest! {
    #[test]
    fn every_value_decodes_and_encodes_to_the_same_bits(bits in any::<u64>(), n_bits in 7..=64usize) {
        let bits = bits >> (64 - n_bits);
        let bitmap = OutcomeBitmap::decode(bits, n_bits).unwrap();
        prop_assert_eq!(bitmap.outcomes.len(), n_bits - 6);
        prop_assert_eq!(bitmap.encode(), bits);
        if n_bits < 64 {
            let beyond = OutcomeBitmap::decode(bits | 1 << n_bits, n_bits);
            let is_refused = matches!(beyond, Err(Error::OutOfBounds { .. }));
            prop_assert!(is_refused);
        }
    }
}

#[test]
fn two_bytes_hold_ten_outcomes() {
    // Slot 200 has number 8 modulo 64. The first outcomes are one heard and two missed.
    let outcomes = [true, false, false, true, true, false, true, false, false, true].to_vec();
    let bitmap = OutcomeBitmap { slot_mod: 200 % 64, outcomes };
    assert_eq!(bitmap.encode().to_le_bytes()[..3], [0x48, 0x96, 0]);
    for n_bits in [0, 6, 65, usize::MAX] {
        assert!(matches!(OutcomeBitmap::decode(0, n_bits), Err(Error::OutOfBounds { .. })), "{n_bits}");
    }
}
