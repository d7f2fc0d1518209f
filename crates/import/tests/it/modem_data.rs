//! ASCII data and flexible packets of the Micro-Modem, sentence by sentence.

use crate::modems::{capture, receptions, transmissions};

#[test]
fn ascii_data_are_read_as_binary_data() {
    let (recording, skipped) = capture(&[
        (0.0, "CACFG,SRC,1"),
        (1.0, "CACYC,0,1,2,0,0,1"),
        (1.1, "CCTXA,1,2,0,a text, and more"),
        (1.2, "CATXA,1,2,0,16"),
        (1.3, "CATXP,32"),
        (3.0, "CATXF,32"),
        // No data.
        (10.0, "CCTXA,1,2,0,"),
        (10.1, "CATXA,1,2,0,0"),
        (10.2, "CATXP,2"),
        (10.8, "CATXF,2"),
        // Two announced frames, of which one arrives.
        (20.0, "CACYC,0,2,1,1,0,2"),
        (23.0, "CARXA,2,1,0,2,a text, and more"),
        (40.0, "CARXA,2,1,0,first,a text"),
        (50.0, "CAREV,120050,AUV,0.94.0.00"),
    ]);
    assert_eq!(transmissions(&recording), [(1.3, "2".into(), Some(1), "rate 0".into())]);
    assert_eq!(receptions(&recording), [(23.0, "2", Some(2), Some(2), true)]);
    assert_eq!((skipped.garbled, recording.deaf_intervals.len()), (1, 1));
    assert!(recording.modem_ids.contains("1"));
}

#[test]
fn flexible_packets_have_mini_frames_and_data_frames() {
    let (recording, skipped) = capture(&[
        (1.0, "CCTFP,0,0,127,1,5,0,0,01,AABB"),
        (1.1, "CATFP,0,0,127,1,5,0,0,1;1;,1;1;;1;1;"),
        (1.2, "CATXP,28"),
        (3.0, "CATXF,28"),
        // Older firmware, and mini frames alone.
        (11.0, "CCTFP,3,1,5,0,0,01,"),
        (11.2, "CATXP,28"),
        (13.0, "CATXF,28"),
        // A packet of the modem's own frames has no data of the user.
        (21.0, "CCTFP,0,0,127,1,5,0,0,,"),
        (21.2, "CATXP,28"),
        (23.0, "CATXF,28"),
        (30.0, "CARFP,2026-05-03T12:00:30.5,0,2,127,1,5,0,0,1;6;08ff,1;1;01,0;1;AA;1;1;BB,0"),
        (40.0, "CARFP,2026-05-03T12:00:40.5,1,2,3,1,-1,0,0,1;6;08ff,1;1;01,"),
        (50.0, "CARFP,2026-05-03T12:00:50.5,2,2,127,1,-1,0,0,1;6;08ff,,"),
        (60.0, "CARFP,2026-05-03T12:01:00.5,3,2,127,1,5,0,0"),
    ]);
    let expected = [(1.2, "127", Some(3), "rate 5"), (11.2, "3", Some(1), "mini")];
    assert_eq!(
        transmissions(&recording),
        expected.map(|(time_s, destination, frames, kind)| (time_s, destination.into(), frames, kind.into()))
    );
    let expected = [
        (30.0, "2", Some(1), Some(3), true),
        (30.0, "2", Some(2), Some(3), false),
        (30.0, "2", Some(3), Some(3), true),
        (40.0, "2", Some(1), Some(1), true),
    ];
    assert_eq!(receptions(&recording), expected);
    assert_eq!((skipped.garbled, recording.deaf_intervals.len()), (1, 1));
}
