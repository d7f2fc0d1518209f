use std::path::Path;

use super::host::Host;
use super::journal::{Frames, Life};
use super::mission::{Mission, configure, folder};
use crate::common::{pingmap, stdout};

/// Plays a mission with snapshots, kills the process, and truncates its store.
fn truncated_store(folder: &Path, share: f64, frames: &mut Frames) -> Mission {
    let mut mission = Mission::new(7);
    let mut life = Life::start(folder);
    for _ in 0..200 {
        life.step(&mut mission, frames);
    }
    life.kill(frames);
    let store = std::fs::File::options().write(true).open(folder.join("auv1.redb")).unwrap();
    store.set_len((share * store.metadata().unwrap().len() as f64) as u64).unwrap();
    mission
}

fn warnings(greeting: &serde_json::Value) -> String {
    greeting["warnings"].to_string()
}

#[test]
fn a_truncated_store_is_replaced_by_the_snapshot_and_counters_are_skipped() {
    for (share, is_killed_at_once) in [(0.0, false), (0.3, true), (0.9, false)] {
        let folder = folder();
        let folder = folder.path();
        configure(folder, "[store]\nsnapshot_interval_s = 300.0");
        let mut frames = Frames::default();
        let mut mission = truncated_store(folder, share, &mut frames);
        let latest = frames.latest();
        assert!(frames.summaries() > 5, "{}", frames.summaries());
        if is_killed_at_once {
            // The recovery survives a crash that follows it.
            let (mut host, greeting) = Host::greeted(folder);
            assert!(warnings(&greeting).contains("continues from its snapshot"), "{greeting}");
            host.kill();
        } else {
            let (mut host, greeting) = Host::greeted(folder);
            assert!(warnings(&greeting).contains("skips a window of counters"), "{greeting}");
            assert!(greeting["events"].as_u64().unwrap() > 20, "{greeting}");
            host.close();
            assert!(host.finish().0.success());
        }
        assert!(folder.join("auv1.redb.damaged-1").exists());
        // Numbers of frames after the snapshot are lost with the store. Counters are not used again.
        frames.forget_tokens();
        let before = frames.summaries();
        let mut life = Life::start(folder);
        for _ in 0..60 {
            life.step(&mut mission, &mut frames);
        }
        assert!(frames.summaries() > before && frames.latest() > latest, "{share}: {}", frames.latest());
    }
}

#[test]
fn without_a_snapshot_the_vehicle_sends_nothing() {
    let folder = folder();
    let folder = folder.path();
    let mut mission = truncated_store(folder, 0.5, &mut Frames::default());
    std::fs::remove_file(folder.join("auv1.snapshot")).unwrap();
    let (mut host, greeting) = Host::greeted(folder);
    assert!(warnings(&greeting).contains("sends nothing"), "{greeting}");
    host.kill();
    // Also after a crash that follows the recovery.
    let (mut host, _) = Host::greeted(folder);
    for line in (0..30).flat_map(|_| mission.next()) {
        let answer = host.ask(&line);
        let is_request = line.contains("frame_request");
        assert_eq!(answer["code"] == "store_failed", is_request, "{line}: {answer}");
    }
    assert_eq!(host.ask(r#"{"type":"piggyback_request","time":3000,"n_bits":16}"#)["type"], "nothing");
    let status = host.ask(r#"{"type":"status"}"#);
    assert!(status["store"]["problem"].as_str().unwrap().contains("epoch"), "{status}");
    host.close();
    assert!(host.finish().0.success());
    let log = stdout(&pingmap(folder, &["store", "export", "auv1.redb"]));
    assert!(log.lines().count() > 5, "{log}");
}

#[cfg(unix)]
#[test]
fn on_a_full_medium_the_vehicle_continues_in_memory() {
    use std::process::{Command, Stdio};
    let folder = folder();
    // Files cannot grow beyond 160 blocks of 512 bytes.
    let program = env!("CARGO_BIN_EXE_pingmap");
    let script = |blocks: u32| format!("trap '' XFSZ; ulimit -f {blocks}; exec {program} vehicle");
    let mut command = Command::new("sh");
    let full = command.current_dir(folder.path()).args(["-c", &script(20)]).output().unwrap();
    let log = String::from_utf8_lossy(&full.stderr).into_owned();
    assert!(full.status.code() == Some(2) && log.contains("no space for") && log.contains("Free space"), "{log}");
    let mut command = Command::new("sh");
    command.current_dir(folder.path()).args(["-c", &script(160)]);
    let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut host = Host::of(child);
    assert_eq!(host.ask(super::host::HELLO)["type"], "hello");
    let mut mission = Mission::new(3);
    let mut failed = false;
    for line in (0..400).flat_map(|_| mission.next()) {
        let answer = host.ask(&line);
        if answer["input"] == 0 {
            // The report that follows the error.
            assert_eq!(answer["store"]["state"], "failed", "{answer}");
            failed = true;
            assert_ne!(host.next().unwrap()["type"], "frame");
        } else if failed {
            assert_ne!(answer["type"], "frame", "{answer}");
        }
    }
    assert!(failed, "the file did not grow to the limit");
    let status = host.ask(r#"{"type":"status"}"#);
    assert!(status["own_events"].as_u64().unwrap() > 50, "{status}");
    host.close();
    let (status, _, log) = host.finish();
    assert!(status.success() && log.contains("continues in memory"), "{log}");
}
