//! Checks of event logs: errors in a log give findings, and correct logs give none.

use std::path::Path;

use pingmap_agent::{Position, VehicleId};
use pingmap_trial::simulate::{Simulation, Sound};
use pingmap_trial::{BUILT_IN, EventLog, built_in};

fn simulated(seed: u64) -> EventLog {
    let mut log = Simulation { seed, slots: 600, ..Simulation::default() }.run(&Sound::default()).unwrap().log;
    log.has_depths = false;
    log
}

fn found(log: &EventLog) -> Vec<&'static str> {
    log.findings().iter().map(|finding| finding.check).collect()
}

#[test]
fn correct_logs_give_no_findings() {
    for name in BUILT_IN {
        let log = built_in(name).unwrap().unwrap();
        assert_eq!(found(&log), [""; 0], "{name}");
    }
    for seed in 1..=10 {
        assert_eq!(found(&simulated(seed)), [""; 0], "seed {seed}");
    }
}

/// A receiver that stops recording looks as if it missed everything.
#[test]
fn a_receiver_that_stops_recording_is_found() {
    let silenced = |seed: u64| {
        let mut log = simulated(seed);
        for event in log.events.iter_mut().filter(|event| event.time_s > 3000.0 && event.receiver_id.as_str() != "auv1")
        {
            event.success = false;
        }
        log
    };
    let count = (1..=20).filter(|&seed| found(&silenced(seed)).contains(&"silent_receiver")).count();
    assert!(count >= 14, "{count} of 20");
    let finding =
        (1..=20).flat_map(|seed| silenced(seed).findings()).find(|finding| finding.check == "silent_receiver");
    assert!(finding.unwrap().text.contains("--listening"));
}

#[test]
fn each_error_gives_its_finding() {
    let with = |change: &dyn Fn(&mut EventLog)| {
        let mut log = simulated(1);
        change(&mut log);
        found(&log)
    };
    let each = |change: &dyn Fn(&mut pingmap_agent::Event)| with(&|log| log.events.iter_mut().for_each(change));
    assert_eq!(each(&|event| event.success = true), ["heard_only"]);
    assert_eq!(each(&|event| event.success = false), ["missed_only"]);
    // The other receivers look silent in comparison.
    let all_heard = each(&|event| event.success |= event.receiver_id.as_str() == "auv2");
    assert_eq!(all_heard[0], "receiver_heard_only");
    let few = with(&|log| {
        log.events.truncate(20);
        log.events[3].success = false;
    });
    assert_eq!(few, ["few_events"]);
    let degrees = |position: &mut Position| {
        *position = Position::new(-70.67 + 1.2e-5 * position.east_m, 41.52 + 9e-6 * position.north_m);
    };
    let in_degrees = each(&|event| {
        degrees(&mut event.link.transmitter);
        degrees(&mut event.link.receiver);
    });
    assert_eq!(in_degrees, ["degrees"]);
    assert_eq!(with(&|log| log.events[50].link.receiver.east_m += 9e4), ["far_away", "jumps"]);
    assert_eq!(with(&|log| log.events[50].link.receiver.east_m += 400.0), ["jumps"]);
    let renamed = with(&|log| {
        for event in log.events.iter_mut().filter(|event| event.receiver_id.as_str() == "auv3" && event.time_s > 2000.0)
        {
            event.receiver_id = VehicleId::new("AUV3");
        }
    });
    assert_eq!(renamed, ["names_alike"]);
    assert_eq!(
        with(&|log| log.events[7].receiver_id = VehicleId::new("Broadcast")),
        ["receiver_heard_only", "broadcast_vehicle"][1..]
    );
    assert!(with(&|log| log.events[7].receiver_id = log.events[7].transmitter_id.clone()).contains(&"own_messages"));
    let one = with(&|log| log.events.retain(|event| event.receiver_id.as_str() == "auv1"));
    assert_eq!(one, ["one_receiver"]);
    assert_eq!(with(&|log| log.events.push(log.events[3].clone())), ["duplicate_rows"]);
    let both = with(&|log| {
        let mut event = log.events[3].clone();
        event.success = !event.success;
        log.events.push(event);
    });
    assert_eq!(both, ["contradictions"]);
    assert_eq!(with(&|log| log.unknown_columns.push("speed".into())), ["unknown_columns"]);
    assert!(
        each(&|event| event.link =
            pingmap_agent::Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(9.0, 9.0) })
        .contains(&"few_links")
    );
}

#[test]
fn range_bins_contain_all_events() {
    let log = simulated(2);
    let bins = log.over_range(8);
    assert_eq!(bins.len(), 8);
    assert_eq!(bins.iter().map(|bin| bin.events).sum::<usize>(), log.events.len());
    assert!(bins.windows(2).all(|pair| pair[0].to_m <= pair[1].from_m));
    let heard: usize = bins.iter().map(|bin| bin.heard).sum();
    assert_eq!(heard, log.pairs().values().map(|pair| pair.heard).sum::<usize>());
    let nothing = EventLog::read(
        "time_s,tx_id,rx_id,tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m,success\n".as_bytes(),
        Path::new("x"),
    );
    assert!(nothing.is_err());
}
