//! Properties for random inputs: the events equal the simulated ones, and no input makes a reader fail.

use std::collections::BTreeSet;
use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_import::{
    Arrival, FileSource, Fix, ModemIds, Place, RecordReader, Recording, Recordings, Reference, Rules, Schedule,
    TableKind, TransmissionRecord, join, parse_time, time_in_words,
};
use proptest::prelude::*;

const SOUND_M_PER_S: f64 = 1500.0;

/// A simulated fleet with clock offsets, clock drifts and messages.
#[derive(Debug, Clone)]
struct Fleet {
    ahead_s: Vec<f64>,
    drift: Vec<f64>,
    delay_s: f64,
    /// Each message: sender, gap before it in seconds, and a bit for each vehicle that heard it.
    messages: Vec<(usize, f64, u8)>,
}

fn fleets() -> impl Strategy<Value = Fleet> {
    (2usize..5).prop_flat_map(|vehicles| {
        let ahead = prop::collection::vec(-4.0..4.0f64, vehicles);
        let drift = prop::collection::vec(-2e-5..2e-5f64, vehicles);
        // The gaps are aperiodic, so that the clock offsets are unambiguous.
        let messages = prop::collection::vec((0..vehicles, 8.0..23.0f64, any::<u8>()), 120..200);
        (ahead, drift, 0.0..2.5f64, messages).prop_map(|(ahead_s, drift, delay_s, messages)| Fleet {
            ahead_s,
            drift,
            delay_s,
            messages,
        })
    })
}

fn vehicle_name(vehicle: usize) -> VehicleId {
    VehicleId::new(format!("v{vehicle}"))
}

/// Returns a position on a circle. The travel time of sound is at most one second.
fn place(vehicle: usize, time_s: f64) -> (f64, f64) {
    let angle = 0.002 * time_s + vehicle as f64;
    let radius_m = 200.0 + 150.0 * vehicle as f64;
    (radius_m * angle.cos(), radius_m * angle.sin())
}

/// The simulated outcomes: time, sender, receiver, and whether it was heard.
type Truth = Vec<(f64, usize, usize, bool)>;

impl Fleet {
    fn clock(&self, vehicle: usize, time_s: f64) -> f64 {
        time_s + self.ahead_s[vehicle] + self.drift[vehicle] * time_s
    }

    fn simulate(&self) -> (Recordings, Truth) {
        let vehicles = self.ahead_s.len();
        let mut recordings =
            vec![
                Recording { transmissions: Some(Vec::new()), arrivals: Some(Vec::new()), ..Recording::default() };
                vehicles
            ];
        let (mut truth, mut time_s) = (Truth::new(), 20.0);
        for &(sender, gap_s, heard) in &self.messages {
            time_s += gap_s;
            let record = TransmissionRecord {
                time_s: self.clock(sender, time_s),
                destination: None,
                frames: None,
                kind: None,
                band: None,
            };
            recordings[sender].transmissions.as_mut().unwrap().push(record);
            for receiver in (0..vehicles).filter(|&receiver| receiver != sender) {
                let is_heard = heard >> receiver & 1 == 1;
                truth.push((time_s, sender, receiver, is_heard));
                let (a, b) = (place(sender, time_s), place(receiver, time_s));
                let arrival_s = time_s + (a.0 - b.0).hypot(a.1 - b.1) / SOUND_M_PER_S + self.delay_s;
                let (time_s, source) = (self.clock(receiver, arrival_s), vehicle_name(sender));
                let (destination, frame, frames, kind) = (None, None, None, None);
                let arrival = Arrival { time_s, source, destination, frame, frames, good: true, kind };
                recordings[receiver].arrivals.as_mut().unwrap().extend(is_heard.then_some(arrival));
            }
        }
        for (vehicle, recording) in recordings.iter_mut().enumerate() {
            recording.listening.push((-100.0, time_s + 100.0));
            for second in 0..(time_s + 30.0) as u32 {
                let (east_m, north_m) = place(vehicle, f64::from(second));
                let (time_s, place) = (self.clock(vehicle, f64::from(second)), Place::Metres(east_m, north_m));
                recording.fixes.push(Fix { time_s, place, depth_m: None });
            }
        }
        ((0..vehicles).map(vehicle_name).zip(recordings).collect(), truth)
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(40) })]

    #[test]
    fn simulated_events_are_recovered_with_any_clock_offsets(fleet in fleets()) {
        let (recordings, truth) = fleet.simulate();
        let rules = Rules { reference_clock: Some(vehicle_name(0)), message_s: 2.6, ..Rules::default() };
        let imported = join(&recordings, None, &Reference::unknown(), &rules).unwrap();
        // All times are by the first vehicle's clock.
        let found: Vec<_> = imported.log.events.iter().map(|event| {
            (event.time_s, event.transmitter_id.clone(), event.receiver_id.clone(), event.success, event.link)
        }).collect();
        prop_assert_eq!(found.len() + imported.excluded().values().sum::<usize>(), truth.len());
        // Only messages of vehicles with an unknown clock are left out.
        let determined: BTreeSet<VehicleId> =
            imported.clocks.iter().filter(|clock| !clock.segments.is_empty()).map(|clock| clock.vehicle.clone()).collect();
        let are_determined = |sender: usize, receiver: usize| determined.contains(&vehicle_name(sender)) && determined.contains(&vehicle_name(receiver));
        prop_assert_eq!(found.len(), truth.iter().filter(|event| are_determined(event.1, event.2)).count());
        for (time_s, sender, receiver, heard) in truth.into_iter().filter(|event| are_determined(event.1, event.2)) {
            let reference_time_s = fleet.clock(0, time_s);
            let is_same_event = |event: &&(f64, VehicleId, VehicleId, bool, _)| {
                event.1 == vehicle_name(sender) && event.2 == vehicle_name(receiver) && (event.0 - reference_time_s).abs() < 0.1
            };
            let event = found.iter().find(is_same_event);
            prop_assert!(event.is_some_and(|event| event.3 == heard), "{time_s} {sender} {receiver} {heard}: {event:?}");
            let link: pingmap_agent::Link = event.unwrap().4;
            let (a, b) = (place(sender, time_s), place(receiver, time_s));
            prop_assert!((link.transmitter.east_m - a.0).hypot(link.transmitter.north_m - a.1) < 0.5);
            prop_assert!((link.receiver.east_m - b.0).hypot(link.receiver.north_m - b.1) < 0.5);
        }
    }

    #[test]
    fn the_order_of_records_has_no_effect(fleet in fleets(), seed in any::<u64>()) {
        let (recordings, _) = fleet.simulate();
        let mut other = recordings.clone();
        for recording in other.values_mut() {
            let offset = |length: usize| if length == 0 { 0 } else { (seed % length as u64) as usize };
            let fixes = offset(recording.fixes.len());
            recording.fixes.rotate_left(fixes);
            let arrivals = recording.arrivals.as_mut().unwrap();
            let by = offset(arrivals.len());
            arrivals.rotate_left(by);
            arrivals.reverse();
            recording.transmissions.as_mut().unwrap().reverse();
        }
        let log = |recordings: &Recordings| {
            join(recordings, None, &Reference::unknown(), &Rules::default()).unwrap().log.digest()
        };
        prop_assert_eq!(log(&recordings), log(&other));
    }

    #[test]
    fn formatted_times_are_parsed_back(milliseconds in 200_000_000_000i64..4_000_000_000_000) {
        let time_s = milliseconds as f64 / 1e3;
        prop_assert!((parse_time(&time_in_words(time_s)).unwrap() - time_s).abs() < 1e-6);
    }
}

/// Sentences of a modem, with small random fields.
fn sentences() -> impl Strategy<Value = String> {
    let names =
        "CA(CYC|RXD|RXP|CST|MSG|TXD|TXP|TXF|XST|DRQ|ERR|MUA|MUC|RDP|TDP|REV|CFG|MSC|MPC)|CC(CYC|TXD|TDP|MUC)|SNTTA";
    let fields = prop::collection::vec("([0-6]|1[0-9]|BAD_CRC|DATA_TIMEOUT|INIT|SRC|AABB|1;2;00|)", 0..24);
    (names, fields).prop_map(|(name, fields)| format!("${name},{}", fields.join(",")))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    /// Reads arbitrary bytes, and texts that resemble tables.
    #[test]
    fn no_text_makes_a_table_reader_panic(
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        rows in prop::collection::vec("[0-9eE.,;:TZ+-]{0,12}(,[0-9a-z.-]{0,8}){0,4}", 0..6),
        header in "(time|t|lat|lon|x|y|source|vehicle|ok|frame)(,(time|lat|lon|x|y|source|vehicle|ok|frame|depth)){0,5}",
    ) {
        let text = format!("{header}\n{}", rows.join("\n"));
        for content in [bytes.as_slice(), text.as_bytes()] {
            let path = Path::new("table");
            let mut recordings = Recordings::new();
            for kind in [TableKind::Navigation, TableKind::Receptions, TableKind::Transmissions] {
                for vehicle in [None, Some(&vehicle_name(0))] {
                    let _ = RecordReader::default().read_table(kind, (content, path), vehicle, &mut recordings);
                }
            }
            let _ = join(&recordings, None, &Reference::unknown(), &Rules::default());
            let _ = ModemIds::read(content, path);
            if let Ok(schedule) = Schedule::read(content, path, &ModemIds::default()) {
                let _ = join(&recordings, Some(&schedule), &Reference::unknown(), &Rules::default());
            }
        }
    }

    /// Reads arbitrary bytes, and sentences and rows with random fields in any order.
    #[test]
    fn no_log_makes_a_reader_panic(
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        modem_sentences in prop::collection::vec((0u32..400, sentences()), 0..40),
        rows in prop::collection::vec("-?[0-9]{1,3} (NAV_(X|Y|LAT|LONG|DEPTH)|NODE_REPORT_LOCAL|ACOMMS_MODEM_(RECEIVE|TRANSMIT)|%%) p [ -~]{0,40}", 0..20),
    ) {
        let capture: String = modem_sentences.iter().map(|(time_s, sentence)| format!("{time_s} {sentence}\n")).collect();
        let rows_of_modem: String = modem_sentences.iter().map(|(time_s, sentence)| format!("{time_s} ACOMMS_NMEA_IN p {sentence}\n")).collect();
        let log = format!("%% LOG FILE: x\n%% LOGSTART 5000\n{rows_of_modem}{}\n", rows.join("\n"));
        for content in [bytes.as_slice(), capture.as_bytes(), log.as_bytes()] {
            let mut recordings = Recordings::new();
            let _ = RecordReader::default().read_record(content, &FileSource::new(Path::new("file"), Some(&vehicle_name(0))), &mut recordings);
            // Each transmission was finished, and the number of each frame lies within its message.
            for recording in recordings.values() {
                let finished = capture.matches("TXF").count() + capture.matches("XST").count();
                prop_assert!(content != capture.as_bytes() || recording.transmissions.iter().flatten().count() <= finished);
                for arrival in recording.arrivals.iter().flatten() {
                    prop_assert!(arrival.frame.zip(arrival.frames).is_none_or(|(frame, frames)| 1 <= frame && frame <= frames));
                }
            }
            let _ = join(&recordings, None, &Reference::unknown(), &Rules::default());
        }
    }

    #[test]
    fn the_number_of_slots_is_bounded(start_s in -1e11..1e11f64, duration_s in 1e-3..1e6f64, restarts in any::<bool>(), from_s in -1e11..1e11f64) {
        let text = format!("[slots]\nstart_s = {start_s:e}\nduration_s = {duration_s:e}\norder = ['a', 'b']\nrestarts_daily = {restarts}\n");
        if let Ok(schedule) = Schedule::read(text.as_bytes(), Path::new("s"), &ModemIds::default()) {
            let starts = schedule.slot_starts_s(&VehicleId::new("a"), from_s, from_s + 100.0 * duration_s);
            prop_assert!(starts.len() <= 202 && starts.is_sorted(), "{}", starts.len());
        }
    }
}
