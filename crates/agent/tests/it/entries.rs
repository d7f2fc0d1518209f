//! Entries of every kind: their order, their repetition and restarts in between do not matter.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// A mission of vehicle 0 with a late member, unused slots, reports, piggybacked outcomes and own frames.
#[derive(Debug, Clone)]
struct Mission {
    trip: Trip,
    entries: Vec<Entry>,
}

/// The reports and piggybacked outcomes of another vehicle, formed during the mission.
fn entries_of(trip: &Trip, number: usize, unused: &BTreeSet<u32>) -> Vec<Entry> {
    let mut agent = vehicle_with(&trip.team, number, reports_alone(), []);
    let mut entries = Vec::new();
    for slot in 0..trip.slots {
        let time_s = slot_s(slot);
        agent.record_positions([(time_s, trip.at(number, slot))]).unwrap();
        agent.record(trip.event(slot, number)).unwrap();
        if trip.sender(slot) != number {
            continue;
        }
        if unused.contains(&slot) {
            agent.record_unused_slots([time_s]).unwrap();
            continue;
        }
        let frame = agent.next_frame(Some(time_s), 32).unwrap().map(|frame| frame.bytes);
        entries.extend(frame.map(|bytes| Entry::Received { time_s: None, bytes }));
        // The newest reception, as far as there is one.
        let newest = (0..slot).rev().find_map(|slot| Some((slot, trip.event(slot, number)?.success)));
        entries.extend(newest.map(|(newest, heard)| Entry::Piggyback {
            sender: name(number),
            newest,
            outcomes: vec![heard],
        }));
    }
    entries
}

fn missions() -> impl Strategy<Value = Mission> {
    let slots = prop::collection::vec(prop::bool::weighted(0.15), 48);
    (trips(), slots, 0..24u32, 10..48u32, 1..4u16, 8..40usize, any::<bool>()).prop_map(
        |(mut trip, unused, from, length, reports_max, events_max, stores_few)| {
            // Vehicle 0 hears most messages of the late member.
            for slot in (0..trip.slots).filter(|slot| slot % 4 != 0 && trip.sender(*slot) == 1).collect::<Vec<u32>>() {
                trip.outcomes[slot as usize][0] = Some(true);
            }
            let trip = trip.without_exclusion().with_team(|team| {
                if stores_few {
                    team.reports_per_sender_max = reports_max;
                    team.limits.events_max = events_max;
                }
            });
            let unused: BTreeSet<u32> = (0..trip.slots).filter(|&slot| unused[slot as usize]).collect();
            let late = |sender: usize, slot: u32| i64::from(sender == 1 && (from..from + length).contains(&slot));
            let recorded = trip.recorded(late).into_iter().filter(|event| (event.time_s / SLOT_S) as u32 % 7 < 5);
            let observed = (0..).zip(recorded).map(|(number, event)| Entry::Observed { number, event });
            let mut entries: Vec<Entry> = observed.collect();
            entries.extend(trip.positions(0).map(|(time_s, position)| Entry::Navigated { time_s, position }));
            entries.extend((1..trip.members()).flat_map(|number| entries_of(&trip, number, &unused)));
            // Vehicle 0 knows some outcomes without positions, and some positions of the late member.
            entries.extend((0..trip.slots).filter(|slot| slot % 3 == 0).filter_map(|slot| {
                let Event { time_s, transmitter_id, success, .. } = trip.event(slot, 0)?;
                Some(Entry::Outcome { time_s, transmitter_id, success })
            }));
            entries.extend((0..trip.slots).filter(|slot| slot % 5 < 2).map(|slot| {
                let (time_s, position) = (slot_s(slot), trip.at(1, slot));
                Entry::PeerPosition { member: name(1), time_s, position, is_independent: slot % 2 == 0 }
            }));
            entries.extend(unused.iter().map(|&slot| Entry::UnusedSlot { sender: name(trip.sender(slot)), slot }));
            let mut own = trip.vehicle(0);
            let sent = (0..3).map_while(|number| Some((number, own.next_frame(None, 32).unwrap()?.bytes)));
            entries.extend(sent.flat_map(|(number, bytes)| {
                let slot = Some(trip.members() as u32 * (3 + number as u32));
                let states = [FrameState::Proposed, FrameState::Dropped, FrameState::Departed];
                let states = states.into_iter().take(1 + number as usize);
                states.map(move |state| Entry::Sent { number, state, slot, bytes: bytes.clone() }).collect::<Vec<_>>()
            }));
            Mission { trip, entries }
        },
    )
}

/// Snapshot, status, predictions and frames of a vehicle after a fit from nothing.
#[derive(Debug, PartialEq)]
struct Results {
    snapshot: Vec<u8>,
    status: Status,
    mean: Vec<u64>,
    variance: Vec<u64>,
    frames: Vec<Vec<u8>>,
}

impl Results {
    fn of(mut agent: Agent) -> Self {
        agent.rebuild().unwrap();
        let (mean, variance) = test_latent(&mut agent);
        let snapshot = agent.snapshot();
        // Repeated frames change the counts alone.
        let mut status = agent.status();
        // Numbers of frames, and the times since when data do not count, are history.
        status.counts.clear();
        status.members.values_mut().flat_map(|member| member.ignored.values_mut()).for_each(|since_s| *since_s = 0.0);
        Self { snapshot, status, mean: bits(&mean), variance: bits(&variance), frames: frames(&mut agent, 20) }
    }
}

proptest! {
    #![proptest_config(cases(32))]

    #[test]
    fn mixtures_of_all_entries_in_any_order_give_the_same_vehicle(
        mission in missions(), shuffle in any::<u64>(), asked in any::<u64>(), cut in any::<prop::sample::Index>(),
        repeated in prop::collection::vec(any::<prop::sample::Index>(), 0..40),
    ) {
        let Mission { trip, entries } = mission;
        let mut in_order = vehicle_with(&trip.team, 0, reports_alone(), []);
        for entry in &entries {
            in_order.apply(entry.clone()).unwrap();
        }
        let mut order: Vec<usize> = (0..entries.len()).collect();
        order.sort_by_key(|&place| (place as u64 + 1).wrapping_mul(shuffle | 1).rotate_left(17));
        order.extend(repeated.iter().map(|place| place.index(entries.len())));
        let mut unordered = vehicle_with(&trip.team, 0, reports_alone(), []);
        let cut = cut.index(order.len());
        for (step, place) in order.into_iter().enumerate() {
            if step == cut {
                let team = Arc::new(unordered.team().clone());
                unordered = Agent::restore(name(0), team, reports_alone(), &unordered.snapshot()).unwrap();
            }
            unordered.apply(entries[place].clone()).unwrap();
            match (asked.rotate_left(step as u32) & 7, step % 8) {
                (0 | 1, 0) => unordered.refit().unwrap(),
                (2 | 3, 1) => drop(unordered.status()),
                (4, 2) => drop(test_probabilities(&mut unordered)),
                _ => {}
            }
        }
        prop_assert_eq!(Results::of(unordered), Results::of(in_order));
    }
}
