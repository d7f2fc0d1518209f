//! Orders of slots that change under way, and who does not know of it.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// The slot in which three were to begin to send in the other order, which was taken back at once.
const HALF: u32 = 24;

/// Whose turn it would be then.
fn reversed(slot: u32) -> usize {
    (3 - slot as usize % 3) % 3
}

/// A trip of three: vehicle 0 does not know that they went on as before.
struct Missed {
    trip: Trip,
    /// What vehicle 0 takes the agreement to be.
    old: Arc<Team>,
}

impl Missed {
    fn of(trip: Trip, is_sealed: bool) -> Self {
        let order = |turn: [usize; 3]| turn.map(|number| names(3).remove(number)).to_vec();
        let there = SlotChange { from: HALF, order: order([0, 2, 1]) };
        let back = SlotChange { from: HALF + 1, order: order([1, 2, 0]) };
        let key = is_sealed.then(|| key(7));
        let with = |changes: Vec<SlotChange>| {
            let team = (*trip.team).clone();
            Arc::new(Team { slots: Slots { changes, ..team.slots }, key: key.clone(), ..team })
        };
        let (old, new) = (with(vec![there.clone()]), with(vec![there, back]));
        assert_eq!((HALF..HALF + 6).map(reversed).collect::<Vec<_>>(), [0, 2, 1, 0, 2, 1]);
        Self { trip: Trip { team: new, ..trip }, old }
    }

    fn vehicle_0(&self) -> Agent {
        let expected = |slot: u32| if slot < HALF { slot as usize % 3 } else { reversed(slot) };
        let recorded = self.trip.misread(|slot| (slot.into(), expected(slot)));
        let mut agent = vehicle(&self.old, 0, recorded).telling(Telling { points: false, reports: true });
        agent.navigate((0..=self.trip.slots).map(|slot| (SLOT_S * f64::from(slot), self.trip.at(0, slot)))).unwrap();
        agent
    }
}

/// A trip on which vehicle 0 hears and misses many of the others' messages, before and after.
fn long_trips() -> impl Strategy<Value = Trip> {
    trips().prop_filter("three, for long", |trip| trip.members() == 3 && trip.slots == 48).prop_map(Trip::trusting)
}

proptest! {
    #![proptest_config(ProptestConfig { max_local_rejects: 1_000_000, max_global_rejects: 100_000, ..cases(8) })]

    #[test]
    fn who_missed_a_change_shares_what_was_before_it(trip in long_trips(), is_sealed in any::<bool>()) {
        let missed = Missed::of(trip, is_sealed);
        let mut lost = missed.vehicle_0();
        // It heard both in turn before, and out of turn since.
        let was_heard = |id: &VehicleId| {
            missed.trip.events(0).iter().any(|event| event.success && event.transmitter_id == *id && event.time_s < SLOT_S * f64::from(HALF))
        };
        prop_assume!(names(3)[1..].iter().all(was_heard) && lost.out_of_turn().len() == 2);
        prop_assert_eq!(lost.clock_ahead_slots(), 0);
        let told: Vec<Vec<u8>> = sent(&mut lost, 100);
        let of_others: Vec<Vec<u8>> = (1..3).flat_map(|number| sent(&mut missed.trip.vehicle(number), 100)).collect();
        // The others know what it heard before, and all that they heard of it then and since.
        let mut listener = missed.trip.vehicle(1);
        for frame in told.iter().chain(&of_others) {
            let is_foreign = matches!(listener.receive(frame, f64::INFINITY), Receipt::Refused(Refusal::OtherTeam { .. }));
            prop_assert!(!is_foreign);
        }
        listener.rebuild_posteriors().unwrap();
        let before: Vec<Event> = missed.trip.events(0).into_iter().filter(|event| event.time_s <= SLOT_S * f64::from(HALF)).collect();
        let mut all = Agent::new(VehicleId::new("shore"), missed.trip.team.clone()).owning_all_events();
        all.observe_all(before.iter().cloned().chain((1..3).flat_map(|number| missed.trip.events(number)))).unwrap();
        all.rebuild_posteriors().unwrap();
        let ((mean, variance), (all_mean, all_variance)) = (latent(&mut listener), latent(&mut all));
        prop_assert!(largest_difference(&mean, &all_mean) < 1e-6 && largest_difference(&variance, &all_variance) < 1e-6);
        // What speaks of later slots it cannot read, and says so; nothing that it takes in is of these.
        for frame in &of_others {
            let (_, report, _) = listener.read_report(frame).unwrap();
            let said = (report.first..).filter(|slot| report.tells_own || listener.team().slots.sender(*slot) != names(3).get(usize::from(report.sender)));
            let last = said.take(report.outcomes.len()).last().unwrap();
            let is_foreign = matches!(lost.receive(frame, f64::INFINITY), Receipt::Refused(Refusal::OtherTeam { .. }));
            prop_assert_eq!(is_foreign, last > HALF, "{:?}", report);
        }
        prop_assert_eq!(restored(&lost, &lost.snapshot()).told_events(), lost.told_events());
    }
}

#[test]
fn map_messages_speak_of_places_and_cross_any_change() {
    let trip = Trip::of_three(|_| true);
    for is_sealed in [false, true] {
        let missed = Missed::of(trip.clone(), is_sealed);
        let points = Telling { points: true, reports: false };
        let [mut lost, mut other] = [missed.vehicle_0(), missed.trip.vehicle(1)].map(|agent| agent.telling(points));
        let (from_lost, from_other) = (sent(&mut lost, 1), sent(&mut other, 1));
        assert_eq!((from_lost.len(), from_other.len()), (1, 1));
        assert_eq!(other.receive(&from_lost[0], 0.0), Receipt::Accepted);
        assert_eq!(lost.receive(&from_other[0], 0.0), Receipt::Accepted);
        // A change of anything else is another team.
        let mut stranger = Agent::new(names(3).remove(2), Arc::new(Team { epoch: 1, ..(*missed.old).clone() }));
        assert!(matches!(stranger.receive(&from_lost[0], 0.0), Receipt::Refused(Refusal::OtherTeam { .. })));
    }
}

#[test]
fn who_learns_of_a_change_goes_on_with_all_that_it_knew() {
    let trip = Trip::of_three(|slot| slot % 4 < 3);
    for is_sealed in [false, true] {
        let missed = Missed::of(trip.clone(), is_sealed);
        let mut lost = missed.vehicle_0().telling(Telling::default());
        let mut other = missed.trip.vehicle(1);
        let of_other = sent(&mut missed.trip.vehicle(1), 20);
        of_other.iter().for_each(|frame| drop(lost.receive(frame, f64::INFINITY)));
        let first = sent(&mut lost.clone().telling(Telling { points: true, reports: false }), 1).remove(0);
        lost.apply(Entry::Sent { number: 0, slot: Some(HALF + 3), bytes: first.clone() }).unwrap();
        let known = lost.told_events().0;
        assert!(known > 0 && lost.out_of_turn().len() == 2);
        // Under what it learns of it has these, and what the others told since it reads when it comes again.
        let mut found = Agent::restore(lost.id().clone(), missed.trip.team.clone(), &lost.snapshot()).unwrap();
        assert_eq!((found.told_events().0, found.out_of_turn().len()), (known, 0));
        of_other.iter().for_each(|frame| drop(found.receive(frame, f64::INFINITY)));
        assert!(found.told_events().0 > known);
        assert_eq!(found.numbers_next().1, 1);
        // No counter is used twice.
        found.observe_all(walk(0, 40, 2.0)).unwrap();
        let next = sent(&mut found.telling(Telling { points: true, reports: false }), 1).remove(0);
        for frame in [&first, &next] {
            assert_eq!(other.receive(frame, 0.0), Receipt::Accepted);
        }
        assert_eq!(other.conflicts(&names(1)[0]), 0);
        // And back: what it knows of slots since is of another order.
        let back = Agent::restore(lost.id().clone(), missed.old.clone(), &missed.trip.vehicle(0).snapshot()).unwrap();
        assert_eq!(back.events().len(), missed.trip.events(0).len());
    }
}
