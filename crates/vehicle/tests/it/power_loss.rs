//! Loss of power at any write: every acknowledged entry is there, and nothing that was never appended is.

use pingmap_vehicle::{Contents, Store, StoreError};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::common::{identity, random, random_entries};
use crate::sim_disk::SimDisk;

/// One change of a store.
enum Step {
    Append(Vec<Vec<u8>>),
    ReplaceBase(Vec<u8>),
}

impl Step {
    fn random(random: &mut ChaCha8Rng) -> Self {
        if random.random_ratio(1, 8) {
            return Self::ReplaceBase(random_entries(random, 10).concat());
        }
        let count = random.random_range(1..30);
        Self::Append(random_entries(random, count))
    }

    fn run(&self, store: &mut Store) -> Result<(), StoreError> {
        match self {
            Self::Append(entries) => store.append(entries),
            Self::ReplaceBase(base) => store.replace_base(base),
        }
    }

    fn apply(&self, contents: &mut Contents) {
        match self {
            Self::Append(entries) => contents.entries.extend(entries.iter().cloned()),
            Self::ReplaceBase(base) => *contents = Contents { base: Some(base.clone()), entries: Vec::new() },
        }
    }
}

/// Runs steps until one fails. Returns the content that was acknowledged, and the one that the failed step had led to.
fn run_until_failure(store: &mut Store, mut contents: Contents, random: &mut ChaCha8Rng) -> (Contents, Contents) {
    for _ in 0..200 {
        let step = Step::random(random);
        let mut next = contents.clone();
        step.apply(&mut next);
        match step.run(store) {
            Ok(()) => contents = next,
            Err(_) => return (contents, next),
        }
    }
    (contents.clone(), contents)
}

/// Opens a store whose acknowledged content is known.
fn reopen(disk: &SimDisk, (acknowledged, next): (Contents, Contents), what: &str) -> (Store, Contents) {
    let (store, contents) = Store::open_on(disk.clone(), &identity()).unwrap_or_else(|error| panic!("{what}: {error}"));
    assert!(contents == acknowledged || contents == next, "{what}: {} entries", contents.entries.len());
    (store, contents)
}

#[test]
fn acknowledged_entries_survive_a_loss_of_power_at_any_write() {
    for seed in 0..200 {
        let mut random = random(seed);
        let mut disk = SimDisk::new(seed);
        let (mut store, mut contents) = Store::open_on(disk.clone(), &identity()).unwrap();
        for cycle in 0..4 {
            let what = format!("seed {seed}, cycle {cycle}");
            disk.lose_power_at(random.random_range(0..300));
            let outcomes = run_until_failure(&mut store, contents, &mut random);
            drop(store);
            disk = disk.crash();
            // Power is lost once more while the store is opened.
            disk.lose_power_at(random.random_range(0..10));
            if let Ok((_, contents)) = Store::open_on(disk.clone(), &identity()) {
                assert!(contents == outcomes.0 || contents == outcomes.1, "{what}");
            }
            disk = disk.crash();
            (store, contents) = reopen(&disk, outcomes, &what);
        }
    }
}

#[test]
fn acknowledged_entries_survive_an_error_or_a_full_disk_at_any_write() {
    for seed in 0..200 {
        let mut random = random(seed);
        let mut disk = SimDisk::new(seed);
        let (mut store, mut contents) = Store::open_on(disk.clone(), &identity()).unwrap();
        for cycle in 0..4 {
            let what = format!("seed {seed}, cycle {cycle}");
            let change = random.random_range(0..300);
            if random.random() {
                disk.fail_at(change)
            } else {
                disk.fill_at(change)
            }
            let outcomes = run_until_failure(&mut store, contents, &mut random);
            drop(store);
            if random.random() {
                disk = disk.crash();
            } else {
                disk.recover();
            }
            (store, contents) = reopen(&disk, outcomes, &what);
        }
    }
}

#[test]
fn a_loss_of_power_while_a_storage_becomes_a_store_is_harmless_or_refused() {
    for seed in 0..200 {
        let disk = SimDisk::new(seed);
        disk.lose_power_at(random(seed).random_range(0..15));
        let opened = Store::open_on(disk.clone(), &identity());
        let is_complete = opened.is_ok();
        drop(opened);
        match Store::open_on(disk.crash(), &identity()) {
            Ok((_, contents)) => assert_eq!(contents, Contents::default(), "seed {seed}"),
            Err(error) => assert!(!is_complete, "seed {seed}: {error}"),
        }
    }
}
