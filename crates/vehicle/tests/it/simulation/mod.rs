//! A whole team of real vehicles in a simulated world, driven by one seed: water, clocks, hosts and disks.
//!
//! The world injects faults of the channel: loss, duplicates, late frames, bit flips, forged and replayed frames. Disks
//! crash at any write, lose or tear unsynced writes, and fill up. Clocks jump and drift. Slots stay unused, frames
//! expire, and one member is faulty. Checkers compare the vehicles with the state of the world.
//!
//! `VEHICLE_SEEDS=10000 cargo nextest run --release -p pingmap-vehicle simulation` runs more seeds, and
//! `VEHICLE_SEEDS=200..10000` those from 200 on.

mod checks;
mod faulty;
mod member;
mod world;

use rayon::prelude::*;

use self::checks::{Finding, Selection};
use self::faulty::{FAULTS, Sabotage};
use self::world::{Run, World};

/// Seeds of the normal test.
const SEEDS: u64 = 200;

/// Number of seeds whose mean has an error far below [`HARM_MAX`].
const SEEDS_OF_PRECISE_HARM: usize = 5000;

/// Largest increase of the NLL of honest members by received data, in nats per event, over all runs.
const HARM_MAX: f64 = 0.002;

fn seeds() -> std::ops::Range<u64> {
    let Ok(seeds) = std::env::var("VEHICLE_SEEDS") else { return 0..SEEDS };
    let (first, end) = seeds.split_once("..").unwrap_or(("0", &seeds));
    let number = |text: &str| text.parse().expect("VEHICLE_SEEDS is a number or a range");
    number(first)..number(end)
}

/// Runs these seeds with a planted fault.
fn runs(seeds: std::ops::Range<u64>, sabotage: Sabotage) -> Vec<Run> {
    seeds.into_par_iter().map(|seed| World::new(seed, sabotage).run()).collect()
}

fn findings(runs: &[Run]) -> Vec<(u64, &Finding)> {
    runs.iter().flat_map(|run| run.findings.iter().map(|finding| (run.seed, finding))).collect()
}

/// The sum of the selections of all runs.
fn selection(runs: &[Run]) -> Selection {
    runs.iter().fold(Selection::default(), |sum, run| sum.plus(&run.selection))
}

/// Mean NLL of the team minus that of own events alone, and its standard error over runs.
fn harm<'a>(runs: impl IntoIterator<Item = &'a Run>) -> (f64, f64) {
    let differences: Vec<f64> = runs.into_iter().filter_map(|run| run.harm).collect();
    let count = differences.len() as f64;
    let mean = differences.iter().sum::<f64>() / count;
    let variance = differences.iter().map(|difference| (difference - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

#[test]
fn no_seed_breaks_an_invariant_and_sharing_does_no_harm() {
    let runs = runs(seeds(), Sabotage::None);
    let found = findings(&runs);
    assert!(found.is_empty(), "{} findings, the first: {:#?}", found.len(), &found[..found.len().min(5)]);
    let selection = selection(&runs);
    assert!(selection.is_independent(), "{selection:?}");
    for fault in FAULTS {
        let (harm, error) = harm(runs.iter().filter(|run| run.fault == fault));
        println!("{fault:?}: harm {harm:.4} +- {error:.4} nats");
    }
    let (harm, error) = harm(&runs);
    println!("{} runs; harm {harm:.4} +- {error:.4} nats; {selection:?}", runs.len());
    // The error of 200 seeds is about as large as the bound.
    let is_precise = runs.len() >= SEEDS_OF_PRECISE_HARM;
    let bound = if is_precise { harm + error } else { harm - 2.0 * error };
    assert!(bound <= HARM_MAX, "{harm} +- {error}");
    // The faults did occur.
    let total = |count: fn(&Run) -> u64| runs.iter().map(count).sum::<u64>();
    let counts = [total(|run| run.crashes), total(|run| run.store_failures), total(|run| run.forgeries)];
    assert!(counts.iter().all(|&count| count > runs.len() as u64 / 10), "{counts:?}");
}

#[test]
fn a_seed_replays_exactly() {
    for seed in 0..4 {
        let [first, second] = [0, 1].map(|_| World::new(seed, Sabotage::None).run());
        assert_eq!(first.transcript, second.transcript, "seed {seed}");
    }
}

#[test]
fn a_muted_member_equals_one_whose_frames_never_arrive() {
    for seed in 0..12 {
        let [muted, absent] = [Sabotage::Mute, Sabotage::DropFrames].map(|choice| World::new(seed, choice).run());
        assert!(muted.first_vehicle == absent.first_vehicle, "seed {seed}");
    }
}

#[test]
fn every_checker_catches_a_planted_fault() {
    for (sabotage, is_expected) in [
        (Sabotage::LoseRecord, (|finding| matches!(finding, Finding::LostRecords { .. })) as fn(&Finding) -> bool),
        (Sabotage::CountTwice, |finding| matches!(finding, Finding::CountedTwice { .. })),
        (Sabotage::ForgetOnRestart, |finding| matches!(finding, Finding::OtherSnapshot { .. })),
        (Sabotage::LeakKey, |finding| matches!(finding, Finding::AcceptedForgery { .. })),
        (Sabotage::ReuseCounters, |finding| matches!(finding, Finding::ReusedCounter { .. })),
        (Sabotage::RaiseLimit, |finding| matches!(finding, Finding::OverLimit { .. })),
        (Sabotage::AdvanceClocks, |finding| matches!(finding, Finding::Refused { .. })),
        (Sabotage::AdvanceClocks, |finding| matches!(finding, Finding::WrongClock { .. })),
    ] {
        let runs = runs(0..12, sabotage);
        assert!(findings(&runs).iter().any(|(_, finding)| is_expected(finding)), "{sabotage:?}");
    }
    let biased = runs(0..24, Sabotage::HideMisses);
    assert!(!selection(&biased).is_independent(), "{:?}", selection(&biased));
    let lied = runs(0..24, Sabotage::TrustLiars);
    let (harm, error) = harm(&lied);
    assert!(harm - 2.0 * error > HARM_MAX, "{harm} +- {error}");
    let [muted, heard] = [Sabotage::Mute, Sabotage::None].map(|choice| World::new(1, choice).run());
    assert!(muted.first_vehicle != heard.first_vehicle);
}
