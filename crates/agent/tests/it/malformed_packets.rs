//! Malformed packets: any bytes are a packet or are refused with a reason, and no packet breaks a prediction.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::{Block, Layout, MapMessage, Point};
use proptest::collection::vec;
use proptest::prelude::*;

/// Bits before the content: id, sender and counter in 4 bytes, and 14 bits of the check number.
const HEADER_BITS: usize = 46;

/// Length-scales from a thousandth of the region to ten thousand times it.
fn extreme_models() -> impl Strategy<Value = Model> {
    let decades = prop_oneof![-3.0f64..4.0, Just(-3.0), Just(4.0)];
    (shapes(), any::<bool>(), decades, -2.0f64..3.0).prop_map(|(shape, reciprocal, decades, variance)| {
        isotropic(shape, reciprocal, REACH_M * 10f64.powf(decades), 10f64.powf(variance))
    })
}

/// The frame with random bits after its header, and with a check number that fits if these bits decode.
fn scrambled(team: &Arc<Team>, mut frame: Vec<u8>, bits: &[u8]) -> Vec<u8> {
    for (place, byte) in frame.iter_mut().enumerate() {
        let kept = HEADER_BITS.saturating_sub(8 * place).min(8);
        let header = if kept == 8 { 0xff } else { !(0xff << kept) };
        *byte = *byte & header | bits[place] & !header;
    }
    match MapMessage::decode(&frame, None) {
        Ok((layout, message)) => vehicle(team, 0, []).codec().write(layout, &message).unwrap(),
        Err(_) => frame,
    }
}

/// Number of all counted packets.
fn counted(agent: &Agent) -> u64 {
    agent.status().counts.values().sum()
}

/// Fails unless all predictions are probabilities: at the received points and between them, before and after a rebuild.
fn check_probabilities(agent: &mut Agent) -> Result<(), TestCaseError> {
    let received = agent.links_of_packets().into_iter().flat_map(|(_, _, links)| links);
    let places: Vec<Link> = received.chain(test_links()).collect();
    for _ in 0..2 {
        let p = agent.predict(&places, Which::Fused);
        let p = p.map_err(|error| TestCaseError::fail(error.to_string()))?;
        prop_assert!(p.iter().all(|p| (0.0..=1.0).contains(&p.probability)), "{:?}", p);
        agent.rebuild().unwrap();
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn random_content_is_accepted_or_refused_and_keeps_probabilities_in_range(
        model in extreme_models(), events in events_of(0, 0..10), all in vec((0..5u8, any::<[u8; 32]>()), 24),
    ) {
        let team = Arc::new(team(4, model));
        let mut agent = vehicle(&team, 0, events);
        for (counter, (sender, bits)) in (0..).zip(&all) {
            let before = agent.snapshot();
            let receipt = agent.receive(&scrambled(&team, empty_packet(&team, *sender, counter), bits), None).receipt;
            let is_stored = matches!(receipt, Receipt::Accepted | Receipt::Refused(Refusal::OwnNumber(_)));
            prop_assert_eq!(is_stored, agent.snapshot() != before, "{:?}", receipt);
            // The header is valid, so that every refusal is due to the content after it.
            let expected = is_stored && (*sender == 0) == matches!(receipt, Receipt::Refused(_))
                || matches!(receipt, Receipt::Refused(Refusal::Malformed(_) | Refusal::Unusable(_)))
                || matches!(receipt, Receipt::Refused(Refusal::UnknownSender(4))) && *sender == 4;
            prop_assert!(expected, "{:?}", receipt);
            if counter % 5 == 4 {
                check_probabilities(&mut agent)?;
            }
        }
        check_probabilities(&mut agent)?;
        prop_assert_eq!(counted(&agent), all.len() as u64);
        agent.next_frame(None, 32).unwrap();
    }

    #[test]
    fn every_combination_of_levels_decodes_to_a_positive_semidefinite_precision_or_an_error(
        model in extreme_models(),
        points in vec((0..64u8, 0..64u8, 0..64u8, 0..64u8, 0..32u8, -15..=15i8), 5),
        time in 0..64u8,
        correlations in vec(-3..=3i8, 10),
        directions in vec(vec(-1.0..1.0f64, 5), 8),
    ) {
        let team = team(2, model);
        let cell = |east, north| pingmap_packet::Cell { east, north, depth: 0 };
        let points = points.into_iter().map(|(a, b, c, d, information, mean)| {
            Point { transmitter: cell(a, b), receiver: cell(c, d), information, mean }
        });
        let block = Block { time, points: points.collect(), correlations };
        // The error is for points that the kernel cannot tell apart.
        if let Ok(summary) = team.quantizer().decode(&block) {
            let precision = summary.whitened_precision();
            let size = summary.len();
            let scale: f64 = (0..size).map(|i| precision[(i, i)]).sum();
            for v in &directions {
                let pairs = (0..size).flat_map(|i| (0..size).map(move |j| (i, j)));
                let quadratic: f64 = pairs.map(|(i, j)| v[i] * precision[(i, j)] * v[j]).sum();
                prop_assert!(quadratic >= -1e-12 * scale, "{} {:?}", quadratic, v);
            }
            prop_assert!(summary.moments().is_ok());
            prop_assert!(summary.whitened_shift().iter().all(|shift| shift.is_finite()));
        }
    }

    #[test]
    fn points_in_neighbouring_cells_keep_probabilities_in_range(
        model in extreme_models(),
        all in vec((vec((0..3u8, 0..3u8, 0..3u8, 0..3u8, 0..32u8, -15..=15i8), 5), vec(-3..=3i8, 10)), 12),
    ) {
        let team = Arc::new(team(2, model));
        let layout = team.layout(32).unwrap();
        let mut agent = vehicle(&team, 0, walk(0, 5, 0.0));
        for (counter, (points, correlations)) in (0..).zip(all) {
            let cell = |east: u8, north: u8| pingmap_packet::Cell { east: 30 + east, north: 30 + north, depth: 0 };
            let points = points.into_iter().map(|(a, b, c, d, information, mean)| {
                Point { transmitter: cell(a, b), receiver: cell(c, d), information, mean }
            });
            let blocks = vec![Block { time: counter as u8 % 64, points: points.collect(), correlations }];
            let bytes = agent.codec().write(layout, &MapMessage { sender: 1, counter, model: 0, blocks }).unwrap();
            let receipt = agent.receive(&bytes, None).receipt;
            let expected = matches!(receipt, Receipt::Accepted | Receipt::Refused(Refusal::Unusable(_)));
            prop_assert!(expected, "{:?}", receipt);
        }
        check_probabilities(&mut agent)?;
    }

    #[test]
    fn random_bytes_are_refused_and_counted(
        all in vec(vec(any::<u8>(), 0..300), 1..20), have_an_id in vec(any::<bool>(), 20),
    ) {
        let team = Arc::new(team(2, model()));
        let mut agent = vehicle(&team, 0, walk(0, 5, 0.0));
        let before = agent.snapshot();
        for (bytes, &has_an_id) in all.iter().zip(&have_an_id) {
            let mut bytes = bytes.clone();
            if has_an_id {
                bytes.splice(..bytes.len().min(1), [empty_packet(&team, 1, 0)[0]]);
            }
            agent.receive(&bytes, None);
        }
        prop_assert_eq!(counted(&agent), all.len() as u64);
        if count(&agent, "accepted") == 0 {
            prop_assert_eq!(agent.snapshot(), before);
        }
        check_probabilities(&mut agent)?;
    }
}

#[test]
fn coinciding_points_are_unusable() {
    let team = Arc::new(team(2, model()));
    let layout: &Layout = team.layout(32).unwrap();
    let mut agent = vehicle(&team, 0, []);
    let mut block = Block::empty(layout);
    for point in &mut block.points[..2] {
        point.information = 12;
    }
    let message = MapMessage { sender: 1, counter: 0, model: 0, blocks: vec![block] };
    let bytes = agent.codec().write(layout, &message).unwrap();
    assert!(matches!(agent.receive(&bytes, None).receipt, Receipt::Refused(Refusal::Unusable(_))));
    let status = agent.status();
    assert_eq!((status.counts["unusable"], status.live_packets), (1, 0));
}

#[test]
fn padding_zeros_are_not_part_of_the_packet() {
    let team = Arc::new(team(2, model()));
    let bytes = vehicle(&team, 1, walk(1, 20, 0.0)).next_frame(None, 32).unwrap().unwrap().bytes;
    let (mut plain, mut padded) = (vehicle(&team, 0, []), vehicle(&team, 0, []));
    plain.receive(&bytes, None);
    assert_eq!(padded.receive(&[bytes.as_slice(), &[0; 9]].concat(), None).receipt, Receipt::Accepted);
    assert_eq!(padded.receive(&bytes, None).receipt, Receipt::Refused(Refusal::Duplicate));
    assert_eq!(padded.snapshot(), plain.snapshot());
}

#[test]
fn a_damaged_plain_frame_is_refused() {
    let team = Arc::new(team(2, model()));
    let frame = frames(&mut vehicle(&team, 1, walk(1, 20, 0.0)), 1).remove(0);
    let mut agent = vehicle(&team, 0, walk(0, 5, 0.0));
    let before = agent.snapshot();
    for bit in 0..8 * frame.len() {
        let mut damaged = frame.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        let refused = matches!(agent.receive(&damaged, None).receipt, Receipt::Refused(_));
        assert!(refused, "bit {bit}");
    }
    assert_eq!(agent.snapshot(), before);
    assert_eq!(agent.receive(&frame, None).receipt, Receipt::Accepted);
}

#[test]
fn a_block_of_the_wrong_size_or_with_levels_out_of_range_is_refused() {
    let team = team(1, model());
    let layout = team.layout(32).unwrap();
    let mut block = Block::empty(layout);
    for (n, point) in block.points.iter_mut().enumerate() {
        point.transmitter.east = 7 * n as u8;
        point.information = 5;
    }
    assert!(team.quantizer().decode(&block).is_ok());
    let with = |change: &dyn Fn(&mut Block)| {
        let mut block = block.clone();
        change(&mut block);
        team.quantizer().decode(&block).unwrap_err()
    };
    let few = with(&|block| block.correlations.truncate(9));
    assert!(matches!(few, dgpc::Error::SizeMismatch { expected: 10, found: 9, .. }), "{few}");
    for refused in [
        with(&|block| block.correlations[3] = 8),
        with(&|block| block.correlations[3] = i8::MIN),
        with(&|block| block.points[1].information = 32),
        with(&|block| block.points[1].mean = -16),
    ] {
        assert!(matches!(refused, dgpc::Error::OutOfRange { .. }), "{refused}");
    }
}
