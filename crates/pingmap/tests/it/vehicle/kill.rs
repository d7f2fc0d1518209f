use std::time::Duration;

use super::journal::{Frames, Life};
use super::mission::{Mission, folder};

/// Kills the process at random moments under load. After each kill the store has everything that was acknowledged. No
/// token and no counter is used for two frames.
fn kill(seed: u64, times: usize) {
    let folder = folder();
    let folder = folder.path();
    let (mut mission, mut frames) = (Mission::new(seed), Frames::default());
    let mut life = Life::start(folder);
    for _ in 0..180 {
        life.step(&mut mission, &mut frames);
    }
    for _ in 0..times {
        let steps = (15.0 * mission.uniform()) as usize;
        for _ in 0..steps {
            life.step(&mut mission, &mut frames);
        }
        let lines = mission.next();
        life.send(lines);
        std::thread::sleep(Duration::from_secs_f64(0.04 * mission.uniform()));
        life.kill(&mut frames);
        life = Life::start(folder);
    }
    // The vehicle still handles inputs and sends.
    for _ in 0..12 {
        life.step(&mut mission, &mut frames);
    }
    let (count, summaries) = (frames.count(), frames.summaries());
    eprintln!("seed {seed}: {times} kills, {count} frames, {summaries} of them with a counter: none used twice");
    assert!(count > 20 && summaries > 10, "{count} {summaries}");
}

#[test]
fn a_killed_vehicle_keeps_what_it_acknowledged() {
    kill(1, 5);
}

#[test]
#[ignore = "some minutes"]
fn a_hundred_kills_lose_nothing() {
    for seed in 2..6 {
        kill(seed, 25);
    }
}
