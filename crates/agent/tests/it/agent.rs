//! One vehicle: its predictions follow from the data that it has, not from the order or the times of their arrival.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn late_and_unordered_events_give_the_same_memory_and_predictions(
        model in models(), events in events_of(0, 5..40), asked in any::<u64>(),
        order in Just((0..40).collect::<Vec<usize>>()).prop_shuffle(),
    ) {
        let team = Arc::new(team(2, model));
        let mut late = vehicle(&team, 0, []);
        for (n, number) in order.into_iter().filter(|&place| place < events.len()).enumerate() {
            late.apply(Entry::Observed { number: number as u64, event: events[number].clone() }).unwrap();
            if asked >> n & 1 == 1 {
                test_probabilities(&mut late);
            }
        }
        let mut in_order = vehicle(&team, 0, events);
        prop_assert!(in_order.events().eq(late.events()));
        prop_assert_eq!(in_order.snapshot(), late.snapshot());
        prop_assert_eq!(bits(&rebuilt_probabilities(&mut in_order)), bits(&rebuilt_probabilities(&mut late)));
    }

    #[test]
    fn events_after_the_last_fit_change_predictions_nearly_as_a_new_fit_does(
        model in models(), events in events_of(0, 5..40), first in 0..40usize, asked in any::<u64>(),
    ) {
        let first = first.min(events.len());
        let mut agent = vehicle(&Arc::new(team(2, model)), 0, events[..first].iter().cloned());
        agent.rebuild().unwrap();
        for (n, event) in events[first..].iter().enumerate() {
            agent.record([event.clone()]).unwrap();
            if asked >> n & 1 == 1 {
                test_probabilities(&mut agent);
            }
        }
        let absorbed = test_probabilities(&mut agent);
        let difference = largest_difference(&absorbed, &rebuilt_probabilities(&mut agent));
        // Over 20000 cases it was at most 0.105.
        prop_assert!(difference < 0.15, "{}", difference);
    }

    #[test]
    fn packets_absorbed_one_by_one_give_the_predictions_of_all_at_once(fleet in fleets()) {
        let mut agent = fleet.vehicle(0);
        agent.rebuild().unwrap();
        for bytes in fleet.packets(3) {
            agent.receive(&bytes, None);
            test_probabilities(&mut agent);
        }
        let absorbed = test_probabilities(&mut agent);
        let difference = largest_difference(&absorbed, &rebuilt_probabilities(&mut agent));
        prop_assert!(difference < 1e-9, "{}", difference);
    }
}

#[test]
fn a_refit_becomes_due_after_many_new_events() {
    let team = Arc::new(team(2, model()));
    let mut agent = vehicle(&team, 0, []);
    for event in walk(0, 70, 0.0) {
        agent.record([event]).unwrap();
        if agent.refit_due() {
            agent.refit().unwrap();
        }
        test_probabilities(&mut agent);
    }
    assert!(agent.status().fit.is_some_and(|quality| quality.converged));
    assert_eq!(agent.sites().unwrap().len(), 63, "at most 8 events may wait for the next fit of so few");
    let limits = agent.team().limits;
    assert_eq!([0, 128, 320, 2000, 5000].map(|events| limits.refit_threshold(events)), [8, 8, 20, 125, 256]);
    let kept = test_probabilities(&mut agent);
    let mut fresh = vehicle(&team, 0, walk(0, 70, 0.0));
    let difference = largest_difference(&kept, &rebuilt_probabilities(&mut fresh));
    assert!(difference < 0.05, "{difference}");
}

#[test]
fn numbers_that_are_not_finite_are_refused_and_nothing_is_recorded() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 5, 0.0));
    let before = (agent.snapshot(), test_probabilities(&mut agent));
    let good = walk(0, 6, 0.0).remove(5);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut events = vec![good.clone(); 4];
        events[0].time_s = bad;
        events[1].link.transmitter.east_m = bad;
        events[2].link.receiver.north_m = bad;
        events[3].link.receiver.depth_m = Some(bad);
        for event in events {
            // The good event before it is not recorded either.
            let error = agent.record([good.clone(), event.clone()]).unwrap_err();
            assert!(matches!(error, AgentError::NoTime { .. } | AgentError::Nowhere { .. }), "{error} {event:?}");
            assert!(agent.record([event]).is_err());
        }
        assert!(matches!(agent.probability(link([bad, 0.0, 0.0, 0.0])), Err(AgentError::Method(_))));
        let position = |east_m| Position::new(east_m, 0.0);
        assert!(agent.record_positions([(0.0, position(0.0)), (bad, position(0.0))]).is_err());
        assert!(agent.record_positions([(0.0, position(0.0)), (1.0, position(bad))]).is_err());
    }
    assert_eq!((agent.snapshot(), test_probabilities(&mut agent)), before);
}

#[test]
fn a_reception_time_that_is_not_finite_is_unknown() {
    let team = Arc::new(team(2, model()));
    let packets = frames(&mut vehicle(&team, 1, walk(1, 40, 0.0)), 3);
    let mut agent = vehicle(&team, 0, []);
    let last_heard_s = |agent: &Agent| member(agent, &name(1)).last_heard_s;
    for (bytes, time_s) in packets.iter().zip([f64::NAN, f64::INFINITY, 12.5]) {
        assert_eq!(last_heard_s(&agent), None);
        assert_eq!(agent.receive(bytes, Some(time_s)).receipt, Receipt::Accepted);
    }
    assert_eq!(last_heard_s(&agent), Some(12.5));
}

#[test]
fn equal_events_of_known_and_unknown_depth_have_one_order() {
    let team = Arc::new(team(2, model()));
    let unknown = walk(0, 1, 0.0).remove(0);
    let mut surface = unknown.clone();
    surface.link.receiver.depth_m = Some(0.0);
    let both = vehicle(&team, 0, [unknown.clone(), surface.clone()]);
    assert_eq!(events(&both), events(&vehicle(&team, 0, [surface, unknown])));
}

#[test]
fn a_vehicle_outside_the_team_receives_and_does_not_send() {
    let team = Arc::new(team(2, model()));
    let mut guest = vehicle(&team, 2, walk(2, 10, 0.5));
    let id = guest.id().clone();
    assert_eq!(guest.next_frame(Some(0.0), 32), Err(AgentError::NotAMember(id)));
    let before = test_probabilities(&mut guest);
    for bytes in frames(&mut vehicle(&team, 0, walk(0, 40, 0.0)), 2) {
        assert_eq!(guest.receive(&bytes, Some(7.0)).receipt, Receipt::Accepted);
    }
    let status = guest.status();
    assert_eq!((status.live_packets, status.members[&name(0)].last_heard_s), (2, Some(7.0)));
    assert_ne!(test_probabilities(&mut guest), before);
}

#[test]
fn a_frame_below_32_bytes_is_refused() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 10, 0.0));
    let small = AgentError::Team(TeamError::FrameTooSmall(31));
    assert_eq!(agent.next_frame(Some(0.0), 31), Err(small));
    for frame_bytes in [32, 63, 64, 255, 256, 1000] {
        let mut agent = agent.clone();
        let length = agent.next_frame(Some(0.0), frame_bytes).unwrap().unwrap().bytes.len();
        assert!(length <= frame_bytes, "{length} {frame_bytes}");
    }
}

#[test]
fn a_vehicle_without_events_predicts_even_odds_and_sends_nothing() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, []);
    let p = test_probabilities(&mut agent);
    assert!(p.iter().all(|p| (p - 0.5).abs() < 1e-12), "{p:?}");
    assert_eq!(agent.next_frame(Some(0.0), 32), Ok(None));
    assert_eq!(probabilities(&mut agent, [] as [Link; 0]), []);
}

#[test]
fn own_packets_add_nothing_to_own_events() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 30, 0.0));
    let before = rebuilt_probabilities(&mut agent);
    for bytes in frames(&mut agent, 5) {
        assert_eq!(agent.receive(&bytes, None).receipt, Receipt::Refused(Refusal::Duplicate));
    }
    assert_eq!(test_probabilities(&mut agent), before);
    assert_eq!(rebuilt_probabilities(&mut agent), before);
}

#[test]
fn a_sparse_fit_predicts_and_sends_nearly_as_a_dense_one() {
    let (dense, mut sparse) = (team(2, model()), team(2, model()));
    // Members need not agree on limits.
    sparse.limits = Limits { dense_events_max: 50, inducing_points_max: 120, candidates_max: 1000, ..sparse.limits };
    let [mut dense, mut sparse] = [dense, sparse].map(|team| vehicle(&Arc::new(team), 1, walk(1, 150, 1.0)));
    assert!(dense.status().is_dense && !sparse.status().is_dense);
    let predicted = [&mut dense, &mut sparse].map(test_probabilities);
    assert!(largest_difference(&predicted[0], &predicted[1]) < 0.01, "{predicted:?}");
    let received = [&mut dense, &mut sparse].map(|sender| {
        let mut receiver = vehicle(&Arc::new(team(2, model())), 0, []);
        for bytes in frames(sender, 8) {
            assert_eq!(receiver.receive(&bytes, None).receipt, Receipt::Accepted);
        }
        test_probabilities(&mut receiver)
    });
    // The inducing points differ, and so does their rounding. Packets of one sender differ by as much.
    assert!(largest_difference(&received[0], &received[1]) < 0.1, "{received:?}");
}

#[test]
fn a_large_fit_is_amended_and_sometimes_made_again() {
    let mut large = team(2, model());
    let limits = Limits { dense_events_max: 50, inducing_points_max: 120, pending_events_max: 4, ..large.limits };
    large.limits = Limits { events_max: 350, ..limits };
    let all = walk(0, 400, 0.0);
    let mut agent = vehicle(&Arc::new(large), 0, all[..300].iter().cloned());
    agent.refit().unwrap();
    let mut fits = 0;
    for events in all[300..].chunks(5) {
        let before = agent.status().fit;
        agent.record(events.iter().cloned()).unwrap();
        assert!(agent.refit_due());
        agent.refit().unwrap();
        assert!(!agent.refit_due());
        fits += usize::from(agent.status().fit != before);
        let amended = test_probabilities(&mut agent);
        let mut fresh = restored(&agent, &agent.snapshot());
        let difference = largest_difference(&amended, &rebuilt_probabilities(&mut fresh));
        assert!(difference < 0.02, "{difference}");
    }
    // In 100 events a sixteenth of 300 comes four times, and goes as often.
    assert!((4..=10).contains(&fits), "{fits}");
}

#[test]
fn one_frame_halves_the_error_in_a_region_without_own_events() {
    let team = Arc::new(team(2, model()));
    // The sender saw the east, where all links work; the receiver the west, where only short ones do.
    let shifted = |receiver: usize, phase: f64, east_m: f64| -> Vec<Event> {
        let moved = walk(receiver, 40, phase).into_iter().map(|mut event| {
            for end in [&mut event.link.transmitter, &mut event.link.receiver] {
                end.east_m = 0.4 * end.east_m + east_m;
            }
            event.success = east_m > 0.0 || event.link.range_m() < 200.0;
            event
        });
        moved.collect()
    };
    let mut sender = vehicle(&team, 0, shifted(0, 0.0, 350.0));
    let mut receiver = vehicle(&team, 1, shifted(1, 1.0, -350.0));
    let east: Vec<Link> = shifted(0, 0.19, 350.0).into_iter().map(|event| event.link).collect();
    let bytes = sender.next_frame(Some(0.0), 32).unwrap().unwrap().bytes;
    let expected = probabilities(&mut sender, &east);
    let mut error = || {
        let p = probabilities(&mut receiver, &east);
        let error = p.iter().zip(&expected).map(|(p, expected)| (p - expected).abs()).sum::<f64>() / p.len() as f64;
        receiver.receive(&bytes, Some(1.0));
        error
    };
    let (before, after) = (error(), error());
    assert!(after < 0.5 * before, "{before} {after}");
}

#[test]
fn options_can_change_without_loss_of_data() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 30, 0.0));
    let before = agent.snapshot();
    agent.options.sharing = Sharing::reports();
    assert_eq!(agent.next_frame(None, 32), Ok(None), "the events have no slots, and reports need slots");
    agent.options.sharing = Sharing::default();
    assert_eq!(agent.snapshot(), before);
    assert!(agent.next_frame(None, 32).unwrap().is_some());
}
