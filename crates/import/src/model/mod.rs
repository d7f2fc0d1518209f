//! The types that the readers yield, and the inputs that describe a mission: reference system, modem ids, schedule.

// Each file uses only those above it.
pub(crate) mod time;
pub(crate) mod utm_zone;
pub(crate) mod reference;
pub(crate) mod scale;
pub(crate) mod error;
pub(crate) mod exclusion;
pub(crate) mod recording;
pub(crate) mod parsed_file;
pub(crate) mod modem_ids;
pub(crate) mod schedule;
pub(crate) mod goby_mac;
pub(crate) mod schedule_file;
