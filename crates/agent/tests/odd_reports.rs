//! Reports beyond what a vehicle keeps, and reports that say what no honest one says or what was said otherwise before.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use pingmap_packet::{Cell, Knot, Outcome, Recent, Report};

/// Vehicles that lie 900 m apart, and heard each other in every other slot.
fn still(members: usize, slots: u32) -> Trip {
    let turns =
        (0..members).map(|n| vec![Cell { east: 60 + 70 * n as u8, north: 128, depth: 0 }; slots as usize / 8 + 2]);
    let outcomes = (0..slots).map(|slot| vec![Some(slot % 4 < 2); members]).collect();
    let team = Team { track_off_max_m: 1e-6, tellings_max: 2, ..team(members, model()) };
    Trip { team: Arc::new(team), slots, turns: turns.collect(), outcomes }
}

#[test]
fn who_keeps_few_reports_tells_what_it_keeps_and_then_no_more() {
    let mut trip = still(2, 1200);
    // For a third of the time the other one lies near, and is heard.
    trip.turns[1][..50].fill(Cell { east: 70, north: 100, depth: 0 });
    trip.outcomes[..400].fill(vec![Some(true); 2]);
    for (max, points) in [(1, false), (2, false), (3, true)] {
        let team = Team { reports_per_sender_max: max, ..(*trip.team).clone() };
        let trip = Trip { team: Arc::new(team), ..trip.clone() };
        let mut agent = trip.vehicle(0).telling(Telling { points, reports: true });
        let frames = sent(&mut agent, 100);
        // A report goes for another one that says something new; and points are of what is too long ago to be kept.
        assert!(frames.len() < if points { 60 } else { 10 }, "{max}: {}", frames.len());
        let mut listener = trip.vehicle(1);
        frames.iter().for_each(|frame| drop(listener.receive(frame, 0.0)));
        assert!(listener.told_events().0 > 40 * usize::from(max), "{max}: {:?}", listener.told_events());
        assert!(listener.told_events().0 < 600, "too few reports for everything");
        assert_eq!(listener.live_packets() > 0, points);
    }
}

#[test]
fn two_places_at_one_time_are_no_way() {
    let trip = still(3, 48);
    let team = Team { slots: Slots::at_will(5.0, names(3)), ..(*trip.team).clone() };
    let mut agent = Agent::new(names(1).remove(0), Arc::new(team));
    agent.navigate([0.0, 400.0].map(|time_s| (time_s, Position::new(0.0, 0.0)))).unwrap();
    let knot = |slots, east| Knot { slots, east, north: 128, depth: 0 };
    // Slots 3 and 4 are of one stretch.
    for (sender, tells_own) in [(1, true), (2, true)] {
        let report = Report {
            sender,
            model: 0,
            first: 3,
            tells_own,
            outcomes: vec![Outcome::Heard; 12],
            knots: vec![knot(0, 10), knot(1, 250), knot(0, 90), knot(9, 40)],
            earlier: None,
        };
        let bytes = agent.write_report(&report).unwrap();
        assert_eq!(agent.receive(&bytes, 0.0), Receipt::Accepted);
    }
    assert!(agent.told_events().0 > 0);
    let is_somewhere = |event: Event| event.link.ends().iter().all(|end| end.east_m.is_finite());
    assert!(agent.unheard(0.0).into_iter().all(is_somewhere));
    assert!((0.0..=1.0).contains(&agent.probability(somewhere()[0]).unwrap()));
    agent.rebuild_posteriors().unwrap();
}

#[test]
fn what_a_report_says_otherwise_counts_at_once() {
    let trip = still(2, 16);
    let mut agent = Trip { outcomes: vec![vec![None; 2]; 16], ..trip.clone() }.vehicle(0);
    // Vehicle 0 sends in even slots, and saw the other one between.
    let seen = (0..9).map(|n| event_at(0, 20.0 * f64::from(n) - 1.0, trip.event(1, 0).unwrap().link, true));
    agent.observe_all(seen.map(|event| Event { transmitter_id: names(2).remove(1), ..event })).unwrap();
    // Of slots 14 and 15, number 7.
    let wrong = Recent { newest: 7, outcomes: (0..8).map(|n| (14 - 2 * n) % 4 >= 2).collect() };
    let report = sent(&mut trip.vehicle(1), 1).remove(0);
    let link = trip.event(0, 1).unwrap().link;
    let mut never = agent.clone();
    never.receive(&report, 0.0);
    assert_eq!(agent.receive_recent(&names(2)[1], 150.0, wrong.encode(), 14), Receipt::Accepted);
    assert_eq!(agent.told_events(), (8, 0));
    agent.refit().unwrap();
    agent.probability(link).unwrap();
    agent.receive(&report, 0.0);
    never.refit().unwrap();
    let (found, expected) = (agent.probability(link).unwrap(), never.probability(link).unwrap());
    assert!((found - expected).abs() < 0.05, "{found} {expected}");
    agent.rebuild_posteriors().unwrap();
    never.rebuild_posteriors().unwrap();
    assert_eq!(agent.probability(link).unwrap(), never.probability(link).unwrap());
}

/// A place between two fixes is another one when a fix between these is recorded late, whether or not something came since somebody
/// last asked.
#[test]
fn a_late_place_moves_what_was_told() {
    let trip = still(2, 48);
    let reports = trip.reports_under_way(1);
    for last in [reports.len(), reports.len() - 1] {
        let mut agent = Agent::new(names(1).remove(0), trip.team.clone());
        let fix = |time_s: f64, east_m: f64| (time_s, Position::new(east_m, 0.0));
        agent.navigate([fix(0.0, 0.0), fix(105.0, 0.0), fix(165.0, 900.0), fix(475.0, 900.0)]).unwrap();
        reports[..last].iter().for_each(|report| drop(agent.receive(report, 0.0)));
        let before = latent(&mut agent);
        reports[last..].iter().for_each(|report| drop(agent.receive(report, 0.0)));
        agent.navigate([fix(135.0, 0.0)]).unwrap();
        let again = restored(&agent, &agent.snapshot());
        let latents = [agent, again].map(|mut agent| {
            agent.rebuild_posteriors().unwrap();
            latent(&mut agent)
        });
        assert_eq!(latents[0], latents[1]);
        assert_ne!(latents[0], before);
    }
}
