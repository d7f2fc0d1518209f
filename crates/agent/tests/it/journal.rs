//! Entries as bytes, for the journal of a host.

use crate::common::*;
use pingmap_agent::*;
use proptest::collection::vec;
use proptest::prelude::*;

fn positions() -> impl Strategy<Value = Position> {
    let optional = || prop::option::of(-100.0..100.0f64);
    (-1e4..1e4f64, -1e4..1e4f64, optional(), optional()).prop_map(|(east_m, north_m, depth_m, heading_deg)| Position {
        east_m,
        north_m,
        depth_m,
        heading_deg,
    })
}

fn entries() -> impl Strategy<Value = Entry> {
    let time_s = || -1e9..1e9f64;
    let id = || "[a-z]{0,8}".prop_map(VehicleId::new);
    let bytes = || vec(any::<u8>(), 0..40);
    let states = prop::sample::select(vec![FrameState::Proposed, FrameState::Dropped, FrameState::Departed]);
    let event = (time_s(), id(), id(), positions(), positions(), prop::option::of("[a-z]{1,5}"), any::<bool>())
        .prop_map(|(time_s, transmitter_id, receiver_id, transmitter, receiver, kind, success)| Event {
            time_s,
            transmitter_id,
            receiver_id,
            link: Link { transmitter, receiver },
            kind: kind.map(MessageKind::new),
            success,
        });
    prop_oneof![
        (any::<u64>(), event).prop_map(|(number, event)| Entry::Observed { number, event }),
        (time_s(), positions()).prop_map(|(time_s, position)| Entry::Navigated { time_s, position }),
        (time_s(), id(), any::<bool>()).prop_map(|(time_s, transmitter_id, success)| Entry::Outcome {
            time_s,
            transmitter_id,
            success
        }),
        (id(), time_s(), positions(), any::<bool>()).prop_map(|(member, time_s, position, is_independent)| {
            Entry::PeerPosition { member, time_s, position, is_independent }
        }),
        (id(), any::<u32>()).prop_map(|(sender, slot)| Entry::UnusedSlot { sender, slot }),
        (id(), any::<u32>(), vec(any::<bool>(), 0..20)).prop_map(|(sender, newest, outcomes)| Entry::Piggyback {
            sender,
            newest,
            outcomes
        }),
        (prop::option::of(time_s()), bytes()).prop_map(|(time_s, bytes)| Entry::Received { time_s, bytes }),
        (any::<u64>(), states, prop::option::of(any::<u32>()), bytes())
            .prop_map(|(number, state, slot, bytes)| Entry::Sent { number, state, slot, bytes }),
    ]
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn every_entry_is_read_as_it_was_written(entry in entries()) {
        prop_assert_eq!(Entry::from_bytes(&entry.to_bytes()), Ok(entry));
    }

    #[test]
    fn other_bytes_are_refused_or_encode_exactly_one_entry(bytes in vec(any::<u8>(), 0..60), tag in 0..12u8) {
        let bytes = [&[1, tag], bytes.as_slice()].concat();
        if let Ok(entry) = Entry::from_bytes(&bytes) {
            prop_assert_eq!(entry.to_bytes(), bytes);
        }
    }

    #[test]
    fn cut_entries_and_those_of_another_version_are_refused(entry in entries(), version in 2..=255u8) {
        let mut bytes = entry.to_bytes();
        for length in 0..bytes.len() {
            prop_assert!(Entry::from_bytes(&bytes[..length]).is_err());
        }
        bytes[0] = version;
        let refused = Entry::from_bytes(&bytes).unwrap_err().to_string();
        prop_assert!(refused.contains(&format!("version {version}")), "{refused}");
    }
}
