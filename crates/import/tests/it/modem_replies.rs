//! Acknowledgements that a modem sends by itself.

use pingmap_import::{ExclusionReason, Recording};

use crate::modems::{capture, read_text};

fn replies(recording: &Recording) -> Vec<(f64, f64, f64)> {
    recording.replies.iter().map(|reply| (reply.decoded_s, reply.start_s, reply.end_s)).collect()
}

#[test]
fn a_packet_after_a_message_that_requests_an_acknowledgement_is_a_reply() {
    let packet = [(3.0, "CATXP,0"), (4.0, "CATXF,0")];
    let source = (0.0, "CACFG,SRC,1");
    // The latest frame is answered. Mini-packets are always answered.
    for requests in [
        &[(2.5, "CARXD,2,1,1,1,AA")][..],
        &[(1.0, "CARXD,2,1,1,1,AA"), (2.5, "CARXD,2,1,1,2,AA")],
        &[(2.5, "CARDP,2,1,5,1,0,1;2;AABB")],
        &[(2.5, "CARXA,2,1,1,1,a text")],
        &[(2.5, "CARFP,2026-05-03T12:00:00.5,0,2,1,1,5,1,0,1;6;08ff,,1;2;AABB")],
        &[(2.5, "CAMUA,2,1,0123")],
    ] {
        let (recording, _) = capture(&[&[source][..], requests, &packet].concat());
        assert_eq!(replies(&recording), [(2.5, 3.0, 4.0)], "{requests:?}");
        assert!(recording.deaf_intervals.is_empty() && recording.transmissions.unwrap().is_empty());
    }
    // The modem's own id is unknown, and its report of the start is switched off.
    let (recording, _) = capture(&[(2.5, "CARXD,2,1,1,1,AA"), (4.0, "CATXF,0")]);
    assert_eq!(replies(&recording), [(2.5, 2.5, 4.0)]);
    // No acknowledgement was requested, or from another modem, or long ago, or the host began a cycle.
    for earlier in [
        &[(2.5, "CARXD,2,1,0,1,AA")][..],
        &[(2.5, "CARXD,2,3,1,1,AA")],
        &[(2.5, "CAMUA,2,3,0123")],
        &[(-4.0, "CARXD,2,1,1,1,AA")],
        &[(2.5, "CARXD,2,1,1,1,AA"), (2.8, "CCCYC,0,1,2,0,0,1"), (2.9, "CACYC,0,1,2,0,0,1")],
        &[(2.5, "CARXD,2,1,1,1,AA"), (2.9, "CAPDT,1,1")],
    ] {
        let (recording, _) = capture(&[&[source][..], earlier, &packet].concat());
        assert_eq!(replies(&recording), [], "{earlier:?}");
        assert_eq!(recording.deaf_intervals.last(), Some(&(3.0, 4.0, ExclusionReason::Transmitting)), "{earlier:?}");
    }
}

#[test]
fn a_reply_does_not_extend_the_activity_of_the_modem() {
    // A modem that answers shows that it decoded a message. Data and cycles are independent of that.
    let statistics = "CAXST,6,20260503,120005.0000,0,0,200,5000,25000,0,1,2,0,1,1,2,0";
    let start =
        [(0.0, "CACFG,SRC,1"), (2.5, "CARXD,2,1,1,1,AA"), (3.0, "CATXP,0"), (4.0, "CATXF,0"), (4.1, statistics)];
    assert_eq!(capture(&start).0.modem_activity, [(0.0, 2.5)]);
    let (recording, _) = capture(&[&start[..], &[(9.0, "CATXP,0"), (9.9, "CATXF,0"), (9.95, statistics)]].concat());
    assert_eq!(recording.modem_activity, [(0.0, 9.95)]);
    // Statistics of an acknowledgement neither prove nor revoke data that wait for their transmission.
    let waiting = [&start[..4], &[(4.05, "CATXD,1,2,0,1"), (4.1, statistics)]].concat();
    assert!(capture(&waiting).0.transmissions.unwrap().is_empty());
}

#[test]
fn an_acknowledgement_of_goby_is_a_reply() {
    let text =
        "%% LOG FILE: a\n%% LOGSTART 1777809600\n10 ACOMMS_MODEM_TRANSMIT p src: 1 dest: 2 type: ACK acked_frame: 0\n";
    let (recording, _) = read_text(text);
    assert_eq!(replies(&recording), [(1_777_809_610.0, 1_777_809_610.0, 1_777_809_613.0)]);
    assert!(recording.deaf_intervals.is_empty() && recording.transmissions.unwrap().is_empty());
}
