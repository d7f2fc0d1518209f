//! The memory of a vehicle is a set: entries count once, in any order, before and after restarts.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

/// Frames that vehicle 0 may receive: packets of all members, its own number among them, from two vehicles under each
/// number; and packets without content, under near and far counters.
fn received_frames(fleet: &Fleet) -> Vec<Vec<u8>> {
    let mut all = fleet.packets(3);
    for number in 0..fleet.events.len() {
        let other = fleet.events[number].iter().rev().take(4).cloned();
        all.extend(frames(&mut vehicle(&fleet.team, number, other), 2));
    }
    for sender in 0..2 {
        let counters = [7, 40, 900, 1900, 4000, 4900, 20_000, 65_535];
        all.extend(counters.map(|counter| empty_packet(&fleet.team, sender, counter)));
    }
    all
}

/// The latest time of a step, in seconds.
const END_S: f64 = 200.0;

/// Returns a copy of the vehicle whose clock is at the latest time. Times of departure are in no entry.
fn at_end(agent: &Agent) -> Agent {
    let mut agent = agent.clone();
    agent.record_positions([(END_S, walk(0, 1, 0.0)[0].link.receiver)]).unwrap();
    agent
}

/// One step in the life of vehicle 0.
#[derive(Debug, Clone)]
enum Step {
    Record,
    Receive(Index),
    Send,
    /// The host reports about the last frame: it left at this time, or never.
    Leave(Option<f64>),
    Refit,
    Predict,
    /// A restart from the last snapshot, followed by all entries of the journal.
    Restart,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        3 => Just(Step::Record),
        4 => any::<Index>().prop_map(Step::Receive),
        2 => Just(Step::Send),
        1 => prop::option::of(0.0..END_S).prop_map(Step::Leave),
        1 => Just(Step::Refit),
        2 => Just(Step::Predict),
        1 => Just(Step::Restart),
    ];
    vec(step, 1..40)
}

/// Takes these steps, and returns the vehicle and a journal of the entries that it returned, as read from their bytes.
fn run(fleet: &Fleet, window: u16, steps: &[Step]) -> (Agent, Vec<Entry>) {
    let team = Arc::new(Team { packets_per_sender_max: window, ..(*fleet.team).clone() });
    let frames: Vec<Vec<u8>> = received_frames(&Fleet { team: team.clone(), events: fleet.events.clone() });
    let mut agent = vehicle(&team, 0, []);
    let (mut journal, mut snapshot) = (Vec::<Entry>::new(), agent.snapshot());
    let mut events = fleet.events[0].iter();
    for step in steps {
        let new = match step {
            Step::Record => agent.record(events.next().cloned()).unwrap(),
            Step::Receive(frame) => Vec::from_iter(agent.receive(&frames[frame.index(frames.len())], None).entry),
            Step::Send => match agent.next_frame(Some(0.0), 32) {
                Ok(frame) => Vec::from_iter(frame.map(|frame| frame.entry())),
                Err(AgentError::CountersUsedUp { .. }) => Vec::new(),
                Err(error) => panic!("{error}"),
            },
            Step::Leave(time_s) => {
                let number = agent.status().next_frame.wrapping_sub(1);
                let left = time_s.map(|time_s| agent.frame_departed(number, time_s));
                // Without a frame there is no number.
                Vec::from_iter(left.unwrap_or_else(|| agent.frame_dropped(number)).ok())
            }
            Step::Refit => {
                agent.refit().unwrap();
                Vec::new()
            }
            Step::Predict => {
                test_probabilities(&mut agent);
                Vec::new()
            }
            Step::Restart => {
                let before = agent.clone();
                agent = Agent::restore(agent.id().clone(), team.clone(), agent.options, &snapshot).unwrap();
                journal.iter().for_each(|entry| drop(agent.apply(entry.clone()).unwrap()));
                assert_eq!(at_end(&agent).snapshot(), at_end(&before).snapshot());
                snapshot = agent.snapshot();
                Vec::new()
            }
        };
        journal.extend(new.iter().map(|entry| Entry::from_bytes(&entry.to_bytes()).unwrap()));
    }
    (agent, journal)
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn equal_sets_of_entries_give_equal_memories_and_predictions(
        fleet in fleets(), window in prop::sample::select(vec![1u16, 3, 64]), steps in steps(),
        repeated in vec(any::<Index>(), 0..40), cut in any::<Index>(), shuffle in any::<u64>(),
    ) {
        let (agent, journal) = run(&fleet, window, &steps);
        // Every entry once, in another order, and some entries twice, with a restart in between.
        let mut order: Vec<usize> = (0..journal.len()).collect();
        order.sort_by_key(|&place| (place as u64 + 1).wrapping_mul(shuffle | 1).rotate_left(17));
        order.extend(repeated.iter().filter(|_| !journal.is_empty()).map(|place| place.index(journal.len())));
        let team = Arc::new(agent.team().clone());
        let mut other = vehicle(&team, 0, []);
        let cut = cut.index(order.len() + 1);
        for (step, &place) in order.iter().enumerate() {
            if step == cut {
                other = Agent::restore(name(0), team.clone(), AgentOptions::default(), &other.snapshot()).unwrap();
            }
            other.apply(journal[place].clone()).unwrap();
        }
        let [mut agent, mut other] = [&agent, &other].map(at_end);
        prop_assert!(other.snapshot() == agent.snapshot(), "{:?}\n{:?}", agent.links_of_packets(), other.links_of_packets());
        let next_numbers = |agent: &Agent| (agent.status().next_event, agent.status().next_frame);
        prop_assert_eq!(next_numbers(&other), next_numbers(&agent));
        // Absorbed data give the same as a rebuild from the same fit, and both vehicles predict the same.
        agent.refit().unwrap();
        let absorbed = test_probabilities(&mut agent);
        let rebuilt = [&mut agent, &mut other].map(rebuilt_probabilities);
        // A fit stops at 1e-6.
        prop_assert!(largest_difference(&absorbed, &rebuilt[0]) < 1e-5);
        prop_assert_eq!(bits(&rebuilt[0]), bits(&rebuilt[1]));
        let next = [&mut agent, &mut other].map(|agent| agent.next_frame(Some(99.0), 32));
        prop_assert_eq!(&next[0], &next[1]);
    }

    #[test]
    fn a_full_memory_keeps_the_events_recorded_last_independent_of_time_and_order(
        times in vec(-1e9..1e9f64, 60), clock_is_set_back in any::<bool>(), order in Just((0..60).collect::<Vec<usize>>()).prop_shuffle(),
    ) {
        let mut team = team(2, model());
        team.limits.events_max = 32;
        let team = Arc::new(team);
        let time_s = |n: usize| if clock_is_set_back { 1.7e9 * f64::from(u8::from(n < 30)) + n as f64 } else { times[n] };
        let all: Vec<Event> = walk(0, 60, 0.0).into_iter().enumerate().map(|(n, event)| Event { time_s: time_s(n), ..event }).collect();
        let mut agent = vehicle(&team, 0, []);
        for &number in &order {
            agent.apply(Entry::Observed { number: number as u64, event: all[number].clone() }).unwrap();
            if number % 7 == 0 {
                test_probabilities(&mut agent);
            }
        }
        let mut in_order = vehicle(&team, 0, all.iter().cloned());
        prop_assert_eq!(agent.snapshot(), in_order.snapshot());
        let mut expected = all[28..].to_vec();
        expected.sort_by(Event::canonical_order);
        prop_assert_eq!(events(&agent), expected);
        prop_assert_eq!(bits(&rebuilt_probabilities(&mut agent)), bits(&rebuilt_probabilities(&mut in_order)));
    }
}

#[test]
fn two_equal_events_are_two_and_one_event_applied_twice_is_one() {
    let team = Arc::new(team(2, model()));
    let event = walk(0, 1, 0.0).remove(0);
    let mut agent = vehicle(&team, 0, [event.clone(), event.clone()]);
    assert_eq!(agent.events().len(), 2);
    for number in [0, 1, 1, 0] {
        agent.apply(Entry::Observed { number, event: event.clone() }).unwrap();
    }
    assert_eq!((agent.events().len(), agent.status().next_event), (2, 2));
    // No correct host gives one number to two events. The memory keeps the same one of them in either order.
    let other = Event { time_s: -5.0, ..event.clone() };
    let both = [[&event, &other], [&other, &event]].map(|[first, second]| {
        let mut agent = vehicle(&team, 0, []);
        for event in [first, second] {
            agent.apply(Entry::Observed { number: 3, event: event.clone() }).unwrap();
            test_probabilities(&mut agent);
        }
        (events(&agent), agent.snapshot())
    });
    assert_eq!(both[0], both[1]);
    assert_eq!(both[0].0, [other]);
}

#[test]
fn kinds_of_messages_are_stored() {
    let team = Arc::new(team(2, model()));
    let kind = |n: usize| (!n.is_multiple_of(3)).then(|| MessageKind::new(format!("kind {}", n % 3)));
    let of_kinds = walk(0, 9, 0.0).into_iter().enumerate().map(|(n, event)| Event { kind: kind(n), ..event });
    let agent = vehicle(&team, 0, of_kinds);
    let again = restored(&agent, &agent.snapshot());
    assert_eq!(events(&again), events(&agent));
    assert_eq!(events(&again).iter().filter(|event| event.kind.is_some()).count(), 6);
}

#[test]
fn events_of_other_receivers_and_numbers_out_of_bounds_are_refused() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 3, 0.0));
    let before = agent.snapshot();
    let theirs = walk(1, 1, 0.0).remove(0);
    assert!(matches!(agent.record([theirs.clone()]), Err(AgentError::NotMine { .. })));
    let applied = agent.apply(Entry::Observed { number: 9, event: theirs.clone() });
    assert!(matches!(applied, Err(AgentError::NotMine { .. })));
    let mut far = walk(0, 1, 0.0).remove(0);
    far.link.receiver.north_m = 1.1e9;
    assert_eq!(agent.record([far.clone()]), Err(AgentError::Nowhere { value_m: 1.1e9 }));
    far.link.receiver.north_m = 0.0;
    let number = 1 << 48;
    assert_eq!(agent.apply(Entry::Observed { number, event: far }), Err(AgentError::NumberTooLarge(number)));
    assert_eq!(agent.snapshot(), before);
    agent.options.record_all_receivers = true;
    agent.record([theirs]).unwrap();
    assert_eq!(agent.events().len(), 4);
}

#[test]
fn two_vehicles_under_one_number_are_detected() {
    let team = Arc::new(team(3, model()));
    let [mut first, mut second] = [0.0, 0.7].map(|phase| vehicle(&team, 1, walk(1, 40, phase)));
    let packets = [&mut first, &mut second].map(|agent| frames(agent, 2));
    let mut listener = vehicle(&team, 0, []);
    assert_eq!(listener.receive(&packets[0][0], None).receipt, Receipt::Accepted);
    let before = test_probabilities(&mut listener);
    assert_eq!(listener.receive(&packets[1][0], None).receipt, Receipt::Refused(Refusal::Conflict(0)));
    assert_ne!(test_probabilities(&mut listener), before, "neither packet counts");
    assert_eq!(listener.receive(&packets[0][0], None).receipt, Receipt::Refused(Refusal::Duplicate));
    let conflicts = |agent: &Agent| member(agent, &name(1)).conflicts;
    let status = listener.status();
    assert_eq!((conflicts(&listener), status.counts["conflict"], status.live_packets), (1, 1, 0));
    // Each of the two vehicles detects the other, and continues with counters that the other has not used.
    assert_eq!(first.receive(&packets[1][1], None).receipt, Receipt::Refused(Refusal::Conflict(1)));
    assert_eq!(count(&first, "conflict"), 1);
    first.record(walk(1, 40, 1.4)).unwrap();
    first.refit().unwrap();
    let bytes = first.next_frame(None, 32).unwrap().unwrap().bytes;
    assert_eq!(first.codec().read(&bytes).unwrap().1.counter, 1 + team.packets_per_sender_max);
    assert_eq!(listener.receive(&bytes, None).receipt, Receipt::Accepted);
    assert_eq!(conflicts(&listener), 0);
}

#[test]
fn muting_ignores_stored_and_later_packets_until_unmuting() {
    let team = Arc::new(team(3, model()));
    let packets = [1, 2].map(|n| frames(&mut vehicle(&team, n, walk(n, 40, n as f64)), 3));
    let listener = || vehicle(&team, 0, walk(0, 20, 0.3));
    let [one, two] = [name(1), name(2)];
    let (mut only_two, mut both) = (listener(), listener());
    receive_all(&mut only_two, &packets[1]);
    receive_all(&mut both, packets.iter().flatten());
    let (without, with) = (test_probabilities(&mut only_two), test_probabilities(&mut both));
    assert!(largest_difference(&without, &with) > 1e-3);

    let mut agent = listener();
    agent.set_muted(&one, true);
    receive_all(&mut agent, packets.iter().flatten());
    assert!(largest_difference(&test_probabilities(&mut agent), &without) < 1e-9);
    assert!(
        member(&agent, &one).is_ignored(IgnoreReason::Muted) && !member(&agent, &two).is_ignored(IgnoreReason::Muted)
    );
    agent.set_muted(&one, false);
    assert!(largest_difference(&test_probabilities(&mut agent), &with) < 1e-9);
    assert_eq!(agent.snapshot(), both.snapshot());
    agent.set_muted(&two, true);
    agent.set_muted(&one, true);
    agent.set_muted(&two, false);
    assert!(largest_difference(&test_probabilities(&mut agent), &without) < 1e-9);
    assert_eq!(agent.status().live_packets, packets[1].len());
}

#[test]
fn muting_unknown_names_or_the_own_name_changes_nothing() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 20, 0.3));
    let before = (agent.snapshot(), agent.status());
    agent.set_muted(&name(0), true);
    agent.set_muted(&VehicleId::new("a ship"), true);
    assert_eq!((agent.snapshot(), agent.status()), before);
}
