//! Exclusion from the log, and the content of a message, are independent of the outcome.

use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_import::{
    ExclusionReason, ImportError, ImportResult, RecordReader, Recordings, Reference, Rules, Schedule, TableKind, join,
};

/// Joins vehicles a, b and c, 300 m apart, from the transmissions of a and the receptions of b and c. Their modems
/// listen all the time.
fn join_tables(transmissions: &str, receptions: [&str; 2], rules: &Rules) -> ImportResult {
    join_records(transmissions, receptions, Some((0.0, 2000.0)), rules)
}

/// Joins them with an optional interval in which b and c listen, as stated by the user.
fn join_records(
    transmissions: &str,
    receptions: [&str; 2],
    listening: Option<(f64, f64)>,
    rules: &Rules,
) -> ImportResult {
    join(&records(transmissions, receptions, listening), None, &Reference::unknown(), rules).unwrap()
}

fn records(transmissions: &str, receptions: [&str; 2], listening: Option<(f64, f64)>) -> Recordings {
    let mut recordings = Recordings::new();
    let mut read = |kind, vehicle: &str, text: &str| {
        let table = (text.as_bytes(), Path::new("table"));
        RecordReader::default().read_table(kind, table, Some(&VehicleId::new(vehicle)), &mut recordings).unwrap();
    };
    for (vehicle, east_m) in [("a", 0), ("b", 300), ("c", -300)] {
        let line = |n: u32| format!("{},{east_m},0\n", 20 * n);
        read(TableKind::Navigation, vehicle, &format!("t,x,y\n{}", (0..80).map(line).collect::<String>()));
    }
    read(TableKind::Transmissions, "a", transmissions);
    for (vehicle, receptions) in ["b", "c"].into_iter().zip(receptions) {
        read(TableKind::Receptions, vehicle, receptions);
    }
    for vehicle in ["b", "c"] {
        recordings.get_mut(&VehicleId::new(vehicle)).unwrap().listening.extend(listening);
    }
    recordings
}

/// Makes a table of one hundred transmissions, one every ten seconds.
fn transmission_table(more: &str, fields: impl Fn(u32) -> String) -> String {
    format!("t{more}\n{}", (1..=100).map(|n| format!("{}{}\n", 10 * n, fields(n))).collect::<String>())
}

/// Makes a table of the messages that are heard, with further columns.
fn reception_table(more: &str, is_heard: impl Fn(u32) -> bool, fields: impl Fn(u32) -> String) -> String {
    let lines = (1..=100).filter(|n| is_heard(*n)).map(|n| format!("{}.2,a{}\n", 10 * n, fields(n)));
    format!("t,source{more}\n{}", lines.collect::<String>())
}

fn no_fields(_: u32) -> String {
    String::new()
}

/// A choice of messages: the first and the last, and two of three in between.
fn two_of_three(n: u32) -> bool {
    !n.is_multiple_of(3)
}

fn pair_counts(imported: &ImportResult, destination: &str) -> (usize, usize, usize) {
    let pair = &imported.pairs[&(VehicleId::new("a"), VehicleId::new(destination))];
    (pair.heard, pair.missed, pair.excluded.values().sum())
}

#[test]
fn destination_and_kind_are_independent_of_the_outcome() {
    let destination = |n: u32| format!(",{}", if n.is_multiple_of(2) { "b" } else { "c" });
    let receptions = reception_table(",to", two_of_three, destination);
    let found = join_tables(&transmission_table("", no_fields), [&receptions, &receptions], &Rules::default());
    // Messages that a receiver heard have a known destination, and both receivers heard them. Unheard messages have an
    // unknown destination. Only heard messages remain, and the result names the sender.
    assert_eq!((pair_counts(&found, "b"), pair_counts(&found, "c")), ((34, 0, 33), (33, 0, 33)));
    assert_eq!(found.undocumented_destinations, "a");
    let overheard = join_tables(
        &transmission_table("", no_fields),
        [&receptions, &receptions],
        &Rules { overhear: true, ..Rules::default() },
    );
    assert_eq!(pair_counts(&overheard, "b"), (67, 33, 0));
    // The sender's record of destinations takes precedence. Otherwise heard and missed messages would have different
    // destinations.
    let destination = |n: u32| if n.is_multiple_of(2) { ",b".to_owned() } else { ",".to_owned() };
    let receptions_of_b = reception_table(",to", two_of_three, |_| ",b".to_owned());
    let found = join_tables(
        &transmission_table(",to", destination),
        [&receptions_of_b, &reception_table("", two_of_three, no_fields)],
        &Rules::default(),
    );
    assert_eq!((pair_counts(&found, "b"), pair_counts(&found, "c")), ((67, 33, 0), (33, 17, 0)));
    assert_eq!(found.undocumented_destinations, "");
    // If only receptions state kinds, only heard messages have one. No event gets a kind then.
    let kinds = reception_table(",kind", two_of_three, |_| ",short".into());
    let found = join_tables(&transmission_table("", no_fields), [&kinds, &kinds], &Rules::default());
    assert!(found.log.events.iter().all(|event| event.kind.is_none()));
    // If every message was heard by a receiver, all events get a kind.
    let other_receptions = reception_table(",kind", |n| !two_of_three(n) || n == 1 || n == 100, |_| ",short".into());
    let found = join_tables(&transmission_table("", no_fields), [&kinds, &other_receptions], &Rules::default());
    assert!(
        found.log.events.iter().all(|event| event.kind.is_some())
            && found.log.events.iter().any(|event| !event.success)
    );
}

#[test]
fn receptions_with_a_varying_delay_are_assigned_within_the_gap_between_transmissions() {
    // Every second reception is recorded three seconds late, as by a program that polls its modem.
    let late_s = |n: u32| if n.is_multiple_of(2) { 3 } else { 0 };
    let lines = (1..=100).filter(|n| two_of_three(*n)).map(|n| format!("{}.2,a\n", 10 * n + late_s(n)));
    let late_receptions = format!("t,source\n{}", lines.collect::<String>());
    let others = reception_table("", two_of_three, no_fields);
    let found = join_tables(&transmission_table("", no_fields), [&late_receptions, &others], &Rules::default());
    assert_eq!((pair_counts(&found, "b"), pair_counts(&found, "c")), ((67, 33, 0), (67, 33, 0)));
    assert!(found.left_out.unexpected.is_empty() && found.contradictions.is_empty(), "{:?}", found.contradictions);
    assert!(found.warnings.iter().any(|warning| warning.contains("polling")), "{:?}", found.warnings);
}

#[test]
fn a_sender_that_is_known_by_one_receiver_only_yields_no_event_of_that_receiver() {
    // Receiver b is the only witness of every third message, and c of the others that b missed.
    let of_b = reception_table("", two_of_three, no_fields);
    let of_c = reception_table("", |n| n.is_multiple_of(2), no_fields);
    let mut recordings = records(&transmission_table("", no_fields), [&of_b, &of_c], Some((0.0, 2000.0)));
    recordings.get_mut(&VehicleId::new("a")).unwrap().transmissions = None;
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    // Events of b are the messages that c heard, and the reverse. The shares heard are two thirds and a half.
    let pair = |destination: &str| &found.pairs[&(VehicleId::new("a"), VehicleId::new(destination))];
    assert_eq!((pair("b").heard, pair("b").missed), (34, 16));
    assert_eq!((pair("c").heard, pair("c").missed), (34, 33));
    assert_eq!(pair("b").excluded[&ExclusionReason::Unconfirmed], 33);
}

#[test]
fn a_reply_to_a_message_does_not_exclude_it() {
    // Receiver b answers half a second after each message that it hears, and starts messages of its own 5 s later.
    let receptions = reception_table("", two_of_three, no_fields);
    let mut recordings = records(&transmission_table("", no_fields), [&receptions, &receptions], Some((0.0, 2000.0)));
    let replies = (1..=100).filter(|n| two_of_three(*n)).map(|n| format!("{}.7\n", 10 * n));
    let table = format!("t\n{}", replies.collect::<String>());
    let b = VehicleId::new("b");
    RecordReader::default()
        .read_table(TableKind::Transmissions, (table.as_bytes(), Path::new("t")), Some(&b), &mut recordings)
        .unwrap();
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(pair_counts(&found, "b"), (67, 33, 0));
    // A transmission that begins before a message arrives excludes it, heard or missed.
    let earlier = (1..=100u32).filter(|n| n.is_multiple_of(4)).map(|n| format!("{}\n", 10 * n - 2));
    let table = format!("t\n{}", earlier.collect::<String>());
    RecordReader::default()
        .read_table(TableKind::Transmissions, (table.as_bytes(), Path::new("t")), Some(&b), &mut recordings)
        .unwrap();
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(pair_counts(&found, "b"), (67 - 17, 33 - 8, 25));
}

#[test]
fn receptions_that_bound_the_modem_activity_do_not_count() {
    let (share, mut seed) = (0.3, 1u64);
    let mut is_heard = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / 2f64.powi(31) < share
    };
    let (mut heard_events, mut events, mut bounding_receptions) = (0.0, 0.0, 0.0);
    for _ in 0..150 {
        let outcomes: Vec<bool> = (0..=100).map(|_| is_heard()).collect();
        // Each short record contains ten messages, so the first and the last reception matter.
        let is_received = |n: u32| n.is_multiple_of(10) && outcomes[n as usize];
        let ten_transmissions = format!("t\n{}", (1..=10).map(|n| format!("{}\n", 100 * n)).collect::<String>());
        let found = join_records(
            &ten_transmissions,
            [&reception_table("", is_received, no_fields), &reception_table("", is_received, no_fields)],
            None,
            &Rules::default(),
        );
        let (heard, missed, _) = pair_counts(&found, "b");
        (heard_events, events) = (heard_events + heard as f64, events + (heard + missed) as f64);
        bounding_receptions += f64::from((1..=100).filter(|n| is_received(*n)).count() > 1) * 2.0;
    }
    let deviation = (heard_events - share * events) / (share * (1.0 - share) * events).sqrt();
    assert!(deviation.abs() < 4.0, "{heard_events} of {events}: {deviation} deviations");
    // The bias would be visible if these receptions counted.
    let deviation = (heard_events + bounding_receptions - share * (events + bounding_receptions))
        / (share * (1.0 - share) * (events + bounding_receptions)).sqrt();
    assert!(deviation > 8.0, "{deviation}");
    // Two files of one receiver, with a gap between them.
    let receptions = reception_table("", two_of_three, no_fields);
    let lines: Vec<&str> = receptions.lines().collect();
    let mut recordings = Recordings::new();
    for part in [&lines[1..20], &lines[40..]] {
        let text = format!("{}\n{}", lines[0], part.join("\n"));
        let (table, b) = ((text.as_bytes(), Path::new("t")), VehicleId::new("b"));
        RecordReader::default().read_table(TableKind::Receptions, table, Some(&b), &mut recordings).unwrap();
    }
    assert_eq!(recordings[&VehicleId::new("b")].modem_activity, [(10.2, 280.2), (590.2, 1000.2)]);
}

#[test]
fn messages_in_a_damaged_place_of_a_log_do_not_count_whether_heard_or_missed() {
    let (b, everything) = (VehicleId::new("b"), |_: u32| true);
    let heard = reception_table("", two_of_three, no_fields);
    // Records of b from 399 s to 601 s were lost. A record may deviate by ten seconds from its message (`match_s`).
    let outside = |n: u32| two_of_three(n) && !(40..=60).contains(&n);
    let damaged = |is_heard: &dyn Fn(u32) -> bool| {
        let receptions = [&*reception_table("", is_heard, no_fields), &heard];
        let mut recordings = records(&transmission_table("", no_fields), receptions, Some((0.0, 2000.0)));
        recordings.get_mut(&b).unwrap().lost_spans.push((399.0, 601.0));
        join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap()
    };
    let whole = join_tables(&transmission_table("", no_fields), [&heard, &heard], &Rules::default());
    let found = damaged(&outside);
    let excluded = &found.pairs[&(VehicleId::new("a"), b.clone())].excluded;
    assert_eq!(
        excluded.iter().map(|(&reason, &count)| (reason, count)).collect::<Vec<_>>(),
        [(ExclusionReason::DamagedLog, 23)]
    );
    let is_counted = |event: &&pingmap_agent::Event| event.receiver_id != b || !(389.0..=612.0).contains(&event.time_s);
    let expected: Vec<_> = whole.log.events.iter().filter(is_counted).collect();
    assert_eq!(found.log.events.iter().collect::<Vec<_>>(), expected);
    // Outcomes in the span have no effect.
    for is_heard in [&two_of_three as &dyn Fn(u32) -> bool, &everything] {
        let inside = |n: u32| if (40..=60).contains(&n) { is_heard(n) } else { two_of_three(n) };
        assert_eq!(damaged(&inside).log.events, found.log.events);
    }
}

#[test]
fn a_packet_that_broke_near_a_message_is_a_miss_of_that_message() {
    // For every third message, a cycle breaks two seconds before the data, and the data are missed.
    let broken = |n: u32| n.is_multiple_of(3);
    let line = |n: u32| if broken(n) { format!("{}.3,a,0\n", 10 * n - 2) } else { format!("{}.2,a,1\n", 10 * n) };
    let text = format!("t,source,good\n{}", (1..=100).map(line).collect::<String>());
    let found = join_tables(
        &transmission_table("", no_fields),
        [&text, &reception_table("", |_| true, no_fields)],
        &Rules::default(),
    );
    assert_eq!((pair_counts(&found, "b"), pair_counts(&found, "c")), ((67, 33, 0), (100, 0, 0)));
    assert!(found.left_out.unexpected.is_empty());
    // The result is equal without a record of the transmissions.
    let mut recordings = Recordings::new();
    for (vehicle, receptions) in [("b", &text), ("c", &reception_table("", |_| true, no_fields))] {
        let vehicle = VehicleId::new(vehicle);
        let table = (receptions.as_bytes(), Path::new("t"));
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
    assert_eq!((pair_counts(&found, "b"), pair_counts(&found, "c")), ((67, 33, 0), (100, 0, 0)));
}

#[test]
fn duplicate_records_count_once_and_arrivals_without_frames_are_complete() {
    let table = transmission_table("", no_fields);
    let duplicated = table.clone() + table.split_once('\n').unwrap().1;
    let receptions = reception_table("", two_of_three, no_fields);
    assert_eq!(pair_counts(&join_tables(&duplicated, [&receptions, &receptions], &Rules::default()), "b"), (67, 33, 0));
    let three_frames = transmission_table(",frames", |_| ",3".into());
    assert_eq!(
        pair_counts(&join_tables(&three_frames, [&receptions, &receptions], &Rules::default()), "b"),
        (67, 33, 0)
    );
}

#[test]
fn transmissions_in_another_band_are_excluded() {
    let mut recordings = records(
        &transmission_table("", no_fields),
        [&reception_table("", two_of_three, no_fields), &reception_table("", two_of_three, no_fields)],
        Some((0.0, 2000.0)),
    );
    let mut tune = |vehicle: &str, bands: &[(f64, &str)]| {
        let bands = bands.iter().map(|(from_s, band)| (*from_s, (*band).to_owned()));
        recordings.get_mut(&VehicleId::new(vehicle)).unwrap().bands = bands.collect();
    };
    // Receiver b reports its band late, out of order, and changes it once. Receiver c does not report its band.
    tune("a", &[(0.0, "1")]);
    tune("b", &[(655.0, "1"), (155.0, "1"), (355.0, "2")]);
    let imported = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(pair_counts(&imported, "c"), (67, 33, 0));
    // Messages 36 to 65 are excluded, whether heard or missed.
    let to_b = &imported.pairs[&(VehicleId::new("a"), VehicleId::new("b"))];
    assert_eq!((to_b.heard, to_b.missed), (47, 23));
    assert_eq!(to_b.excluded.iter().collect::<Vec<_>>(), [(&ExclusionReason::OtherMode, &30)]);
}

#[test]
fn bands_in_tables_and_carriers_of_a_band_exclude_transmissions() {
    // Sender a records the band of each message, receiver b its own band in the navigation table, and receiver c no
    // band.
    let band = |n: u32| format!(",{}", if n.is_multiple_of(2) { "low" } else { "high" });
    let receptions = reception_table("", two_of_three, no_fields);
    let mut recordings = records(&transmission_table(",band", band), [&receptions, &receptions], Some((0.0, 2000.0)));
    let line = |n: u32| format!("{},300,0,{}\n", 20 * n, if n < 25 { "low" } else { "high" });
    let tuned = format!("t,x,y,band\n{}", (0..80).map(line).collect::<String>());
    let table = (tuned.as_bytes(), Path::new("table"));
    RecordReader::default()
        .read_table(TableKind::Navigation, table, Some(&VehicleId::new("b")), &mut recordings)
        .unwrap();
    let imported = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!((pair_counts(&imported, "b").2, pair_counts(&imported, "c").2), (25 + 26, 0));
    // The order of the rows has no effect.
    let mut reversed = records(&transmission_table(",band", band), [&receptions, &receptions], Some((0.0, 2000.0)));
    let (header, lines) = tuned.split_once('\n').unwrap();
    let lines: Vec<&str> = lines.lines().rev().collect();
    let tuned = format!("{header}\n{}\n", lines.join("\n"));
    let table = (tuned.as_bytes(), Path::new("table"));
    RecordReader::default()
        .read_table(TableKind::Navigation, table, Some(&VehicleId::new("b")), &mut reversed)
        .unwrap();
    let reversed_import = join(&reversed, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(reversed_import.pairs, imported.pairs);
    // A band number without a carrier is compatible with any carrier. Different carriers are different bands.
    for (band_of_b, left_out) in
        [("0", 0), ("0\u{1f}25000", 0), ("0\u{1f}10000", 100), ("0\u{1f}\u{1f}4000", 0), ("1", 100)]
    {
        let mut recordings =
            records(&transmission_table("", no_fields), [&receptions, &receptions], Some((0.0, 2000.0)));
        let mut tune = |vehicle: &str, band: &str| {
            recordings.get_mut(&VehicleId::new(vehicle)).unwrap().bands = vec![(0.0, band.to_owned())];
        };
        tune("a", "0\u{1f}25000\u{1f}4000");
        tune("b", band_of_b);
        let imported = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
        assert_eq!(pair_counts(&imported, "b").2, left_out, "{band_of_b:?}");
    }
}

#[test]
fn a_clock_that_satellites_set_during_the_mission_has_two_segments() {
    // The clock of b is 4 s ahead until the vehicle surfaces half-way, and right afterwards. Receiver b reports when it
    // has a fix.
    let ahead_s = |n: u32| if n < 50 { 4.0 } else { 0.0 };
    let receptions = reception_table("", two_of_three, no_fields);
    let rows_of_b: String = (1..=100)
        .filter(|n| two_of_three(*n))
        .map(|n| format!("{},a\n", f64::from(10 * n) + 0.2 + ahead_s(n)))
        .collect();
    let mut recordings = records(
        &transmission_table("", no_fields),
        [&format!("t,source\n{rows_of_b}"), &receptions],
        Some((0.0, 2000.0)),
    );
    // Without the reports, the step is unknown. Every reception is nearest to its own transmission still.
    let without = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(pair_counts(&without, "b"), (67, 33, 0));
    let b = recordings.get_mut(&VehicleId::new("b")).unwrap();
    b.clock_syncs = vec![(0.0, true), (3.0, true), (498.0, true), (499.0, true), (500.0, false)];
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(pair_counts(&found, "b"), (67, 33, 0));
    let clock = found.clocks.iter().find(|clock| clock.vehicle.as_str() == "b").unwrap();
    let ahead: Vec<f64> = clock.segments.iter().map(|piece| piece.offset_s).collect();
    assert!(ahead.len() == 2 && (ahead[0] - ahead[1] - 4.0).abs() < 0.05, "{ahead:?}");
    // A report every two minutes is continuous reception, so the clock has one segment.
    let c = recordings.get_mut(&VehicleId::new("c")).unwrap();
    c.clock_syncs = (0..9).map(|n| (120.0 * f64::from(n), true)).collect();
    let found = join(&recordings, None, &Reference::unknown(), &Rules::default()).unwrap();
    assert_eq!(found.clocks.iter().find(|clock| clock.vehicle.as_str() == "c").unwrap().segments.len(), 1);
}

#[test]
fn records_without_an_event_are_counted_for_each_pair() {
    // Every fourth message is addressed to c. One reception is a duplicate, and one matches no transmission.
    let destination = |n: u32| format!(",{}", if n.is_multiple_of(4) { "c" } else { "" });
    let receptions = reception_table("", two_of_three, no_fields);
    let receptions_of_b = format!("{receptions}100.3,a\n1015,a\n");
    let found =
        join_tables(&transmission_table(",to", destination), [&receptions_of_b, &receptions], &Rules::default());
    let pair_counts = |destination: &str| &found.pairs[&(VehicleId::new("a"), VehicleId::new(destination))];
    assert_eq!((pair_counts("b").overheard, pair_counts("b").duplicates, pair_counts("b").unassigned), (25, 1, 1));
    assert_eq!((pair_counts("c").overheard, pair_counts("c").duplicates, pair_counts("c").unassigned), (0, 0, 0));
    assert_eq!((found.left_out.overheard, found.left_out.duplicates), (25, 1));
}

#[test]
fn a_schedule_with_too_many_slots_is_refused() {
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
