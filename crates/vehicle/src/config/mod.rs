//! The configuration of one vehicle: `vehicle.toml`.

pub(crate) mod settings;
