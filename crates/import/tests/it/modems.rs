//! Transmissions and receptions from Micro-Modem sentences and from Goby's text format.

use std::path::Path;

use pingmap_agent::VehicleId;
use pingmap_import::{
    ExclusionReason, FileSource, RecordKind, RecordReader, Recording, Recordings, SkipCounts, nmea_checksum,
    resolve_modem_ids,
};

/// Reads a file as the recording of `a`.
pub fn read_text(text: &str) -> (Recording, SkipCounts) {
    let mut recordings = Recordings::new();
    let a = VehicleId::new("a");
    let summary = RecordReader::default().read_record(
        text.as_bytes(),
        &FileSource::new(Path::new("file"), Some(&a)),
        &mut recordings,
    );
    (recordings.remove(&a).unwrap(), summary.unwrap().unwrap().skipped)
}

/// Reads a capture of sentences, each with its time.
pub fn capture(sentences: &[(f64, &str)]) -> (Recording, SkipCounts) {
    let line = |(time_s, sentence): &(f64, &str)| format!("{time_s} ${sentence}*{:02X}\n", nmea_checksum(sentence));
    read_text(&sentences.iter().map(line).collect::<String>())
}

/// Lists the transmissions: time, destination, number of frames, kind.
pub fn transmissions(recording: &Recording) -> Vec<(f64, String, Option<u32>, String)> {
    let text = |text: Option<String>| text.unwrap_or_default();
    let fields = |transmission: &pingmap_import::TransmissionRecord| {
        let destination = transmission.destination.as_ref().map(ToString::to_string);
        (
            transmission.time_s,
            text(destination),
            transmission.frames,
            text(transmission.kind.as_ref().map(ToString::to_string)),
        )
    };
    recording.transmissions.iter().flatten().map(fields).collect()
}

/// A reception: time, source, frame, number of frames, and whether it was decoded.
pub type Reception<'a> = (f64, &'a str, Option<u32>, Option<u32>, bool);

pub fn receptions(recording: &Recording) -> Vec<Reception<'_>> {
    let arrivals = recording.arrivals.iter().flatten();
    arrivals
        .map(|arrival| (arrival.time_s, arrival.source.as_str(), arrival.frame, arrival.frames, arrival.good))
        .collect()
}

#[test]
fn finished_messages_are_transmissions_and_requests_are_not() {
    let (recording, skipped) = capture(&[
        (0.0, "CACFG,SRC,1"),
        (1.0, "CCCYC,0,1,2,1,0,3"),
        (1.1, "CACYC,0,1,2,1,0,3"),
        (1.2, "CADRQ,120001,1,2,0,64,1"),
        (1.3, "CCTXD,1,2,0,AA"),
        (1.4, "CATXD,1,2,0,1"),
        (1.5, "CCTXD,1,2,0,BB"),
        (1.6, "CATXD,1,2,0,1"),
        (1.7, "CCTXD,1,2,0,"),
        (2.0, "CATXP,128"),
        (5.0, "CATXF,128"),
        (5.1, "CAXST,20260503,120005.0000,0,0,200,5000,25000,1,1,2,0,3,2,3,128"),
        // Requested but not sent, because no data arrived in time.
        (20.0, "CCCYC,0,1,2,1,0,3"),
        (20.1, "CACYC,0,1,2,1,0,3"),
        (20.2, "CATXD,1,2,0,1"),
        (25.0, "CAERR,120025,DATA_TIMEOUT,2"),
        // Requested only.
        (40.0, "CCCYC,0,1,2,1,0,3"),
        // Finished, but revoked by the statistics.
        (60.0, "CATXD,1,63,0,1"),
        (60.1, "CATXP,32"),
        (61.0, "CATXF,32"),
        (61.1, "CAXST,6,20260503,120101.0000,0,2,200,5000,25000,0,1,63,0,1,0,2,32"),
        // A mini-packet, a flexible packet, and a message that only statistics report.
        (80.0, "CCMUC,1,3,0123"),
        (80.1, "CAMUC,1,3,0123"),
        (80.2, "CATXP,2"),
        (80.8, "CATXF,2"),
        (90.0, "CCTDP,3,5,0,0,AABB"),
        (90.1, "CATDP,0,7,3,5,0,0,2"),
        (90.2, "CATXP,2"),
        (91.8, "CATXF,2"),
        (100.0, "CATXD,1,2,0,32"),
        (103.0, "CAXST,6,20260503,120143.0000,0,0,200,5000,25000,0,1,2,0,1,1,2,32"),
    ]);
    let expected = [
        (2.0, "2", Some(2), "rate 1"),
        (80.2, "3", Some(1), "mini"),
        (90.2, "3", Some(1), "rate 5"),
        (103.0, "2", Some(1), ""),
    ];
    assert_eq!(
        transmissions(&recording),
        expected.map(|(time_s, destination, frames, kind)| (time_s, destination.into(), frames, kind.into()))
    );
    assert_eq!((skipped.failed_transmissions, recording.arrivals.as_ref().map(Vec::len)), (2, Some(0)));
    assert_eq!((recording.modem_activity[0], recording.modem_ids.len()), ((0.0, 103.0), 1));
}

#[test]
fn data_are_receptions_and_statistics_name_broken_ones() {
    let long = "9000,60,200,150,0,0,0,0,0";
    let statistics = |mode: u32, source: &str, frames: u32, bad: u32, before: &str| {
        format!("CACST,{before}{mode},120000.0000,0,{long},1,{source},63,0,3,{frames},{bad},120,15,-1,-1,-1,180")
    };
    // Three frames, two of them good: statistics before version 6, and from version 6 on.
    for version in ["", "6,"] {
        let bad = statistics(1, "2", 3, 1, version);
        let (recording, skipped) = capture(&[
            (0.0, "CACYC,0,2,63,1,0,3"),
            (0.5, "CARXP,1"),
            (3.0, "CARXD,2,63,0,1,AA"),
            (3.2, "CAMSG,BAD_CRC,2"),
            (3.4, "CARXD,2,63,0,3,CC"),
            (3.5, &bad),
        ]);
        assert_eq!(receptions(&recording), [(3.0, "2", Some(1), Some(3), true), (3.0, "2", Some(3), Some(3), true)]);
        assert_eq!(skipped.unattributed, 0, "version {version:?}");
    }
    let (nothing, broken, whole) =
        (statistics(2, "", 0, 0, ""), statistics(1, "3", 1, 1, ""), statistics(0, "2", 3, 0, ""));
    let (recording, skipped) = capture(&[
        // A cycle without a packet.
        (0.0, "CACYC,0,2,63,1,0,3"),
        (9.0, "CAMSG,PACKET_TIMEOUT,1"),
        (9.1, &nothing),
        // Two broken messages: the statistics name the sender of the first only.
        (20.0, "CAMSG,Bad CRC,1"),
        (20.1, &broken),
        (40.0, "CACYC,0,2,63,0,0,1"),
        (43.0, "CAMSG,BAD_CRC,1"),
        // A complete message with the announced number of frames. A repeated frame starts a new message.
        (60.0, "CACYC,0,2,63,1,0,2"),
        (63.0, "CARXD,2,63,0,1,AA"),
        (63.5, "CARXD,2,63,0,2,BB"),
        (63.6, &whole),
        (66.0, "CARXD,2,63,0,1,AA"),
        // Two sources, a mini-packet, and a flexible packet with a broken frame.
        (66.5, "CARXD,4,63,0,1,AA"),
        (70.0, "CAMUA,5,63,0123"),
        (80.0, "CARDP,5,63,1,0,0,1;2;AABB;0;2;CCDD"),
        (90.0, "CARDP,5,63,1,0,0,1;2;AABB"),
    ]);
    let expected = [
        (20.0, "3", Some(1), Some(1), false),
        (63.0, "2", Some(1), Some(3), true),
        (63.0, "2", Some(2), Some(3), true),
        (66.0, "2", Some(1), Some(2), true),
        (66.5, "4", Some(1), Some(1), true),
        (70.0, "5", None, None, true),
        (80.0, "5", Some(1), Some(2), true),
        (80.0, "5", Some(2), Some(2), false),
        (90.0, "5", Some(1), Some(1), true),
    ];
    let mut found = receptions(&recording);
    // The announcement, not the statistics, determines the number of frames of a good message.
    found.iter_mut().filter(|arrival| arrival.0 == 63.0).for_each(|arrival| arrival.3 = Some(3));
    assert_eq!(found, expected);
    assert_eq!(skipped.unattributed, 1);
    // Announcements of others are no activity of this modem, but its receptions are.
    assert_eq!(recording.modem_activity, [(20.0, 90.0)]);
}

#[test]
fn a_modem_that_starts_ranges_or_acknowledges_is_deaf() {
    let (recording, _) = capture(&[
        (10.0, "CAMSC,1"),
        (17.0, "CAREV,120017,INIT,0.94.0.00"),
        (30.0, "CAREV,120030,AUV,0.94.0.00"),
        (31.0, "CCCFG,BND,2"),
        (31.1, "CACFG,BND,2"),
        (40.0, "CAMPC,1,2"),
        (50.0, "CATXP,2"),
        (50.7, "CATXF,2"),
        (60.0, "CATXF,2"),
    ]);
    let expected = [
        (10.0, 17.0, ExclusionReason::Rebooting),
        (40.0, 45.0, ExclusionReason::OtherMode),
        (50.0, 50.7, ExclusionReason::Transmitting),
        (57.0, 60.0, ExclusionReason::Transmitting),
    ];
    assert_eq!(recording.deaf_intervals, expected);
    // Only the modem's own reports count.
    assert_eq!(recording.bands, [(31.1, "2".to_owned())]);
    assert!(recording.transmissions.unwrap().is_empty());
    // Carrier and bandwidth determine band 0. In other bands they are ignored.
    let (recording, _) = capture(&[
        (1.0, "CACFG,BND,0"),
        (2.0, "CACFG,FC0,25000"),
        (3.0, "CACFG,BW0,4000"),
        (4.0, "CACFG,BND,3"),
        (5.0, "CACFG,FC0,10000"),
    ]);
    let bands: Vec<&str> = recording.bands.iter().map(|(_, band)| band.as_str()).collect();
    assert_eq!(bands, ["0", "0\u{1f}25000", "0\u{1f}25000\u{1f}4000", "3"]);
}

#[test]
fn satellite_fixes_in_a_capture_set_the_clock() {
    let (recording, skipped) = capture(&[
        (1.0, "CAREV,120000,AUV,0.94.0.00"),
        (2.0, "GPRMC,120002,V,,,,,,,030526,,"),
        (3.0, "GPGGA,120003,,,,,0,00,,,,,,,"),
        (4.0, "GNGGA,120004,4130.0,N,07040.0,W,1,08,1.0,0,M,0,M,,"),
        (5.0, "GPRMC,120005,A,4130.0,N,07040.0,W,0,0,030526,,"),
        (6.0, "GPGSV,1,1,00"),
    ]);
    assert_eq!(recording.clock_syncs, [(2.0, false), (3.0, false), (4.0, true), (5.0, true)]);
    assert_eq!((skipped, recording.modem_activity), (SkipCounts::default(), vec![(1.0, 1.0)]));
}

#[test]
fn a_packet_that_broke_before_a_complete_message_is_not_its_frame() {
    let named = "CACST,1,120000.0000,0,9000,60,200,150,0,0,0,0,0,1,1,63,0,3,1,1,120,15,-1,-1,-1,180";
    // An announcement whose own packet broke, by either sentence, and an earlier attempt that the sender's record
    // contains.
    let cases = [
        [(0.0, "CACYC,0,1,63,0,0,1"), (0.6, "CAMSG,BAD_CRC,0"), (1.5, "CARXD,1,63,0,1,AA")],
        [(0.0, "CACYC,0,1,63,0,0,1"), (0.6, named), (1.5, "CARXD,1,63,0,1,AA")],
        [(0.0, "CAREV,120000,AUV,0.94.0.00"), (1.4, named), (5.4, "CARXD,1,63,0,1,AA")],
    ];
    for case in cases {
        let (recording, _) = capture(&case);
        assert_eq!(receptions(&recording), [(case[2].0, "1", Some(1), Some(1), true)], "{case:?}");
    }
    // A packet that breaks after a complete message is another message.
    let (recording, _) = capture(&[(0.0, "CACYC,0,1,63,0,0,1"), (1.5, "CARXD,1,63,0,1,AA"), (5.0, named)]);
    assert_eq!(receptions(&recording), [(1.5, "1", Some(1), Some(1), true), (5.0, "1", Some(1), Some(1), false)]);
    // With another announcement in between, there are two messages.
    let (recording, _) =
        capture(&[(0.0, "CACYC,0,1,63,0,0,1"), (1.4, named), (4.0, "CACYC,0,1,63,0,0,1"), (5.0, "CARXD,1,63,0,1,AA")]);
    assert_eq!(receptions(&recording), [(1.4, "1", Some(1), Some(1), false), (5.0, "1", Some(1), Some(1), true)]);
}

#[test]
fn statistics_revoke_only_their_own_message_and_stale_data_are_not_sent() {
    let statistics = |mode: u32| format!("CAXST,6,20260503,120005.0000,0,{mode},200,5000,25000,0,1,2,0,1,1,2,32");
    let (good, bad) = (statistics(0), statistics(2));
    let (recording, _) = capture(&[
        (0.0, "CATXD,1,2,0,1"),
        (0.1, "CATXP,32"),
        (2.0, "CATXF,32"),
        (2.1, &good),
        // The statistics belong to the next cycle, for which no data arrived.
        (6.0, &bad),
        // Data that the modem lost in a restart, or that waited too long.
        (20.0, "CATXD,1,2,0,1"),
        (21.0, "CAMSC,1"),
        (27.0, "CAREV,120027,INIT,0.94.0.00"),
        (30.0, "CATXP,2"),
        (30.7, "CATXF,2"),
        (40.0, "CATXD,1,2,0,1"),
        (240.0, "CATXP,2"),
        (240.7, "CATXF,2"),
        // Ranging.
        (300.0, "CAPGT,1,25000"),
    ]);
    assert_eq!(transmissions(&recording).iter().map(|transmission| transmission.0).collect::<Vec<_>>(), [0.1]);
    assert_eq!(recording.deaf_intervals.last(), Some(&(300.0, 305.0, ExclusionReason::OtherMode)));
}

#[test]
fn a_wrong_checksum_is_garbled_and_the_content_determines_the_kind() {
    let text = "2026-05-03 12:00:00Z,RX,$CACFG,SRC,7*35\r\n2026-05-03 12:00:01Z,RX,$CARXD,2,63,0,1,AA*00\r\n";
    let (recording, skipped) = read_text(text);
    assert_eq!((recording.arrivals.unwrap().len(), skipped.garbled), (0, 1));
    assert_eq!(recording.modem_activity, [(1_777_809_600.0, 1_777_809_600.0)]);
    for (text, kind) in [
        (text, Some(RecordKind::ModemCapture)),
        ("%%%%\n%% LOG FILE: x\n%% LOGSTART 5\n", Some(RecordKind::MoosLog)),
        ("ServerPort = 9000\nLatOrigin = 41\nLongOrigin = -70\n", Some(RecordKind::MoosMission)),
        ("time,source\n1,2\n", None),
        ("1 $GPGGA,1,2,3\n", None),
        ("", None),
    ] {
        assert_eq!(RecordReader::default().detect_kind(text.as_bytes(), Path::new("file"), None), kind, "{text}");
    }
}

#[test]
fn goby_transmissions_are_records_of_its_host() {
    let rows = |additional_rows: &str| {
        format!(
            "%% LOG FILE: a\n%% LOGSTART 1777809600\n\
             10 ACOMMS_MODEM_TRANSMIT pAcommsHandler @PB[goby.acomms.protobuf.ModemTransmission] src: 1 dest: 0 rate: 1 type: DATA frame: \"a\" frame: \"b\"\n\
             20 ACOMMS_MODEM_RECEIVE pAcommsHandler src: 2 dest: 1 rate: 1 type: DATA frame: \"a\" frame: \"\" [micromodem.protobuf.frame_with_bad_crc]: 1\n\
             30 ACOMMS_MODEM_RECEIVE pAcommsHandler src: 2 dest: 1 type: ACK acked_frame: 0\n\
             40 ACOMMS_MAC_SLOT_START pAcommsHandler src: 1 dest: 2 type: DATA frame: \"x\"\n{additional_rows}"
        )
    };
    let (recording, _) = read_text(&rows(""));
    let start_s = 1_777_809_600.0;
    assert_eq!(transmissions(&recording), [(start_s + 10.0, String::new(), Some(2), "rate 1".into())]);
    assert_eq!(receptions(&recording), [(start_s + 20.0, "2", Some(1), Some(2), true)]);
    assert!(recording.modem_ids.contains("1"));
    // The modem's own sentences take precedence.
    let (recording, _) = read_text(&rows("50 ACOMMS_NMEA_IN p $CARXD,3,1,0,1,AA\n"));
    assert_eq!(
        (transmissions(&recording).len(), receptions(&recording)),
        (0, vec![(start_s + 50.0, "3", Some(1), Some(1), true)])
    );
    // A vehicle that acknowledges or ranges is deaf meanwhile.
    let (recording, _) = read_text(&rows("50 ACOMMS_MODEM_TRANSMIT p src: 1 dest: 2 type: MICROMODEM_TWO_WAY_PING\n"));
    assert_eq!(
        (transmissions(&recording).len(), &recording.deaf_intervals[..]),
        (1, &[(start_s + 50.0, start_s + 55.0, ExclusionReason::OtherMode)][..])
    );
    // The prefix of the variables is configurable.
    let reading = RecordReader { moos_prefix: "MM_".into(), ..RecordReader::default() };
    let mut recordings = Recordings::new();
    let text = rows("").replace("ACOMMS_", "MM_");
    let a = VehicleId::new("a");
    reading.read_record(text.as_bytes(), &FileSource::new(Path::new("a.alog"), Some(&a)), &mut recordings).unwrap();
    assert_eq!(transmissions(&recordings[&a]).len(), 1);
}

#[test]
fn modem_ids_resolve_to_the_vehicles_that_state_them() {
    let mut recordings = Recordings::new();
    let mut read = |vehicle: &str, text: &str| {
        let vehicle = VehicleId::new(vehicle);
        RecordReader::default()
            .read_record(text.as_bytes(), &FileSource::new(Path::new("f"), Some(&vehicle)), &mut recordings)
            .unwrap();
    };
    read("ada", "1 $CACFG,SRC,1\n5 $CARXD,2,1,0,1,AA\n");
    read("bob", "1 $CACFG,SRC,2\n3 $CATXD,2,1,0,1\n4 $CATXF,1\n");
    resolve_modem_ids(&mut recordings).unwrap();
    let recording_of = |name: &str| recordings[&VehicleId::new(name)].clone();
    let arrival = recording_of("ada").arrivals.unwrap().remove(0);
    assert_eq!((arrival.source.as_str(), arrival.destination.unwrap().as_str()), ("bob", "ada"));
    assert_eq!(recording_of("bob").transmissions.unwrap()[0].destination, Some(VehicleId::new("ada")));
    recordings.get_mut(&VehicleId::new("bob")).unwrap().modem_ids.insert("1".into());
    let error = resolve_modem_ids(&mut recordings).unwrap_err().to_string();
    assert!(error.contains("ada and bob") && error.contains("id is 1"), "{error}");
}
