//! One vehicle as a state machine: what it knows depends on what arrived, not on when or in which order.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::*;
use dgpc::Matrix;
use pingmap_agent::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn late_and_unordered_events_end_in_the_same_memory_and_map(
        model in models(), events in events_of(0, 5..40), asked in any::<u64>(),
        order in Just((0..40).collect::<Vec<usize>>()).prop_shuffle(),
    ) {
        let team = Arc::new(team(2, model));
        let mut late = vehicle(&team, 0, []);
        for (n, number) in order.into_iter().filter(|&place| place < events.len()).enumerate() {
            late.apply(Entry::Observed { number: number as u64, event: events[number].clone() }).unwrap();
            if asked >> n & 1 == 1 {
                late.probabilities(somewhere()).unwrap();
            }
        }
        let mut in_order = vehicle(&team, 0, events);
        prop_assert!(in_order.events().eq(late.events()));
        prop_assert_eq!(in_order.snapshot(), late.snapshot());
        in_order.rebuild_posteriors().unwrap();
        late.rebuild_posteriors().unwrap();
        let p = [&mut in_order, &mut late].map(|agent| bits(&agent.probabilities(somewhere()).unwrap()));
        prop_assert_eq!(&p[0], &p[1]);
    }

    #[test]
    fn events_beside_the_last_fit_move_predictions_nearly_as_a_new_fit_does(
        model in models(), events in events_of(0, 5..40), first in 0..40usize, asked in any::<u64>(),
    ) {
        let first = first.min(events.len());
        let mut agent = vehicle(&Arc::new(team(2, model)), 0, events[..first].iter().cloned());
        agent.rebuild_posteriors().unwrap();
        for (n, event) in events[first..].iter().enumerate() {
            agent.observe(event.clone()).unwrap();
            if asked >> n & 1 == 1 {
                agent.probabilities(somewhere()).unwrap();
            }
        }
        let beside = agent.probabilities(somewhere()).unwrap();
        agent.rebuild_posteriors().unwrap();
        let difference = largest_difference(&beside, &agent.probabilities(somewhere()).unwrap());
        // Over 20000 cases it was at most 0.105.
        prop_assert!(difference < 0.15, "{}", difference);
    }

    #[test]
    fn packets_taken_in_one_after_the_other_say_what_all_say_at_once(fleet in fleets()) {
        let mut agent = fleet.vehicle(0);
        agent.rebuild_posteriors().unwrap();
        for bytes in fleet.packets(3) {
            agent.receive(&bytes, 0.0);
            agent.probabilities(somewhere()).unwrap();
        }
        let absorbed = agent.probabilities(somewhere()).unwrap();
        agent.rebuild_posteriors().unwrap();
        let difference = largest_difference(&absorbed, &agent.probabilities(somewhere()).unwrap());
        prop_assert!(difference < 1e-9, "{}", difference);
    }
}

#[test]
fn many_new_events_are_fitted_afresh() {
    let team = Arc::new(team(2, model()));
    let mut agent = vehicle(&team, 0, []);
    for event in walk(0, 70, 0.0) {
        agent.observe(event).unwrap();
        if agent.refit_due() {
            agent.refit().unwrap();
        }
        agent.probabilities(somewhere()).unwrap();
    }
    assert!(agent.fit_quality().is_some_and(|quality| quality.converged));
    assert_eq!(agent.sites().unwrap().len(), 63, "more than 8 events stand beside no fit of so few");
    let limits = agent.team().limits;
    assert_eq!([0, 128, 320, 2000, 5000].map(|events| limits.beside_fit(events)), [8, 8, 20, 125, 256]);
    let kept = agent.probabilities(somewhere()).unwrap();
    let mut fresh = vehicle(&team, 0, walk(0, 70, 0.0));
    fresh.rebuild_posteriors().unwrap();
    let difference = largest_difference(&kept, &fresh.probabilities(somewhere()).unwrap());
    assert!(difference < 0.05, "{difference}");
}

#[test]
fn numbers_that_are_not_finite_are_refused_and_nothing_is_recorded() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 5, 0.0));
    let before = (agent.snapshot(), agent.probabilities(somewhere()).unwrap());
    let good = walk(0, 6, 0.0).remove(5);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut events = vec![good.clone(); 4];
        events[0].time_s = bad;
        events[1].link.transmitter.east_m = bad;
        events[2].link.receiver.north_m = bad;
        events[3].link.receiver.depth_m = Some(bad);
        for event in events {
            // The good event before it is not recorded either.
            let error = agent.observe_all([good.clone(), event.clone()]).unwrap_err();
            assert!(matches!(error, AgentError::NoTime { .. } | AgentError::Nowhere { .. }), "{error} {event:?}");
            assert!(agent.observe(event).is_err());
        }
        assert!(matches!(agent.probability(link([bad, 0.0, 0.0, 0.0])), Err(AgentError::Method(_))));
    }
    assert_eq!((agent.snapshot(), agent.probabilities(somewhere()).unwrap()), before);
}

#[test]
fn equal_events_of_known_and_unknown_depth_are_kept_in_one_order() {
    let team = Arc::new(team(2, model()));
    let unknown = walk(0, 1, 0.0).remove(0);
    let mut surface = unknown.clone();
    surface.link.receiver.depth_m = Some(0.0);
    let both = vehicle(&team, 0, [unknown.clone(), surface.clone()]);
    assert_eq!(events(&both), events(&vehicle(&team, 0, [surface, unknown])));
}

#[test]
fn who_is_not_a_member_listens_only() {
    let team = Arc::new(team(2, model()));
    let mut guest = vehicle(&team, 2, walk(2, 10, 0.5));
    let id = guest.id().clone();
    assert!(!guest.is_member());
    assert_eq!(guest.next_packet(0.0, 32), Err(AgentError::NotAMember { id }));
    let before = guest.probabilities(somewhere()).unwrap();
    for bytes in sent(&mut vehicle(&team, 0, walk(0, 40, 0.0)), 2) {
        assert_eq!(guest.receive(&bytes, 7.0), Receipt::Accepted);
    }
    assert_eq!((guest.live_packets(), guest.heard_s(&names(1)[0])), (2, Some(7.0)));
    assert_ne!(guest.probabilities(somewhere()).unwrap(), before);
}

#[test]
fn a_frame_that_no_packet_fits_is_refused() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 10, 0.0));
    let small = AgentError::Team(TeamError::FrameTooSmall { found: 31 });
    assert_eq!(agent.next_packet(0.0, 31), Err(small));
    for frame_bytes in [32, 63, 64, 255, 256, 1000] {
        let mut agent = agent.clone();
        let length = agent.next_packet(0.0, frame_bytes).unwrap().unwrap().len();
        assert!(length <= frame_bytes, "{length} {frame_bytes}");
    }
}

#[test]
fn a_vehicle_without_events_predicts_even_odds_and_tells_nothing() {
    let mut nobody = vehicle(&Arc::new(team(2, model())), 0, []);
    let p = nobody.probabilities(somewhere()).unwrap();
    assert!(p.iter().all(|p| (p - 0.5).abs() < 1e-12), "{p:?}");
    assert_eq!(nobody.next_packet(0.0, 32), Ok(None));
    assert_eq!(nobody.probabilities([] as [Link; 0]), Ok(Vec::new()));
}

#[test]
fn own_packets_add_nothing_to_own_events() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 30, 0.0));
    agent.rebuild_posteriors().unwrap();
    let before = agent.probabilities(somewhere()).unwrap();
    for bytes in sent(&mut agent, 5) {
        assert_eq!(agent.receive(&bytes, 0.0), Receipt::Refused(Refusal::Duplicate));
    }
    assert_eq!(agent.probabilities(somewhere()).unwrap(), before);
    agent.rebuild_posteriors().unwrap();
    assert_eq!(agent.probabilities(somewhere()).unwrap(), before);
}

#[test]
fn a_sparse_fit_knows_and_tells_nearly_what_a_dense_one_does() {
    let (dense, mut sparse) = (team(2, model()), team(2, model()));
    // Limits are every vehicle's own affair: packets of either are read by both.
    sparse.limits = Limits { dense_events_max: 50, inducing_points_max: 120, candidates_max: 1000, ..sparse.limits };
    let [mut dense, mut sparse] = [dense, sparse].map(|team| vehicle(&Arc::new(team), 1, walk(1, 150, 1.0)));
    assert!(dense.learns_densely() && !sparse.learns_densely());
    let knows = [&mut dense, &mut sparse].map(|agent| agent.probabilities(somewhere()).unwrap());
    assert!(largest_difference(&knows[0], &knows[1]) < 0.01, "{knows:?}");
    let heard = [&mut dense, &mut sparse].map(|sender| {
        let mut receiver = vehicle(&Arc::new(team(2, model())), 0, []);
        for bytes in sent(sender, 8) {
            assert_eq!(receiver.receive(&bytes, 0.0), Receipt::Accepted);
        }
        receiver.probabilities(somewhere()).unwrap()
    });
    // Other points, rounded otherwise: that far apart are two packets of one vehicle, too.
    assert!(largest_difference(&heard[0], &heard[1]) < 0.1, "{heard:?}");
}

#[test]
fn a_long_fit_grows_and_is_made_again_now_and_then() {
    let mut long = team(2, model());
    long.limits =
        Limits { dense_events_max: 50, inducing_points_max: 120, events_beside_max: 4, events_max: 350, ..long.limits };
    let all = walk(0, 400, 0.0);
    let mut agent = vehicle(&Arc::new(long), 0, all[..300].iter().cloned());
    agent.refit().unwrap();
    let mut fits = 0;
    for events in all[300..].chunks(5) {
        let before = agent.fit_quality();
        agent.observe_all(events.iter().cloned()).unwrap();
        assert!(agent.refit_due());
        agent.refit().unwrap();
        assert!(!agent.refit_due());
        fits += usize::from(agent.fit_quality() != before);
        let grown = agent.probabilities(somewhere()).unwrap();
        let mut anew = restored(&agent, &agent.snapshot());
        anew.rebuild_posteriors().unwrap();
        let off = largest_difference(&grown, &anew.probabilities(somewhere()).unwrap());
        assert!(off < 0.02, "{off}");
    }
    // A sixteenth of 300 events comes four times in 100, and as many went.
    assert!((4..=10).contains(&fits), "{fits}");
}

#[test]
fn one_frame_tells_a_vehicle_of_a_region_that_it_has_not_seen() {
    let team = Arc::new(team(2, model()));
    // One saw the west, where only short links work; the other the east, where all do.
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
    let bytes = sender.next_packet(0.0, 32).unwrap().unwrap();
    let theirs = sender.probabilities(&east).unwrap();
    let mut off = || {
        let p = receiver.probabilities(&east).unwrap();
        let off = p.iter().zip(&theirs).map(|(p, theirs)| (p - theirs).abs()).sum::<f64>() / p.len() as f64;
        receiver.receive(&bytes, 1.0);
        off
    };
    let (before, after) = (off(), off());
    assert!(after < 0.5 * before, "{before} {after}");
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_link_longer_than_any_that_was_tried_is_not_better_than_its_part(
        fleet in fleets(), ends in prop::array::uniform4(-4.0 * REACH_M..4.0 * REACH_M), beyond in 1.0..50.0f64,
    ) {
        let mut agent = fleet.vehicle(0);
        let own_m = fleet.events[0].iter().map(|event| event.link.range_m()).fold(0.0, f64::max);
        prop_assert_eq!(agent.longest_m(), Some(own_m));
        for bytes in fleet.packets(2) {
            agent.receive(&bytes, 0.0);
        }
        let longest_m = agent.longest_m().unwrap();
        let told = agent.links_of_packets().into_iter().flat_map(|(_, _, links)| links);
        prop_assert_eq!(longest_m, told.map(|link| link.range_m()).fold(own_m, f64::max));
        let link = link(ends);
        let share = longest_m * beyond / link.range_m();
        let longer = Position {
            east_m: ends[0] + share * (ends[2] - ends[0]),
            north_m: ends[1] + share * (ends[3] - ends[1]),
            depth_m: None,
        };
        let longer = Link { receiver: longer, ..link };
        let part = longer.shortened_to(longest_m);
        prop_assert!((part.range_m() - longest_m).abs() < 1e-6 && part.transmitter == link.transmitter);
        let back = longer.swapped().shortened_to(longest_m).swapped();
        prop_assert!(back.receiver == longer.receiver);
        let p = agent.probabilities([longer, part, back]).unwrap();
        prop_assert!(p[0] <= p[1] + 1e-12 && p[0] <= p[2] + 1e-12, "{:?}", p);
    }
}

#[test]
fn beyond_all_data_even_odds_come_back_only_where_they_may() {
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, walk(0, 60, 0.0));
    agent.refit().unwrap();
    let longest_m = agent.longest_m().unwrap();
    let [part, far] = [longest_m, 30.0 * longest_m].map(|range_m| link([0.0, 0.0, range_m, 0.0]));
    let held = agent.probability(far).unwrap();
    assert_eq!(held.to_bits(), agent.probability(part).unwrap().to_bits());
    // A reciprocal kernel says the same the other way round, and nobody knows how bad it is out there.
    assert!((agent.probability(far.swapped()).unwrap() - held).abs() < 1e-9);
    let wide = agent.wide_posterior().unwrap();
    let [near, far_off] = [part, far].map(|link| agent.intervals(&wide, [link]).unwrap()[0]);
    assert!(far_off.0 <= near.0 && far_off.1 == near.1, "{near:?} {far_off:?}");
    let rising = agent.rising_beyond().probability(far).unwrap();
    assert!(held < 0.48 && (rising - 0.5).abs() < 0.01, "{held} {rising}");
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn intervals_hold_what_is_predicted(fleet in fleets(), learned in 0..40usize, places in prop::collection::vec(links(), 8)) {
        let mut agent = vehicle(&fleet.team, 0, fleet.events[0].iter().take(learned).cloned());
        agent.refit().unwrap();
        // Beside the fit.
        agent.observe_all(fleet.events[0].iter().skip(learned).cloned()).unwrap();
        fleet.packets(2).iter().for_each(|bytes| drop(agent.receive(bytes, 0.0)));
        let wide = agent.wide_posterior().unwrap();
        prop_assert_eq!(wide.len(), agent.posterior().unwrap().len());
        let predicted = agent.probabilities(&places).unwrap();
        let intervals = agent.intervals(&wide, &places).unwrap();
        for (p, (low, high)) in predicted.into_iter().zip(intervals) {
            prop_assert!(0.0 <= low && low <= p && p <= high && high <= 1.0, "{} {} {}", low, p, high);
        }
    }
}

#[test]
fn intervals_are_wide_where_nothing_is_known() {
    let heard = walk(0, 60, 0.0).into_iter().filter(|event| event.success);
    let mut agent = vehicle(&Arc::new(team(2, model())), 0, heard);
    agent.refit().unwrap();
    let wide = agent.wide_posterior().unwrap();
    let near: Vec<Link> = agent.events().map(|event| event.link).collect();
    let far = link([60_000.0, 60_000.0, 60_100.0, 60_000.0]);
    let width = |(low, high): &(f64, f64)| high - low;
    let far = width(&agent.intervals(&wide, [far]).unwrap()[0]);
    let widths: Vec<f64> = agent.intervals(&wide, &near).unwrap().iter().map(width).collect();
    let near = widths.iter().sum::<f64>() / widths.len() as f64;
    assert!(far > 0.95 && near < far - 0.15, "{far} {near}");
}

#[test]
fn events_explain_what_is_near_them_and_draws_go_as_far_as_intervals_do() {
    let team = Arc::new(team(2, model()));
    let places =
        [[0.0, 0.0, 100.0, 0.0], [300.0, 0.0, 350.0, 40.0], [60_000.0, 60_000.0, 60_100.0, 60_000.0]].map(link);
    // Nothing is explained before the first event.
    let none = vehicle(&team, 0, []).explained_shares(places).unwrap();
    assert!(none.iter().all(|share| share.abs() < 1e-9), "{none:?}");
    let mut agent = vehicle(&team, 0, walk(0, 60, 0.0));
    agent.refit().unwrap();
    let own: Vec<Link> = agent.events().map(|event| event.link).collect();
    let near = agent.explained_shares(&own).unwrap();
    let far = agent.explained_shares([places[2]]).unwrap()[0];
    assert!(near.iter().all(|share| (0.0..=1.0).contains(share) && *share > far + 0.1) && far < 0.05, "{near:?} {far}");
    // Functions drawn: their mean and their spread are those of each attempt by itself, and what is wide is wider.
    let wide = agent.wide_posterior().unwrap();
    let unit = Matrix::from_fn(3, 4, |row, draw| f64::from(u8::from(row + 1 == draw)));
    let [plain, wider] = [agent.draws(&wide, places, &unit).unwrap(), agent.wide_draws(&wide, places, &unit).unwrap()];
    let latent = agent.wide_latent(&wide, places).unwrap();
    for place in 0..3 {
        let mean = plain.column(0)[place];
        assert!((mean - latent.mean[place]).abs() < 1e-9 && (wider.column(0)[place] - mean).abs() < 1e-9);
        let spread = |draws: &Matrix| (1..4).map(|draw| (draws.column(draw)[place] - mean).powi(2)).sum::<f64>();
        assert!((spread(&wider) / latent.variance[place] - 1.0).abs() < 1e-6, "{place}");
        assert!((spread(&wider) / spread(&plain) - 1.7 * 1.7).abs() < 1e-6, "{place}");
    }
}

#[test]
fn models_are_known_by_what_is_predicted_under_them() {
    let digest = |change: &dyn Fn(&mut Model)| {
        let mut model = model();
        change(&mut model);
        model.digest()
    };
    let plain = digest(&|_| {});
    assert!(plain.len() == 32 && plain == digest(&|_| {}));
    // What is for learning alone makes no other model.
    assert_eq!(plain, digest(&|model| model.chart.scale_m *= 2.0));
    let others = [
        digest(&|model| model.chart.origin.east_m += 1.0),
        digest(&|model| model.chart.reference = ReferenceSystem::Epsg(32619)),
        digest(&|model| model.fading = Fading::NONE),
        digest(&|model| model.inputs = InputSpec::PositionsAndDepths),
    ];
    for (n, other) in others.iter().enumerate() {
        assert!(*other != plain && !others[..n].contains(other), "{n}");
    }
}
