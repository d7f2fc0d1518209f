//! `pingmap import` of files that are too large, malicious or interrupted.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::mission::*;
use crate::common::*;

/// Runs an import that must be refused, and returns the message.
fn refusal(folder: &Path, arguments: &str) -> String {
    let output = pingmap(folder, &["import"].into_iter().chain(arguments.split_whitespace()).collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(2), "{arguments}: {}", stderr(&output));
    stderr(&output)
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(bytes).unwrap();
    gzip.finish().unwrap()
}

/// Kills an import while it reads a pipe or an archive. SIGKILL allows no work at the end, so no signal leaves more.
#[test]
fn an_interrupted_import_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, temporary) = (folder.path(), folder.path().join("tmp"));
    std::fs::create_dir(&temporary).unwrap();
    let start = |argument: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pingmap"));
        command.current_dir(folder).env("TMPDIR", &temporary).args(["import", argument, "-o", "events.csv"]);
        command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap()
    };
    let is_empty = || std::fs::read_dir(&temporary).unwrap().next().is_none();
    // The pipe stays open, so that the program waits with a part of it.
    let mut child = start("-");
    let mut input = child.stdin.take().unwrap();
    input.write_all(&gzip(&vec![b'\n'; 20 << 20])).unwrap();
    input.write_all(&[0; 1 << 20]).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(is_empty());
    // An archive of 400 MB: killed as soon as the program has a temporary file, and at other times.
    file(folder, "bomb.nav.csv.gz", gzip(&[b"time,lat,lon\n".as_slice(), &vec![b'\n'; 400 << 20]].concat()));
    for delay_ms in [20, 100, 300] {
        let mut child = start("bomb.nav.csv.gz");
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_millis(delay_ms) {
            assert!(is_empty(), "a file with a name");
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(is_empty(), "{delay_ms} ms");
    }
}

#[test]
fn unpacked_content_has_a_limit_and_links_are_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let table = [b"time,lat,lon\n".as_slice(), &vec![b'\n'; 3 << 20]].concat();
    file(folder, "auv1.nav.csv.gz", gzip(&table));
    let message = refusal(folder, "auv1.nav.csv.gz --unpacked-max 0.002");
    assert!(message.contains("auv1.nav.csv.gz") && message.contains("0.002 GB"), "{message}");
    // The limit holds for all archives together.
    file(folder, "auv2.nav.csv.gz", gzip(&table));
    let message = refusal(folder, "auv1.nav.csv.gz auv2.nav.csv.gz --unpacked-max 0.005");
    assert!(message.contains("auv2.nav.csv.gz") && message.contains("--unpacked-max"), "{message}");
    // A link to a file outside is not followed.
    file(folder, "secret.csv", "time,lat,lon\nsecret,2,3\n");
    let mut tar = tar::Builder::new(Vec::new());
    let mut header = tar::Header::new_gnu();
    header.set_entry_type(tar::EntryType::Symlink);
    header.set_size(0);
    tar.append_link(&mut header, "auv1.nav.csv", folder.join("secret.csv")).unwrap();
    file(folder, "links.tar", tar.into_inner().unwrap());
    assert!(!refusal(folder, "links.tar").contains("secret"));
}

#[test]
fn lines_text_files_and_vehicles_have_limits() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let long = "1".repeat((1 << 20) + 1);
    file(folder, "auv1.nav.csv", format!("time,lat,lon\n{long},2,3\n"));
    assert!(refusal(folder, "auv1.nav.csv").contains("a line is longer than 1 MB"));
    let named = |count: usize| (0..count).map(|name| format!("{name},v{name},2,3\n")).collect::<String>();
    file(folder, "all.nav.csv", format!("time,vehicle,lat,lon\n{}", named(257)));
    for arguments in ["all.nav.csv", "--nav all.nav.csv"] {
        let message = refusal(folder, arguments);
        assert!(message.contains("257 vehicles") && message.contains("at most 256"), "{message}");
    }
    file(folder, "all.nav.csv", format!("time,vehicle,lat,lon\n{}", named(256)));
    assert!(!refusal(folder, "all.nav.csv").contains("at most"));
    // Files that are read as a whole.
    file(folder, "long.toml", vec![b'#'; (16 << 20) + 1]);
    assert!(refusal(folder, "all.nav.csv --columns long.toml").contains("16 MB"));
    assert!(refusal(folder, "all.nav.csv --schedule long.toml").contains("16 MB"));
    file(folder, "events.csv", log(&["a", "b"], 20));
    for arguments in [
        &["predict", "events.csv", "--links", "events.csv", "--model", "long.toml"][..],
        &["replay", "events.csv", "--team", "long.toml"],
    ] {
        let output = pingmap(folder, arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains("long.toml") && stderr(&output).contains("16 MB"), "{}", stderr(&output));
    }
}

/// A bag in an archive is read, and the archive may not hold messages that only a write-ahead log has.
#[test]
fn sqlite_bags_are_read_from_archives() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bag = Path::new(env!("CARGO_MANIFEST_DIR")).join("../import/tests/data/ros2.db3");
    let Ok(bag) = std::fs::read(&bag) else { return assert!(!bag.exists()) };
    let archive = |name: &str, files: &[(&str, &[u8])]| {
        let mut zip = zip::ZipWriter::new(std::fs::File::create(folder.join(name)).unwrap());
        for (name, content) in files {
            zip.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
            zip.write_all(content).unwrap();
        }
        zip.finish().unwrap();
    };
    file(folder, "auv2.nav.csv", "time,x,y\n1777809500,0,0\n1777809700,0,10\n");
    file(folder, "auv2.sent.csv", "time\n1777809603\n1777809613\n1777809623\n1777809633\n1777809643\n1777809653\n");
    file(folder, "ids.csv", "id,name\n1,auv1\n2,auv2\n63,broadcast\n");
    archive("bag.zip", &[("bag/bag_0.db3", &bag)]);
    let tables = "auv2.nav.csv auv2.sent.csv --ids ids.csv --nav-gap-s-max 300 --clock-offset-s-max 0";
    file(folder, "bag.db3", &bag);
    let expected = import(folder, &format!("auv1=bag.db3 {tables}")).0;
    let found = import(folder, &format!("auv1=bag.zip {tables}")).0;
    assert_eq!((&found["log_digest"], &found["pairs"]), (&expected["log_digest"], &expected["pairs"]));
    let log = [[0x37, 0x7f, 0x06, 0x82].as_slice(), &[0; 100]].concat();
    archive("wal.zip", &[("bag_0.db3", &bag), ("bag_0.db3-wal", &log)]);
    let message = refusal(folder, &format!("auv1=wal.zip {tables} --overwrite"));
    assert!(message.contains("wal.zip/bag_0.db3-wal") && message.contains("unpacked folder"), "{message}");
    // A write-ahead log next to its bag is no file of its own, and alone it is refused.
    file(folder, "bag.db3-wal", &log);
    let found = import(folder, &format!("auv1=bag.db3 bag.db3-wal {tables}")).0;
    assert_eq!(found["pairs"], expected["pairs"]);
    std::fs::remove_file(folder.join("bag.db3")).unwrap();
    assert!(refusal(folder, &format!("bag.db3-wal {tables} --overwrite")).contains("expected the bag"));
}
