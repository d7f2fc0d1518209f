//! Reports: they come back as they were said, stand in front of anything, and a changed bit changes them or is refused.

#![allow(clippy::unwrap_used)]

use pingmap_packet::*;
use proptest::collection::vec;
use proptest::prelude::*;

fn cases(count: u32) -> ProptestConfig {
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(count) }
}

fn outcomes() -> impl Strategy<Value = Vec<Outcome>> {
    let told = prop_oneof![Just(Outcome::Missed), Just(Outcome::Heard)];
    let any = prop_oneof![4 => told.clone(), 1 => Just(Outcome::Untold)];
    // What says nothing is not sent at the end.
    let with_gaps = (vec(any, 0..200), told.clone()).prop_map(|(mut outcomes, last)| {
        outcomes.push(last);
        outcomes
    });
    let few = vec((0..300_usize, told.clone()), 0..20).prop_map(|few| {
        let run = |(gap, told)| std::iter::repeat_n(Outcome::Untold, gap).chain([told]);
        few.into_iter().flat_map(run).collect()
    });
    prop_oneof![vec(told, 0..300), with_gaps, few]
}

fn report() -> impl Strategy<Value = (&'static ReportLayout, Report)> {
    let layout = prop::sample::select(&REPORT_LAYOUTS[..]);
    let knot = (any::<u8>(), any::<u8>(), any::<u8>(), 0..KNOT_DEPTH_CELLS);
    let knot = knot.prop_map(|(slots, east, north, depth)| Knot { slots, east, north, depth });
    let earlier = (any::<u8>(), any::<bool>()).prop_map(|(before, counts)| Earlier { before, counts });
    let head = (layout, any::<u8>(), 0..1_u16 << 14, 0..SLOTS, any::<bool>());
    (head, outcomes(), vec(knot, 0..=KNOTS_MAX), prop::option::of(earlier)).prop_map(
        |((layout, sender, model, first, tells_own), outcomes, mut knots, earlier)| {
            if !layout.has_depth {
                knots.iter_mut().for_each(|knot| knot.depth = 0);
            }
            let layout = REPORT_LAYOUTS.iter().find(|known| known.id == layout.id).unwrap();
            let model = if layout.is_sealed { 0 } else { model };
            (layout, Report { sender, model, first, tells_own, outcomes, knots, earlier })
        },
    )
}

fn counts(outcomes: &[Outcome]) -> OutcomeCounts {
    let mut counts = OutcomeCounts::default();
    for run in outcomes.chunk_by(|a, b| (*a == Outcome::Untold) == (*b == Outcome::Untold)) {
        match run[0] {
            Outcome::Untold => {
                counts.untold += run.len();
                counts.skips += run.len() / OutcomeCounts::SKIP;
            }
            _ => counts.told += run.len(),
        }
    }
    counts
}

fn key() -> Key {
    Key::new(std::array::from_fn(|place| place as u8)).unwrap()
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn a_report_comes_back_whatever_follows_it((layout, report) in report(), rest in vec(any::<u8>(), 0..40)) {
        let key = key();
        let seal = layout.is_sealed.then_some(Seal { key: &key, context: b"team" });
        let bytes = report.encode(layout, seal).unwrap();
        let length = layout.length(counts(&report.outcomes), report.knots.len(), report.earlier.is_some());
        prop_assert_eq!(bytes.len(), length);
        for followed in [bytes.clone(), [bytes.clone(), vec![0; 9]].concat(), [bytes.clone(), rest].concat()] {
            let (found, again, length) = Report::decode(&followed, seal).unwrap();
            prop_assert_eq!((found.id, length), (layout.id, bytes.len()));
            prop_assert_eq!(&again, &report);
        }
    }

    #[test]
    fn a_changed_bit_is_no_sealed_report((layout, report) in report(), bit in any::<prop::sample::Index>()) {
        let layout = ReportLayout::new(layout.has_depth, true);
        let report = Report { model: 0, ..report };
        let key = key();
        let seal = Some(Seal { key: &key, context: b"team" });
        let mut bytes = report.encode(layout, seal).unwrap();
        let bit = bit.index(8 * bytes.len());
        bytes[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(Report::decode(&bytes, seal).is_err());
        prop_assert!(Report::decode(&bytes[..bytes.len() - 1], seal).is_err());
    }

    /// Any bytes are refused, or are the one form of what they say.
    #[test]
    fn no_other_bytes_say_the_same((layout, report) in report(), flips in vec(any::<prop::sample::Index>(), 1..4)) {
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

    /// At most 1.6 bits an outcome, and one where every outcome is told; a byte for each of few.
    #[test]
    fn outcomes_take_few_bits(outcomes in outcomes()) {
        let bytes = |outcomes: Vec<Outcome>| {
            let report = Report { sender: 0, model: 0, first: 0, tells_own: false, outcomes, knots: vec![], earlier: None };
            report.encode(&REPORT_LAYOUTS[0], None).unwrap().len()
        };
        let bits = if outcomes.contains(&Outcome::Untold) { 1.6 } else { 1.0 };
        let allowed = (bits * outcomes.len() as f64 / 8.0).ceil() as usize;
        let OutcomeCounts { told, skips, .. } = counts(&outcomes);
        prop_assert!(bytes(outcomes) <= bytes(vec![]) + allowed.min(told + skips));
    }
}

fn examples() -> Vec<(&'static ReportLayout, Report)> {
    let outcomes = |gaps: bool| {
        (0..23).map(move |n| match n % 7 {
            3 if gaps => Outcome::Untold,
            0 | 4 | 5 => Outcome::Heard,
            _ => Outcome::Missed,
        })
    };
    let knots = |has_depth: bool| {
        let depth = |n: u8| if has_depth { 9 * n + 1 } else { 0 };
        (0..4).map(move |n| Knot { slots: 31 * n + 2, east: 60 * n, north: 255 - 17 * n, depth: depth(n) }).collect()
    };
    let example = |(place, layout): (usize, &'static ReportLayout)| {
        let earlier = (place % 2 == 1).then_some(Earlier { before: 201, counts: true });
        let model = if layout.is_sealed { 0 } else { 10_917 };
        let (first, tells_own) = (74_565, place >= 2);
        let outcomes = outcomes(place >= 1).collect();
        (layout, Report { sender: 52, model, first, tells_own, outcomes, knots: knots(layout.has_depth), earlier })
    };
    let few = || {
        let told = [(0, Outcome::Heard), (4, Outcome::Missed), (300, Outcome::Heard), (301, Outcome::Missed)];
        let mut outcomes = vec![Outcome::Untold; 302];
        told.into_iter().for_each(|(place, outcome)| outcomes[place] = outcome);
        (&REPORT_LAYOUTS[0], Report { outcomes, ..example((0, &REPORT_LAYOUTS[0])).1 })
    };
    REPORT_LAYOUTS.iter().enumerate().map(example).chain([few()]).collect()
}

/// What is on the water does not change by chance. Who changes it on purpose gives the protocol another version, says so in
/// CHANGELOG.md and writes these bytes anew.
#[test]
fn every_form_of_report_has_its_golden_bytes() {
    let line = |(layout, report): (&ReportLayout, Report)| {
        let key = key();
        let seal = layout.is_sealed.then_some(Seal { key: &key, context: b"golden" });
        format!("{} {}\n", layout.name, to_hex(&report.encode(layout, seal).unwrap()))
    };
    let found: String = examples().into_iter().map(line).collect();
    assert_eq!(found, include_str!("golden/reports.txt"));
}

#[test]
fn reports_of_other_kinds_are_told_by_name() {
    let (layout, report) = examples().remove(0);
    let refused = |report: Report| report.encode(layout, None).unwrap_err().to_string();
    assert!(refused(Report { first: SLOTS, ..report.clone() }).contains("first"));
    let deep = Knot { slots: 0, east: 0, north: 0, depth: 3 };
    assert!(refused(Report { knots: vec![deep], ..report.clone() }).contains("knot.depth"));
    let flat = Knot { depth: 0, ..deep };
    assert!(refused(Report { knots: vec![flat; KNOTS_MAX + 1], ..report.clone() }).contains("knot"));
    assert!(refused(Report { outcomes: vec![Outcome::Heard; 8 * 256], ..report.clone() }).contains("outcomes"));
    let key = key();
    let seal = Seal { key: &key, context: b"" };
    assert!(matches!(report.encode(layout, Some(seal)), Err(Error::Seal(_))));
    let bytes = report.encode(layout, None).unwrap();
    assert!(matches!(Report::decode(&bytes, Some(seal)), Err(Error::Seal(_))));
    let sealed = ReportLayout::new(false, true);
    assert!(matches!(report.encode(sealed, None), Err(Error::Seal(_))));
    let other = Seal { key: &key, context: b"other" };
    let bytes = Report { model: 0, ..report }.encode(sealed, Some(seal)).unwrap();
    assert!(matches!(Report::decode(&bytes, Some(other)), Err(Error::OtherContext)));
    assert!(matches!(Report::decode(&bytes, None), Err(Error::Seal(_))));
    assert!(matches!(Report::decode(&[0x12, 0x34], None), Err(Error::Id { .. })));
}
