//! Offsets of receivers, transmitters, times and kinds of messages: vehicles differ, and conditions change.

use std::sync::Arc;

use crate::common::summaries_alone;
use pingmap_agent::*;

const NAMES: [&str; 4] = ["ada", "bob", "eve", "joe"];

/// Two hours in which all vehicles hear transmissions over less than about 500 m, except where `missed` holds.
fn events(missed: impl Fn(&str, &str, f64) -> bool) -> Vec<Event> {
    events_of_rounds(60, missed)
}

/// Events as in [`events`], with three receivers in each of these rounds.
fn events_of_rounds(rounds: u32, missed: impl Fn(&str, &str, f64) -> bool) -> Vec<Event> {
    let mut events = Vec::new();
    for n in 0..rounds {
        let time_s = 120.0 * f64::from(n);
        let place = |vehicle: usize| {
            let phase = f64::from(n) * (0.37 + 0.11 * vehicle as f64) + vehicle as f64;
            Position::new(400.0 * phase.sin(), 400.0 * (1.7 * phase).cos())
        };
        let sender = n as usize % NAMES.len();
        for receiver in (0..NAMES.len()).filter(|&receiver| receiver != sender) {
            let link = Link { transmitter: place(sender), receiver: place(receiver) };
            // Deterministic noise with both signs everywhere.
            let noise = 150.0 * (f64::from(n) * 2.4 + receiver as f64 * 1.3).sin();
            let success = link.range_m() + noise < 500.0 && !missed(NAMES[sender], NAMES[receiver], time_s);
            let (transmitter_id, receiver_id) = (VehicleId::new(NAMES[sender]), VehicleId::new(NAMES[receiver]));
            events.push(Event { time_s, transmitter_id, receiver_id, link, kind: None, success });
        }
    }
    events
}

fn learned(events: &[Event]) -> LearnedModel {
    let chart = Chart::about(events.iter().flat_map(|event| event.link.ends()));
    Learning::default().best(chart, InputSpec::Positions, events, &[]).unwrap()
}

fn has(fit: &LearnedModel, term: OptionalTerm) -> bool {
    fit.structure.additions.has(term)
}

fn team(fit: &LearnedModel, events: &[Event]) -> Team {
    let reach = events.iter().flat_map(|event| event.link.ends());
    Team::new(NAMES.map(VehicleId::new), fit.model.clone(), reach).unwrap()
}

/// A vehicle that sends summaries, with those of the events that it received.
fn agent(team: &Arc<Team>, name: &str, events: &[Event]) -> Agent {
    let id = VehicleId::new(name);
    let mut agent = Agent::new(id.clone(), team.clone(), summaries_alone());
    agent.record(events.iter().filter(|event| event.receiver_id == id).cloned()).unwrap();
    agent.rebuild().unwrap();
    agent
}

/// Sends summaries until nothing is worth a frame.
fn share(sender: &mut Agent, listener: &mut Agent) {
    while let Some(packet) = sender.next_frame(Some(8000.0), 32).unwrap().map(|frame| frame.bytes) {
        assert_eq!(listener.receive(&packet, Some(8000.0)).receipt, Receipt::Accepted);
    }
}

fn east(range_m: f64) -> Link {
    Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(range_m, 0.0) }
}

/// The probability over a short link between these vehicles at this time.
fn short_link(fit: &LearnedModel, transmitter: Vehicle, receiver: Vehicle, when: Time) -> f64 {
    let inputs = fit.model.inputs([LinkQuery { transmitter, receiver, when, ..LinkQuery::from(east(120.0)) }]).unwrap();
    fit.learned.fit.posterior().unwrap().probability(&inputs).unwrap()[0]
}

fn vehicle(name: &str) -> Vehicle {
    (&VehicleId::new(name)).into()
}

#[test]
fn no_offsets_are_learned_for_equal_vehicles() {
    let fit = learned(&events(|_, _, _| false));
    for term in [OptionalTerm::Receivers, OptionalTerm::Transmitters, OptionalTerm::Time] {
        assert!(!has(&fit, term), "{}", fit.structure);
    }
}

#[test]
fn screening_rejects_a_term_of_equal_vehicles_and_passes_a_true_one() {
    let attempts = |events: &[Event]| {
        let (learning, events) = (Learning::default(), events.iter().collect::<Vec<_>>());
        let chart = Chart::about(events.iter().flat_map(|event| event.link.ends()));
        let first = learning.first_attempt(chart, InputSpec::Positions, &events, &[]).unwrap();
        let receivers = learning.try_term(OptionalTerm::Receivers, &first, &events, &[]).unwrap();
        (first, receivers)
    };
    let (first, equal) = attempts(&events_of_rounds(120, |_, _, _| false));
    assert!(first.is_accepted && !equal.is_accepted);
    assert_eq!((first.model.events_used, first.is_screened_out), (360, false));
    assert_eq!((equal.model.events_used, equal.is_screened_out), (180, true));
    // The values are those of all events plus the change on some, which is small for a needless term.
    assert!((equal.leave_one_out - first.leave_one_out).abs() < 0.01);
    assert!((equal.evidence_per_event - first.evidence_per_event).abs() < 0.01);
    assert!((equal.model.evidence_per_event() - first.evidence_per_event).abs() > 0.01);
    let (_, deaf) = attempts(&events_of_rounds(120, |_, receiver, _| receiver == "joe"));
    assert!(deaf.is_accepted);
    assert_eq!((deaf.model.events_used, deaf.is_screened_out), (360, false));
    // Short logs are not screened.
    let (_, short) = attempts(&events_of_rounds(99, |_, _, _| false));
    assert_eq!((short.is_accepted, short.model.events_used, short.is_screened_out), (false, 297, false));
}

#[test]
fn a_deaf_receiver_has_an_offset_and_does_not_change_predictions_for_others() {
    let (equal, deaf) = (events(|_, _, _| false), events(|_, receiver, _| receiver == "joe"));
    let (equal, fit) = (learned(&equal), learned(&deaf));
    assert!(has(&fit, OptionalTerm::Receivers), "{}", fit.structure);
    let typical = |fit: &LearnedModel, receiver| short_link(fit, Vehicle::Typical, receiver, Time::Typical);
    for name in ["ada", "bob", "eve"] {
        let (found, expected) = (typical(&fit, vehicle(name)), typical(&equal, vehicle(name)));
        assert!(found > expected - 0.1, "{name}: {found}, {expected}");
    }
    assert!(typical(&fit, vehicle("joe")) < 0.2);
    // A new vehicle may be deaf, too.
    let (new, known) = (typical(&fit, Vehicle::New), typical(&fit, vehicle("ada")));
    assert!(new < known && new > typical(&fit, vehicle("joe")), "{new} {known}");
}

#[test]
fn a_weak_transmitter_has_an_offset_and_its_receivers_have_none() {
    let fit = learned(&events(|sender, _, _| sender == "eve"));
    assert!(has(&fit, OptionalTerm::Transmitters) && !has(&fit, OptionalTerm::Receivers), "{}", fit.structure);
    let from = |name| short_link(&fit, vehicle(name), Vehicle::Typical, Time::Typical);
    assert!(from("eve") < 0.2 && from("ada") > 0.7, "{} {}", from("eve"), from("ada"));
    assert!(short_link(&fit, Vehicle::Typical, vehicle("eve"), Time::Typical) > 0.6);
}

#[test]
fn temporary_noise_is_learned_as_a_function_of_time() {
    let fit = learned(&events(|_, _, time_s| (2400.0..4800.0).contains(&time_s)));
    assert!(has(&fit, OptionalTerm::Time), "{}", fit.structure);
    let at = |when| short_link(&fit, Vehicle::Typical, Vehicle::Typical, when);
    let [before, during, after] = [1200.0, 3600.0, 6600.0].map(|time_s| at(Time::At(time_s)));
    assert!(before > 0.7 && during < 0.2 && after > 0.7, "{before} {during} {after}");
    // On another day the noise of that time may be any.
    let another = at(Time::AnotherDay);
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
fn a_fast_kind_of_message_has_an_offset() {
    let events = of_two_kinds();
    let fit = learned(&events);
    assert!(has(&fit, OptionalTerm::Kinds), "{}", fit.structure);
    let options = AgentOptions { record_all_receivers: true, ..AgentOptions::default() };
    let mut agent = Agent::new(VehicleId::new("all"), Arc::new(team(&fit, &events)), options);
    agent.record(events.clone()).unwrap();
    agent.refit().unwrap();
    let mut of = |kind| agent.probability(LinkQuery { kind, ..LinkQuery::from(east(330.0)) }).unwrap();
    let [slow, fast] = ["slow", "fast"].map(|name| of((&MessageKind::new(name)).into()));
    let (typical, unknown) = (of(Kind::Typical), of((&MessageKind::new("faster")).into()));
    assert!(
        slow > fast + 0.3 && (fast..slow).contains(&typical) && (fast..slow).contains(&unknown),
        "{slow} {typical} {fast}"
    );
    // With one kind only, the term is not tried.
    let one: Vec<&Event> = events.iter().filter(|event| event.kind == events[0].kind).collect();
    assert!(!Learning::default().additions_to(&one, InputSpec::Positions).contains(&OptionalTerm::Kinds));
    assert!(
        Learning::default()
            .additions_to(&events.iter().collect::<Vec<_>>(), InputSpec::Positions)
            .contains(&OptionalTerm::Kinds)
    );
}

#[test]
fn summaries_describe_messages_of_a_typical_kind() {
    let events = of_two_kinds();
    let fit = learned(&events);
    let team = Arc::new(team(&fit, &events));
    let [mut ada, mut bob] = ["ada", "bob"].map(|name| agent(&team, name, &events));
    share(&mut ada, &mut bob);
    let to_ada = |kind| LinkQuery { receiver: vehicle("ada"), kind, ..LinkQuery::from(east(330.0)) };
    let kinds = ["slow", "fast"].map(|name| (&MessageKind::new(name)).into());
    let [slow, fast] = kinds.map(|kind| ada.probability(to_ada(kind)).unwrap());
    let [received_slow, received_fast] = kinds.map(|kind| bob.probability(to_ada(kind)).unwrap());
    assert!(received_slow > received_fast + 0.2, "{received_slow} {received_fast}");
    assert!(
        (received_slow - slow).abs() < 0.2 && (received_fast - fast).abs() < 0.2,
        "{slow} {fast} {received_slow} {received_fast}"
    );
}

/// Offsets do not depend on positions, so that the path term stays reciprocal.
#[test]
fn a_typical_vehicle_has_no_offset() {
    let fit = learned(&events(|_, receiver, _| receiver == "joe"));
    let kernel = fit.model.prior.kernel();
    let variance = |receiver| {
        let link = Link { transmitter: Position::new(5e6, 0.0), receiver: Position::new(-5e6, 0.0) };
        let query = LinkQuery { receiver, ..LinkQuery::from(link) };
        kernel.diagonal(&fit.model.inputs([query]).unwrap()).unwrap()[0]
    };
    let offset = variance(Vehicle::New) - variance(Vehicle::Typical);
    let label = kernel.terms().iter().find(|term| term.correlations()[0].shape() == dgpc::Shape::Label);
    assert!((offset - label.unwrap().variance()).abs() < 1e-9, "{offset}");
    assert_eq!(variance(Vehicle::New), variance(vehicle("ada")));
}

#[test]
fn summaries_of_a_deaf_member_change_predictions_for_that_member_alone() {
    let events = events(|_, receiver, _| receiver == "joe");
    let team = Arc::new(team(&learned(&events), &events));
    let [mut ada, mut joe] = ["ada", "joe"].map(|name| agent(&team, name, &events));
    let to = |name: &str| LinkQuery { receiver: vehicle(name), ..LinkQuery::from(east(120.0)) };
    let [ada_before, joe_before] = ["ada", "joe"].map(|name| ada.probability(to(name)).unwrap());
    share(&mut joe, &mut ada);
    let [ada_after, joe_after] = ["ada", "joe"].map(|name| ada.probability(to(name)).unwrap());
    assert!(ada_after > ada_before - 0.05, "{ada_before} {ada_after}");
    assert!(joe_after < 0.25 && joe_after < joe_before - 0.2, "{joe_before} {joe_after}");
}

#[test]
fn summaries_carry_the_time_of_their_events() {
    let is_noon = |time_s: f64| (2400.0..4800.0).contains(&time_s);
    let events = events(|_, _, time_s| is_noon(time_s));
    let team = team(&learned(&events), &events);
    let noisy: Vec<Event> = events.iter().filter(|event| is_noon(event.time_s)).cloned().collect();
    let evening_less_noon = |grid: Grid| {
        let team = Arc::new(Team { grid, ..team.clone() });
        let (mut ada, mut bob) = (agent(&team, "ada", &[]), agent(&team, "bob", &noisy));
        share(&mut bob, &mut ada);
        let at = |time_s| LinkQuery { when: Time::At(time_s), ..LinkQuery::from(east(120.0)) };
        let [noon, evening] = [3600.0, 7200.0].map(|time_s| ada.probability(at(time_s)).unwrap());
        evening - noon
    };
    let with_time = evening_less_noon(team.grid.spanning(events.iter().map(|event| event.time_s)));
    // Outside the time cells of the grid, packets describe a typical time.
    let without_time = evening_less_noon(Grid { start_s: 1e6, ..team.grid });
    assert!(with_time > 0.15 && without_time.abs() < 0.02, "{with_time} {without_time}");
}
