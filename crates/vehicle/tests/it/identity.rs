use pingmap_vehicle::{Contents, Identity, Store, StoreError, adopt_store};

use crate::common::{Place, identity};

/// Appends the number of entries to a base.
fn converted(_: &Identity, contents: &Contents) -> Result<Vec<u8>, StoreError> {
    let entries = format!(" and {} entry", contents.entries.len());
    Ok([contents.base.as_deref().unwrap_or_default(), entries.as_bytes()].concat())
}

#[test]
fn the_store_of_another_vehicle_is_refused() {
    let place = Place::new();
    drop(Store::open(&place.store, &identity()).unwrap());
    let other = Identity { vehicle: "auv2".into(), ..identity() };
    for error in [
        Store::open(&place.store, &other).map(drop).unwrap_err(),
        adopt_store(&place.store, &other, converted).map(drop).unwrap_err(),
    ] {
        let text = error.to_string();
        assert!(matches!(error, StoreError::OtherVehicle { .. }), "{text}");
        assert!(text.contains("\"auv1\"") && text.contains("\"auv2\"") && text.contains("auv1.redb"), "{text}");
    }
}

#[test]
fn the_store_of_another_team_is_refused_until_it_is_adopted() {
    let place = Place::new();
    let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
    store.replace_base(b"base").unwrap();
    store.append(&[b"entry".to_vec()]).unwrap();
    drop(store);

    let other = Identity { team_digest: [8; 32], ..identity() };
    let error = Store::open(&place.store, &other).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, StoreError::OtherTeam { .. }), "{text}");
    assert!(text.contains(&"07".repeat(32)) && text.contains(&"08".repeat(32)) && text.contains("adopt"), "{text}");

    assert_eq!(adopt_store(&place.store, &other, converted).unwrap(), identity());
    let (store, contents) = Store::open(&place.store, &other).unwrap();
    assert_eq!(contents, Contents { base: Some(b"base and 1 entry".to_vec()), entries: Vec::new() });
    drop(store);
    // A store of the same team stays as it is.
    assert_eq!(adopt_store(&place.store, &other, converted).unwrap(), other);
    assert_eq!(Store::open(&place.store, &other).unwrap().1, contents);
    assert!(matches!(Store::open(&place.store, &identity()), Err(StoreError::OtherTeam { .. })));
}

#[test]
fn a_missing_store_cannot_be_adopted() {
    let place = Place::new();
    assert!(matches!(adopt_store(&place.store, &identity(), converted), Err(StoreError::Missing { .. })));
    assert!(place.files().is_empty());
}
