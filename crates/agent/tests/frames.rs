//! Any bytes are a packet or are refused by reason, and whatever they say leaves every probability a probability.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::*;
use pingmap_agent::*;
use pingmap_packet::{Block, Layout, MapMessage, Point};
use proptest::collection::vec;
use proptest::prelude::*;

/// Bits before those that say something: id, sender and counter in 4 bytes, and 14 bits of the model.
const HEADER_BITS: usize = 46;

/// Length-scales from a thousandth of the region to ten thousand times it.
fn extreme_models() -> impl Strategy<Value = Model> {
    let decades = prop_oneof![-3.0f64..4.0, Just(-3.0), Just(4.0)];
    (shapes(), any::<bool>(), decades, -2.0f64..3.0).prop_map(|(shape, reciprocal, decades, variance)| {
        isotropic(shape, reciprocal, REACH_M * 10f64.powf(decades), 10f64.powf(variance))
    })
}

/// A frame of the team that says nothing.
fn silent(team: &Arc<Team>, sender: u8, counter: u16) -> Vec<u8> {
    let layout = team.layout(32).unwrap();
    let message = MapMessage { sender, counter, model: 0, blocks: vec![Block::silent(layout)] };
    vehicle(team, 0, []).write(layout, &message).unwrap()
}

/// The frame with random bits after its header, and the check number of what they say, if they say anything.
fn scribbled(team: &Arc<Team>, mut frame: Vec<u8>, bits: &[u8]) -> Vec<u8> {
    for (place, byte) in frame.iter_mut().enumerate() {
        let kept = HEADER_BITS.saturating_sub(8 * place).min(8);
        let header = if kept == 8 { 0xff } else { !(0xff << kept) };
        *byte = *byte & header | bits[place] & !header;
    }
    match MapMessage::decode(&frame, None) {
        Ok((layout, message)) => vehicle(team, 0, []).write(layout, &message).unwrap(),
        Err(_) => frame,
    }
}

fn counted(counts: &Counts) -> u64 {
    let Counts { accepted, malformed, forged, other_team, unknown_sender, duplicate, too_old, .. } = *counts;
    let Counts { conflict, unconfirmed, own_number, unusable, .. } = *counts;
    let known = accepted + malformed + forged + other_team + unknown_sender + duplicate + too_old;
    known + conflict + unconfirmed + own_number + unusable
}

/// Fails unless all probabilities are probabilities: at the links told of and between them, before and after a rebuild.
fn check_probabilities(agent: &mut Agent) -> Result<(), TestCaseError> {
    let told = agent.links_of_packets().into_iter().flat_map(|(_, _, links)| links);
    let places: Vec<Link> = told.chain(somewhere()).collect();
    for _ in 0..2 {
        let p = agent.probabilities(&places);
        let p = p.map_err(|error| TestCaseError::fail(error.to_string()))?;
        prop_assert!(p.iter().all(|p| (0.0..=1.0).contains(p)), "{:?}", p);
        agent.rebuild_posteriors().unwrap();
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn random_bits_of_the_team_are_taken_or_refused_and_harm_nothing(
        model in extreme_models(), events in events_of(0, 0..10), all in vec((0..5u8, any::<[u8; 32]>()), 24),
    ) {
        let team = Arc::new(team(4, model));
        let mut agent = vehicle(&team, 0, events);
        for (counter, (sender, bits)) in (0..).zip(&all) {
            let before = agent.snapshot();
            let receipt = agent.receive(&scribbled(&team, silent(&team, *sender, counter), bits), 0.0);
            let is_kept = matches!(receipt, Receipt::Accepted | Receipt::Refused(Refusal::OwnNumber { .. }));
            prop_assert_eq!(is_kept, agent.snapshot() != before, "{:?}", receipt);
            // The header is good, and so every refusal is for what stands behind it.
            let expected = is_kept && (*sender == 0) == matches!(receipt, Receipt::Refused(_))
                || matches!(receipt, Receipt::Refused(Refusal::Malformed(_) | Refusal::Unusable(_)))
                || matches!(receipt, Receipt::Refused(Refusal::UnknownSender { number: 4 })) && *sender == 4;
            prop_assert!(expected, "{:?}", receipt);
            if counter % 5 == 4 {
                check_probabilities(&mut agent)?;
            }
        }
        check_probabilities(&mut agent)?;
        prop_assert_eq!(counted(agent.counts()), all.len() as u64);
        agent.next_packet(0.0, 32).unwrap();
    }

    #[test]
    fn every_pattern_of_levels_is_positive_semidefinite_or_an_error(
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
        // Points that the kernel cannot tell apart are the error.
        if let Ok(summary) = team.wire().decode(&block) {
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
    fn points_as_close_as_cells_allow_harm_nothing(
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
            let bytes = agent.write(layout, &MapMessage { sender: 1, counter, model: 0, blocks }).unwrap();
            let receipt = agent.receive(&bytes, 0.0);
            let expected = matches!(receipt, Receipt::Accepted | Receipt::Refused(Refusal::Unusable(_)));
            prop_assert!(expected, "{:?}", receipt);
        }
        check_probabilities(&mut agent)?;
    }

    #[test]
    fn random_bytes_are_refused_and_counted(
        all in vec(vec(any::<u8>(), 0..300), 1..20), starts in vec(any::<bool>(), 20),
    ) {
        let team = Arc::new(team(2, model()));
        let mut agent = vehicle(&team, 0, walk(0, 5, 0.0));
        let before = agent.snapshot();
        for (bytes, &looks_right) in all.iter().zip(&starts) {
            let mut bytes = bytes.clone();
            if looks_right {
                bytes.splice(..bytes.len().min(1), [silent(&team, 1, 0)[0]]);
            }
            agent.receive(&bytes, 0.0);
        }
        prop_assert_eq!(counted(agent.counts()), all.len() as u64);
        if agent.counts().accepted == 0 {
            prop_assert_eq!(agent.snapshot(), before);
        }
        check_probabilities(&mut agent)?;
    }
}

#[test]
fn points_that_coincide_say_nothing_usable() {
    let team = Arc::new(team(2, model()));
    let layout: &Layout = team.layout(32).unwrap();
    let mut agent = vehicle(&team, 0, []);
    let mut block = Block::silent(layout);
    for point in &mut block.points[..2] {
        point.information = 12;
    }
    let message = MapMessage { sender: 1, counter: 0, model: 0, blocks: vec![block] };
    let bytes = agent.write(layout, &message).unwrap();
    assert!(matches!(agent.receive(&bytes, 0.0), Receipt::Refused(Refusal::Unusable(_))));
    assert_eq!((agent.counts().unusable, agent.live_packets()), (1, 0));
}

#[test]
fn zeros_that_fill_a_frame_are_no_part_of_the_packet() {
    let team = Arc::new(team(2, model()));
    let bytes = vehicle(&team, 1, walk(1, 20, 0.0)).next_packet(0.0, 32).unwrap().unwrap();
    let (mut plain, mut filled) = (vehicle(&team, 0, []), vehicle(&team, 0, []));
    plain.receive(&bytes, 0.0);
    assert_eq!(filled.receive(&[bytes.as_slice(), &[0; 9]].concat(), 0.0), Receipt::Accepted);
    assert_eq!(filled.receive(&bytes, 0.0), Receipt::Refused(Refusal::Duplicate));
    assert_eq!(filled.snapshot(), plain.snapshot());
}

#[test]
fn a_damaged_open_frame_is_refused() {
    let team = Arc::new(team(2, model()));
    let frame = sent(&mut vehicle(&team, 1, walk(1, 20, 0.0)), 1).remove(0);
    let mut agent = vehicle(&team, 0, walk(0, 5, 0.0));
    let before = agent.snapshot();
    for bit in 0..8 * frame.len() {
        let mut damaged = frame.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        let refused = matches!(agent.receive(&damaged, 0.0), Receipt::Refused(_));
        assert!(refused, "bit {bit}");
    }
    assert_eq!(agent.snapshot(), before);
    assert_eq!(agent.receive(&frame, 0.0), Receipt::Accepted);
}
