use pingmap_vehicle::{Contents, Store, StoreError, inspect};

use crate::common::{Place, fill, identity, random, random_entries};

#[test]
fn a_missing_file_becomes_an_empty_store() {
    let place = Place::new();
    let (store, contents) = Store::open(&place.store, &identity()).unwrap();
    assert_eq!(contents, Contents::default());
    drop(store);
    assert_eq!(Store::open(&place.store, &identity()).unwrap().1, Contents::default());
    assert_eq!(place.files(), ["auv1.redb"]);
}

#[test]
fn what_was_appended_is_there_when_the_store_is_opened_again() {
    let place = Place::new();
    let mut expected = Contents::default();
    let mut random = random(3);
    for opening in 0..5 {
        let (mut store, contents) = Store::open(&place.store, &identity()).unwrap();
        assert_eq!(contents, expected, "opening {opening}");
        for count in [0, 1, 7] {
            let entries = random_entries(&mut random, count);
            store.append(&entries).unwrap();
            expected.entries.extend(entries);
        }
        store.close().unwrap();
    }
}

#[test]
fn a_new_base_removes_the_entries_before_it() {
    let place = Place::new();
    let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
    let (base, entries) = fill(&mut store);
    drop(store);
    let (mut store, contents) = Store::open(&place.store, &identity()).unwrap();
    assert_eq!(contents, Contents { base: Some(base), entries });
    store.replace_base(b"").unwrap();
    store.append(&[b"after".to_vec()]).unwrap();
    drop(store);
    let (_, contents) = Store::open(&place.store, &identity()).unwrap();
    assert_eq!(contents, Contents { base: Some(Vec::new()), entries: vec![b"after".to_vec()] });
}

#[test]
fn a_report_describes_the_store_and_does_not_change_it() {
    let place = Place::new();
    let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
    let (base, entries) = fill(&mut store);
    drop(store);
    let before = std::fs::read(&place.store).unwrap();
    let report = inspect(&place.store).unwrap();
    assert_eq!(report.identity, identity());
    assert_eq!((report.format, report.entry_count), (1, 300));
    assert_eq!(report.entry_bytes, entries.concat().len());
    assert_eq!(report.base_bytes, Some(base.len()));
    assert_eq!(report.file_bytes, before.len() as u64);
    assert_eq!(std::fs::read(&place.store).unwrap(), before);
}

#[test]
fn a_store_whose_content_shrank_returns_its_space_when_it_is_opened() {
    let place = Place::new();
    let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
    for _ in 0..10 {
        store.append(&vec![vec![5; 1000]; 1000]).unwrap();
    }
    store.replace_base(b"small").unwrap();
    drop(store);
    for _ in 0..2 {
        let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
        store.append(&[vec![6; 100]]).unwrap();
    }
    let (_, contents) = Store::open(&place.store, &identity()).unwrap();
    assert_eq!(contents, Contents { base: Some(b"small".to_vec()), entries: vec![vec![6; 100]; 2] });
    let bytes = std::fs::metadata(&place.store).unwrap().len();
    assert!(bytes < 1 << 20, "{bytes} bytes");
}

#[test]
fn the_file_does_not_grow_with_the_number_of_snapshots() {
    let place = Place::new();
    let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
    let mut largest = 0;
    for round in 0..50 {
        store.append(&vec![vec![5; 100]; 500]).unwrap();
        store.replace_base(&vec![6; 100_000]).unwrap();
        let bytes = std::fs::metadata(&place.store).unwrap().len();
        assert!(round < 5 || bytes <= largest, "{bytes} bytes in round {round}");
        largest = largest.max(bytes);
    }
}

#[test]
fn an_open_store_is_locked() {
    let place = Place::new();
    let (store, _) = Store::open(&place.store, &identity()).unwrap();
    for error in [
        Store::open(&place.store, &identity()).map(drop).unwrap_err(),
        pingmap_vehicle::adopt_store(&place.store, &identity(), |_, _| Ok::<_, StoreError>(Vec::new()))
            .map(drop)
            .unwrap_err(),
        inspect(&place.store).map(drop).unwrap_err(),
        pingmap_vehicle::open_or_recover(&place.store, &place.snapshot, &identity()).map(drop).unwrap_err(),
    ] {
        assert!(matches!(error, StoreError::Locked { .. }), "{error}");
    }
    drop(store);
    Store::open(&place.store, &identity()).unwrap();
}
