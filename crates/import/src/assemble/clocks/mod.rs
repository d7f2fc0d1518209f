//! Estimation of the clock offsets between vehicles from transmissions and receptions.

pub(crate) mod clock;
pub(crate) mod peak;
pub(crate) mod delays;
pub(crate) mod fleet_clocks;
