//! States that are no damage: the store is refused, its file is unchanged, and the text names a remedy.

use std::fs;
use std::path::Path;

use pingmap_vehicle::{Identity, Store, StoreError, inspect, open_or_recover};
use redb::{Database, TableDefinition};

use crate::common::{Place, identity};
use crate::sim_disk::SimDisk;

const META: TableDefinition<&str, &[u8]> = TableDefinition::new("meta");

/// The error of both ways to open a store.
fn refusal(path: &Path, snapshot: &Path) -> StoreError {
    let plain = Store::open(path, &identity()).map(drop).unwrap_err();
    let policy = open_or_recover(path, snapshot, &identity()).map(drop).unwrap_err();
    assert_eq!(std::mem::discriminant(&plain), std::mem::discriminant(&policy), "{plain} {policy}");
    policy
}

#[test]
fn a_newer_version_is_refused() {
    let place = Place::new();
    drop(Store::open(&place.store, &identity()).unwrap());
    let database = Database::open(&place.store).unwrap();
    let transaction = database.begin_write().unwrap();
    transaction.open_table(META).unwrap().insert("format", 2_u32.to_le_bytes().as_slice()).unwrap();
    transaction.commit().unwrap();
    drop(database);
    let before = fs::read(&place.store).unwrap();
    let error = refusal(&place.store, &place.snapshot);
    assert!(matches!(error, StoreError::NewerFormat { found: 2, expected: 1, .. }), "{error}");
    assert!(matches!(inspect(&place.store), Err(StoreError::NewerFormat { .. })));
    assert_eq!(fs::read(&place.store).unwrap(), before);
}

#[test]
fn a_newer_version_of_the_engine_is_refused() {
    let place = Place::new();
    drop(Store::open(&place.store, &identity()).unwrap());
    let mut bytes = fs::read(&place.store).unwrap();
    (bytes[64], bytes[192]) = (4, 4);
    fs::write(&place.store, &bytes).unwrap();
    let error = refusal(&place.store, &place.snapshot);
    assert!(matches!(error, StoreError::NewerFormat { found: 4, expected: 3, .. }), "{error}");
    assert_eq!(fs::read(&place.store).unwrap(), bytes);
}

#[test]
fn a_file_of_another_kind_is_refused() {
    let place = Place::new();
    let of_whole_pages = format!("SQLite format 3{}", "\0".repeat(8177));
    for content in ["time,x,y\n", "t", &"time,x,y\n0,0,0\n".repeat(100), &of_whole_pages] {
        fs::write(&place.store, content).unwrap();
        let error = refusal(&place.store, &place.snapshot);
        assert!(matches!(error, StoreError::NotAStore { .. }), "{error}");
        assert_eq!(fs::read_to_string(&place.store).unwrap(), content);
        assert_eq!(place.files(), ["auv1.redb"]);
    }
}

#[test]
fn a_database_of_another_program_is_refused() {
    let place = Place::new();
    drop(Database::create(&place.store).unwrap());
    let error = refusal(&place.store, &place.snapshot);
    assert!(matches!(error, StoreError::NotAStore { .. }), "{error}");
    assert_eq!(place.files(), ["auv1.redb"]);
}

#[test]
fn a_folder_and_a_missing_folder_are_refused() {
    let place = Place::new();
    let error = refusal(place.folder.path(), &place.snapshot);
    assert!(matches!(error, StoreError::IsFolder { .. }), "{error}");
    let path = place.folder.path().join("missions/auv1.redb");
    let error = refusal(&path, &place.snapshot);
    assert!(matches!(&error, StoreError::NoFolder { folder, .. } if folder.ends_with("missions")), "{error}");
    assert!(place.files().is_empty());
}

#[test]
#[cfg(target_os = "linux")]
fn a_folder_without_permission_is_refused() {
    // Not even the administrator may create a file there.
    let path = Path::new("/sys/auv1.redb");
    let error = refusal(path, Path::new("/sys/auv1.snapshot"));
    assert!(matches!(error, StoreError::NoPermission { .. }), "{error}");
}

#[test]
fn a_file_that_is_read_only_is_refused_but_can_be_inspected() {
    let place = Place::new();
    drop(Store::open(&place.store, &identity()).unwrap());
    let mut permissions = fs::metadata(&place.store).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&place.store, permissions).unwrap();
    inspect(&place.store).unwrap();
    if fs::OpenOptions::new().write(true).open(&place.store).is_ok() {
        println!("skipped: this user may write to files that are read-only");
        return;
    }
    let error = refusal(&place.store, &place.snapshot);
    assert!(matches!(error, StoreError::NoPermission { .. }), "{error}");
}

#[test]
fn a_full_disk_is_no_damage_and_closes_the_store() {
    let disk = SimDisk::new(1);
    let (mut store, _) = Store::open_on(disk.clone(), &identity()).unwrap();
    store.append(&[b"acknowledged".to_vec()]).unwrap();
    disk.fill_at(0);
    let error = store.append(&[vec![0; 10_000]]).unwrap_err();
    assert!(matches!(error, StoreError::Full { .. }), "{error}");
    let error = store.append(&[]).unwrap_err();
    assert!(matches!(error, StoreError::Closed { .. }), "{error}");
    drop(store);
    let (_, contents) = Store::open_on(disk.crash(), &identity()).unwrap();
    assert_eq!(contents.entries, [b"acknowledged".to_vec()]);
}

#[test]
fn every_text_names_the_file_and_a_remedy() {
    let place = Place::new();
    drop(Store::open(&place.store, &identity()).unwrap());
    let other = Identity { vehicle: "auv2".into(), ..identity() };
    let errors = [
        Store::open(&place.store, &other).unwrap_err(),
        Store::open(place.folder.path(), &identity()).unwrap_err(),
        inspect(&place.folder.path().join("none.redb")).unwrap_err(),
    ];
    for error in errors {
        let text = error.to_string();
        assert!(text.contains(place.folder.path().to_str().unwrap()), "{text}");
        assert!(text.contains(". C") && text.ends_with('.'), "{text}");
    }
}
