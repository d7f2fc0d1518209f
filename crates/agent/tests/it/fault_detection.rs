//! Fault detection: members whose data contradict those of all others are excluded, and come back.

use std::sync::Arc;

use crate::common::trip::{LEG, Trip, slot_s};
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::{Cell, Outcome, Point};
use proptest::prelude::*;

fn discrepancy(agent: &mut Agent, number: usize) -> f64 {
    agent.discrepancy(&name(number)).unwrap().unwrap()
}

/// A vehicle that knows the region, and packets of two others that know it, too.
fn correct_members() -> (Agent, [Vec<Vec<u8>>; 2]) {
    let team = Arc::new(team(3, model()));
    let packets = [1, 2].map(|n| frames(&mut vehicle(&team, n, walk(n, 240, n as f64)), 6));
    (vehicle(&team, 0, walk(0, 240, 0.4)), packets)
}

/// Packets of a vehicle whose outcomes are all inverted.
fn inverted(team: &Arc<Team>, number: usize) -> Vec<Vec<u8>> {
    let events = walk(number, 240, number as f64).into_iter().map(|event| Event { success: !event.success, ..event });
    frames(&mut vehicle(team, number, events), 6)
}

#[test]
fn a_member_that_contradicts_all_others_is_excluded_in_any_order_of_arrival() {
    let (agent, [correct, _]) = correct_members();
    let faulty = inverted(&Arc::new(agent.team().clone()), 2);
    let orders = [[&correct, &faulty], [&faulty, &correct]].map(|order| {
        let mut agent = agent.clone();
        for bytes in order.into_iter().flatten() {
            agent.receive(bytes, None);
            test_probabilities(&mut agent);
        }
        assert_eq!(excluded(&agent), [name(2)]);
        assert!(discrepancy(&mut agent, 2) > agent.team().exclusion_threshold_sd);
        assert!(discrepancy(&mut agent, 1) < 3.0);
        test_probabilities(&mut agent)
    });
    assert!(largest_difference(&orders[0], &orders[1]) < 1e-9);
    // The predictions are those without its packets, and those of a vehicle that mutes it.
    let mut without = agent.clone();
    receive_all(&mut without, &correct);
    assert!(largest_difference(&test_probabilities(&mut without), &orders[0]) < 1e-9);
    let mut muted = agent.clone();
    muted.set_muted(&name(2), true);
    receive_all(&mut muted, faulty.iter().chain(&correct));
    assert_eq!((excluded(&muted).len(), muted.discrepancy(&name(2)).unwrap()), (0, None));
    assert!(largest_difference(&test_probabilities(&mut muted), &orders[0]) < 1e-9);
    // Without fault detection its packets change the predictions.
    let trusting = Arc::new(Team { exclusion_threshold_sd: 1e9, ..agent.team().clone() });
    let mut trusting = vehicle(&trusting, 0, walk(0, 240, 0.4));
    receive_all(&mut trusting, faulty.iter().chain(&correct));
    assert!(excluded(&trusting).is_empty());
    assert!(largest_difference(&test_probabilities(&mut trusting), &orders[0]) > 0.1);
}

#[test]
fn one_wrong_packet_among_correct_ones_is_detected() {
    let (mut agent, [one, two]) = correct_members();
    let (layout, mut message) = agent.codec().read(&one[0]).unwrap();
    let invert = |point: &mut Point| (point.information, point.mean) = (31, if point.mean > 0 { -15 } else { 15 });
    message.blocks[0].points.iter_mut().filter(|point| point.information > 0).for_each(invert);
    let wrong = agent.codec().write(layout, &message).unwrap();
    receive_all(&mut agent, &two);
    receive_all(&mut agent, [&wrong].into_iter().chain(&one[1..]));
    test_probabilities(&mut agent);
    assert_eq!(excluded(&agent), [name(1)]);
    assert!(discrepancy(&mut agent, 1) > 20.0);
}

#[test]
fn a_member_comes_back_when_it_agrees_again() {
    let (agent, _) = correct_members();
    let team = Arc::new(Team { packets_per_sender_max: 6, ..agent.team().clone() });
    let mut agent = vehicle(&team, 0, walk(0, 240, 0.4));
    receive_all(&mut agent, &inverted(&team, 2));
    test_probabilities(&mut agent);
    assert_eq!(excluded(&agent), [name(2)]);
    // After its repair it sends correct packets until the wrong ones have left the window.
    let mut repaired = after_counter(vehicle(&team, 2, walk(2, 240, 2.0)), 20);
    let correct = frames(&mut repaired, 6);
    receive_all(&mut agent, &correct);
    test_probabilities(&mut agent);
    assert!(excluded(&agent).is_empty(), "{}", discrepancy(&mut agent, 2));
    assert!(correct.len() > 3);
}

#[test]
fn a_member_that_contradicts_the_prior_alone_is_not_excluded() {
    let team = Arc::new(team(2, model()));
    let certain = walk(0, 60, 0.0).into_iter().map(|event| Event { success: false, ..event });
    let packets = frames(&mut vehicle(&team, 0, certain), 8);
    let mut listener = vehicle(&team, 1, []);
    receive_all(&mut listener, &packets);
    test_probabilities(&mut listener);
    assert!(excluded(&listener).is_empty());
    assert_eq!(listener.discrepancy(&name(0)).unwrap(), Some(0.0));
    assert_eq!(listener.discrepancy(&name(1)).unwrap(), None, "the vehicle itself");
    assert_eq!(listener.discrepancy(&VehicleId::new("eve")).unwrap(), None, "not a member");
}

/// Three vehicles that move to and fro on 40 legs, and hear transmitters within 450 m.
fn mission() -> Trip {
    let corner = |vehicle: u32, leg: u32| {
        let along = |step: u32| 16 + ((leg * step + 37 * vehicle) % 16 * 14) as u8;
        Cell { east: along(5 + vehicle), north: along(3 + 2 * vehicle), depth: 0 }
    };
    let mut trip = Trip::stationary(&[(0, 0); 3], 40 * LEG, |_, _| None);
    trip.corners = (0..3).map(|vehicle| (0..=40).map(|leg| corner(vehicle, leg)).collect()).collect();
    let nearby = |slot: u32, receiver: usize| {
        let link = Link { transmitter: trip.at(trip.sender(slot), slot), receiver: trip.at(receiver, slot) };
        Some(link.range_m() < 450.0)
    };
    trip.outcomes = (0..trip.slots).map(|slot| (0..3).map(|receiver| nearby(slot, receiver)).collect()).collect();
    trip
}

/// A function of outcomes: how a faulty receiver changes them.
type Fault = fn(bool) -> bool;

/// Reports of a vehicle with a fault from some slot on.
fn reports(trip: &Trip, number: usize, fault: Fault, from: u32) -> Vec<Vec<u8>> {
    let faulty = |event: Event| match event.time_s < slot_s(from) {
        true => event,
        false => Event { success: fault(event.success), ..event },
    };
    frames(&mut trip.vehicle_with_events(number, trip.events(number).into_iter().map(faulty)), 100)
}

/// A report without its outcomes of other members.
fn without_outcomes(agent: &Agent, bytes: &[u8]) -> Vec<u8> {
    let (_, mut report, _) = agent.codec().read_report(bytes).unwrap();
    report.outcomes.fill(Outcome::Unreported);
    agent.codec().write_report(&report).unwrap()
}

#[test]
fn a_member_whose_reports_contradict_all_others_is_excluded_without_a_trace() {
    let trip = mission();
    let [one, two] = [1, 2].map(|number| reports(&trip, number, |heard| heard, 0));
    let receive = |reports: &[&[Vec<u8>]]| {
        let mut agent = trip.vehicle(0);
        receive_all(&mut agent, reports.iter().copied().flatten());
        let probabilities = rebuilt_probabilities(&mut agent);
        (agent, probabilities)
    };
    let (mut agent, _) = receive(&[&one, &two]);
    assert!(excluded(&agent).is_empty());
    assert!(discrepancy(&mut agent, 2) < 3.0 && discrepancy(&mut agent, 1) < 3.0);
    let faults: [(Fault, u32); 4] =
        [(|_| false, 0), (|_| true, 0), (|heard| !heard, 0), (|heard| !heard, trip.slots / 4 * 3)];
    for (number, (fault, from)) in faults.into_iter().enumerate() {
        let faulty = reports(&trip, 2, fault, from);
        let (mut agent, probabilities) = receive(&[&one, &faulty]);
        assert_eq!(excluded(&agent), [name(2)], "fault {number}");
        assert!(discrepancy(&mut agent, 2) > agent.team().exclusion_threshold_sd);
        assert!(discrepancy(&mut agent, 1) < 3.0, "fault {number}");
        let (_, reversed) = receive(&[&faulty, &one]);
        assert_eq!(bits(&probabilities), bits(&reversed), "fault {number}");
        // Its track still locates events. Its outcomes have no effect.
        let tracks: Vec<Vec<u8>> = faulty.iter().map(|report| without_outcomes(&agent, report)).collect();
        let (_, without) = receive(&[&one, &tracks]);
        assert_eq!(bits(&without), bits(&probabilities), "fault {number}");
        // Earlier fits that included its outcomes leave no trace.
        let mut agent = trip.vehicle(0);
        for report in faulty.iter().chain(&one) {
            agent.receive(report, None);
            agent.refit().unwrap();
        }
        assert_eq!(excluded(&agent), [name(2)], "fault {number}");
        assert!(largest_difference(&test_probabilities(&mut agent), &probabilities) < 1e-3);
        assert!(!agent.refit_due());
    }
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn discrepancies_and_exclusions_do_not_depend_on_the_order_of_arrival(
        fleet in fleets(), has_fault in any::<bool>(), shuffle in any::<u64>(), asked in any::<u64>(),
    ) {
        let mut packets = fleet.packets(3);
        if has_fault {
            packets.extend(inverted(&fleet.team, 1));
        }
        let mut order: Vec<usize> = (0..packets.len()).collect();
        let straight = order.clone();
        // Packets of the faulty member come last, first, and in between.
        let reversed: Vec<usize> = order.iter().rev().copied().collect();
        order.sort_by_key(|&place| (place as u64 + 1).wrapping_mul(shuffle | 1).rotate_left(17));
        let results = [straight, reversed, order].map(|order| {
            let mut agent = fleet.vehicle(0);
            for (step, place) in order.into_iter().enumerate() {
                agent.receive(&packets[place], None);
                if asked >> (step % 64) & 1 == 1 {
                    test_probabilities(&mut agent);
                }
            }
            agent.rebuild().unwrap();
            let discrepancies: Vec<_> = names(4).iter().map(|name| agent.discrepancy(name).unwrap()).collect();
            (excluded(&agent), discrepancies, agent.snapshot())
        });
        prop_assert_eq!(&results[0], &results[1]);
        prop_assert_eq!(&results[0], &results[2]);
    }
}
