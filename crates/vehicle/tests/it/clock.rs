//! The clock of a vehicle: starts, gaps, wrong times, and slots that do not count because of them.

use pingmap_agent::{Agent, AgentOptions, Event, Link, Position, VehicleId};
use pingmap_vehicle::{At, FaultCode, FrameIn, FrameLink, Hex, Input, Listening, Message, Nav, PeerSource};

use crate::host::*;

#[test]
fn slots_do_not_count_across_a_restart_or_a_gap_without_inputs() {
    let mut host = Host::new("clock.gap_s = 60");
    host.cycles(|_| true, |_, _, _| {});
    // The slot from 230 s on is under way when the process ends.
    host.peer(225.0, PeerSource::Other);
    host.hear(231.0);
    let before = host.status().own_events;
    let mut host = host.restarted();
    assert_eq!(host.status().own_events, before);
    host.nav(235.0);
    for time_s in [245.0, 255.0, 265.0] {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    // Slot 23 is excluded, slot 25 counts, and the slots in the gap do not.
    host.nav(400.0);
    host.nav(460.0);
    let times: Vec<f64> = host.events.iter().map(|event| event.time).collect();
    assert_eq!(times, [250.0, 410.0, 430.0, 450.0][..times.len()], "{times:?}");
    let excluded = host.status().excluded_slots;
    assert!(excluded["the vehicle was not running"] >= 1 && excluded["no input from the host"] >= 5, "{excluded:?}");
}

#[test]
fn a_slot_that_continues_counts_after_its_last_part() {
    let mut host = Host::with_order("", &["ada", "bob", "", ""]);
    host.nav(0.0);
    for time_s in [10.0, 20.0, 30.0, 38.0] {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    assert_eq!(host.events, []);
    // The message ends in the last part of the slot.
    host.hear(39.0);
    host.nav(46.0);
    assert_eq!(host.events.iter().map(|event| (event.time, event.heard)).collect::<Vec<_>>(), [(10.0, true)]);
    assert_eq!(host.status().late_receptions, 0);
}

#[test]
fn receptions_and_positions_of_peers_do_not_move_the_clock() {
    let counted = |is_heard: bool| {
        let mut host = Host::new("clock.gap_s = 60");
        host.nav(0.0);
        host.peer(0.0, PeerSource::Other);
        host.peer(190.0, PeerSource::Other);
        for cycle in 0..9 {
            let begin_s = 2.0 * SLOT_S * f64::from(cycle);
            if is_heard {
                host.hear(begin_s + SLOT_S + 2.0);
            }
        }
        assert_eq!(host.status().time, 0.0);
        [189.0, 190.0, 196.0].into_iter().for_each(|time_s| host.nav(time_s));
        (host.events.len(), host.status().excluded_slots)
    };
    assert_eq!(counted(true), counted(false));
    assert_eq!(counted(true).0, 0);
}

#[test]
fn a_single_wrong_time_does_not_move_the_clock() {
    let mut host = Host::new("");
    host.cycles(
        |_| true,
        |host, cycle, _| {
            if cycle == 4 {
                host.nav(50_000.0)
            }
        },
    );
    assert_eq!(host.events.len(), 10);
    // The second report confirms that time has passed.
    host.nav(5000.0);
    assert_eq!(host.status().time, 220.0);
    host.nav(5001.0);
    assert_eq!(host.status().time, 5001.0);
    // A gap of more than a day is refused once.
    let nav = |time| Input::Nav(Nav { time, clock_sigma: None, position: place(0.0), sigma: None, surfaced: false });
    assert_eq!(code(&host.send(nav(1e6))), FaultCode::WrongTime);
    assert_eq!(host.status().time, 5001.0);
    host.nav(1e6 + 1.0);
    assert_eq!(host.status().time, 1e6 + 1.0);
}

#[test]
fn a_wrong_first_time_does_not_stop_the_count() {
    for wrong_s in [1e6, 0.0] {
        let mut host = Host::new("");
        host.nav(wrong_s);
        let counted = |host: &mut Host, first_s: f64| {
            for time_s in (0..5).map(|n| first_s + 10.0 * f64::from(n)) {
                host.peer(time_s, PeerSource::Other);
                host.nav(time_s);
            }
            host.events.iter().filter(|event| event.time >= first_s).count()
        };
        assert_eq!(counted(&mut host, 20_001.0), 1, "{:?}", host.events);
        // The same after a restart.
        let mut host = host.restarted();
        host.nav(wrong_s);
        assert_eq!(counted(&mut host, 40_001.0), 1, "{:?}", host.events);
    }
}

#[test]
fn reports_that_are_rarer_than_the_gap_move_the_clock_and_count_no_slot() {
    let mut host = Host::new("clock.gap_s = 60");
    (0..6).for_each(|n| host.nav(90.0 * f64::from(n)));
    let status = host.status();
    assert!(status.time >= 360.0, "{}", status.time);
    assert_eq!(host.events, []);
    assert!(status.excluded_slots["no input from the host"] >= 10, "{:?}", status.excluded_slots);
}

#[test]
fn wrong_times_and_places_change_nothing_about_surfacing() {
    let counted = |disturb: &dyn Fn(&mut Host)| {
        let mut host = Host::new("");
        let nav =
            |time, x, surfaced| Input::Nav(Nav { time, clock_sigma: None, position: place(x), sigma: None, surfaced });
        for time_s in (0..30).map(|n| 5.0 * f64::from(n)) {
            host.peer(time_s, PeerSource::Other);
            host.send(nav(time_s, 0.0, (50.0..100.0).contains(&time_s)));
            if time_s == 60.0 {
                disturb(&mut host);
            }
        }
        (host.events.iter().map(|event| event.time).collect::<Vec<_>>(), host.status().excluded_slots)
    };
    let expected = counted(&|_| {});
    assert_eq!(expected.0, [10.0, 30.0, 110.0, 130.0]);
    let wrong_time = |host: &mut Host| host.nav(50_000.0);
    assert_eq!(counted(&wrong_time), expected);
    let wrong_place = |host: &mut Host| {
        let nav = Nav { time: 75.0, clock_sigma: None, position: place(4e5), sigma: None, surfaced: false };
        assert_eq!(code(&host.send(Input::Nav(nav))), FaultCode::WrongPlace);
        assert_eq!(host.status().time, 60.0);
    };
    assert_eq!(counted(&wrong_place), expected);
}

#[test]
fn a_slot_that_was_not_counted_before_a_restart_does_not_count() {
    let restarted = |is_heard: bool| {
        let mut host = Host::new("slots.settle_s = 15");
        host.cycles(|_| true, |_, _, _| {});
        // The slot from 210 s on has ended, and is not counted yet.
        if is_heard {
            host.hear(212.0);
        }
        host.nav(224.0);
        let mut host = host.restarted();
        // A late report is no sign that the vehicle ran.
        host.nav(223.0);
        host.peer(224.0, PeerSource::Other);
        host.nav(224.5);
        host.nav(240.0);
        (host.events.len(), host.status().excluded_slots["the vehicle was not running"])
    };
    assert_eq!(restarted(true), (0, 1));
    assert_eq!(restarted(false), (0, 1));
}

#[test]
fn an_own_slot_before_the_start_is_not_reported_as_unused() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    host.contents.entries.clear();
    // The vehicle was deaf for another reason, too.
    let (from, to, not) = (221.0, 239.0, Some("pinging".into()));
    host.send(Input::Listening(Listening { from, to, not }));
    let mut host = host.restarted();
    host.nav(238.0);
    host.nav(250.0);
    assert_eq!(host.unused_slots(0), 0);
}

#[test]
fn receptions_between_the_first_two_reports_after_days_count() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let later_s = 300_000.0;
    assert_eq!(code(&host.try_nav(later_s + 10.0)), FaultCode::WrongTime);
    assert!(matches!(host.hear(later_s + 12.0), Message::Ok { .. }));
    host.peer(later_s + 10.0, PeerSource::Other);
    host.peer(later_s + 25.0, PeerSource::Other);
    host.nav(later_s + 15.0);
    host.nav(later_s + 26.0);
    assert_eq!(host.events.last().map(|event| (event.time, event.heard)), Some((later_s + 10.0, true)));
}

#[test]
fn slots_while_no_host_was_connected_do_not_count() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    host.vehicle.begin_host();
    host.greet();
    let entries = host.contents.entries.len();
    host.nav(280.0);
    host.nav(286.0);
    assert_eq!(host.events.len(), 10);
    assert!(host.status().excluded_slots["the vehicle was not running"] >= 3);
    assert_eq!(host.unused_slots(entries), 0);
}

#[test]
fn a_wrong_second_time_does_not_move_the_clock_to_it() {
    let mut host = Host::new("");
    [0.0, 50_000.0, 2.0].into_iter().for_each(|time_s| host.nav(time_s));
    assert_eq!(host.status().time, 2.0);
}

#[test]
fn a_clock_that_was_a_day_ahead_can_go_back() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    // The clock of the host was wrong twice.
    host.try_nav(1e6);
    host.nav(1e6 + 1.0);
    assert_eq!(host.status().time, 1e6 + 1.0);
    assert_eq!(code(&host.try_nav(195.0)), FaultCode::WrongTime);
    for time_s in (0..10).map(|n| 200.0 + 5.0 * f64::from(n)) {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    assert_eq!(host.status().time, 245.0);
    // The slot from 190 s on was counted before, and that from 210 s on was under way.
    let times: Vec<f64> = host.events.iter().map(|event| event.time).collect();
    assert_eq!(times[10..], [230.0], "{times:?}");
    let time_s = host.restarted().status().time;
    assert_eq!(time_s, 245.0);
}

#[test]
fn listening_does_not_begin_the_count() {
    let mut host = Host::new("");
    host.send(Input::Listening(Listening { from: 0.0, to: 30.0, not: None }));
    host.peer(0.0, PeerSource::Other);
    [30.0, 36.0].into_iter().for_each(|time_s| host.nav(time_s));
    assert_eq!(host.events, []);
}

#[test]
fn a_clock_that_was_hours_ahead_goes_back() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    // The clock of the host was wrong twice. An equal report confirms nothing.
    [11_000.0, 11_000.0].into_iter().for_each(|time_s| host.nav(time_s));
    assert_eq!(host.status().time, 220.0);
    host.nav(11_001.0);
    assert_eq!(host.status().time, 11_001.0);
    let counted = |mut host: Host| {
        for time_s in (0..9).map(|n| 225.0 + 5.0 * f64::from(n)) {
            host.peer(time_s, PeerSource::Other);
            host.try_nav(time_s);
        }
        assert_eq!(host.status().time, 265.0);
        host.events.iter().map(|event| event.time).filter(|&time_s| time_s > 200.0).collect::<Vec<_>>()
    };
    let contents = host.contents.clone();
    let again = Host::with(host.config.clone(), team(), contents);
    // Receptions in the slot from 210 s on could have arrived after the jump.
    assert_eq!(counted(host), [230.0, 250.0]);
    assert_eq!(counted(again), [230.0, 250.0]);
}

#[test]
fn a_clock_that_goes_back_counts_no_slot_twice() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    for time_s in [100.0, 101.0, 102.0] {
        assert_eq!(code(&host.try_nav(time_s)), FaultCode::WrongTime, "{time_s}");
    }
    assert_eq!(host.status().time, 220.0);
    // Slots that were counted while the clock was ahead do not count when their time comes.
    [11_000.0, 11_001.0].into_iter().for_each(|time_s| host.nav(time_s));
    for time_s in (0..8).map(|n| 11_000.0 + 5.0 * f64::from(n)) {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    let counted = host.events.len();
    assert!(counted > 10, "{:?}", host.events);
    host.try_nav(300.0);
    [305.0, 10_990.0, 10_995.0].into_iter().for_each(|time_s| host.nav(time_s));
    for time_s in (0..14).map(|n| 11_000.0 + 5.0 * f64::from(n)) {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    let times: Vec<f64> = host.events[counted..].iter().map(|event| event.time).collect();
    assert_eq!(times, [10_990.0, 11_050.0], "{:?}", host.events);
    assert!(host.status().excluded_slots["the clock was wrong"] >= 1);
}

#[test]
fn listening_far_in_the_past_does_not_move_the_clock() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    [11_000.0, 11_001.0].into_iter().for_each(|time_s| host.nav(time_s));
    for from in [0.0, 225.0, 230.0, 235.0] {
        host.send(Input::Listening(Listening { from, to: from + 30.0, not: None }));
    }
    assert_eq!(host.status().time, 11_001.0);
}

#[test]
fn slots_between_the_two_reports_of_a_clock_that_goes_back_do_not_count() {
    let mut host = Host::new("slots.reports_transmissions = true");
    host.cycles(|_| true, |_, _, _| {});
    [11_000.0, 11_001.0, 11_030.0, 11_035.0].into_iter().for_each(|time_s| host.nav(time_s));
    let entries = host.contents.entries.len();
    host.try_nav(229.0);
    host.hear(231.0);
    host.send(Input::Sent(At { time: 240.1, kind: None }));
    host.nav(241.0);
    for time_s in (0..5).map(|n| 245.0 + 5.0 * f64::from(n)) {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    let times: Vec<f64> =
        host.events.iter().map(|event| event.time).filter(|time_s| (220.0..1000.0).contains(time_s)).collect();
    assert_eq!(times, [250.0]);
    assert_eq!(host.unused_slots(entries), 0);
}

#[test]
fn a_clock_that_goes_back_twice_counts_no_slot_twice() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let report = |host: &mut Host, times: std::ops::Range<u32>| {
        for time_s in times.step_by(5).map(f64::from) {
            host.peer(time_s, PeerSource::Other);
            host.try_nav(time_s);
        }
    };
    // Slots from 11 000 s on count while the clock is ahead.
    for times in [11_000..11_050, 300..400, 50_000..50_020, 405..600, 10_980..11_100] {
        report(&mut host, times);
    }
    let mut times: Vec<f64> = host.events.iter().map(|event| event.time).collect();
    assert!(times.contains(&11_010.0) && times.contains(&11_070.0), "{times:?}");
    let count = times.len();
    times.sort_by(f64::total_cmp);
    times.dedup();
    assert_eq!(times.len(), count, "{times:?}");
}

#[test]
fn intervals_that_the_host_reported_before_a_wrong_time_still_hold_after_it() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    host.send(Input::Listening(Listening { from: 220.0, to: 300.0, not: Some("pinging".into()) }));
    [11_000.0, 11_001.0, 11_030.0].into_iter().for_each(|time_s| host.nav(time_s));
    for time_s in (0..20).map(|n| 230.0 + 5.0 * f64::from(n)) {
        host.peer(time_s, PeerSource::Other);
        host.try_nav(time_s);
    }
    let times = host.events.iter().map(|event| event.time).filter(|time_s| (220.0..1000.0).contains(time_s));
    assert_eq!(times.collect::<Vec<_>>(), [310.0]);
}

#[test]
fn a_gap_while_the_clock_is_ahead_counts_as_soon_as_its_time_comes() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    for time_s in [3820.0, 3821.0, 1e6, 1e6 + 1.0, 230.0, 231.0, 4000.0] {
        host.try_nav(time_s);
    }
    for time_s in (0..8).map(|n| 4001.0 + 5.0 * f64::from(n)) {
        host.peer(time_s, PeerSource::Other);
        host.nav(time_s);
    }
    assert_eq!(host.events.last().map(|event| event.time), Some(4010.0), "{:?}", host.events);
}

#[test]
fn frames_at_a_time_that_was_refused_do_not_move_the_clock_of_the_agent() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let mut bob = Agent::new(VehicleId::new("bob"), team(), AgentOptions::default());
    let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(300.0, 0.0) };
    let heard = |cycle: u32| {
        let [transmitter_id, receiver_id] = ["ada", "bob"].map(VehicleId::new);
        let time_s = 2.0 * SLOT_S * f64::from(cycle);
        Event { time_s, transmitter_id, receiver_id, link, kind: None, success: true }
    };
    bob.record((0..10).map(heard)).unwrap();
    bob.record_positions([0.0, 205.0].map(|time_s| (time_s, link.receiver))).unwrap();
    let bytes = bob.next_frame(Some(210.0), 32).unwrap().unwrap().bytes;
    assert_eq!(code(&host.try_nav(1e9)), FaultCode::WrongTime);
    let frame = FrameIn { time: 1e9, from: None, bytes: Hex(bytes), link: FrameLink::Other };
    let answer = host.send(Input::FrameIn(frame));
    assert!(matches!(answer, Message::Acknowledgement { counts: true, .. }), "{answer:?}");
    let last_heard_s = host.status().members[&VehicleId::new("bob")].last_heard;
    assert!(last_heard_s.is_none_or(|time_s| time_s < 1000.0), "{last_heard_s:?}");
}
