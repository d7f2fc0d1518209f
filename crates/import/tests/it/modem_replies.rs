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
fn an_acknowledgement_of_goby_is_a_reply() {
    let text =
        "%% LOG FILE: a\n%% LOGSTART 1777809600\n10 ACOMMS_MODEM_TRANSMIT p src: 1 dest: 2 type: ACK acked_frame: 0\n";
    let (recording, _) = read_text(text);
    assert_eq!(replies(&recording), [(1_777_809_610.0, 1_777_809_610.0, 1_777_809_613.0)]);
    assert!(recording.deaf_intervals.is_empty() && recording.transmissions.unwrap().is_empty());
}
