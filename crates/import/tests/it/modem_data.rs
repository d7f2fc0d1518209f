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

#[test]
fn sentences_with_unknown_names_are_counted_and_others_are_silent() {
    let silent =
        ["CACST,2", "CAREV,120001,AUV,2.1", "CACFG,SRC,1", "CCCFQ,ALL", "CAMFD,1,2,3,4", "CAACK,1,2,1,1", "CCCLK,1"];
    let navigation = ["SNTTA,1,2,3,4,120000", "GPGSV,1,1,00"];
    let unknown = ["CAJRX,1,2,3,0,00,1,1,AA", "CAJRX,1,2,3,0,00,1,1,BB", "CCTJN,0,3,0,00,AA", "CALONGNAME,1"];
    let sentences: Vec<_> = [&silent[..], &navigation, &unknown].concat().into_iter().map(|text| (1.0, text)).collect();
    let (recording, skipped) = capture(&sentences);
    assert_eq!(skipped.unknown_sentences.iter().collect::<Vec<_>>(), [("CAJRX", 2), ("CCTJN", 1), ("others", 1)]);
    // They say nothing about the activity of the modem.
    let (without, _) = capture(&sentences[..silent.len()]);
    assert_eq!(recording.modem_activity, without.modem_activity);
    // The number of names is bounded, also over several files.
    let names: Vec<String> = (0..100).map(|number| format!("CAX{number:02},1")).collect();
    let sentences: Vec<_> = names.iter().map(|name| (1.0, name.as_str())).collect();
    let counts = capture(&sentences).1;
    let other_counts = capture(&[(1.0, "CAJRX,1"), (2.0, "CAX00,1")]).1;
    for (counts, others, all) in [(counts.clone(), 68, 100), (counts.sum(other_counts), 69, 102)] {
        let counts = counts.unknown_sentences;
        assert_eq!((counts.iter().count(), counts.iter().map(|(_, number)| number).sum()), (33, all));
        assert_eq!(counts.iter().find(|(name, _)| *name == "others"), Some(("others", others)));
    }
}
