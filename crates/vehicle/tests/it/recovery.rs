use std::fs;

use pingmap_vehicle::{Contents, Opened, Store, StoreError, inspect, open_or_recover, write_snapshot};

use crate::common::{Place, fill, identity};

/// Writes a store and a snapshot, and damages the store. Returns the damaged bytes.
fn damaged_store(place: &Place) -> Vec<u8> {
    let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
    fill(&mut store);
    drop(store);
    let mut bytes = fs::read(&place.store).unwrap();
    bytes.truncate(bytes.len() / 2);
    fs::write(&place.store, &bytes).unwrap();
    bytes
}

#[test]
fn an_intact_store_is_opened_with_its_content() {
    let place = Place::new();
    let (mut store, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
    assert_eq!(opened, Opened::New);
    let (base, entries) = fill(&mut store);
    drop(store);
    let (_, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
    assert_eq!(opened, Opened::Intact(Contents { base: Some(base), entries }));
    assert_eq!(place.files(), ["auv1.redb"]);
}

#[test]
fn a_damaged_store_is_kept_unchanged_and_the_snapshot_becomes_the_base() {
    let place = Place::new();
    write_snapshot(&place.snapshot, b"snapshot").unwrap();
    for number in 1..=3 {
        let bytes = damaged_store(&place);
        assert!(matches!(Store::open(&place.store, &identity()), Err(StoreError::Damaged { .. })));
        assert!(matches!(inspect(&place.store), Err(StoreError::Damaged { .. })));
        let (store, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
        let Opened::Recovered { kept_as: Some(kept_as), snapshot, .. } = opened else { panic!("{opened:?}") };
        assert_eq!(kept_as, place.folder.path().join(format!("auv1.redb.damaged-{number}")));
        assert_eq!(fs::read(kept_as).unwrap(), bytes);
        assert_eq!(snapshot.as_deref(), Some(b"snapshot".as_slice()));
        drop(store);
        // A crash after the recovery does not lose the snapshot.
        let (_, contents) = Store::open(&place.store, &identity()).unwrap();
        assert_eq!(contents, Contents { base: Some(b"snapshot".to_vec()), entries: Vec::new() });
        fs::remove_file(&place.store).unwrap();
    }
}

#[test]
fn a_damaged_store_without_a_snapshot_becomes_an_empty_one() {
    let place = Place::new();
    damaged_store(&place);
    let (mut store, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
    assert!(matches!(opened, Opened::Recovered { kept_as: Some(_), snapshot: None, .. }), "{opened:?}");
    store.append(&[b"entry".to_vec()]).unwrap();
    drop(store);
    let (_, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
    assert_eq!(opened, Opened::Intact(Contents { base: None, entries: vec![b"entry".to_vec()] }));
}

#[test]
fn a_crash_between_the_two_renames_of_a_recovery_loses_nothing() {
    let place = Place::new();
    write_snapshot(&place.snapshot, b"snapshot").unwrap();
    damaged_store(&place);
    fs::rename(&place.store, place.folder.path().join("auv1.redb.damaged-1")).unwrap();
    let (store, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
    assert!(matches!(&opened, Opened::Recovered { kept_as: None, snapshot: Some(_), .. }), "{opened:?}");
    drop(store);
    assert_eq!(Store::open(&place.store, &identity()).unwrap().1.base.unwrap(), b"snapshot");
}

#[test]
fn an_empty_file_and_a_file_of_zeros_are_damaged() {
    let place = Place::new();
    for (number, bytes) in [(1, vec![]), (2, vec![0; 8192]), (3, vec![0; 5])] {
        fs::write(&place.store, bytes).unwrap();
        let (store, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
        assert!(matches!(opened, Opened::Recovered { .. }), "{opened:?}");
        drop(store);
        fs::remove_file(&place.store).unwrap();
        assert_eq!(place.files().len(), number);
    }
}

#[test]
fn a_damaged_snapshot_is_refused_and_kept() {
    let place = Place::new();
    damaged_store(&place);
    write_snapshot(&place.snapshot, b"snapshot").unwrap();
    let mut bytes = fs::read(&place.snapshot).unwrap();
    bytes[3] ^= 1;
    fs::write(&place.snapshot, &bytes).unwrap();
    let (_, opened) = open_or_recover(&place.store, &place.snapshot, &identity()).unwrap();
    let Opened::Recovered { snapshot: None, problem, .. } = opened else { panic!("{opened:?}") };
    assert!(problem.contains("its snapshot is damaged: its checksum"), "{problem}");
    assert_eq!(fs::read(place.folder.path().join("auv1.snapshot.damaged-1")).unwrap(), bytes);
}
