//! Estimation of the clock offsets between vehicles from transmissions and receptions.

pub(crate) mod clock;
pub(crate) mod peak;
pub(crate) mod delays;
pub(crate) mod step;
pub(crate) mod fleet_clocks;
pub(crate) mod round_trips;
pub(crate) mod unrecorded_steps;
