//! What a vehicle remembers is a set: of events and frames in any order, any number and any number of lives.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::*;
use pingmap_agent::*;
use pingmap_packet::{Block, MapMessage};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

/// Frames of a team that vehicle 0 can hear: what all said, itself among them, in two lives each; and frames that say
/// nothing, under counters near and far.
fn frames(fleet: &Fleet) -> Vec<Vec<u8>> {
    let mut frames = fleet.packets(3);
    for number in 0..fleet.events.len() {
        let other_life = fleet.events[number].iter().rev().take(4).cloned();
        frames.extend(sent(&mut vehicle(&fleet.team, number, other_life), 2));
    }
    let writer = fleet.vehicle(0);
    let layout = fleet.team.layout(32).unwrap();
    for sender in 0..2 {
        for counter in [7, 40, 900, 1900, 4000, 4900, 20_000, 65_535] {
            let message = MapMessage { sender, counter, model: 0, blocks: vec![Block::silent(layout)] };
            frames.push(writer.write(layout, &message).unwrap());
        }
    }
    frames
}

/// What happens to vehicle 0.
#[derive(Debug, Clone)]
enum Happening {
    Observes,
    Hears(Index),
    Sends,
    Refits,
    IsAsked,
    /// It stops, and starts again from its last snapshot and a journal of everything.
    Restarts,
}

fn happenings() -> impl Strategy<Value = Vec<Happening>> {
    let happening = prop_oneof![
        3 => Just(Happening::Observes),
        4 => any::<Index>().prop_map(Happening::Hears),
        2 => Just(Happening::Sends),
        1 => Just(Happening::Refits),
        2 => Just(Happening::IsAsked),
        1 => Just(Happening::Restarts),
    ];
    vec(happening, 1..40)
}

/// Lives through it, and writes down every entry.
fn live(fleet: &Fleet, window: u16, happenings: &[Happening]) -> (Agent, Vec<Entry>) {
    let team = Arc::new(Team { packets_per_sender_max: window, repeats_max: 1, ..(*fleet.team).clone() });
    let frames = frames(&Fleet { team: team.clone(), events: fleet.events.clone() });
    let mut agent = vehicle(&team, 0, []);
    let (mut journal, mut snapshot) = (Vec::new(), agent.snapshot());
    let mut events = fleet.events[0].iter();
    for happening in happenings {
        let (number, sent_number) = agent.numbers_next();
        match happening {
            Happening::Observes => {
                let Some(event) = events.next() else { continue };
                journal.push(Entry::Observed { number, event: event.clone() });
                agent.observe(event.clone()).unwrap();
            }
            Happening::Hears(frame) => {
                let bytes = frame.get(&frames).clone();
                agent.receive(&bytes, 0.0);
                journal.push(Entry::Heard { bytes });
            }
            Happening::Sends => match agent.next_packet(0.0, 32) {
                Ok(Some(bytes)) => journal.push(Entry::Sent {
                    number: sent_number,
                    slot: agent.team().slots.next_turn(0.0, agent.id()),
                    bytes,
                }),
                Ok(None) | Err(AgentError::CountersUsedUp { .. }) => {}
                Err(error) => panic!("{error}"),
            },
            Happening::Refits => agent.refit().unwrap(),
            Happening::IsAsked => drop(agent.probabilities(somewhere()).unwrap()),
            Happening::Restarts => {
                let before = agent.snapshot();
                agent = Agent::restore(agent.id().clone(), team.clone(), &snapshot).unwrap();
                journal.iter().for_each(|entry| drop(agent.apply(entry.clone()).unwrap()));
                assert_eq!(agent.snapshot(), before);
                snapshot = before;
            }
        }
    }
    (agent, journal)
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn equal_sets_of_entries_are_equal_memories_and_beliefs(
        fleet in fleets(), window in prop::sample::select(vec![1u16, 3, 64]), happenings in happenings(),
        again in vec(any::<Index>(), 0..40), cut in any::<Index>(), shuffle in any::<u64>(),
    ) {
        let (mut agent, journal) = live(&fleet, window, &happenings);
        // Every entry once, in another order, and some of them twice, with a restart in between.
        let mut order: Vec<usize> = (0..journal.len()).collect();
        order.sort_by_key(|&place| (place as u64 + 1).wrapping_mul(shuffle | 1).rotate_left(17));
        order.extend(again.iter().filter(|_| !journal.is_empty()).map(|place| place.index(journal.len())));
        let team = Arc::new(agent.team().clone());
        let mut other = Agent::new(agent.id().clone(), team.clone());
        let cut = cut.index(order.len() + 1);
        for (step, &place) in order.iter().enumerate() {
            if step == cut {
                other = Agent::restore(agent.id().clone(), team.clone(), &other.snapshot()).unwrap();
            }
            other.apply(journal[place].clone()).unwrap();
        }
        prop_assert!(other.snapshot() == agent.snapshot(), "{:?}\n{:?}", agent.links_of_packets(), other.links_of_packets());
        prop_assert_eq!(other.numbers_next(), agent.numbers_next());
        // What was absorbed under way is what is put together of the same fit, and both vehicles believe the same.
        agent.refit().unwrap();
        let absorbed = agent.probabilities(somewhere()).unwrap();
        let rebuilt = [&mut agent, &mut other].map(|agent| {
            agent.rebuild_posteriors().unwrap();
            agent.probabilities(somewhere()).unwrap()
        });
        // A fit stops at 1e-6.
        prop_assert!(largest_difference(&absorbed, &rebuilt[0]) < 1e-5);
        prop_assert_eq!(bits(&rebuilt[0]), bits(&rebuilt[1]));
        let next = [&mut agent, &mut other].map(|agent| agent.next_packet(99.0, 32));
        prop_assert_eq!(&next[0], &next[1]);
    }

    #[test]
    fn a_full_memory_keeps_the_events_recorded_last_whatever_their_times_and_order(
        times in vec(-1e9..1e9f64, 60), clock_falls_back in any::<bool>(), order in Just((0..60).collect::<Vec<usize>>()).prop_shuffle(),
    ) {
        let mut team = team(2, model());
        team.limits.events_max = 32;
        let team = Arc::new(team);
        let time_s = |n: usize| if clock_falls_back { 1.7e9 * f64::from(u8::from(n < 30)) + n as f64 } else { times[n] };
        let all: Vec<Event> = walk(0, 60, 0.0).into_iter().enumerate().map(|(n, event)| Event { time_s: time_s(n), ..event }).collect();
        let mut agent = vehicle(&team, 0, []);
        for &number in &order {
            agent.apply(Entry::Observed { number: number as u64, event: all[number].clone() }).unwrap();
            if number % 7 == 0 {
                agent.probabilities(somewhere()).unwrap();
            }
        }
        let mut in_turn = vehicle(&team, 0, all.iter().cloned());
        prop_assert_eq!(agent.snapshot(), in_turn.snapshot());
        let mut expected = all[28..].to_vec();
        expected.sort_by(Event::canonical_order);
        prop_assert_eq!(events(&agent), expected);
        let p = [&mut agent, &mut in_turn].map(|agent| {
            agent.rebuild_posteriors().unwrap();
            bits(&agent.probabilities(somewhere()).unwrap())
        });
        prop_assert_eq!(&p[0], &p[1]);
    }
}

#[test]
fn equal_events_are_two_and_one_that_comes_twice_is_one() {
    let team = Arc::new(team(2, model()));
    let event = walk(0, 1, 0.0).remove(0);
    let mut agent = vehicle(&team, 0, [event.clone(), event.clone()]);
    assert_eq!(agent.events().len(), 2);
    for number in [0, 1, 1, 0] {
        agent.apply(Entry::Observed { number, event: event.clone() }).unwrap();
    }
    assert_eq!((agent.events().len(), agent.numbers_next().0), (2, 2));
    // No vehicle has two events under one number; of two such the same one stays whichever comes first.
    let other = Event { time_s: -5.0, ..event.clone() };
    let both = [[&event, &other], [&other, &event]].map(|[first, second]| {
        let mut agent = vehicle(&team, 0, []);
        for event in [first, second] {
            agent.apply(Entry::Observed { number: 3, event: event.clone() }).unwrap();
            agent.probabilities(somewhere()).unwrap();
        }
        (events(&agent), agent.snapshot())
    });
    assert_eq!(both[0], both[1]);
    assert_eq!(both[0].0, [other]);
}

#[test]
fn kinds_of_messages_are_kept() {
    let team = Arc::new(team(2, model()));
    let kind = |n: usize| (!n.is_multiple_of(3)).then(|| MessageKind::new(format!("kind {}", n % 3)));
    let of_kinds = walk(0, 9, 0.0).into_iter().enumerate().map(|(n, event)| Event { kind: kind(n), ..event });
    let agent = vehicle(&team, 0, of_kinds);
    let again = restored(&agent, &agent.snapshot());
    assert_eq!(events(&again), events(&agent));
    assert_eq!(events(&again).iter().filter(|event| event.kind.is_some()).count(), 6);
}

#[test]
fn what_is_no_event_of_this_vehicle_is_not_recorded() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 3, 0.0));
    let before = agent.snapshot();
    let theirs = walk(1, 1, 0.0).remove(0);
    assert!(matches!(agent.observe(theirs.clone()), Err(AgentError::NotMine { .. })));
    assert!(matches!(
        agent.apply(Entry::Observed { number: 9, event: theirs.clone() }),
        Err(AgentError::NotMine { .. })
    ));
    let mut far = walk(0, 1, 0.0).remove(0);
    far.link.receiver.north_m = 1.1e9;
    assert_eq!(agent.observe(far.clone()), Err(AgentError::Nowhere { value_m: 1.1e9 }));
    far.link.receiver.north_m = 0.0;
    let number = 1 << 48;
    assert_eq!(agent.apply(Entry::Observed { number, event: far }), Err(AgentError::NumberTooLarge { number }));
    assert_eq!(agent.snapshot(), before);
    let mut shore = agent.owning_all_events();
    shore.observe(theirs).unwrap();
    assert_eq!(shore.events().len(), 4);
}

/// A frame that says nothing.
fn silent(team: &Arc<Team>, sender: u8, counter: u16) -> Vec<u8> {
    let layout = team.layout(32).unwrap();
    let message = MapMessage { sender, counter, model: 0, blocks: vec![Block::silent(layout)] };
    vehicle(team, 0, []).write(layout, &message).unwrap()
}

#[test]
fn a_counter_far_ahead_waits_for_another_one() {
    let team = Arc::new(team(3, model()));
    let mut agent = vehicle(&team, 0, []);
    let mut hear = |counter| agent.receive(&silent(&team, 1, counter), 0.0);
    let waits = |counter, latest| Receipt::Refused(Refusal::Unconfirmed { counter, latest });
    assert_eq!(hear(65_535), waits(65_535, None));
    assert_eq!(hear(COUNTER_LEAP_MAX), waits(COUNTER_LEAP_MAX, None));
    assert_eq!(hear(5), Receipt::Accepted);
    // The one that waited is near enough now, and so is what follows it.
    assert_eq!(hear(COUNTER_LEAP_MAX), Receipt::Refused(Refusal::Duplicate));
    assert_eq!(hear(COUNTER_LEAP_MAX + 1), Receipt::Accepted);
    assert_eq!(hear(5), Receipt::Refused(Refusal::TooOld));
    // Two that confirm each other are believed.
    assert_eq!(hear(40_000), waits(40_000, Some(COUNTER_LEAP_MAX + 1)));
    assert_eq!(hear(40_001), Receipt::Accepted);
    assert_eq!(hear(COUNTER_LEAP_MAX + 2), Receipt::Refused(Refusal::TooOld));
    assert_eq!((agent.counts().unconfirmed, agent.live_packets()), (3, 2));
    // One's own number is no exception: a stray packet uses up no counters.
    let mut sender = vehicle(&team, 0, walk(0, 40, 0.0));
    assert_eq!(sender.receive(&silent(&team, 0, 65_535), 0.0), waits(65_535, None));
    let bytes = sender.next_packet(0.0, 32).unwrap().unwrap();
    assert_eq!(sender.read(&bytes).unwrap().1.counter, 0);
}

#[test]
fn two_vehicles_under_one_number_are_noticed_by_whoever_hears_both() {
    let team = Arc::new(team(3, model()));
    let [mut first, mut second] = [0.0, 0.7].map(|phase| vehicle(&team, 1, walk(1, 40, phase)));
    let packets = [&mut first, &mut second].map(|agent| sent(agent, 2));
    let mut listener = vehicle(&team, 0, []);
    assert_eq!(listener.receive(&packets[0][0], 0.0), Receipt::Accepted);
    let before = listener.probabilities(somewhere()).unwrap();
    assert_eq!(listener.receive(&packets[1][0], 0.0), Receipt::Refused(Refusal::Conflict { counter: 0 }));
    assert_ne!(listener.probabilities(somewhere()).unwrap(), before, "neither is believed");
    assert_eq!(listener.receive(&packets[0][0], 0.0), Receipt::Refused(Refusal::Duplicate));
    let name = &names(2)[1];
    assert_eq!((listener.conflicts(name), listener.counts().conflict, listener.live_packets()), (1, 1, 0));
    // Each of the two notices the other, and gets out of its way.
    assert_eq!(first.receive(&packets[1][1], 0.0), Receipt::Refused(Refusal::Conflict { counter: 1 }));
    assert_eq!(first.conflicts(name), 1);
    first.observe_all(walk(1, 40, 1.4)).unwrap();
    first.refit().unwrap();
    let bytes = first.next_packet(0.0, 32).unwrap().unwrap();
    assert_eq!(first.read(&bytes).unwrap().1.counter, 1 + team.packets_per_sender_max);
    assert_eq!(listener.receive(&bytes, 0.0), Receipt::Accepted);
    assert_eq!(listener.conflicts(name), 0);
}

#[test]
fn muting_chooses_from_what_is_there() {
    let team = Arc::new(team(3, model()));
    let packets = [1, 2].map(|n| sent(&mut vehicle(&team, n, walk(n, 40, n as f64)), 3));
    let listener = || vehicle(&team, 0, walk(0, 20, 0.3));
    let hear =
        |agent: &mut Agent, sender: usize| packets[sender].iter().for_each(|bytes| drop(agent.receive(bytes, 0.0)));
    let told = |agent: &mut Agent| agent.probabilities(somewhere()).unwrap();
    let [one, two] = [&names(3)[1], &names(3)[2]];
    let (mut only_two, mut both) = (listener(), listener());
    hear(&mut only_two, 1);
    (0..2).for_each(|sender| hear(&mut both, sender));
    let (without, with) = (told(&mut only_two), told(&mut both));
    assert!(largest_difference(&without, &with) > 1e-3);

    let mut agent = listener();
    agent.mute(one);
    hear(&mut agent, 0);
    hear(&mut agent, 1);
    assert!(largest_difference(&told(&mut agent), &without) < 1e-9);
    assert_eq!(agent.snapshot(), both.snapshot());
    agent.unmute(one);
    assert!(largest_difference(&told(&mut agent), &with) < 1e-9);
    agent.mute(two);
    agent.mute(one);
    agent.unmute(two);
    assert!(largest_difference(&told(&mut agent), &without) < 1e-9);
    assert_eq!(agent.live_packets(), packets[1].len());
}
