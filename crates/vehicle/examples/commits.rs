//! Prints how long commits take in a folder: `cargo run --release --example commits FOLDER`.

#![allow(clippy::print_stdout)]

use std::time::{Duration, Instant};

use pingmap_vehicle::{Identity, Store, StoreError, write_snapshot};

/// Number of commits whose median is printed.
const COMMITS: usize = 300;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = match std::env::args_os().nth(1) {
        Some(folder) => tempfile::tempdir_in(folder)?,
        None => tempfile::tempdir()?,
    };
    let path = folder.path().join("commits.redb");
    let identity = Identity { vehicle: "auv1".into(), team_digest: [0; 32] };
    let (mut store, _) = Store::open(&path, &identity)?;
    for (entries, bytes) in [(1, 100), (20, 100)] {
        let batch = vec![vec![1; bytes]; entries];
        let median = median(|| store.append(&batch))?;
        println!("append {entries} entries of {bytes} bytes: median {median:.2?}");
    }
    let base = vec![2; 1_000_000];
    println!("replace the base, 1 MB: median {:.2?}", median(|| store.replace_base(&base))?);
    let snapshot = folder.path().join("commits.snapshot");
    println!("write a snapshot, 1 MB: median {:.2?}", median(|| write_snapshot(&snapshot, &base))?);
    drop(store);
    let start = Instant::now();
    Store::open(&path, &identity)?;
    println!("open: {:.2?}", start.elapsed());
    Ok(())
}

fn median(mut commit: impl FnMut() -> Result<(), StoreError>) -> Result<Duration, StoreError> {
    let mut times = Vec::new();
    for _ in 0..COMMITS {
        let start = Instant::now();
        commit()?;
        times.push(start.elapsed());
    }
    times.sort();
    Ok(times[COMMITS / 2])
}
