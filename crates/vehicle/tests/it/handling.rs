//! One vehicle as a state machine: which slots count, and what its host learns.

use pingmap_agent::{Agent, AgentOptions, Entry, Event, Link, Position, VehicleId};
use pingmap_packet::OutcomeBitmap;
use pingmap_vehicle::{
    At, Departed, End, FaultCode, FrameIn, FrameLink, FrameRequest, Heard, Hex, Input, LearnedEvent, Listening,
    Message, Nav, Nmea, PeerSource, Predict, QueryLink, Token,
};

use crate::host::*;

#[test]
fn every_slot_of_a_peer_counts_as_heard_or_missed() {
    let mut host = Host::new("");
    host.cycles(|cycle| cycle % 3 == 0, |_, _, _| {});
    let outcomes: Vec<bool> = host.events.iter().map(|event| event.heard).collect();
    assert_eq!(outcomes, [true, false, false, true, false, false, true, false, false, true]);
    assert!(host.events.iter().all(|event| event.probability.is_some() && event.by_range.is_some()));
    assert_eq!(host.status().own_events, 10);
    assert_eq!(host.vehicle.agent().events().next().unwrap().link.transmitter, Position::new(300.0, 0.0));
}

#[test]
fn whether_a_slot_counts_does_not_depend_on_whether_it_was_heard() {
    let counted = |heard: bool| {
        let mut host = Host::new("");
        host.cycles(
            |_| heard,
            |host, cycle, begin_s| match cycle {
                2 => {
                    let (from, to, not) = (begin_s + 4.0, begin_s + 5.0, Some("pinging".into()));
                    host.send(Input::Listening(Listening { from, to, not }));
                }
                4 => {
                    let position = place(0.0);
                    let nav = Nav { time: begin_s, clock_sigma: None, position, sigma: None, surfaced: true };
                    host.send(Input::Nav(nav));
                }
                6 => {
                    let position = place(0.0);
                    let nav = Nav { time: begin_s, clock_sigma: Some(4.0), position, sigma: None, surfaced: false };
                    host.send(Input::Nav(nav));
                }
                _ => {}
            },
        );
        let times: Vec<f64> = host.events.iter().map(|event| event.time).collect();
        (times, host.status().excluded_slots)
    };
    let (times, excluded) = counted(true);
    assert_eq!((times.clone(), excluded.clone()), counted(false));
    assert_eq!(times, [10.0, 30.0, 70.0, 110.0, 150.0, 170.0, 190.0]);
    let reasons: Vec<(&str, u64)> = excluded.iter().map(|(reason, &count)| (reason.as_str(), count)).collect();
    assert_eq!(reasons, [("clock uncertain", 1), ("pinging", 1), ("surfaced", 1)]);
}

#[test]
fn outcomes_without_positions_count_when_positions_arrive() {
    let mut host = Host::new("");
    for cycle in 0..5 {
        let begin_s = 2.0 * SLOT_S * f64::from(cycle);
        host.nav(begin_s);
        host.nav(begin_s + SLOT_S + 1.0);
        host.hear(begin_s + SLOT_S + 2.0);
    }
    host.nav(120.0);
    let status = host.status();
    assert_eq!((status.own_events, status.located_events, status.unlocated_events), (0, 0, 5));
    assert!(host.events.iter().all(|event| event.probability.is_none()));
    host.peer(0.0, PeerSource::Other);
    host.peer(110.0, PeerSource::Other);
    let status = host.status();
    assert_eq!((status.located_events, status.unlocated_events), (5, 0));
}

#[test]
fn a_reception_after_its_slot_was_counted_is_reported_as_late() {
    let mut host = Host::new("");
    host.cycles(|_| false, |_, _, _| {});
    host.hear(12.0);
    assert_eq!(host.status().late_receptions, 1);
    assert_eq!(host.status().own_events, 10);
}

#[test]
fn trust_follows_from_predictions_that_were_made_before_the_events() {
    let mut host = Host::new("");
    host.nav(0.0);
    let before = host.predict(300.0);
    assert!(!before.trusted && before.reason.unwrap().starts_with("0 of 20 events"));
    host.cycles(|_| true, |_, _, _| {});
    let trust = host.status().trust;
    let nll = |of: fn(&LearnedEvent) -> Option<f64>| {
        host.events.iter().map(|event| -of(event).unwrap().ln()).sum::<f64>() / host.events.len() as f64
    };
    assert!((trust.map_nll.unwrap() - nll(|event| event.probability)).abs() < 1e-9);
    assert!((trust.range_nll.unwrap() - nll(|event| event.by_range)).abs() < 1e-9);
    let evidence = 10.0 * (trust.range_nll.unwrap() - trust.map_nll.unwrap());
    assert!((trust.map_weight - 1.0 / (1.0 + (-evidence).exp())).abs() < 1e-9);
    let after = host.predict(300.0);
    assert!(!after.trusted && after.reason.unwrap().starts_with("10 of 20 events"));
    assert!(after.low <= after.probability && after.probability <= after.high && after.probability > 0.8);
    let restored = host.restarted().status().trust;
    assert_eq!(restored, trust);
}

#[test]
fn positions_in_messages_alone_give_scores_that_do_not_depend_on_the_outcome() {
    // The position has the time at which it arrived, or the earlier time at which Bob measured it.
    for lead_s in [0.0, 6.0, 20.0, -8.5] {
        let scored = |heard: bool| {
            let mut host = Host::new("");
            for cycle in 0..12 {
                let begin_s = 2.0 * SLOT_S * f64::from(cycle);
                host.nav(begin_s);
                host.nav(begin_s + SLOT_S + 1.0);
                // Bob is heard in the first cycle. A message gives his position.
                if cycle == 0 || heard {
                    host.hear(begin_s + SLOT_S + 2.0);
                    host.peer(begin_s + SLOT_S + 2.0 - lead_s, PeerSource::Message);
                }
            }
            host.nav(260.0);
            host.events.iter().map(|event| (event.time, event.probability.is_some())).collect::<Vec<_>>()
        };
        let (heard, missed) = (scored(true), scored(false));
        assert!(!heard[0].1 && heard[1..].iter().all(|event| event.1), "{heard:?}");
        assert_eq!(heard, missed);
    }
}

#[test]
fn before_any_event_the_answer_is_that_of_the_conservative_range() {
    let mut host = Host::new("conservative_range_m = 500");
    host.nav(0.0);
    let [near, middle, far] = [0.0, 500.0, 1000.0].map(|east_m| host.predict(east_m));
    assert!((middle.probability - 0.5).abs() < 1e-12 && middle.probability == middle.by_range);
    assert!((near.probability + far.probability - 1.0).abs() < 1e-12 && near.probability > 0.98);
    assert!(near.low <= near.probability && near.probability <= near.high);
    host.cycles(|_| true, |_, _, _| {});
    let after = host.predict(500.0);
    assert!(after.probability > 0.5 && (after.by_range - 0.5).abs() < 1e-12);
    // An outcome that was located later is an event, too. It was not predicted before.
    let mut host = Host::new("conservative_range_m = 500");
    host.nav(0.0);
    host.nav(SLOT_S + 1.0);
    host.hear(SLOT_S + 2.0);
    host.nav(3.0 * SLOT_S);
    host.peer(0.0, PeerSource::Other);
    host.peer(2.0 * SLOT_S, PeerSource::Other);
    let status = host.status();
    assert_eq!((status.trust.events, status.located_events), (0, 1));
    let located = host.predict(300.0);
    assert!(located.probability != located.by_range, "{located:?}");
}

#[test]
fn a_prediction_uses_the_data_that_arrived_before_its_slot() {
    // Bob's bits say that he heard Ada. They arrive before the last slot, or in it.
    let bits = OutcomeBitmap { slot_mod: 18, outcomes: vec![true; 10] }.encode();
    let predicted = |after_s: Option<f64>| {
        let mut host = Host::new("");
        host.cycles(
            |cycle| cycle < 9,
            |host, cycle, begin_s| {
                if let Some(after_s) = after_s.filter(|_| cycle == 9) {
                    host.receive_bits(begin_s + after_s, bits);
                }
            },
        );
        (host.events.last().unwrap().probability.unwrap(), host.status().located_events)
    };
    let [(without, none), (before, early), (within, late)] = [None, Some(-1.0), Some(2.0)].map(predicted);
    assert!(none == 0 && early > 0 && late > 0, "{early} {late}");
    assert_ne!(without, before);
    assert_eq!(without, within);
}

#[test]
fn a_prediction_after_a_gap_uses_no_data_that_arrived_in_its_slot() {
    let bits = OutcomeBitmap { slot_mod: 18, outcomes: vec![true; 10] }.encode();
    // The first report comes before the slot, or at its begin.
    for first_s in [408.0, 410.0] {
        let predicted = |receives_bits: bool| {
            let mut host = Host::new("");
            host.cycles(|_| true, |_, _, _| {});
            host.nav(first_s);
            host.peer(first_s, PeerSource::Other);
            if receives_bits {
                host.receive_bits(411.0, bits);
            }
            for time_s in [413.0, 418.0, 425.0, 440.0] {
                host.nav(time_s);
                host.peer(time_s, PeerSource::Other);
            }
            let event = host.events.iter().find(|event| event.time == 410.0).unwrap();
            (event.heard, event.probability.unwrap(), host.status().located_events)
        };
        let ((missed, without, none), (heard, with, some)) = (predicted(false), predicted(true));
        assert!(!missed && heard && none == 0 && some > 0, "{some}");
        assert_eq!(without, with);
    }
}

#[test]
fn a_prediction_of_a_slot_without_navigation_uses_all_data_from_before_it() {
    let bits = OutcomeBitmap { slot_mod: 16, outcomes: vec![true; 9] }.encode();
    let predicted = |has_bits: bool, is_heard: bool| {
        let mut host = Host::new("");
        for second in 0..230 {
            let time_s = f64::from(second);
            // No navigation in the slots at 180 and 190 seconds.
            if second % 5 == 1 && !(180..200).contains(&second) {
                host.nav(time_s);
            }
            if second % 5 == 1 {
                host.peer(time_s, PeerSource::Other);
            }
            if second % 20 == 1 && second < 200 {
                host.send(Input::Sent(At { time: time_s, kind: None }));
            }
            if second == 175 && has_bits {
                host.receive_bits(time_s, bits);
            }
            if second == 193 && is_heard {
                host.hear(time_s);
            }
        }
        let event = host.events.iter().find(|event| event.time == 190.0).unwrap();
        assert_eq!(event.heard, is_heard);
        event.probability.unwrap()
    };
    let [[missed, heard], [with_missed, with_heard]] =
        [false, true].map(|has_bits| [false, true].map(|is_heard| predicted(has_bits, is_heard)));
    assert_eq!((missed, with_missed), (heard, with_heard));
    assert_ne!(missed, with_missed);
}

#[test]
fn the_predictions_of_a_heard_and_of_a_missed_slot_use_the_same_events() {
    // Bob has two slots in a row. The first of them counts while the second one lasts.
    let predicted = |is_last_heard: bool| {
        let mut host = Host::with_order("", &["ada", "bob", "bob"]);
        for second in 0..122 {
            let time_s = f64::from(second);
            host.nav(time_s);
            host.peer(time_s, PeerSource::Other);
            let is_last = second == 112;
            if second % 10 == 2 && second % 30 > 10 && (is_last_heard || !is_last) {
                let frames = vec![Hex(vec![0; 32])];
                host.send(Input::Heard(Heard { time: time_s, from: VehicleId::new("bob"), kind: None, frames }));
            }
        }
        host.nav(126.0);
        let last = host.events.pop().unwrap();
        assert_eq!((last.time, last.heard), (110.0, is_last_heard));
        last.probability.unwrap()
    };
    assert_eq!(predicted(true), predicted(false));
}

#[test]
fn a_reception_that_is_reported_twice_is_not_late() {
    let mut host = Host::new("");
    host.cycles(|cycle| cycle == 9, |_, _, _| {});
    host.hear(192.5);
    assert_eq!(host.status().late_receptions, 0);
    host.hear(172.5);
    assert_eq!(host.status().late_receptions, 1);
}

#[test]
fn receptions_in_a_slot_of_another_member_are_one_outcome() {
    let mut host = Host::new("");
    [0.0, 0.5].into_iter().for_each(|time_s| host.nav(time_s));
    (0..50).for_each(|n| drop(host.hear(1.0 + 0.1 * f64::from(n))));
    assert_eq!(host.entries(0, |entry| matches!(entry, Entry::Outcome { .. })), 1);
}

#[test]
fn a_dropped_frame_is_sent_again_and_tokens_are_checked() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let request = |host: &mut Host, time: f64| match host.send(Input::FrameRequest(FrameRequest { time, bytes: 32 })) {
        Message::Frame { token, bytes, .. } => Some((token, bytes)),
        Message::Nothing { .. } => None,
        other => panic!("{other:?}"),
    };
    let (first, bytes) = request(&mut host, 240.0).unwrap();
    host.send(Input::Dropped(Token { token: first }));
    let (second, again) = request(&mut host, 240.0).unwrap();
    assert!(second > first && again == bytes);
    assert_eq!(host.status().open_frames, 1);
    host.send(Input::Departed(Departed { token: second, time: 240.5 }));
    assert_eq!(host.status().open_frames, 0);
    assert_eq!(code(&host.send(Input::Dropped(Token { token: 99 }))), FaultCode::UnknownToken);
    let small = host.send(Input::FrameRequest(FrameRequest { time: 260.0, bytes: 5 }));
    assert_eq!(code(&small), FaultCode::OutOfBounds);
}

#[test]
fn a_frame_by_an_acoustic_link_names_its_sender_and_shows_that_its_slot_was_heard() {
    let mut host = Host::new("");
    host.nav(0.0);
    let bytes = Hex(vec![0; 32]);
    let nameless = FrameIn { time: 11.0, from: None, bytes: bytes.clone(), link: FrameLink::Acoustic };
    assert_eq!(code(&host.send(Input::FrameIn(nameless))), FaultCode::WrongField);
    host.peer(5.0, PeerSource::Other);
    let frame = FrameIn { time: 11.0, from: Some(VehicleId::new("bob")), bytes, link: FrameLink::Acoustic };
    // A damaged frame counts as a reception, too.
    assert!(matches!(host.send(Input::FrameIn(frame)), Message::Acknowledgement { counts: false, .. }));
    host.peer(25.0, PeerSource::Other);
    host.nav(30.0);
    assert_eq!(host.events.iter().map(|event| event.heard).collect::<Vec<_>>(), [true]);
}

#[test]
fn sentences_of_a_modem_show_receptions_and_transmissions() {
    let mut host = Host::new("[modem_ids]\n1 = \"ada\"\n2 = \"bob\"\n");
    host.nav(0.0);
    let mut say = |time: f64, sentence: &str| {
        let answer = host.send(Input::Nmea(Nmea { time, sentence: sentence.into() }));
        assert!(matches!(answer, Message::Ok { .. }), "{answer:?}");
    };
    say(10.5, "$CACYC,0,2,1,0,0,1");
    say(13.0, "$CARXD,2,1,0,1,00FF");
    say(14.0, "$CACST,0,120013,0,2,1,0,0,0,0,0,0,0");
    // No later sentence ends the message.
    host.peer(5.0, PeerSource::Other);
    host.peer(25.0, PeerSource::Other);
    host.nav(30.0);
    assert_eq!(host.events.iter().map(|event| event.heard).collect::<Vec<_>>(), [true]);
    let wrong = host.send(Input::Nmea(Nmea { time: 31.0, sentence: "$CARXD,2,1*00".into() }));
    assert_eq!(code(&wrong), FaultCode::WrongField);
}

#[test]
fn own_slots_without_a_transmission_are_reported_as_unused() {
    let unused = |reports: bool| {
        let mut host = Host::new(&format!("slots.reports_transmissions = {reports}"));
        host.cycles(|_| true, |_, _, _| {});
        // Two further own slots, from 220 s and from 240 s on, have no transmission.
        for time_s in [230.0, 245.0, 260.0] {
            host.nav(time_s);
        }
        host.unused_slots(0)
    };
    assert_eq!((unused(false), unused(true)), (0, 3));
}

#[test]
fn slots_that_the_sender_reports_as_unused_change_no_score() {
    let scores = |is_reported_early: bool| {
        let mut host = Host::new("");
        let mut bob = Agent::new(VehicleId::new("bob"), team(), AgentOptions::default());
        let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(300.0, 0.0) };
        let heard = |time_s| Event {
            time_s,
            transmitter_id: VehicleId::new("ada"),
            receiver_id: VehicleId::new("bob"),
            link,
            kind: None,
            success: true,
        };
        bob.record((0..10).map(|n| heard(2.0 * SLOT_S * f64::from(n)))).unwrap();
        bob.record_unused_slots((0..5).map(|n| 2.0 * SLOT_S * f64::from(2 * n + 1) + SLOT_S)).unwrap();
        bob.record_positions([(0.0, Position::new(300.0, 0.0)), (205.0, Position::new(300.0, 0.0))]).unwrap();
        let bytes = Hex(bob.next_frame(Some(210.0), 32).unwrap().unwrap().bytes);
        let report = |host: &mut Host| {
            let (from, bytes, link) = (Some(VehicleId::new("bob")), bytes.clone(), FrameLink::Other);
            let answer = host.send(Input::FrameIn(FrameIn { time: 212.0, from, bytes, link }));
            assert!(matches!(answer, Message::Acknowledgement { counts: true, .. }), "{answer:?}");
        };
        host.cycles(
            |cycle| cycle % 2 == 0,
            |host, cycle, _| {
                if cycle == 9 && is_reported_early {
                    report(host);
                }
            },
        );
        if !is_reported_early {
            assert_eq!(host.status().trust.events, 10);
            report(&mut host);
        }
        let trust = host.status().trust;
        assert_eq!(trust.events, 5, "only slots with transmissions");
        let missed = host.events.iter().filter(|event| !event.heard).count();
        assert!(host.vehicle.counting_events().count() == 5 && host.vehicle.agent().events().len() >= 9);
        assert_eq!(host.restarted().status().trust, trust);
        missed
    };
    // A slot that was known to be unused before it was counted gives no event.
    assert_eq!((scores(false), scores(true)), (5, 4));
}

#[test]
fn a_member_that_the_configuration_no_longer_mutes_counts_again() {
    let contents = Host::new("muted = [\"bob\"]").stopped();
    let is_muted = |more: &str| {
        let mut host = Host::with(config(more), team(), contents.clone());
        host.status().members[&VehicleId::new("bob")].ignored.contains_key("muted")
    };
    assert!(is_muted("muted = [\"bob\"]"));
    assert!(!is_muted(""));
}

#[test]
fn no_slot_counts_where_messages_were_dropped() {
    for is_heard in [false, true] {
        let mut host = Host::new("");
        let lose = |host: &mut Host, cycle, _| {
            if cycle == 4 {
                host.vehicle.note_lost_messages();
            }
        };
        host.cycles(|_| is_heard, lose);
        // The slot of the cycle before was not counted yet.
        assert_eq!(host.status().excluded_slots["messages dropped"], 2, "{is_heard}");
        assert_eq!(host.events.len(), 8);
        assert!(host.events.iter().all(|event| event.heard == is_heard));
    }
}

#[test]
fn a_loss_of_messages_between_the_first_two_reports_excludes_slots_and_claims_nothing() {
    for is_started in [false, true] {
        let mut host = Host::new("slots.reports_transmissions = true");
        if is_started {
            host.nav(0.0);
            host.nav(5.0);
            host = host.restarted();
        }
        host.nav(10.0);
        host.vehicle.note_lost_messages();
        host.peer(10.0, PeerSource::Other);
        host.peer(55.0, PeerSource::Other);
        // The own slot from 20 s on may have been used, and Bob's slots until 40 s may have been heard.
        [35.0, 40.0, 48.0].into_iter().for_each(|time_s| host.nav(time_s));
        assert_eq!(host.events, [], "{is_started}");
        assert_eq!(host.unused_slots(0), 0, "{is_started}");
    }
}

#[test]
fn transmissions_and_deaf_intervals_after_their_slot_was_counted_are_late() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    assert_eq!(host.status().late_reports, 0);
    host.send(Input::Sent(At { time: 22.0, kind: None }));
    host.send(Input::Listening(Listening { from: 12.0, to: 14.0, not: Some("pump".into()) }));
    assert_eq!(host.status().late_reports, 2);
    assert_eq!(Host::with(config(""), team(), host.stopped()).status().late_reports, 2);
}

#[test]
fn every_prediction_has_the_trust_of_the_status() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let link = QueryLink { from: End::Place(place(300.0)), to: End::Member(VehicleId::new("ada")) };
    let answer = host.send(Input::Predict(Predict { time: None, kind: None, links: vec![link] }));
    let Message::Prediction { trust, .. } = answer else { panic!("{answer:?}") };
    assert_eq!((trust, trust.events), (host.status().trust, 10));
}
