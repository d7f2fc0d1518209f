//! Estimation of the clock offsets between vehicles from transmissions and receptions.

pub(crate) mod clock;
pub(crate) mod fleet_clocks;
