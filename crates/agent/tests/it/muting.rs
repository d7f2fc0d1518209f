//! Muting: a muted member has no effect of any kind.

use std::sync::Arc;

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// A message of a member.
#[derive(Debug, Clone)]
enum Message {
    Frame(Vec<u8>),
    Piggyback { sender: VehicleId, time_s: f64, bits: u64 },
}

/// Bits of a piggybacked message.
const N_BITS: usize = 16;

/// Messages of every kind of one member: reports with unused slots, summaries, and piggybacked outcomes.
fn messages(trip: &Trip, number: usize, is_unused: impl Fn(u32) -> bool) -> Vec<Message> {
    let mut agent = trip.vehicle(number);
    let unused = (0..trip.slots).filter(|&slot| trip.sender(slot) == number && is_unused(slot));
    agent.record_unused_slots(unused.map(slot_s)).unwrap();
    let end_s = slot_s(trip.slots - 1);
    let piggyback = agent.piggyback(end_s, N_BITS);
    let mut all: Vec<Message> =
        piggyback.map(|bits| Message::Piggyback { sender: name(number), time_s: end_s, bits }).into_iter().collect();
    all.extend(frames(&mut agent, 20).into_iter().map(Message::Frame));
    agent.options = summaries_alone();
    all.extend(frames(&mut agent, 3).into_iter().map(Message::Frame));
    all
}

fn receive(agent: &mut Agent, message: &Message) {
    match message {
        Message::Frame(bytes) => agent.receive(bytes, None).receipt,
        Message::Piggyback { sender, time_s, bits } => agent.receive_piggyback(sender, *time_s, *bits, N_BITS).receipt,
    };
}

/// Predictions after a fit from nothing, and the next frame.
fn results(mut agent: Agent) -> (Vec<u64>, Option<Vec<u8>>) {
    let probabilities = bits(&rebuilt_probabilities(&mut agent));
    agent.options = AgentOptions::default();
    (probabilities, agent.next_frame(Some(1e5), 64).unwrap().map(|frame| frame.bytes))
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn muting_a_member_equals_never_having_received_it(
        trip in trips().prop_filter("two other members", |trip| trip.members() >= 3),
        unused in prop::collection::vec(prop::bool::weighted(0.3), 64),
        order in any::<prop::sample::Index>(),
        muted_after in any::<prop::sample::Index>(),
    ) {
        let all: Vec<(usize, Message)> = (1..trip.members())
            .flat_map(|number| messages(&trip, number, |slot| unused[slot as usize]).into_iter().map(move |one| (number, one)))
            .collect();
        let mut order: Vec<&(usize, Message)> = all.iter().cycle().skip(order.index(all.len())).take(all.len()).collect();
        order.sort_by_key(|(number, message)| matches!(message, Message::Frame(bytes) if bytes.len() % 2 == *number % 2));
        let (mut muting, mut without) = (trip.vehicle(0), trip.vehicle(0));
        let muted_after = muted_after.index(order.len());
        for (index, (number, message)) in order.into_iter().enumerate() {
            receive(&mut muting, message);
            if index == muted_after {
                muting.probability(test_links()[0]).unwrap();
                muting.set_muted(&name(1), true);
            }
            if *number != 1 {
                receive(&mut without, message);
            }
        }
        let restored = restored(&muting, &muting.snapshot());
        let expected = results(without);
        prop_assert_eq!(&results(restored), &expected);
        prop_assert_eq!(&results(muting.clone()), &expected);
        // Unmuting restores everything.
        muting.set_muted(&name(1), false);
        let mut believing = trip.vehicle(0);
        all.iter().for_each(|(_, message)| receive(&mut believing, message));
        prop_assert_eq!(results(muting), results(believing));
    }
}

#[test]
fn the_status_names_each_reason_and_since_when() {
    let team = Arc::new(team(3, model()));
    let mut agent = vehicle(&team, 0, walk(0, 20, 0.0));
    let link = test_links()[0];
    assert!(member(&agent, &name(1)).ignored.is_empty());
    agent.set_muted(&name(1), true);
    agent.probability(link).unwrap();
    // The clock stands at the last event, which is the 20th in steps of ten seconds.
    let since = [(IgnoreReason::Muted, 190.0)].into();
    assert_eq!(member(&agent, &name(1)).ignored, since);
    agent.record(walk(0, 30, 0.0).into_iter().skip(20)).unwrap();
    agent.refit().unwrap();
    assert_eq!(member(&agent, &name(1)).ignored, since, "the reason is older than the new events");
    agent.set_muted(&name(1), false);
    assert!(member(&agent, &name(1)).ignored.is_empty());
    agent.probability(link).unwrap();
    agent.set_muted(&name(1), true);
    assert_eq!(member(&agent, &name(1)).ignored, [(IgnoreReason::Muted, 290.0)].into());
}
