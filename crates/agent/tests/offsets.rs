//! Vehicles that differ, and water that changes.

#![allow(clippy::unwrap_used)]

use pingmap_agent::*;

/// Two hours in which everybody hears all that is sent over less than 500 m or so, but for what `missed` says.
fn events(missed: impl Fn(&str, &str, f64) -> bool) -> Vec<Event> {
    let names = ["ada", "bob", "eve", "joe"];
    let mut events = Vec::new();
    for n in 0..60 {
        let time_s = 120.0 * f64::from(n);
        let place = |who: usize| {
            let phase = f64::from(n) * (0.37 + 0.11 * who as f64) + who as f64;
            Position::new(400.0 * phase.sin(), 400.0 * (1.7 * phase).cos())
        };
        let sender = n as usize % names.len();
        for receiver in (0..names.len()).filter(|&receiver| receiver != sender) {
            let link = Link { transmitter: place(sender), receiver: place(receiver) };
            // A stand-in for chance that takes both sides everywhere.
            let noise = 150.0 * (f64::from(n) * 2.4 + receiver as f64 * 1.3).sin();
            let success = link.range_m() + noise < 500.0 && !missed(names[sender], names[receiver], time_s);
            let (transmitter_id, receiver_id) = (VehicleId::new(names[sender]), VehicleId::new(names[receiver]));
            events.push(Event { time_s, transmitter_id, receiver_id, link, kind: None, success });
        }
    }
    events
}

fn learned(events: &[Event]) -> LearnedModel {
    let chart = Chart::about(events.iter().flat_map(|event| event.link.ends()));
    Learning::default().best(chart, InputSpec::Positions, events, &[]).unwrap()
}

fn has(fit: &LearnedModel, addition: Addition) -> bool {
    fit.structure.additions.has(addition)
}

/// The probability over a short link, by who takes part and when.
fn near(fit: &LearnedModel, transmitter: Party, receiver: Party, when: When) -> f64 {
    let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(120.0, 0.0) };
    let inputs = fit.model.inputs([Attempt { transmitter, receiver, when, ..Attempt::from(link) }]).unwrap();
    fit.learned.fit.posterior().unwrap().probability(&inputs).unwrap()[0]
}

fn vehicle(name: &str) -> Party {
    (&VehicleId::new(name)).into()
}

#[test]
fn vehicles_that_are_alike_have_no_offsets() {
    let fit = learned(&events(|_, _, _| false));
    for addition in [Addition::Receivers, Addition::Transmitters, Addition::Time] {
        assert!(!has(&fit, addition), "{}", fit.structure);
    }
}

#[test]
fn a_deaf_vehicle_is_found_and_spoils_nobody_elses_map() {
    let (alike, deaf) = (events(|_, _, _| false), events(|_, receiver, _| receiver == "joe"));
    let (alike, fit) = (learned(&alike), learned(&deaf));
    assert!(has(&fit, Addition::Receivers), "{}", fit.structure);
    let typical = |fit: &LearnedModel, receiver| near(fit, Party::Typical, receiver, When::Typical);
    for name in ["ada", "bob", "eve"] {
        let (heard, expected) = (typical(&fit, vehicle(name)), typical(&alike, vehicle(name)));
        assert!(heard > expected - 0.1, "{name}: {heard}, {expected}");
    }
    assert!(typical(&fit, vehicle("joe")) < 0.2);
    // Somebody new may be deaf too.
    let (new, known) = (typical(&fit, Party::New), typical(&fit, vehicle("ada")));
    assert!(new < known && new > typical(&fit, vehicle("joe")), "{new} {known}");
}

#[test]
fn a_silent_vehicle_is_told_from_deaf_ones() {
    let fit = learned(&events(|sender, _, _| sender == "eve"));
    assert!(has(&fit, Addition::Transmitters) && !has(&fit, Addition::Receivers), "{}", fit.structure);
    let from = |name| near(&fit, vehicle(name), Party::Typical, When::Typical);
    assert!(from("eve") < 0.2 && from("ada") > 0.7, "{} {}", from("eve"), from("ada"));
    assert!(near(&fit, Party::Typical, vehicle("eve"), When::Typical) > 0.6);
}

#[test]
fn noise_that_comes_and_goes_is_the_waters_and_not_the_places() {
    let fit = learned(&events(|_, _, time_s| (2400.0..4800.0).contains(&time_s)));
    assert!(has(&fit, Addition::Time), "{}", fit.structure);
    let at = |when| near(&fit, Party::Typical, Party::Typical, when);
    let [before, during, after] = [1200.0, 3600.0, 6600.0].map(|time_s| at(When::At(time_s)));
    assert!(before > 0.7 && during < 0.2 && after > 0.7, "{before} {during} {after}");
    // What is known of another day is what is known of the place, less surely.
    let another = at(When::AnotherDay);
    assert!((during + 0.1..after).contains(&another), "{another}");
}

/// Every other round is sent fast, and heard over half the range.
fn of_two_kinds() -> Vec<Event> {
    let kinds = ["slow", "fast"].map(MessageKind::new);
    let of_kind = |event: Event| {
        let round = (event.time_s / 480.0) as usize;
        let success = event.success && (round.is_multiple_of(2) || event.link.range_m() < 250.0);
        Event { kind: Some(kinds[round % 2].clone()), success, ..event }
    };
    events(|_, _, _| false).into_iter().map(of_kind).collect()
}

#[test]
fn a_fast_message_is_harder_to_hear_and_tells_of_slow_ones() {
    let events = of_two_kinds();
    let fit = learned(&events);
    assert!(has(&fit, Addition::Kinds), "{}", fit.structure);
    let mut agent = Agent::new(VehicleId::new("all"), std::sync::Arc::new(team(&fit, &events))).owning_all_events();
    agent.observe_all(events.clone()).unwrap();
    agent.refit().unwrap();
    let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(330.0, 0.0) };
    let mut of = |kind| agent.probability(Attempt { kind, ..Attempt::from(link) }).unwrap();
    let [slow, fast] = ["slow", "fast"].map(|name| of((&MessageKind::new(name)).into()));
    let (typical, unheard_of) = (of(Kind::Typical), of((&MessageKind::new("faster")).into()));
    assert!(
        slow > fast + 0.3 && (fast..slow).contains(&typical) && (fast..slow).contains(&unheard_of),
        "{slow} {typical} {fast}"
    );
    // Where there is one kind only, nothing of the sort is tried.
    let one: Vec<&Event> = events.iter().filter(|event| event.kind == events[0].kind).collect();
    assert!(!Learning::default().additions_to(&one).contains(&Addition::Kinds));
    assert!(Learning::default().additions_to(&events.iter().collect::<Vec<_>>()).contains(&Addition::Kinds));
}

/// A packet speaks of a typical message, whatever kinds its sender heard.
#[test]
fn packets_speak_of_typical_messages() {
    let events = of_two_kinds();
    let fit = learned(&events);
    let team = std::sync::Arc::new(team(&fit, &events));
    let [mut ada, mut bob] = ["ada", "bob"].map(|name| {
        let name = VehicleId::new(name);
        let mut agent = Agent::new(name.clone(), team.clone());
        agent.observe_all(events.iter().filter(|event| event.receiver_id == name).cloned()).unwrap();
        agent.refit().unwrap();
        agent
    });
    while let Some(packet) = ada.next_packet(8000.0, 32).unwrap() {
        assert_eq!(bob.receive(&packet, 8000.0), Receipt::Accepted);
    }
    let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(330.0, 0.0) };
    let to_ada = |kind| Attempt { receiver: vehicle("ada"), kind, ..Attempt::from(link) };
    let [slow, fast] = ["slow", "fast"].map(|name| (&MessageKind::new(name)).into());
    let [knows_slow, knows_fast] = [slow, fast].map(|kind| ada.probability(to_ada(kind)).unwrap());
    let [told_slow, told_fast] = [slow, fast].map(|kind| bob.probability(to_ada(kind)).unwrap());
    assert!(told_slow > told_fast + 0.2, "{told_slow} {told_fast}");
    assert!(
        (told_slow - knows_slow).abs() < 0.2 && (told_fast - knows_fast).abs() < 0.2,
        "{knows_slow} {knows_fast} {told_slow} {told_fast}"
    );
}

fn team(fit: &LearnedModel, events: &[Event]) -> Team {
    let reach = events.iter().flat_map(|event| event.link.ends());
    Team::new(["ada", "bob", "eve", "joe"].map(VehicleId::new), fit.model.clone(), reach).unwrap()
}

/// Offsets are about who and when, so that swapping the ends of a link swaps them with it and the path stays reciprocal.
#[test]
fn a_typical_vehicle_at_a_typical_time_has_no_offset() {
    let fit = learned(&events(|_, receiver, _| receiver == "joe"));
    let variance = |receiver| {
        let link = Link { transmitter: Position::new(5e6, 0.0), receiver: Position::new(-5e6, 0.0) };
        let attempt = Attempt { receiver, ..Attempt::from(link) };
        fit.model.prior.kernel().diagonal(&fit.model.inputs([attempt]).unwrap()).unwrap()[0]
    };
    let offset = variance(Party::New) - variance(Party::Typical);
    let label =
        fit.model.prior.kernel().terms().iter().find(|term| term.correlations()[0].shape() == dgpc::Shape::Label);
    assert!((offset - label.unwrap().variance()).abs() < 1e-9, "{offset}");
    assert_eq!(variance(Party::New), variance(vehicle("ada")));
}

/// Everybody reads a packet as what its sender hears: a deaf member's packets lower nobody else's map.
#[test]
fn packets_of_a_deaf_member_say_that_it_is_deaf() {
    let events = events(|_, receiver, _| receiver == "joe");
    let fit = learned(&events);
    let names = ["ada", "bob", "eve", "joe"].map(VehicleId::new);
    let reach = events.iter().flat_map(|event| event.link.ends());
    let team = std::sync::Arc::new(Team::new(names.clone(), fit.model.clone(), reach).unwrap());
    let vehicle_of = |name: &VehicleId| {
        let points = Telling { points: true, reports: false };
        let mut agent = Agent::new(name.clone(), team.clone()).telling(points);
        agent.observe_all(events.iter().filter(|event| event.receiver_id == *name).cloned()).unwrap();
        agent.rebuild_posteriors().unwrap();
        agent
    };
    let mut ada = vehicle_of(&names[0]);
    let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(120.0, 0.0) };
    let of = |name: &VehicleId| Attempt { receiver: name.into(), ..Attempt::from(link) };
    let [own_before, joes_before] = [&names[0], &names[3]].map(|name| ada.probability(of(name)).unwrap());
    let mut joe = vehicle_of(&names[3]);
    while let Some(packet) = joe.next_packet(8000.0, 32).unwrap() {
        assert_eq!(ada.receive(&packet, 8000.0), Receipt::Accepted);
    }
    let [own_after, joes_after] = [&names[0], &names[3]].map(|name| ada.probability(of(name)).unwrap());
    assert!(own_after > own_before - 0.05, "{own_before} {own_after}");
    assert!(joes_after < 0.25 && joes_after < joes_before - 0.2, "{joes_before} {joes_after}");
}

/// What was noisy at noon says little of the evening, if the packet says that it was noon.
#[test]
fn packets_say_when_what_they_tell_was_true() {
    let is_noon = |time_s: f64| (2400.0..4800.0).contains(&time_s);
    let events = events(|_, _, time_s| is_noon(time_s));
    let fit = learned(&events);
    let names = ["ada", "bob"].map(VehicleId::new);
    let reach = events.iter().flat_map(|event| event.link.ends());
    let team = Team::new(names.clone(), fit.model.clone(), reach).unwrap();
    let evening_less_noon = |grid: Grid| {
        let team = std::sync::Arc::new(Team { grid, ..team.clone() });
        let points = Telling { points: true, reports: false };
        let mut bob = Agent::new(names[1].clone(), team.clone()).telling(points);
        let noisy = events.iter().filter(|event| event.receiver_id == names[1] && is_noon(event.time_s));
        bob.observe_all(noisy.cloned()).unwrap();
        bob.rebuild_posteriors().unwrap();
        let mut ada = Agent::new(names[0].clone(), team);
        while let Some(packet) = bob.next_packet(8000.0, 32).unwrap() {
            assert_eq!(ada.receive(&packet, 8000.0), Receipt::Accepted);
        }
        let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(120.0, 0.0) };
        let at = |time_s| Attempt { when: When::At(time_s), ..Attempt::from(link) };
        let [noon, evening] = [3600.0, 7200.0].map(|time_s| ada.probability(at(time_s)).unwrap());
        evening - noon
    };
    let told = evening_less_noon(team.grid.spanning(events.iter().map(|event| event.time_s)));
    // A mission on another clock: its packets speak of a typical time.
    let untold = evening_less_noon(Grid { start_s: 1e6, ..team.grid });
    assert!(told > 0.15 && untold.abs() < 0.02, "{told} {untold}");
}
