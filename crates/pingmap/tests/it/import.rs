//! `pingmap import`: records of vehicles are compared with the truth of simulated missions.

use std::collections::BTreeMap;

use crate::common::mission::*;
use crate::common::*;
use pingmap_trial::EventLog;

/// Returns the number of events up to the first and from the last recorded reception of their receiver. One receiver
/// stops recording.
fn outside_recording(log: &EventLog, (stops, after_s): (&str, f64)) -> usize {
    let start_s = log.events[0].time_s - 10.0;
    let unrecorded = |id: pingmap_agent::VehicleId| {
        let own = || log.events.iter().filter(|event| event.receiver_id == id);
        let until_s = if id.as_str() == stops { start_s + after_s - 2.5 } else { f64::INFINITY };
        let recorded = own().filter(|event| event.success && event.time_s < until_s).map(|event| event.time_s);
        let span = recorded.fold((f64::MAX, f64::MIN), |(from, to), time_s| (from.min(time_s), to.max(time_s)));
        own().filter(|event| event.time_s <= span.0 || event.time_s >= span.1).count()
    };
    log.vehicles().into_iter().map(unrecorded).sum()
}

#[test]
fn imported_events_match_the_true_mission_except_unknown_ones() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--clock-off-s 3 --stops auv3=0.6");
    let options =
        files(&["nav", "heard"]) + " --schedule mission/schedule.toml --always-transmits --correct-clocks auv1";
    let (found, warnings) = import(folder, &options);
    let missing = compare(folder);
    // The missing events are those before the first or after the last recorded reception of a receiver.
    assert_eq!(missing, count(&found, "not_recording"));
    assert_eq!(missing, outside_recording(&read(folder, "truth.csv"), ("auv3", 0.6 * 4000.0)));
    assert_eq!(found["excluded"].as_object().unwrap().len(), 1);
    assert!(!warnings.contains("optimistic") && !warnings.contains("clocks differ"), "{warnings}");
    // Clock offsets and the delay of a record are estimated.
    for (clock, offset_s) in [(0, 0.0), (1, 3.0), (2, -3.0)] {
        let segment = &found["clocks"][clock]["segments"][0];
        assert!((segment["offset_s"].as_f64().unwrap() - offset_s).abs() < 0.01, "{segment}");
        assert!(segment["drift_ppm"].as_f64().unwrap().abs() < 2.0, "{segment}");
    }
    assert!((found["delay_s"].as_f64().unwrap() - 1.2).abs() < 0.01);
    // With a wrong --listening the silence counts as misses, and the share of received messages is far too low.
    let listening = " --listening auv3=2026-05-03T11:00:00Z/2026-05-03T14:00:00Z";
    import(folder, &(options + listening));
    let (truth, found) = (read(folder, "truth.csv"), read(folder, "events.csv"));
    let heard = |log: &EventLog| {
        let own: Vec<bool> =
            log.events.iter().filter(|event| event.receiver_id.as_str() == "auv3").map(|event| event.success).collect();
        own.iter().filter(|heard| **heard).count() as f64 / own.len() as f64
    };
    assert!(heard(&truth) - heard(&found) > 0.1, "{} {}", heard(&truth), heard(&found));
}

#[test]
fn records_of_transmissions_replace_a_schedule() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--clock-off-s 4 --with-sent --slots 300 --seed 2");
    let (found, _) = import(folder, &(files(&["nav", "heard", "sent"]) + " --correct-clocks auv1"));
    assert_eq!(compare(folder), count(&found, "not_recording"));
    assert_eq!(found["transmissions"]["recorded"], 300);
    // Records take precedence over a schedule, so --always-transmits is not needed.
    let options = files(&["nav", "heard", "sent"]) + " --correct-clocks auv1 --schedule mission/schedule.toml";
    assert_eq!(import(folder, &options).0, found);
    // One table may contain the records of all vehicles in any order.
    let mut all = String::from("vehicle;TIME;lat;Long;depth\r\n# all of them\r\n");
    for id in [3, 1, 2] {
        let text = std::fs::read_to_string(folder.join(format!("mission/auv{id}.nav.csv"))).unwrap();
        all.extend(text.lines().skip(1).map(|line| format!("auv{id};{}\r\n", line.replace(',', ";"))));
    }
    file(folder, "all.csv", all);
    let options = files(&["heard", "sent"]) + " --nav all.csv --correct-clocks auv1";
    assert_eq!(import(folder, &options).0["log_digest"], found["log_digest"]);
    // Without --correct-clocks the outcomes are the same, and a warning names the option.
    let (as_recorded, warnings) = import(folder, &files(&["nav", "heard", "sent"]));
    assert!(warnings.contains("--correct-clocks"), "{warnings}");
    assert_eq!((&as_recorded["events"], &as_recorded["heard"]), (&found["events"], &found["heard"]));
    assert_ne!(as_recorded["log_digest"], found["log_digest"]);
}

#[test]
fn an_unconfirmed_transmission_is_not_a_miss() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--clock-off-s 2 --slots 300");
    let truth = read(folder, "truth.csv");
    let unreceived = {
        let mut by_slot: BTreeMap<i64, bool> = BTreeMap::new();
        for event in &truth.events {
            *by_slot.entry((event.time_s / 10.0).round() as i64).or_default() |= event.success;
        }
        by_slot.values().filter(|heard| !**heard).count()
    };
    let options = files(&["nav", "heard"]) + " --correct-clocks auv1";
    let (found, warnings) = import(folder, &format!("{options} --schedule mission/schedule.toml"));
    assert_eq!(found["transmissions"]["slots_of_unknown_use"], unreceived);
    assert!(warnings.contains("optimistic") && warnings.contains("--always-transmits"), "{warnings}");
    compare(folder);
    // --always-transmits may apply to some vehicles.
    let (partial, _) =
        import(folder, &format!("{options} --schedule mission/schedule.toml --always-transmits=auv1,auv2"));
    assert!(count(&partial, "unconfirmed") > 0 && count(&partial, "unconfirmed") < count(&found, "unconfirmed"));
    compare(folder);
    // Without a schedule transmissions are known from their receptions, and are the same. Common receptions tie the
    // clocks together, but the delay of a record remains unknown.
    let (without_schedule, warnings) = import(folder, &format!("{options} --match-s 0.5"));
    assert_eq!(without_schedule["transmissions"]["by_reception"], 300 - unreceived);
    assert_eq!(
        (&without_schedule["heard"], without_schedule["transmissions"]["recorded"].as_u64()),
        (&found["heard"], Some(0))
    );
    assert!(warnings.contains("messages from auv1, auv2, auv3") && warnings.contains("--sent"), "{warnings}");
}

#[test]
fn refusals_of_import_name_the_option_that_helps() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulate(folder, "--slots 60");
    let refused = |options: &str, words: &[&str]| {
        let output = pingmap(folder, &["import"].into_iter().chain(options.split_whitespace()).collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(2), "{options}: {}", stderr(&output));
        for word in words {
            assert!(stderr(&output).contains(word), "{options}: expected {word} in {}", stderr(&output));
        }
        assert!(!folder.join("events.csv").exists(), "{options}");
    };
    let nav = "--nav auv1=mission/auv1.nav.csv auv2=mission/auv2.nav.csv";
    refused("", &["--nav"]);
    refused("--nav auv1=nowhere.csv", &["nowhere.csv", "cannot be read"]);
    refused("--nav mission/auv1.nav.csv", &["auv1.nav.csv", "vehicle", "one of"]);
    refused(nav, &["--heard NAME=FILE"]);
    refused("--nav auv1=mission/auv1.heard.csv", &["easting_m", "one of"]);
    refused(&format!("{nav} --heard auv3=mission/auv3.heard.csv"), &["auv3", "--nav auv3=FILE", "--fixed"]);
    refused(&format!("{nav} --heard auv1=mission/auv1.nav.csv"), &["source", "heard.source"]);
    refused(&format!("{nav} --heard auv1=mission/auv1.heard.csv --correct-clocks bob"), &["bob", "auv1, auv2"]);
    refused(&format!("{nav} --heard auv1=mission/auv1.heard.csv --schedule mission/schedule.toml"), &["auv3", "--ids"]);
    refused(&format!("{nav} --heard auv1=mission/auv1.heard.csv --crs EPSG:4326"), &["EPSG:4326", "EPSG:32619"]);
    refused(&format!("{nav} --column heard.sauce=x"), &["heard.sauce", "heard.source"]);
    refused(&format!("{nav} --fixed gate=here"), &["gate=here", "41.52N"]);
    refused(&format!("{nav} --fixed gate=1,2 --heard auv1=mission/auv1.heard.csv"), &["metres", "degrees", "--origin"]);
    file(folder, "plain.csv", "time,source\n10,2\n20,3\n");
    refused(&format!("{nav} --heard auv1=plain.csv"), &["auv1", "times of one kind"]);
    file(folder, "odd.csv", "time,lat,lon\n2026-05-03T12:00:00Z,41.5,-70.6\n2026-05-03T12:00:61Z,41.5,-70.6\n");
    refused("--nav a=odd.csv", &["odd.csv", "line 3", "time", "12:00:61Z"]);
    file(folder, "degrees.csv", "time,lat,lon\n1,141.5,-70.6\n");
    refused("--nav a=degrees.csv", &["degrees.csv", "line 2", "lat", "141.5"]);
}

#[test]
fn import_accepts_fixed_receivers_renamed_columns_and_projections() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let line = |n: u32| format!("{},{:.6},{:.6}\n", 10 * n, 41.52 + 1e-5 * f64::from(n), -70.67);
    file(folder, "nav.csv", format!("when,wide,long_\n{}", (0..60).map(line).collect::<String>()));
    file(folder, "sent.csv", format!("t\n{}", (1..59).map(|n| format!("{}\n", 10 * n)).collect::<String>()));
    let heard = (1..59).filter(|n| n % 3 > 0).map(|n| format!("{:.1}\tauv\t*\t1\n", 10.4 + 10.0 * f64::from(n - 1)));
    file(folder, "heard.csv", format!("Time\tFROM\tTo\tOK\n{}", heard.collect::<String>()));
    file(folder, "columns.toml", "[nav]\ntime = \"when\"\nlatitude = \"wide\"\n");
    let options = "--nav auv=nav.csv --sent auv=sent.csv --heard gate=heard.csv --columns columns.toml --column nav.longitude=long_";
    let (found, warnings) = import(folder, &format!("{options} --fixed gate=41.5205N,70.672W"));
    // The first and the last reception only bound the time in which the receiver listened.
    assert_eq!((found["events"].as_u64(), count(&found, "not_recording")), (Some(56), 2), "{found}");
    assert_eq!(found["heard"], 37, "{warnings}");
    let log = read(folder, "events.csv");
    let range_m = log.events[0].link.range_m();
    assert!((range_m - 173.3).abs() < 3.0, "two thousandths of a degree at this latitude: {range_m}");
    // In eastings and northings the distances differ only by the scale of the projection.
    let (utm, _) = import(folder, &format!("{options} --fixed gate=41.5205N,70.672W --crs EPSG:32619"));
    assert_eq!(utm["reference"], "eastings and northings of EPSG:32619");
    let log = read(folder, "events.csv");
    assert!(log.events[0].link.transmitter.north_m > 4.5e6);
    assert!((log.events[0].link.range_m() / range_m - 0.9996).abs() < 1e-3);
}
