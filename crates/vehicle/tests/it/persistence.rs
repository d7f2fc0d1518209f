//! Content that survives: restarts, recoveries, other team configurations.

use std::sync::Arc;

use pingmap_agent::{Slots, Team};
use pingmap_import::Reference;
use pingmap_vehicle::{
    Contents, FaultCode, FrameRequest, Input, Message, Nav, Output, PeerSource, StatusReport, StoreState, Vehicle,
};

use crate::host::*;

#[test]
fn a_team_that_is_used_again_gets_no_counter_twice() {
    let mut host = Host::new("sharing.reports = false");
    let request = |host: &mut Host, time: f64| match host.send(Input::FrameRequest(FrameRequest { time, bytes: 32 })) {
        Message::Frame { bytes, .. } => host.vehicle.agent().codec().read(&bytes.0).unwrap().1.counter,
        other => panic!("{other:?}"),
    };
    (0..10).for_each(|cycle| host.miss_elsewhere(cycle));
    let first = request(&mut host, 200.0);
    let other = Arc::new(Team { epoch: 1, ..(*team()).clone() });
    let adopted = |host: Host, team: Arc<Team>| {
        let (config, former) = (host.config.clone(), host.vehicle.agent().team().digest());
        let contents = host.contents;
        let vehicle = Vehicle::adopt(config.clone(), team, Reference::unknown(), &contents, &former).unwrap();
        let mut host = Host::greeted(config, Contents::default(), vehicle);
        // The base is in the store from the begin on.
        host.contents.base = host.vehicle.handle(Input::Stop {}).into_iter().find_map(|output| match output {
            Output::Base(base) => Some(base),
            _ => None,
        });
        host
    };
    let mut host = adopted(host, other);
    assert_eq!(request(&mut host, 260.0), 0);
    let mut host = adopted(host, team());
    assert!(request(&mut host, 280.0) > first);
}

#[test]
fn an_adopted_store_keeps_events_and_forgets_slots_and_frames() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let request = Input::FrameRequest(FrameRequest { time: 220.0, bytes: 32 });
    assert!(matches!(host.send(request.clone()), Message::Frame { .. }));
    host.nav(260.0);
    let other =
        Arc::new(Team { epoch: 1, slots: Slots { start_s: 100.0, ..team().slots.clone() }, ..(*team()).clone() });
    let stopped = Host { contents: host.contents.clone(), ..Host::new("") };
    for contents in [host.contents.clone(), stopped.restarted().stopped()] {
        let vehicle =
            Vehicle::adopt(host.config.clone(), other.clone(), Reference::unknown(), &contents, &team().digest());
        let vehicle = vehicle.unwrap();
        let mut adopted = Host::greeted(host.config.clone(), Contents::default(), vehicle);
        let (before, after) = (host.status(), adopted.status());
        assert_eq!((after.own_events, after.trust, after.open_frames), (before.own_events, before.trust, 0));
        assert_eq!(after.excluded_slots, before.excluded_slots);
        for time_s in (0..14).map(|n| 265.0 + 5.0 * f64::from(n)) {
            adopted.peer(time_s, PeerSource::Other);
            adopted.nav(time_s);
        }
        // The slots of the new schedule count from the first report on.
        let times: Vec<f64> = adopted.events.iter().map(|event| event.time).collect();
        assert_eq!(times, [270.0, 290.0, 310.0]);
        let request = FrameRequest { time: 330.0, bytes: 32 };
        assert!(matches!(adopted.send(Input::FrameRequest(request)), Message::Frame { .. }));
    }
}

#[test]
fn a_restart_and_a_base_keep_everything() {
    let mut host = Host::new("store.snapshot_interval_s = 50");
    host.cycles(|cycle| cycle % 2 == 0, |_, _, _| {});
    assert!(host.contents.base.is_some());
    let (snapshot, status, answer) = (host.vehicle.agent().snapshot(), host.status(), host.predict(200.0));
    let mut host = host.restarted();
    assert!(host.vehicle.agent().snapshot() == snapshot);
    // The live vehicle absorbed the last events, and the restarted one fitted all of them.
    assert!((host.predict(200.0).probability - answer.probability).abs() < 1e-3);
    assert_eq!(StatusReport { input: status.input, ..host.status() }, status);
}

#[test]
fn recoveries_from_the_last_snapshot_use_no_counter_twice() {
    const WINDOW: u16 = 6;
    let team = Arc::new(Team { packets_per_sender_max: WINDOW, ..(*team()).clone() });
    // Snapshots by time are rare, so that the counters must ask for them.
    let more = "sharing.reports = false\nstore.snapshot_interval_s = 1e5";
    for (fails_from, expected_refusals) in [(60, false), (5, true)] {
        let mut host = Host::with(config(more), team.clone(), Contents::default());
        let (mut counters, mut refusals) = (std::collections::BTreeSet::new(), 0);
        let mut snapshot: Option<Vec<u8>> = None;
        for cycle in 0..60 {
            let begin_s = 2.0 * SLOT_S * cycle as f64;
            host.miss_elsewhere(cycle);
            for output in host.vehicle.handle(Input::FrameRequest(FrameRequest { time: begin_s + 20.0, bytes: 32 })) {
                match output {
                    Output::Base(_) if cycle >= fails_from => host.vehicle.snapshot_failed(),
                    Output::Base(base) => snapshot = Some(base),
                    Output::Send(Message::Frame { bytes, .. }) => {
                        let (_, packet) = host.vehicle.agent().codec().read(&bytes.0).unwrap();
                        assert!(counters.insert(packet.counter), "counter {} twice", packet.counter);
                    }
                    Output::Send(Message::Error { fault, .. }) => {
                        assert_eq!(fault.code, FaultCode::StoreFailed);
                        refusals += 1;
                    }
                    _ => {}
                }
            }
            // The store is damaged.
            if let Some(base) = snapshot.take_if(|_| cycle % 11 == 10) {
                let contents = Contents { base: Some(base), entries: Vec::new() };
                let restored = Vehicle::restore(config(more), team.clone(), Reference::unknown(), &contents);
                let mut vehicle = restored.unwrap();
                snapshot = Some(vehicle.note_recovery(true, "damage"));
                host = Host::greeted(config(more), contents, vehicle);
            }
        }
        assert!(counters.len() >= WINDOW.into(), "{counters:?}");
        assert_eq!(refusals > 0, expected_refusals, "{refusals}");
    }
}

#[test]
fn after_a_failure_of_the_store_the_vehicle_continues_in_memory_and_sends_nothing() {
    let mut host = Host::new("");
    host.cycles(|_| true, |_, _, _| {});
    let outputs = host.vehicle.store_failed("no space left");
    assert!(matches!(&outputs[0], Output::Send(Message::Error { fault, .. }) if fault.code == FaultCode::StoreFailed));
    assert!(matches!(host.status().store, StoreState::Failed { .. }));
    let request = Input::FrameRequest(FrameRequest { time: 240.0, bytes: 32 });
    assert_eq!(code(&host.send(request)), FaultCode::StoreFailed);
    let nav = Nav { time: 241.0, clock_sigma: None, position: place(0.0), sigma: None, surfaced: false };
    assert!(matches!(host.send(Input::Nav(nav)), Message::Ok { stored: false, .. }));
    assert!(host.predict(100.0).probability > 0.5);
}

#[test]
fn a_recovery_is_reported_until_a_host_was_told() {
    let contents = Host::new("").stopped();
    let mut vehicle = Vehicle::restore(config(""), team(), Reference::unknown(), &contents).unwrap();
    // The process ends before a host comes.
    let base = vehicle.note_recovery(true, "half of it is missing");
    let contents = Contents { base: Some(base), entries: Vec::new() };
    let mut host = Host::with(config(""), team(), contents);
    let warnings = host.status().warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("half of it is missing"), "{warnings:?}");
    let mut host = Host::with(config(""), team(), host.stopped());
    assert_eq!(host.status().warnings, [""; 0]);
}
