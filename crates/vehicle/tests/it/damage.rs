//! Damaged files: the content is exactly right, or the store is refused as damaged.

use std::fs;

use pingmap_vehicle::{Contents, Store, StoreError};
use rand::{Rng, RngExt};

use crate::common::{Place, fill, identity, random};
use crate::sim_disk::SimDisk;

/// How often a damaged file was still right, and how often it was refused.
#[derive(Debug, Default, PartialEq, Eq)]
struct Counts {
    intact: usize,
    refused: usize,
}

/// A store, and what it has to contain.
struct Original {
    place: Place,
    bytes: Vec<u8>,
    contents: Contents,
}

impl Original {
    /// A store that was closed, or one whose process was killed.
    fn new(is_closed: bool) -> Self {
        let place = Place::new();
        let (mut store, _) = Store::open(&place.store, &identity()).unwrap();
        let (base, entries) = fill(&mut store);
        let contents = Contents { base: Some(base), entries };
        let bytes = if is_closed {
            store.close().unwrap();
            fs::read(&place.store).unwrap()
        } else {
            fs::read(&place.store).unwrap()
        };
        Self { place, bytes, contents }
    }

    /// Opens a file with the first bytes of the store.
    fn truncate(&self, places: usize) -> Counts {
        let mut counts = Counts::default();
        let path = self.place.folder.path().join("truncated.redb");
        for place in 0..=places {
            let bytes = &self.bytes[..self.bytes.len() * place / places];
            fs::write(&path, bytes).unwrap();
            let opened = Store::open(&path, &identity());
            self.count(opened, &mut counts, &format!("{} of {} bytes", bytes.len(), self.bytes.len()), || {
                fs::read(&path).unwrap() == bytes
            });
        }
        counts
    }

    /// Opens the store on a disk in memory, after each of these changes.
    fn alter(&self, changes: impl Iterator<Item = (String, Vec<u8>)>) -> Counts {
        let mut counts = Counts::default();
        for (what, bytes) in changes {
            let disk = SimDisk::with_content(0, bytes.clone());
            let opened = Store::open_on(disk.clone(), &identity());
            self.count(opened, &mut counts, &what, || disk.content() == bytes);
        }
        counts
    }

    fn flip(&self, bits: impl Iterator<Item = usize>) -> Counts {
        self.alter(bits.map(|bit| {
            let mut bytes = self.bytes.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            (format!("bit {} of byte {}", bit % 8, bit / 8), bytes)
        }))
    }

    /// Replaces each sector of 512 bytes by zeros, or by random bytes.
    fn lose_sectors(&self, is_zero: bool) -> Counts {
        let mut random = random(4);
        self.alter((0..self.bytes.len() / 512).map(|sector| {
            let mut bytes = self.bytes.clone();
            let lost = &mut bytes[512 * sector..][..512];
            if is_zero {
                lost.fill(0)
            } else {
                random.fill_bytes(lost)
            }
            (format!("sector {sector}, zeros: {is_zero}"), bytes)
        }))
    }

    /// Counts a store that was opened. Its content is right, or it is damaged and unchanged.
    fn count(
        &self,
        opened: Result<(Store, Contents), StoreError>,
        counts: &mut Counts,
        what: &str,
        is_unchanged: impl Fn() -> bool,
    ) {
        match opened {
            Ok((_, contents)) => {
                assert!(contents == self.contents, "{what}: other content");
                counts.intact += 1;
            }
            Err(StoreError::Damaged { .. }) => {
                assert!(is_unchanged(), "{what}: the file was changed");
                counts.refused += 1;
            }
            Err(error) => panic!("{what}: {error}"),
        }
    }

    fn flip_random(&self, count: usize) -> Counts {
        let mut random = random(2);
        self.flip((0..count).map(|_| random.random_range(0..8 * self.bytes.len())))
    }
}

#[test]
fn a_truncated_store_is_intact_or_refused() {
    for is_closed in [true, false] {
        let counts = Original::new(is_closed).truncate(200);
        println!("201 truncations, closed: {is_closed}: {counts:?}");
        assert!(counts.intact >= 1, "the whole file is intact");
    }
}

#[test]
fn a_store_with_one_flipped_bit_is_intact_or_refused() {
    for is_closed in [true, false] {
        let counts = Original::new(is_closed).flip_random(1500);
        println!("1500 flips, closed: {is_closed}: {counts:?}");
        assert!(counts.intact > 100 && counts.refused > 100, "{counts:?}");
    }
}

#[test]
fn a_store_with_one_flipped_bit_in_its_header_is_intact_or_refused() {
    for is_closed in [true, false] {
        let counts = Original::new(is_closed).flip(0..8 * 320);
        println!("2560 flips in the header, closed: {is_closed}: {counts:?}");
    }
}

#[test]
fn a_store_with_a_lost_sector_is_intact_or_refused() {
    for is_closed in [true, false] {
        for is_zero in [true, false] {
            let counts = Original::new(is_closed).lose_sectors(is_zero);
            println!("each sector lost, closed: {is_closed}, zeros: {is_zero}: {counts:?}");
        }
    }
}
