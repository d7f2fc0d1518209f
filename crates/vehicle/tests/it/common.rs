//! Identities, entries and files that several tests use.

use std::path::PathBuf;

use pingmap_agent::Entry;
use pingmap_vehicle::{Identity, Store};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

/// The path of a store in a folder that is deleted with this value.
pub struct Place {
    pub folder: TempDir,
    pub store: PathBuf,
    pub snapshot: PathBuf,
}

impl Place {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (store, snapshot) = (folder.path().join("auv1.redb"), folder.path().join("auv1.snapshot"));
        Self { folder, store, snapshot }
    }

    /// The names of the files in the folder, sorted.
    pub fn files(&self) -> Vec<String> {
        let names = std::fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> = names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

pub fn identity() -> Identity {
    Identity { vehicle: "auv1".into(), team_digest: [7; 32] }
}

pub fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Random entries of 0 to 200 bytes.
pub fn random_entries(random: &mut ChaCha8Rng, count: usize) -> Vec<Vec<u8>> {
    let entry = |_| {
        let mut bytes = vec![0; random.random_range(0..=200)];
        random.fill_bytes(&mut bytes);
        bytes
    };
    (0..count).map(entry).collect()
}

/// Fills a store with a base and 300 entries, in batches of 10, and returns the base and the entries.
pub fn fill(store: &mut Store) -> (Vec<u8>, Vec<Vec<u8>>) {
    let mut random = random(1);
    let base = random_entries(&mut random, 20).concat();
    let entries = random_entries(&mut random, 300);
    store.append(&[b"before the base".to_vec()]).unwrap();
    store.replace_base(&base).unwrap();
    for batch in entries.chunks(10) {
        store.append(batch).unwrap();
    }
    (base, entries)
}

/// Returns whether a record of a store is an entry of the agent of some kind.
pub fn is_entry(record: &[u8], is_wanted: fn(&Entry) -> bool) -> bool {
    record.first() == Some(&0) && Entry::from_bytes(&record[1..]).is_ok_and(|entry| is_wanted(&entry))
}
