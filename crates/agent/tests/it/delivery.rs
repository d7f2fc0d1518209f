//! Delivery: a report that lists the slot of a frame as heard acknowledges the frame, and lost outcomes are sent again.

use std::ops::Range;
use std::sync::Arc;

use crate::common::trip::slot_s;
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::Outcome;

/// Slots of a part of a mission. The outcomes of one part fit into one frame, those of two parts do not.
const PART: u32 = 160;

/// Vehicles that do not move and transmit in the order of their numbers.
struct Mission {
    team: Arc<Team>,
}

impl Mission {
    fn new(members: usize) -> Self {
        Self { team: Arc::new(team(members, model())) }
    }

    fn with_one_transmission_per_slot() -> Self {
        Self { team: Arc::new(Team { transmissions_max: 1, ..team(2, model()) }) }
    }

    /// The position of a vehicle, in the centre of a cell.
    fn place(&self, number: usize) -> Position {
        let at = Position::new(200.0 * number as f64, 0.0);
        let cell = self.team.grid.waypoint_cell(&self.team.model.chart, &at).unwrap();
        self.team.grid.waypoint_position(&self.team.model.chart, cell, false)
    }

    /// A vehicle after these slots, with an outcome for each slot of the others.
    fn vehicle(&self, number: usize, slots: Range<u32>, is_heard: impl Fn(u32) -> bool) -> Agent {
        let mut agent = vehicle_with(&self.team, number, reports_alone(), []);
        self.record(&mut agent, number, slots, is_heard);
        agent
    }

    fn record(&self, agent: &mut Agent, number: usize, slots: Range<u32>, is_heard: impl Fn(u32) -> bool) {
        agent.record_positions(slots.clone().map(|slot| (slot_s(slot), self.place(number)))).unwrap();
        for slot in slots {
            let sender = slot as usize % self.team.members.len();
            if sender != number {
                let link = Link { transmitter: self.place(sender), receiver: self.place(number) };
                let event = event_at(number, slot_s(slot), link, is_heard(slot));
                agent.record([Event { transmitter_id: name(sender), ..event }]).unwrap();
            }
        }
    }

    /// The first and the last slot of the next report.
    fn next_report(&self, agent: &mut Agent, slot: u32) -> [u32; 2] {
        let frame = agent.next_frame(Some(slot_s(slot)), 32).unwrap().unwrap().bytes;
        let (_, report, _) = agent.codec().read_report(&frame).unwrap();
        let id = agent.id().clone();
        let slots = (report.first..).filter(|&slot| self.team.slots.is_heard_by(slot, &id));
        [report.first, slots.take(report.outcomes.len()).last().unwrap()]
    }
}

#[test]
fn a_frame_that_a_peer_reports_as_missed_is_sent_again() {
    for lost in [PART, 2 * PART] {
        let mission = Mission::new(2);
        let mut agent = mission.vehicle(0, 0..PART, |_| true);
        let first_report = mission.next_report(&mut agent, PART);
        assert!(first_report[0] <= 1 && first_report[1] == PART - 1, "{first_report:?}");
        mission.record(&mut agent, 0, PART..2 * PART, |_| true);
        // The second report also repeats a part of the first one.
        let second_report = mission.next_report(&mut agent, 2 * PART);
        assert!(second_report[0] > 1 && second_report[1] == 2 * PART - 1, "{second_report:?}");
        let mut peer = mission.vehicle(1, 0..2 * PART + 8, |slot| slot != lost);
        receive_all(&mut agent, &frames(&mut peer, 8));
        let mut again = restored(&agent, &agent.snapshot());
        // The third report holds what the acknowledged one does not.
        let third_report = mission.next_report(&mut agent, 2 * PART + 2);
        let is_in = |[first, last]: [u32; 2], slot: &u32| (first..=last).contains(slot);
        let [is_lost, is_delivered] =
            if lost == PART { [first_report, second_report] } else { [second_report, first_report] };
        let mut missing = (1..2 * PART).step_by(2).filter(|slot| is_in(is_lost, slot) && !is_in(is_delivered, slot));
        assert!(missing.all(|slot| is_in(third_report, &slot)), "{third_report:?} after {is_delivered:?}");
        assert_eq!(mission.next_report(&mut again, 2 * PART + 2), third_report);
    }
}

#[test]
fn an_acknowledged_report_is_not_sent_again_and_any_other_is() {
    for is_heard in [true, false] {
        let mission = Mission::new(2);
        let mut agent = mission.vehicle(0, 0..PART, |_| true);
        mission.next_report(&mut agent, PART);
        let mut peer = mission.vehicle(1, 0..PART + 8, |slot| is_heard || slot != PART);
        receive_all(&mut agent, &frames(&mut peer, 8));
        let next = agent.next_frame(Some(slot_s(PART + 4)), 32).unwrap().map(|frame| frame.bytes);
        assert_eq!(next.is_none(), is_heard);
    }
}

#[test]
fn without_acknowledgements_a_report_is_sent_up_to_the_maximum_number_of_times() {
    let mission = Mission::new(2);
    let mut agent = mission.vehicle(0, 0..PART, |_| true);
    let reports = frames(&mut agent, 100);
    assert_eq!(reports.len(), usize::from(mission.team.transmissions_max));
    assert!(reports.iter().all(|report| report == &reports[0]));
}

#[test]
fn the_switch_for_acknowledgements_makes_every_transmission_count_as_lost() {
    let mission = Mission::new(2);
    let mut agent = mission.vehicle(0, 0..PART, |_| true);
    let sharing = Sharing { acknowledgements: false, ..Sharing::reports() };
    agent.options.sharing = sharing;
    mission.next_report(&mut agent, PART);
    receive_all(&mut agent, &frames(&mut mission.vehicle(1, 0..PART + 8, |_| true), 8));
    assert!(agent.next_frame(Some(slot_s(PART + 4)), 32).unwrap().is_some());
}

#[test]
fn reports_of_a_muted_member_acknowledge_nothing() {
    let mission = Mission::new(2);
    let mut agent = mission.vehicle(0, 0..PART, |_| true);
    mission.next_report(&mut agent, PART);
    receive_all(&mut agent, &frames(&mut mission.vehicle(1, 0..PART + 8, |_| true), 8));
    let mut muting = agent.clone();
    muting.set_muted(&name(1), true);
    assert_eq!(agent.next_frame(Some(slot_s(PART + 2)), 32).unwrap(), None);
    assert!(muting.next_frame(Some(slot_s(PART + 2)), 32).unwrap().is_some());
}

#[test]
fn muting_the_only_acknowledging_member_makes_reports_worth_sending_again() {
    let mission = Mission::new(2);
    let mut agent = mission.vehicle(0, 0..PART, |_| true);
    mission.next_report(&mut agent, PART);
    receive_all(&mut agent, &frames(&mut mission.vehicle(1, 0..PART + 8, |_| true), 8));
    assert_eq!(agent.next_frame(Some(slot_s(PART + 2)), 32).unwrap(), None);
    agent.set_muted(&name(1), true);
    assert!(agent.next_frame(Some(slot_s(PART + 2)), 32).unwrap().is_some());
    agent.set_muted(&name(1), false);
    assert_eq!(agent.next_frame(Some(slot_s(PART + 4)), 32).unwrap(), None);
}

#[test]
fn a_sent_entry_with_a_slot_of_another_member_has_no_slot() {
    let mission = Mission::new(2);
    let frame = mission.vehicle(0, 0..PART, |_| true).next_frame(Some(slot_s(PART)), 32).unwrap().unwrap().bytes;
    let after = |slot: Option<u32>| {
        let mut agent = mission.vehicle(0, 0..PART, |_| true);
        agent.apply(Entry::Sent { number: 0, state: FrameState::Proposed, slot, bytes: frame.clone() }).unwrap();
        receive_all(&mut agent, &frames(&mut mission.vehicle(1, 0..PART + 8, |_| true), 8));
        agent.next_frame(Some(slot_s(PART)), 32).unwrap();
        agent.snapshot()
    };
    let without_slot = after(None);
    assert!([1, 1 << 18, u32::MAX - 1, u32::MAX].iter().all(|&slot| after(Some(slot)) == without_slot));
    assert_ne!(after(Some(PART)), without_slot);
    // Of two entries under one number the one with a slot counts, in either order.
    let twice = |slots: [Option<u32>; 2]| {
        let mut agent = mission.vehicle(0, 0..PART, |_| true);
        slots.into_iter().for_each(|slot| {
            agent.apply(Entry::Sent { number: 0, state: FrameState::Proposed, slot, bytes: frame.clone() }).unwrap();
        });
        agent.snapshot()
    };
    assert_eq!(twice([None, Some(PART)]), twice([Some(PART), Some(PART)]));
    assert_eq!(twice([None, Some(PART)]), twice([Some(PART), None]));
}

#[test]
fn a_member_out_of_range_does_not_delay_new_outcomes_for_the_others() {
    let mission = Mission::new(3);
    // Vehicle 2 is never heard, and it reports through another channel that it hears nothing.
    let is_heard = |slot: u32| slot % 3 != 2;
    let mut agent = mission.vehicle(0, 0..PART, is_heard);
    mission.next_report(&mut agent, PART);
    for (number, hears) in [(1, true), (2, false)] {
        receive_all(&mut agent, &frames(&mut mission.vehicle(number, 0..PART + 8, |_| hears), 8));
    }
    mission.record(&mut agent, 0, PART..PART + 30, is_heard);
    let [_, last] = mission.next_report(&mut agent, PART + 30);
    assert_eq!(last, PART + 28);
}

#[test]
fn an_unused_slot_found_after_its_report_is_reported_again() {
    let mission = Mission::with_one_transmission_per_slot();
    let mut agent = mission.vehicle(0, 0..PART, |_| true);
    mission.next_report(&mut agent, PART);
    assert_eq!(agent.next_frame(Some(slot_s(PART + 2)), 32).unwrap(), None);
    for slot in [PART / 2, PART - 2] {
        agent.record_unused_slots([slot_s(slot)]).unwrap();
        let frame = agent.next_frame(Some(slot_s(PART + 4)), 32).unwrap().unwrap().bytes;
        let (_, report, _) = agent.codec().read_report(&frame).unwrap();
        assert_eq!((report.first, report.includes_own_slots), (slot, true));
        assert_eq!(report.outcomes, [Outcome::Missed]);
        assert_eq!(agent.next_frame(Some(slot_s(PART + 6)), 32).unwrap(), None);
    }
}

#[test]
fn a_frame_planned_for_an_unused_slot_was_not_transmitted() {
    let mission = Mission::with_one_transmission_per_slot();
    let mut agent = mission.vehicle(0, 0..PART, |_| true);
    mission.next_report(&mut agent, PART);
    assert_eq!(agent.next_frame(Some(slot_s(PART + 2)), 32).unwrap(), None);
    agent.record_unused_slots([slot_s(PART)]).unwrap();
    let [first, last] = mission.next_report(&mut agent, PART + 4);
    assert!(first <= 1 && last >= PART - 1, "{first} to {last}");
}
