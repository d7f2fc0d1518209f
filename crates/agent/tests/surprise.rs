//! Whom a vehicle believes: members that contradict everybody are left out, and come back.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::trip::{LEG, SLOT_S, Trip};
use common::*;
use pingmap_agent::*;
use pingmap_packet::{Cell, Point};
use proptest::prelude::*;

fn hear(agent: &mut Agent, packets: &[Vec<u8>]) {
    packets.iter().for_each(|bytes| drop(agent.receive(bytes, 0.0)));
}

/// A vehicle that knows the region, and two others that saw it, too.
fn honest() -> (Agent, [Vec<Vec<u8>>; 2]) {
    let team = Arc::new(team(3, model()));
    let packets = [1, 2].map(|n| sent(&mut vehicle(&team, n, walk(n, 240, n as f64)), 6));
    (vehicle(&team, 0, walk(0, 240, 0.4)), packets)
}

/// What a vehicle says that hears the opposite of what it hears.
fn contrary(team: &Arc<Team>, number: usize) -> Vec<Vec<u8>> {
    let events = walk(number, 240, number as f64).into_iter().map(|event| Event { success: !event.success, ..event });
    sent(&mut vehicle(team, number, events), 6)
}

#[test]
fn a_member_that_contradicts_everybody_is_left_out_whatever_came_first() {
    let (agent, [one, _]) = honest();
    let lies = contrary(&Arc::new(agent.team().clone()), 2);
    let name = &names(3)[2];
    let orders = [[&one, &lies], [&lies, &one]].map(|order| {
        let mut agent = agent.clone();
        for packets in order {
            for bytes in packets {
                agent.receive(bytes, 0.0);
                agent.probabilities(somewhere()).unwrap();
            }
        }
        assert_eq!(agent.left_out(), [name]);
        assert!(agent.surprise(name).unwrap().unwrap() > agent.team().surprise_max);
        assert!(agent.surprise(&names(2)[1]).unwrap().unwrap() < 3.0);
        agent.probabilities(somewhere()).unwrap()
    });
    assert!(largest_difference(&orders[0], &orders[1]) < 1e-9);
    // It is as if it had said nothing, and as if it were muted.
    let mut without = agent.clone();
    hear(&mut without, &one);
    assert!(largest_difference(&without.probabilities(somewhere()).unwrap(), &orders[0]) < 1e-9);
    let mut muted = agent.clone();
    muted.mute(name);
    hear(&mut muted, &lies);
    hear(&mut muted, &one);
    assert_eq!((muted.left_out().len(), muted.surprise(name).unwrap()), (0, None));
    assert!(largest_difference(&muted.probabilities(somewhere()).unwrap(), &orders[0]) < 1e-9);
    // Whoever trusts everybody is misled.
    let trusting = Arc::new(Team { surprise_max: 1e9, ..agent.team().clone() });
    let mut trusting = vehicle(&trusting, 0, walk(0, 240, 0.4));
    hear(&mut trusting, &lies);
    hear(&mut trusting, &one);
    assert!(trusting.left_out().is_empty());
    assert!(largest_difference(&trusting.probabilities(somewhere()).unwrap(), &orders[0]) > 0.1);
}

#[test]
fn one_lie_among_honest_packets_is_enough() {
    let (mut agent, [one, two]) = honest();
    let liar = vehicle(&Arc::new(agent.team().clone()), 1, []);
    let (layout, mut message) = liar.read(&one[0]).unwrap();
    let turn = |point: &mut Point| (point.information, point.mean) = (31, if point.mean > 0 { -15 } else { 15 });
    message.blocks[0].points.iter_mut().filter(|point| point.information > 0).for_each(turn);
    let lie = liar.write(layout, &message).unwrap();
    hear(&mut agent, &two);
    hear(&mut agent, &[&[lie], &one[1..]].concat());
    agent.probabilities(somewhere()).unwrap();
    assert_eq!(agent.left_out(), [&names(2)[1]]);
    assert!(agent.surprise(&names(2)[1]).unwrap().unwrap() > 20.0);
}

#[test]
fn a_member_comes_back_when_it_agrees_again() {
    let (agent, [one, _]) = honest();
    let mut team = agent.team().clone();
    team.packets_per_sender_max = 6;
    let team = Arc::new(team);
    let name = &names(3)[2];
    let mut agent = vehicle(&team, 0, walk(0, 240, 0.4));
    let lies = contrary(&team, 2);
    hear(&mut agent, &lies);
    agent.probabilities(somewhere()).unwrap();
    assert_eq!(agent.left_out(), [name]);
    // Mended, it says the truth until its lies have fallen out of the window.
    let mended = after_counter(vehicle(&team, 2, walk(2, 240, 2.0)), 20);
    let truth = sent(&mut mended.clone(), 6);
    hear(&mut agent, &truth);
    agent.probabilities(somewhere()).unwrap();
    assert!(agent.left_out().is_empty(), "{:?}", agent.surprise(name));
    assert!(one.len() > 3 && truth.len() > 3);
}

#[test]
fn a_prior_is_no_knowledge_and_nobody_who_contradicts_it_is_left_out() {
    let team = Arc::new(team(2, model()));
    let certain = walk(0, 60, 0.0).into_iter().map(|event| Event { success: false, ..event });
    let packets = sent(&mut vehicle(&team, 0, certain), 8);
    let mut nobody = vehicle(&team, 1, []);
    hear(&mut nobody, &packets);
    nobody.probabilities(somewhere()).unwrap();
    assert!(nobody.left_out().is_empty());
    assert_eq!(nobody.surprise(&names(1)[0]).unwrap(), Some(0.0));
    assert_eq!(nobody.surprise(&names(2)[1]).unwrap(), None);
    assert_eq!(nobody.surprise(&VehicleId::new("eve")).unwrap(), None);
}

/// Three vehicles that go to and fro for 40 legs, and hear what is sent nearby.
fn mission() -> Trip {
    let team = Team { track_off_max_m: 1e-6, ..team(3, model()) };
    let corner = |vehicle: u32, leg: u32| {
        let along = |step: u32| 16 + ((leg * step + 37 * vehicle) % 16 * 14) as u8;
        Cell { east: along(5 + vehicle), north: along(3 + 2 * vehicle), depth: 0 }
    };
    let turns = (0..3).map(|vehicle| (0..=40).map(|leg| corner(vehicle, leg)).collect()).collect();
    let mut trip = Trip { team: Arc::new(team), slots: 40 * LEG, turns, outcomes: Vec::new() };
    let nearby = |slot: u32, receiver: usize| {
        let link = Link { transmitter: trip.at(slot as usize % 3, slot), receiver: trip.at(receiver, slot) };
        Some(link.range_m() < 450.0)
    };
    trip.outcomes = (0..trip.slots).map(|slot| (0..3).map(|receiver| nearby(slot, receiver)).collect()).collect();
    trip
}

/// What becomes of what should be heard, or missed.
type Ear = fn(bool) -> bool;

/// What a vehicle reports that hears something else, from some slot on.
fn reports(trip: &Trip, number: usize, hears: Ear, from: u32) -> Vec<Vec<u8>> {
    let faulty = |event: Event| match event.time_s < SLOT_S * f64::from(from) {
        true => event,
        false => Event { success: hears(event.success), ..event },
    };
    let telling = Telling { points: false, reports: true };
    let events = trip.events(number).into_iter().map(faulty);
    let mut agent = vehicle(&trip.team, number, events).telling(telling);
    agent.navigate((0..=trip.slots).map(|slot| (SLOT_S * f64::from(slot), trip.at(number, slot)))).unwrap();
    sent(&mut agent, 100)
}

#[test]
fn who_reports_what_contradicts_everybody_is_left_out_and_nothing_of_it_stays() {
    let trip = mission();
    let [one, two] = [1, 2].map(|number| reports(&trip, number, |heard| heard, 0));
    let [name, honest] = [2, 1].map(|number| names(3).remove(number));
    let heard = |reports: &[&[Vec<u8>]]| {
        let mut agent = trip.vehicle(0);
        reports.iter().for_each(|reports| hear(&mut agent, reports));
        agent.rebuild_posteriors().unwrap();
        let probabilities = agent.probabilities(somewhere()).unwrap();
        (agent, probabilities)
    };
    let (mut agent, _) = heard(&[&one, &two]);
    assert!(agent.left_out().is_empty());
    assert!(agent.surprise(&name).unwrap().unwrap() < 3.0 && agent.surprise(&honest).unwrap().unwrap() < 3.0);
    let faults: [(Ear, u32); 4] =
        [(|_| false, 0), (|_| true, 0), (|heard| !heard, 0), (|heard| !heard, trip.slots / 4 * 3)];
    for (number, (hears, from)) in faults.into_iter().enumerate() {
        let lies = reports(&trip, 2, hears, from);
        let (mut agent, probabilities) = heard(&[&one, &lies]);
        assert_eq!(agent.left_out(), [&name], "fault {number}");
        assert!(agent.surprise(&name).unwrap().unwrap() > agent.team().surprise_max);
        assert!(agent.surprise(&honest).unwrap().unwrap() < 3.0, "fault {number}");
        let (_, turned) = heard(&[&lies, &one]);
        assert_eq!(bits(&probabilities), bits(&turned), "fault {number}");
        // Where it was is not doubted. Otherwise it is as if it were muted, and had never been fitted.
        let mut muted = trip.vehicle(0);
        muted.mute(&name);
        hear(&mut muted, &lies);
        hear(&mut muted, &one);
        muted.rebuild_posteriors().unwrap();
        assert_eq!(bits(&muted.probabilities(somewhere()).unwrap()), bits(&probabilities), "fault {number}");
        // Nor does it matter that it was believed before.
        let mut agent = trip.vehicle(0);
        for report in lies.iter().chain(&one) {
            agent.receive(report, 0.0);
            agent.refit().unwrap();
        }
        assert_eq!(agent.left_out(), [&name], "fault {number}");
        assert!(largest_difference(&agent.probabilities(somewhere()).unwrap(), &probabilities) < 1e-3);
        assert!(!agent.refit_due());
    }
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn surprise_and_who_is_left_out_depend_on_the_set_alone(
        fleet in fleets(), lies in any::<bool>(), shuffle in any::<u64>(), asked in any::<u64>(),
    ) {
        let mut packets = fleet.packets(3);
        if lies {
            packets.extend(contrary(&fleet.team, 1));
        }
        let mut order: Vec<usize> = (0..packets.len()).collect();
        let straight = order.clone();
        // Who lies comes last, first, and in between.
        let reversed: Vec<usize> = order.iter().rev().copied().collect();
        order.sort_by_key(|&place| (place as u64 + 1).wrapping_mul(shuffle | 1).rotate_left(17));
        let surprises = [straight, reversed, order].map(|order| {
            let mut agent = fleet.vehicle(0);
            for (step, place) in order.into_iter().enumerate() {
                agent.receive(&packets[place], 0.0);
                if asked >> (step % 64) & 1 == 1 {
                    agent.probabilities(somewhere()).unwrap();
                }
            }
            agent.rebuild_posteriors().unwrap();
            let left_out: Vec<VehicleId> = agent.left_out().into_iter().cloned().collect();
            let surprise: Vec<_> = names(4).iter().map(|name| agent.surprise(name).unwrap()).collect();
            (left_out, surprise, agent.snapshot())
        });
        prop_assert_eq!(&surprises[0], &surprises[1]);
        prop_assert_eq!(&surprises[0], &surprises[2]);
    }
}
