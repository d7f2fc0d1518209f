//! Reports: round trips with any bytes after the report, canonical encodings, lengths and authentication.

use pingmap_packet::*;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::golden;

fn cases(count: u32) -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(count) }
}

fn outcomes() -> impl Strategy<Value = Vec<Outcome>> {
    let reported = prop_oneof![Just(Outcome::Missed), Just(Outcome::Heard)];
    let any = prop_oneof![4 => reported.clone(), 1 => Just(Outcome::Unreported)];
    // Unreported outcomes at the end are not sent.
    let with_gaps = (vec(any, 0..200), reported.clone()).prop_map(|(mut outcomes, last)| {
        outcomes.push(last);
        outcomes
    });
    prop_oneof![vec(reported, 0..300), with_gaps]
}

fn report() -> impl Strategy<Value = (&'static ReportLayout, Report)> {
    let layout = prop::sample::select(&REPORT_LAYOUTS[..]);
    let waypoint = (any::<u8>(), any::<u8>(), any::<u8>(), 0..WAYPOINT_DEPTH_CELLS);
    let waypoint = waypoint.prop_map(|(slots, east, north, depth)| Waypoint { slots, east, north, depth });
    let head = (layout, any::<u8>(), 0..1_u16 << 14, 0..SLOTS, any::<bool>());
    (head, outcomes(), vec(waypoint, 0..=WAYPOINTS_MAX)).prop_map(
        |((layout, sender, model, first, includes_own_slots), outcomes, mut waypoints)| {
            if !layout.has_depth {
                waypoints.iter_mut().for_each(|waypoint| waypoint.depth = 0);
            }
            let layout = REPORT_LAYOUTS.iter().find(|known| known.id == layout.id).unwrap();
            let model = if layout.is_authenticated { 0 } else { model };
            (layout, Report { sender, model, first, includes_own_slots, outcomes, waypoints })
        },
    )
}

fn counts(outcomes: &[Outcome]) -> OutcomeCounts {
    let unreported = outcomes.iter().filter(|outcome| **outcome == Outcome::Unreported).count();
    OutcomeCounts { reported: outcomes.len() - unreported, unreported }
}

fn key() -> Key {
    Key::new(std::array::from_fn(|place| place as u8)).unwrap()
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn reports_round_trip_with_any_bytes_after_them((layout, report) in report(), rest in vec(any::<u8>(), 0..40)) {
        let key = key();
        let auth = layout.is_authenticated.then_some(Authenticator { key: &key, context: b"team" });
        let bytes = report.encode(layout, auth).unwrap();
        let length = layout.length(counts(&report.outcomes), report.waypoints.len());
        prop_assert_eq!(bytes.len(), length);
        for followed in [bytes.clone(), [bytes.clone(), vec![0; 9]].concat(), [bytes.clone(), rest].concat()] {
            let (found, again, length) = Report::decode(&followed, auth).unwrap();
            prop_assert_eq!((found.id, length), (layout.id, bytes.len()));
            prop_assert_eq!(&again, &report);
        }
    }

    #[test]
    fn an_authenticated_report_with_a_changed_bit_or_a_missing_byte_is_refused((layout, report) in report(), bit in any::<prop::sample::Index>()) {
        let layout = ReportLayout::new(layout.has_depth, true);
        let report = Report { model: 0, ..report };
        let key = key();
        let auth = Some(Authenticator { key: &key, context: b"team" });
        let mut bytes = report.encode(layout, auth).unwrap();
        let bit = bit.index(8 * bytes.len());
        bytes[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(Report::decode(&bytes, auth).is_err());
        prop_assert!(Report::decode(&bytes[..bytes.len() - 1], auth).is_err());
    }

    #[test]
    fn a_damaged_report_is_refused_or_canonical((layout, report) in report(), flips in vec(any::<prop::sample::Index>(), 1..4)) {
        let layout = ReportLayout::new(layout.has_depth, false);
        let mut bytes = report.encode(layout, None).unwrap();
        for flip in flips {
            let bit = flip.index(8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        if let Ok((layout, again, length)) = Report::decode(&bytes, None) {
            prop_assert_eq!(again.encode(layout, None).unwrap(), &bytes[..length]);
        }
    }

    #[test]
    fn an_outcome_takes_1_bit_or_with_gaps_at_most_1_6_bits(outcomes in outcomes()) {
        let bytes = |outcomes: Vec<Outcome>| {
            let report = Report { sender: 0, model: 0, first: 0, includes_own_slots: false, outcomes, waypoints: vec![] };
            report.encode(&REPORT_LAYOUTS[0], None).unwrap().len()
        };
        let bits = if outcomes.contains(&Outcome::Unreported) { 1.6 } else { 1.0 };
        let allowed = (bits * outcomes.len() as f64 / 8.0).ceil() as usize;
        prop_assert!(bytes(outcomes) <= bytes(vec![]) + allowed);
    }
}

fn examples() -> Vec<(&'static ReportLayout, Report)> {
    let outcomes = |gaps: bool| {
        (0..23).map(move |n| match n % 7 {
            3 if gaps => Outcome::Unreported,
            0 | 4 | 5 => Outcome::Heard,
            _ => Outcome::Missed,
        })
    };
    let waypoints = |has_depth: bool| {
        let depth = |n: u8| if has_depth { 9 * n + 1 } else { 0 };
        (0..4)
            .map(move |n| Waypoint { slots: 31 * n + 2, east: 60 * n, north: 255 - 17 * n, depth: depth(n) })
            .collect()
    };
    let example = |(place, layout): (usize, &'static ReportLayout)| {
        let model = if layout.is_authenticated { 0 } else { 10_917 };
        let (first, includes_own_slots) = (74_565, place >= 2);
        let outcomes = outcomes(place >= 1).collect();
        (
            layout,
            Report { sender: 52, model, first, includes_own_slots, outcomes, waypoints: waypoints(layout.has_depth) },
        )
    };
    REPORT_LAYOUTS.iter().enumerate().map(example).collect()
}

/// Deployed vehicles cannot follow a change of the format. An intended change needs another version of the protocol, an
/// entry in CHANGELOG.md, and new golden bytes (`PINGMAP_WRITE_GOLDEN=1`).
#[test]
fn encodings_match_the_golden_bytes() {
    let line = |(layout, report): (&ReportLayout, Report)| {
        let key = key();
        let auth = layout.is_authenticated.then_some(Authenticator { key: &key, context: b"golden" });
        format!("{} {}\n", layout.name, to_hex(&report.encode(layout, auth).unwrap()))
    };
    let found: String = examples().into_iter().map(line).collect();
    golden::check("tests/golden/reports.txt", &found);
}

#[test]
fn errors_name_the_field_or_the_kind_of_problem() {
    let (layout, report) = examples().remove(0);
    let refused = |report: Report| report.encode(layout, None).unwrap_err().to_string();
    assert!(refused(Report { first: SLOTS, ..report.clone() }).contains("first"));
    let deep = Waypoint { slots: 0, east: 0, north: 0, depth: 3 };
    assert!(refused(Report { waypoints: vec![deep], ..report.clone() }).contains("waypoint.depth"));
    let flat = Waypoint { depth: 0, ..deep };
    assert!(refused(Report { waypoints: vec![flat; WAYPOINTS_MAX + 1], ..report.clone() }).contains("waypoint"));
    assert!(refused(Report { outcomes: vec![Outcome::Heard; 8 * 256], ..report.clone() }).contains("outcomes"));
    let key = key();
    let auth = Authenticator { key: &key, context: b"" };
    assert!(matches!(report.encode(layout, Some(auth)), Err(Error::Authentication(_))));
    let bytes = report.encode(layout, None).unwrap();
    assert!(matches!(Report::decode(&bytes, Some(auth)), Err(Error::Authentication(_))));
    let authenticated = ReportLayout::new(false, true);
    assert!(matches!(report.encode(authenticated, None), Err(Error::Authentication(_))));
    let other = Authenticator { key: &key, context: b"other" };
    let bytes = Report { model: 0, ..report }.encode(authenticated, Some(auth)).unwrap();
    assert!(matches!(Report::decode(&bytes, Some(other)), Err(Error::OtherContext)));
    assert!(matches!(Report::decode(&bytes, None), Err(Error::Authentication(_))));
    assert!(matches!(Report::decode(&[0x12, 0x34], None), Err(Error::Id { .. })));
}
