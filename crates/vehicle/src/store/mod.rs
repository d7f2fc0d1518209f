//! The crash-safe store of one vehicle.
//!
//! A store is one file of the storage engine [redb](https://docs.rs/redb). It has three tables:
//!
//! | table | key | value |
//! |---|---|---|
//! | `meta` | `format` | version of this layout, four bytes, lowest first |
//! | `meta` | `vehicle` | name of the vehicle, UTF-8 |
//! | `meta` | `team` | digest of the team configuration, 32 bytes |
//! | `base` | 0 | the snapshot, if there is one |
//! | `entries` | 0, 1, … without gaps | the entries recorded since the base |
//!
//! Each change is one transaction with a two-phase commit. A store is created under a temporary name and renamed. A
//! file at the path of a store is therefore complete, or it was damaged.

// In the order of the flow: each file uses only those above it.
pub(crate) mod error;
pub(crate) mod identity;
pub(crate) mod folder;
pub(crate) mod snapshot;
pub(crate) mod tables;
pub(crate) mod engine;
pub(crate) mod header;
pub(crate) mod image;
pub(crate) mod verification;
pub(crate) mod locked_file;
pub(crate) mod creation;
pub(crate) mod vehicle_store;
pub(crate) mod recovery;
pub(crate) mod adoption;
pub(crate) mod inspection;
