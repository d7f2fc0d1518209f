use std::fs;

use pingmap_vehicle::{StoreError, read_snapshot, write_snapshot};

use crate::common::Place;

#[test]
fn a_snapshot_is_replaced_by_the_next_one() {
    let place = Place::new();
    assert!(matches!(read_snapshot(&place.snapshot), Err(StoreError::Missing { .. })));
    for bytes in [b"first, the longer one".as_slice(), b"second", b""] {
        write_snapshot(&place.snapshot, bytes).unwrap();
        assert_eq!(read_snapshot(&place.snapshot).unwrap(), bytes);
        assert_eq!(place.files(), ["auv1.snapshot"]);
    }
}

#[test]
fn a_snapshot_that_cannot_be_written_leaves_the_old_one() {
    let place = Place::new();
    write_snapshot(&place.snapshot, b"old").unwrap();
    // A folder has the temporary name.
    let aside = place.folder.path().join("auv1.snapshot.new");
    fs::create_dir(&aside).unwrap();
    write_snapshot(&place.snapshot, b"new").unwrap_err();
    assert_eq!(read_snapshot(&place.snapshot).unwrap(), b"old");

    fs::remove_dir(&aside).unwrap();
    // An interrupted call left a file with the temporary name.
    fs::write(&aside, b"half of the n").unwrap();
    assert_eq!(read_snapshot(&place.snapshot).unwrap(), b"old");
    write_snapshot(&place.snapshot, b"new").unwrap();
    assert_eq!(read_snapshot(&place.snapshot).unwrap(), b"new");
    assert_eq!(place.files(), ["auv1.snapshot"]);
}

#[test]
fn a_snapshot_needs_its_folder_and_the_path_of_a_file() {
    let place = Place::new();
    let path = place.folder.path().join("missions/auv1.snapshot");
    assert!(matches!(write_snapshot(&path, b"bytes"), Err(StoreError::NoFolder { .. })));
    assert!(matches!(read_snapshot(&path), Err(StoreError::NoFolder { .. })));
    assert!(matches!(write_snapshot(place.folder.path(), b"bytes"), Err(StoreError::IsFolder { .. })));
    assert!(place.files().is_empty());
}
