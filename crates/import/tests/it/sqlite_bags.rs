//! SQLite bags that are unusual or malicious.

use std::path::{Path, PathBuf};

use pingmap_agent::VehicleId;
use pingmap_import::{FileSource, RecordKind, RecordReader, Recording, Recordings};
use rusqlite::Connection;
use tempfile::TempDir;

fn ros2_bag() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/ros2.db3")
}

/// Reads a bag as the recording of `auv1`.
fn read(bytes: &[u8], path: Option<&Path>) -> Result<Recording, String> {
    let (mut recordings, vehicle) = (Recordings::new(), VehicleId::new("auv1"));
    let source = FileSource { path, ..FileSource::new(Path::new("bag.db3"), Some(&vehicle)) };
    let found = RecordReader::default().read_record(bytes, &source, &mut recordings);
    found.map_err(|error| error.to_string())?.expect("a bag");
    Ok(recordings.remove(&vehicle).unwrap_or_default())
}

fn read_path(path: &Path) -> Result<Recording, String> {
    let found = read(&std::fs::read(path).unwrap(), Some(path));
    // The same bag from an archive, which has no path. A write-ahead log belongs to the path.
    if !path.with_extension("db3-wal").exists() {
        assert_eq!(read(&std::fs::read(path).unwrap(), None), found, "{}", path.display());
    }
    found
}

/// Copies the bag to a folder, under a name with characters that are special in a URI, and changes the copy.
fn changed_bag(statements: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("50% ?mode=rw#1 ä.db3");
    std::fs::copy(ros2_bag(), &path).unwrap();
    Connection::open(&path).unwrap().execute_batch(statements).unwrap();
    (folder, path)
}

fn names(folder: &TempDir) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path()).unwrap();
    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_bag_in_wal_mode_is_read_and_nothing_is_written_next_to_it() {
    let plain = read_path(&ros2_bag()).unwrap();
    assert_eq!(plain.fixes.len(), 61);
    let (folder, path) = changed_bag("PRAGMA journal_mode = WAL");
    let before = (std::fs::read(&path).unwrap(), names(&folder));
    assert_eq!(before.0[18..20], [2, 2], "the mode of the file");
    assert_eq!(read_path(&path).unwrap(), plain);
    assert_eq!((std::fs::read(&path).unwrap(), names(&folder)), before);
}

/// A recorder that loses its power leaves its last messages in the write-ahead log.
#[test]
fn messages_in_the_write_ahead_log_are_read_up_to_the_last_commit() {
    let plain = read_path(&ros2_bag()).unwrap();
    let (folder, recorded) = changed_bag("PRAGMA journal_mode = WAL");
    let mut recorder = Connection::open(&recorded).unwrap();
    recorder.execute_batch("PRAGMA wal_autocheckpoint = 0").unwrap();
    let messages: i64 = recorder.query_row("SELECT count(*) FROM messages", [], |row| row.get(0)).unwrap();
    // The database itself keeps a part of the messages. The others come in several commits.
    recorder
        .execute_batch("CREATE TABLE later AS SELECT * FROM messages; DELETE FROM messages WHERE id % 2 = 0; PRAGMA wal_checkpoint(TRUNCATE)")
        .unwrap();
    let missing = read_path(&recorded).unwrap();
    assert!(missing.fixes.len() < 61);
    for remainder in [0, 2] {
        let transaction = recorder.transaction().unwrap();
        transaction.execute("INSERT INTO messages SELECT * FROM later WHERE id % 4 = ?1", [remainder]).unwrap();
        transaction.commit().unwrap();
    }
    recorder.execute_batch("DROP TABLE later").unwrap();
    let wal = |path: &Path| PathBuf::from(format!("{}-wal", path.display()));
    let left = tempfile::tempdir().unwrap();
    let path = left.path().join("bag.db3");
    std::fs::copy(&recorded, &path).unwrap();
    let log = std::fs::read(wal(&recorded)).unwrap();
    assert!(log.len() > 4096 && messages > 61);
    std::fs::write(wal(&path), &log).unwrap();
    assert_eq!(read_path(&path).unwrap(), plain);
    // A torn or changed frame ends the log: the result is the state after some commit, as SQLite recovers it.
    for (cut, change) in [(log.len() - 1, 0), (log.len() / 2, 0), (40, 0), (log.len(), 1)] {
        let mut torn = log[..cut].to_vec();
        torn[cut / 3] ^= change;
        std::fs::write(wal(&path), &torn).unwrap();
        let found = read_path(&path).unwrap();
        let other = left.path().join("other.db3");
        std::fs::copy(&path, &other).unwrap();
        std::fs::write(wal(&other), &torn).unwrap();
        let recovered = Connection::open(&other).unwrap();
        recovered.execute_batch("PRAGMA journal_mode = DELETE").unwrap();
        drop(recovered);
        assert_eq!(found, read_path(&other).unwrap(), "{cut} {change}");
    }
    assert_eq!(names(&left).iter().filter(|name| name.starts_with("bag")).count(), 2, "{:?}", names(&left));
    drop((recorder, folder));
    // The log and its index are files of a known kind and no captures of a modem.
    let kind = |head: &[u8]| RecordReader::default().detect_kind(head, Path::new("bag.db3-wal"), None);
    let sentence = b"\n1777809600.25 $CARXD,2,1,0,1,AABB\n";
    assert_eq!(kind(&[&log[..32], sentence].concat()), Some(RecordKind::SqliteLog));
    assert_eq!(kind(sentence), Some(RecordKind::ModemCapture));
}

#[test]
fn compressed_messages_are_read() {
    let plain = read_path(&ros2_bag()).unwrap();
    let (_folder, path) = changed_bag("");
    let database = Connection::open(&path).unwrap();
    let mut statement = database.prepare("SELECT id, data FROM messages").unwrap();
    let rows = statement.query_map([], |row| Ok((row.get::<_, i64>(0)?, row.get::<_, Vec<u8>>(1)?))).unwrap();
    for (id, data) in rows.map(Result::unwrap).collect::<Vec<_>>() {
        let compressed = zstd::bulk::compress(&data, 1).unwrap();
        database.execute("UPDATE messages SET data = ?2 WHERE id = ?1", (id, compressed)).unwrap();
    }
    assert_eq!(read_path(&path).unwrap(), plain);
    // A message of 100 MB after decompression, and a damaged one, count as garbled.
    let long = zstd::bulk::compress(&vec![0; 100 << 20], 1).unwrap();
    let damaged = [0x28, 0xb5, 0x2f, 0xfd, 0xff];
    database.execute("UPDATE messages SET data = ?1 WHERE id = 1", [long]).unwrap();
    database.execute("UPDATE messages SET data = ?1 WHERE id = 2", [damaged]).unwrap();
    let (mut recordings, vehicle) = (Recordings::new(), VehicleId::new("auv1"));
    let source = FileSource::new(&path, Some(&vehicle));
    let head = std::fs::read(&path).unwrap();
    let summary = RecordReader::default().read_record(head.as_slice(), &source, &mut recordings).unwrap().unwrap();
    assert_eq!(summary.skipped.garbled, 2);
}

#[test]
fn bags_whose_values_are_not_stored_are_refused() {
    const RENAME: &str = "ALTER TABLE messages RENAME TO stored;";
    for (statements, word) in [
        ("CREATE VIEW messages AS SELECT id, topic_id, timestamp, data FROM stored", "stored values"),
        (
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
             data BLOB GENERATED ALWAYS AS (cast(hex(zeroblob(400000000)) AS blob)) VIRTUAL);
             INSERT INTO messages (id, topic_id, timestamp) VALUES (1, 1, 1)",
            "stored values",
        ),
        (
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
             INSERT INTO messages VALUES (1, 1, 1, zeroblob(70000000))",
            "too big",
        ),
    ] {
        let (_folder, path) = changed_bag(&format!("{RENAME}{statements}"));
        let error = read_path(&path).unwrap_err();
        assert!(error.contains("bag.db3") && error.contains("bag of ROS 2") && error.contains(word), "{error}");
    }
}

/// Interior pages of a table that point to one page many times: 20 kB that would yield millions of rows.
#[test]
fn rows_that_share_pages_are_refused() {
    let (_folder, path) = changed_bag("PRAGMA user_version = 1");
    let root: i64 = Connection::open(&path)
        .unwrap()
        .query_row("SELECT rootpage FROM sqlite_master WHERE name = 'messages'", [], |row| row.get(0))
        .unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let page_bytes = usize::from(u16::from_be_bytes([bytes[16], bytes[17]]));
    let page = (root as usize - 1) * page_bytes;
    assert_eq!(bytes[page], 5, "the root of the messages is an interior page");
    // Every cell, and the right-most pointer, gets the first child. Five more levels would multiply the rows again.
    let cells = usize::from(u16::from_be_bytes([bytes[page + 3], bytes[page + 4]]));
    let cell_at = |bytes: &[u8], index: usize| {
        let at = page + 12 + 2 * index;
        page + usize::from(u16::from_be_bytes([bytes[at], bytes[at + 1]]))
    };
    let child: [u8; 4] = bytes[cell_at(&bytes, 0)..][..4].try_into().unwrap();
    let first = cell_at(&bytes, 0) - page;
    let count = (page_bytes - 12) / 2 / 4;
    assert!(cells < count);
    bytes[page + 3..page + 5].copy_from_slice(&(count as u16).to_be_bytes());
    for index in 0..count {
        let at = page + 12 + 2 * index;
        if at + 2 < page + page_bytes.min(first) {
            bytes[at..at + 2].copy_from_slice(&(first as u16).to_be_bytes());
        }
    }
    bytes[page + 8..page + 12].copy_from_slice(&child);
    std::fs::write(&path, &bytes).unwrap();
    let error = read_path(&path).unwrap_err();
    assert!(error.contains("share pages"), "{error}");
}
