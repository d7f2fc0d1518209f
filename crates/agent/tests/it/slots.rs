//! Schedules: slots are numbered by time, and belong to members in a cycle or by an explicit list.

use crate::common::*;
use pingmap_agent::*;

fn order(order: &[usize]) -> Vec<VehicleId> {
    order.iter().map(|&number| name(number)).collect()
}

fn sender_at(slots: &Slots, time_s: f64) -> Option<&VehicleId> {
    slots.sender(slots.number(time_s)?)
}

#[test]
fn a_cycle_repeats_after_its_start() {
    let slots = Slots::cycle(2.5, names(3));
    for (time_s, sender) in [(0.0, 0), (2.4, 0), (2.5, 1), (7.4, 2), (7.5, 0), (7.5e4, 0)] {
        assert_eq!(sender_at(&slots, time_s), Some(&name(sender)), "{time_s}");
    }
    let later = Slots { start_s: 1.0, ..slots.clone() };
    assert_eq!((sender_at(&later, 0.9), sender_at(&later, 1.0)), (None, Some(&name(0))));
    for time_s in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(slots.number(time_s), None);
    }
    assert_eq!(Slots::cycle(1.0, Vec::new()).sender(3), None);
}

#[test]
fn an_empty_name_continues_the_slot_before_it() {
    let order = vec![name(2), VehicleId::new(""), name(0)];
    let slots = Slots { start_s: 100.0, ..Slots::cycle(5.0, order) };
    let senders: Vec<Option<VehicleId>> = (0..6).map(|slot| slots.sender(slot).cloned()).collect();
    assert_eq!(senders, [Some(name(2)), None, Some(name(0)), Some(name(2)), None, Some(name(0))]);
    assert_eq!((slots.number(99.9), slots.number(100.0), slots.number(139.0)), (None, Some(0), Some(7)));
    // A transmission over two slots belongs to the first.
    let sent_in = [(101.0, 2), (107.0, 2), (107.0, 0)].map(|(time_s, number)| slots.sent_in(time_s, &name(number)));
    assert_eq!(sent_in, [Some(0), Some(0), None]);
    assert!(slots.is_heard_by(0, &name(0)) && !slots.is_heard_by(0, &name(2)) && !slots.is_heard_by(1, &name(0)));
    assert_eq!(slots.begin_s(7), Some(135.0));
}

#[test]
fn the_next_slot_of_a_member_is_its_current_slot_or_the_one_after() {
    let slots = Slots { start_s: 100.0, ..Slots::cycle(5.0, order(&[0, 1, 2])) };
    let next = [(101.0, 0), (106.0, 0), (106.0, 1), (111.0, 1)];
    let next = next.map(|(time_s, number)| slots.next_slot(time_s, &name(number)));
    assert_eq!(next, [Some(0), Some(3), Some(1), Some(4)]);
    let none = [(99.0, name(0)), (f64::INFINITY, name(0)), (101.0, VehicleId::new("a ship"))];
    assert_eq!(none.map(|(time_s, id)| slots.next_slot(time_s, &id)), [None; 3]);
}

#[test]
fn an_aligned_cycle_starts_at_most_one_cycle_before_the_time() {
    let slots = Slots { start_s: 100.0, ..Slots::cycle(5.0, order(&[0, 1, 2])) };
    for time_s in [1000.0, 100.0, 99.0, -1e6] {
        let aligned = slots.clone().aligned_before(time_s);
        assert!((time_s - 15.0..=time_s).contains(&aligned.start_s), "{time_s} {}", aligned.start_s);
        assert_eq!(sender_at(&aligned, aligned.start_s), Some(&name(0)));
        let expected = ((time_s - 100.0) / 5.0).floor().rem_euclid(3.0);
        assert_eq!(sender_at(&aligned, time_s), Some(&name(expected as usize)));
    }
    assert_eq!(slots.clone().aligned_before(f64::NAN), slots);
}

#[test]
fn explicit_slots_are_numbered_by_their_place_in_the_list() {
    let scheduled =
        |(time_s, number): (f64, usize)| ScheduledTransmission { time_s, sender: name(number), listeners: order(&[2]) };
    let explicit = [(1.0, 0), (4.0, 1), (6.0, 1), (6.0, 2), (9.0, 0)].map(scheduled);
    let slots = Slots { explicit: Some(explicit.into()), ..Slots::cycle(1.0, Vec::new()) };
    assert_eq!(
        [0.9, 1.0, 3.9, 6.0, 99.0].map(|time_s| slots.number(time_s)),
        [None, Some(0), Some(0), Some(3), Some(4)]
    );
    assert_eq!((slots.begin_s(1), slots.begin_s(5), slots.end()), (Some(4.0), None, 5));
    // A slot lasts until the next one. Of two transmissions at one time each belongs to its sender.
    let next = [(0.0, 0), (2.0, 0), (2.0, 1), (5.0, 0), (6.0, 1), (6.0, 2), (9.5, 1), (f64::INFINITY, 0)];
    let next = next.map(|(time_s, number)| slots.next_slot(time_s, &name(number)));
    assert_eq!(next, [None, Some(0), Some(1), Some(4), Some(2), Some(3), None, None]);
    assert!(slots.is_heard_by(0, &name(2)) && !slots.is_heard_by(0, &name(1)) && !slots.is_heard_by(5, &name(2)));
}
