//! What is left out, and what is read of a message, does not depend on whether it was heard.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_import::{
    ExclusionReason, ImportError, ImportResult, RecordReader, Recordings, Reference, Rules, Schedule, TableKind, join,
};

/// Vehicles a, b and c 300 m from each other; what a sent, and what b and c heard.
fn imported(sent: &str, heard: [&str; 2], rules: &Rules) -> ImportResult {
    recorded(sent, heard, Some((0.0, 2000.0)), rules)
}

/// The same where nobody says when b and c listened, or somebody does.
fn recorded(sent: &str, heard: [&str; 2], listening: Option<(f64, f64)>, rules: &Rules) -> ImportResult {
    join(&records(sent, heard, listening), None, &Reference::unknown(), rules).unwrap()
}

fn records(sent: &str, heard: [&str; 2], listening: Option<(f64, f64)>) -> Recordings {
    let mut recordings = Recordings::new();
    let mut take = |kind, vehicle: &str, text: &str| {
        let table = (text.as_bytes(), Path::new("table"));
        RecordReader::default().read_table(kind, table, Some(&VehicleId::new(vehicle)), &mut recordings).unwrap();
    };
    for (vehicle, east_m) in [("a", 0), ("b", 300), ("c", -300)] {
        let line = |n: u32| format!("{},{east_m},0\n", 20 * n);
        take(TableKind::Navigation, vehicle, &format!("t,x,y\n{}", (0..80).map(line).collect::<String>()));
    }
    take(TableKind::Transmissions, "a", sent);
    for (vehicle, heard) in ["b", "c"].into_iter().zip(heard) {
        take(TableKind::Receptions, vehicle, heard);
    }
    for vehicle in ["b", "c"] {
        recordings.get_mut(&VehicleId::new(vehicle)).unwrap().listening.extend(listening);
    }
    recordings
}

/// One hundred messages, every ten seconds.
fn sent(more: &str, of: impl Fn(u32) -> String) -> String {
    format!("t{more}\n{}", (1..=100).map(|n| format!("{}{}\n", 10 * n, of(n))).collect::<String>())
}

/// Those of them that are heard, and what else the line says.
fn heard(more: &str, is_heard: impl Fn(u32) -> bool, of: impl Fn(u32) -> String) -> String {
    let lines = (1..=100).filter(|n| is_heard(*n)).map(|n| format!("{}.2,a{}\n", 10 * n, of(n)));
    format!("t,source{more}\n{}", lines.collect::<String>())
}

fn none(_: u32) -> String {
    String::new()
}

/// Heard at both ends of the mission, and two of three in between.
fn mostly(n: u32) -> bool {
    !n.is_multiple_of(3)
}

fn pair(imported: &ImportResult, to: &str) -> (usize, usize, usize) {
    let pair = &imported.pairs[&(VehicleId::new("a"), VehicleId::new(to))];
    (pair.heard, pair.missed, pair.excluded.values().sum())
}

#[test]
fn to_whom_and_of_what_kind_is_not_asked_of_the_outcome() {
    let to = |n: u32| format!(",{}", if n.is_multiple_of(2) { "b" } else { "c" });
    let both = heard(",to", mostly, to);
    let found = imported(&sent("", none), [&both, &both], &Rules::default());
    // All that somebody heard is known for whom it was, and was heard by both; what nobody heard is not known to be for either.
    // That leaves those that were heard, and is said.
    assert_eq!((pair(&found, "b"), pair(&found, "c")), ((34, 0, 33), (33, 0, 33)));
    assert_eq!(found.destinations_by_reception, "a");
    let overheard = imported(&sent("", none), [&both, &both], &Rules { overhear: true, ..Rules::default() });
    assert_eq!(pair(&overheard, "b"), (67, 33, 0));
    // What the sender says goes before what receivers say, or messages that are heard would be to others than those that are missed.
    let either = |n: u32| if n.is_multiple_of(2) { ",b".to_owned() } else { ",".to_owned() };
    let said = heard(",to", mostly, |_| ",b".to_owned());
    let found = imported(&sent(",to", either), [&said, &heard("", mostly, none)], &Rules::default());
    assert_eq!((pair(&found, "b"), pair(&found, "c")), ((67, 33, 0), (33, 17, 0)));
    assert_eq!(found.destinations_by_reception, "");
    // A kind that only receivers know is that of heard ones: it is none.
    let kinds = heard(",kind", mostly, |_| ",short".into());
    let found = imported(&sent("", none), [&kinds, &kinds], &Rules::default());
    assert!(found.log.events.iter().all(|event| event.kind.is_none()));
    // Where somebody heard every one of them all have one.
    let rest = heard(",kind", |n| !mostly(n) || n == 1 || n == 100, |_| ",short".into());
    let found = imported(&sent("", none), [&kinds, &rest], &Rules::default());
    assert!(
        found.log.events.iter().all(|event| event.kind.is_some())
            && found.log.events.iter().any(|event| !event.success)
    );
}

#[test]
fn a_message_that_fits_no_record_is_no_other_message() {
    let late = |n: u32| if n == 50 || n == 53 { "61" } else { "2" };
    let lines = (1..=100)
        .filter(|n| mostly(*n))
        .map(|n| format!("{}.{},a\n", if late(n) == "61" { 10 * n + 1 } else { 10 * n }, late(n)));
    let heard_late = format!("t,source\n{}", lines.collect::<String>());
    let found = imported(&sent("", none), [&heard_late, &heard("", mostly, none)], &Rules::default());
    assert_eq!((pair(&found, "b"), pair(&found, "c")), ((65, 33, 2), (67, 33, 0)));
    assert_eq!(found.left_out.unexpected[&VehicleId::new("a")], 2);
}

#[test]
fn receptions_that_say_when_a_modem_was_at_work_do_not_count() {
    let (share, mut seed) = (0.3, 1u64);
    let mut is_heard = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / 2f64.powi(31) < share
    };
    let (mut heard_of, mut all, mut at_ends) = (0.0, 0.0, 0.0);
    for _ in 0..150 {
        let outcomes: Vec<bool> = (0..=100).map(|_| is_heard()).collect();
        // Short records: every tenth message is listened for, so the ends weigh a lot.
        let of = |n: u32| n.is_multiple_of(10) && outcomes[n as usize];
        let few = format!("t\n{}", (1..=10).map(|n| format!("{}\n", 100 * n)).collect::<String>());
        let found = recorded(&few, [&heard("", of, none), &heard("", of, none)], None, &Rules::default());
        let (heard, missed, _) = pair(&found, "b");
        (heard_of, all) = (heard_of + heard as f64, all + (heard + missed) as f64);
        at_ends += f64::from((1..=100).filter(|n| of(*n)).count() > 1) * 2.0;
    }
    let off = (heard_of - share * all) / (share * (1.0 - share) * all).sqrt();
    assert!(off.abs() < 4.0, "{heard_of} of {all}: {off} deviations");
    // With them it would have been seen.
    let off = (heard_of + at_ends - share * (all + at_ends)) / (share * (1.0 - share) * (all + at_ends)).sqrt();
    assert!(off > 8.0, "{off}");
    // Two files of one receiver, and nothing from the first to the second.
    let all = heard("", mostly, none);
    let lines: Vec<&str> = all.lines().collect();
    let mut recordings = Recordings::new();
    for part in [&lines[1..20], &lines[40..]] {
        let text = format!("{}\n{}", lines[0], part.join("\n"));
        let (table, b) = ((text.as_bytes(), Path::new("t")), VehicleId::new("b"));
        RecordReader::default().read_table(TableKind::Receptions, table, Some(&b), &mut recordings).unwrap();
    }
    assert_eq!(recordings[&VehicleId::new("b")].modem_activity, [(10.2, 280.2), (590.2, 1000.2)]);
}

#[test]
fn what_broke_beside_a_message_is_a_miss_of_it_and_no_other() {
    // A cycle that broke two seconds before the data of every third message, which was missed then.
    let broken = |n: u32| n.is_multiple_of(3);
    let line = |n: u32| if broken(n) { format!("{}.3,a,0\n", 10 * n - 2) } else { format!("{}.2,a,1\n", 10 * n) };
    let text = format!("t,source,good\n{}", (1..=100).map(line).collect::<String>());
    let found = imported(&sent("", none), [&text, &heard("", |_| true, none)], &Rules::default());
    assert_eq!((pair(&found, "b"), pair(&found, "c")), ((67, 33, 0), (100, 0, 0)));
    assert!(found.left_out.unexpected.is_empty());
    // Nor is it where nobody recorded what was sent.
    let mut recordings = Recordings::new();
    for (vehicle, heard) in [("b", &text), ("c", &heard("", |_| true, none))] {
        let vehicle = VehicleId::new(vehicle);
        let table = (heard.as_bytes(), Path::new("t"));
        RecordReader::default().read_table(TableKind::Receptions, table, Some(&vehicle), &mut recordings).unwrap();
        recordings.get_mut(&vehicle).unwrap().listening.push((0.0, 2000.0));
    }
    for vehicle in ["a", "b", "c"] {
        let lines: String = (0..80).map(|n| format!("{},300,0\n", 20 * n)).collect();
        let table = format!("t,x,y\n{lines}");
        let vehicle = VehicleId::new(vehicle);
        RecordReader::default()
            .read_table(TableKind::Navigation, (table.as_bytes(), Path::new("t")), Some(&vehicle), &mut recordings)
            .unwrap();
    }
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!((pair(&found, "b"), pair(&found, "c")), ((67, 33, 0), (100, 0, 0)));
}

#[test]
fn records_that_are_there_twice_count_once_and_lines_without_frames_are_whole() {
    let once = sent("", none);
    let twice = once.clone() + once.split_once('\n').unwrap().1;
    let both = heard("", mostly, none);
    assert_eq!(pair(&imported(&twice, [&both, &both], &Rules::default()), "b"), (67, 33, 0));
    let of_three = sent(",frames", |_| ",3".into());
    assert_eq!(pair(&imported(&of_three, [&both, &both], &Rules::default()), "b"), (67, 33, 0));
}

#[test]
fn modems_in_different_bands_do_not_hear_each_other() {
    let mut recordings =
        records(&sent("", none), [&heard("", mostly, none), &heard("", mostly, none)], Some((0.0, 2000.0)));
    let mut tune = |vehicle: &str, bands: &[(f64, &str)]| {
        let said = bands.iter().map(|(from_s, band)| (*from_s, (*band).to_owned()));
        recordings.get_mut(&VehicleId::new(vehicle)).unwrap().bands = said.collect();
    };
    // Receiver b says so late, in no order, and goes away once; of c nobody knows.
    tune("a", &[(0.0, "1")]);
    tune("b", &[(655.0, "1"), (155.0, "1"), (355.0, "2")]);
    let imported = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(pair(&imported, "c"), (67, 33, 0));
    // From 36 to 65, heard or not: nobody asks for the outcome.
    let to_b = &imported.pairs[&(VehicleId::new("a"), VehicleId::new("b"))];
    assert_eq!((to_b.heard, to_b.missed), (47, 23));
    assert_eq!(to_b.excluded.iter().collect::<Vec<_>>(), [(&ExclusionReason::OtherMode, &30)]);
}

#[test]
fn bands_of_tables_and_carriers_of_a_band_tell_who_cannot_hear() {
    // a says of each message in which band it was; b where it was tuned to, along with its places; c says nothing.
    let band = |n: u32| format!(",{}", if n.is_multiple_of(2) { "low" } else { "high" });
    let both = heard("", mostly, none);
    let mut recordings = records(&sent(",band", band), [&both, &both], Some((0.0, 2000.0)));
    let line = |n: u32| format!("{},300,0,{}\n", 20 * n, if n < 25 { "low" } else { "high" });
    let tuned = format!("t,x,y,band\n{}", (0..80).map(line).collect::<String>());
    let table = (tuned.as_bytes(), Path::new("table"));
    RecordReader::default()
        .read_table(TableKind::Navigation, table, Some(&VehicleId::new("b")), &mut recordings)
        .unwrap();
    let imported = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!((pair(&imported, "b").2, pair(&imported, "c").2), (25 + 26, 0));
    // Whatever the order of the lines.
    let mut reversed = records(&sent(",band", band), [&both, &both], Some((0.0, 2000.0)));
    let (header, lines) = tuned.split_once('\n').unwrap();
    let lines: Vec<&str> = lines.lines().rev().collect();
    let tuned = format!("{header}\n{}\n", lines.join("\n"));
    let table = (tuned.as_bytes(), Path::new("table"));
    RecordReader::default()
        .read_table(TableKind::Navigation, table, Some(&VehicleId::new("b")), &mut reversed)
        .unwrap();
    let again = join(&reversed, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(again.pairs, imported.pairs);
    // A band by its number alone may be that with any carrier; with another one it is another.
    for (of_b, left_out) in [("0", 0), ("0\u{1f}25000", 0), ("0\u{1f}10000", 100), ("0\u{1f}\u{1f}4000", 0), ("1", 100)]
    {
        let mut recordings = records(&sent("", none), [&both, &both], Some((0.0, 2000.0)));
        let mut tune = |vehicle: &str, band: &str| {
            recordings.get_mut(&VehicleId::new(vehicle)).unwrap().bands = vec![(0.0, band.to_owned())];
        };
        tune("a", "0\u{1f}25000\u{1f}4000");
        tune("b", of_b);
        let imported = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
        assert_eq!(pair(&imported, "b").2, left_out, "{of_b:?}");
    }
}

#[test]
fn a_clock_that_satellites_set_on_the_way_is_found_step_by_step() {
    // b was 4 s ahead until it came up half-way, and has been right since. It says when it heard satellites, and when not any more.
    let ahead_s = |n: u32| if n < 50 { 4.0 } else { 0.0 };
    let both = heard("", mostly, none);
    let of_b: String =
        (1..=100).filter(|n| mostly(*n)).map(|n| format!("{},a\n", f64::from(10 * n) + 0.2 + ahead_s(n))).collect();
    let mut recordings = records(&sent("", none), [&format!("t,source\n{of_b}"), &both], Some((0.0, 2000.0)));
    let without = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    // Nothing says that there was a step: what came before it fits nothing.
    assert!(pair(&without, "b").0 < 40, "{:?}", pair(&without, "b"));
    let b = recordings.get_mut(&VehicleId::new("b")).unwrap();
    b.clock_syncs = vec![(0.0, true), (3.0, true), (498.0, true), (499.0, true), (500.0, false)];
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(pair(&found, "b"), (67, 33, 0));
    let clock = found.clocks.iter().find(|clock| clock.vehicle.as_str() == "b").unwrap();
    let ahead: Vec<f64> = clock.segments.iter().map(|piece| piece.offset_s).collect();
    assert!(ahead.len() == 2 && (ahead[0] - ahead[1] - 4.0).abs() < 0.05, "{ahead:?}");
    // Who says it every two minutes heard them all the time.
    let c = recordings.get_mut(&VehicleId::new("c")).unwrap();
    c.clock_syncs = (0..9).map(|n| (120.0 * f64::from(n), true)).collect();
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(found.clocks.iter().find(|clock| clock.vehicle.as_str() == "c").unwrap().segments.len(), 1);
}

#[test]
fn what_is_no_event_is_counted_for_each_pair() {
    // Every fourth is meant for c; one was recorded twice, and one fits nothing.
    let to = |n: u32| format!(",{}", if n.is_multiple_of(4) { "c" } else { "" });
    let both = heard("", mostly, none);
    let of_b = format!("{both}100.3,a\n504,a\n");
    let found = imported(&sent(",to", to), [&of_b, &both], &Rules::default());
    let pair = |to: &str| &found.pairs[&(VehicleId::new("a"), VehicleId::new(to))];
    assert_eq!((pair("b").overheard, pair("b").duplicates, pair("b").unmatched), (25, 1, 1));
    assert_eq!((pair("c").overheard, pair("c").duplicates, pair("c").unmatched), (0, 0, 0));
    assert_eq!((found.left_out.overheard, found.left_out.duplicates), (25, 1));
}

#[test]
fn what_would_fill_the_memory_is_refused() {
    let schedule = |start_s: &str, duration_s: &str| -> Result<Schedule, ImportError> {
        let text = format!("[slots]\nstart_s = {start_s}\nduration_s = {duration_s}\norder = ['a']\n");
        Schedule::read(text.as_bytes(), Path::new("slots.toml"), &Default::default())
    };
    assert!(schedule("0", "1e-6").is_err() && schedule("-1e10", "1e-18").is_err());
    let mut recordings = Recordings::new();
    for (kind, text) in
        [(TableKind::Navigation, "t,x,y\n-1.7e9,0,0\n0,0,0\n20,1,1\n"), (TableKind::Receptions, "t,source\n10,b\n")]
    {
        RecordReader::default()
            .read_table(kind, (text.as_bytes(), Path::new("t")), Some(&VehicleId::new("a")), &mut recordings)
            .unwrap();
    }
    let schedule = schedule("-1.7e9", "10").unwrap();
    let error = join(&recordings, Some(&schedule), &Reference::unknown(), &Rules::default()).unwrap_err().to_string();
    assert!(error.contains("170000002 slots") && error.contains("far from the rest"), "{error}");
}
