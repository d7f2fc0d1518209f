//! The quantizer: every level of a block survives decoding and encoding.

use crate::common::*;
use dgpc::{Inputs, Matrix, Summary};
use pingmap_packet::{Block, Layout};

/// A block without information whose points lie far apart.
fn block(layout: &Layout) -> Block {
    let mut block = Block::empty(layout);
    for (n, point) in block.points.iter_mut().enumerate() {
        (point.transmitter.east, point.receiver.north) = (12 * n as u8, 60 - 12 * n as u8);
    }
    block
}

#[test]
fn every_level_survives_decoding_and_encoding() {
    let team = team(1, model());
    let (quantizer, layout) = (team.quantizer(), team.layout(32).unwrap());
    for step in 0..31 {
        let mut block = block(layout);
        for (n, point) in block.points.iter_mut().enumerate() {
            point.information = 1 + (step + 7 * n as u8) % 31;
            point.mean = (step as i8 + 5 * n as i8) % 31 - 15;
        }
        for (n, correlation) in block.correlations.iter_mut().enumerate() {
            *correlation = (step as i8 + n as i8) % 7 - 3;
        }
        let (links, summary) = (quantizer.links(&block.points), quantizer.decode(&block).unwrap());
        let encoded = quantizer.encode(layout, block.time, &links, &|_| Ok(summary.clone())).unwrap();
        assert_eq!(encoded.unwrap().0, block);
    }
}

#[test]
fn values_beyond_the_levels_are_clipped_and_points_without_information_are_omitted() {
    let team = team(1, model());
    let (quantizer, layout) = (team.quantizer(), team.layout(32).unwrap());
    let links = quantizer.links(&block(layout).points[..2]);
    let levels = |information: f64, shift: f64, correlation: f64| {
        let summarize = |points: &Inputs| {
            let entry = |i, j| if i == j { information } else { correlation * information };
            Summary::from_whitened(&team.model.prior, points, Matrix::from_fn(2, 2, entry), vec![shift; 2])
        };
        let encoded = quantizer.encode(layout, 0, &links, &summarize).unwrap();
        encoded.map(|(block, _)| (block.points[1].information, block.points[1].mean, block.correlations[0]))
    };
    assert_eq!(levels(1e6, 1e9, 1.0), Some((31, 15, 3)));
    assert_eq!(levels(1e6, -1e9, -1.0), Some((31, -15, -3)));
    assert_eq!(levels(0.0, 0.0, 0.0), None);
}
