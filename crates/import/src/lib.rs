//! From what underwater vehicles recorded to one event log.
//!
//! After a mission there are files of each vehicle: where it was, what it heard, perhaps what it sent, all by its own clock; and perhaps
//! a schedule. [`Reading`] takes tables in, a [`Recording`] for each vehicle; [`join`] puts these together: a log of who could have
//! heard what, from where to where, and whether it was heard.
//!
//! What is estimated from such a log is the probability that a message, *once sent*, is decoded by a *listening* receiver. So
//! a transmission counts only if something proves that it was sent ([`Proof`]), and only for receivers that listened: whatever speaks
//! against that ([`Unknown`]) is asked without regard to the outcome, so that what is left out is left out heard and missed alike.
//!
//! ```
//! use std::path::Path;
//! use pingmap_agent::VehicleId;
//! use pingmap_import::{Reading, Recordings, Reference, Rules, TableKind, join};
//!
//! let (a, b) = (VehicleId::new("a"), VehicleId::new("b"));
//! let mut recordings = Recordings::new();
//! let mut take = |kind, vehicle, text: &str| {
//!     Reading::default().take(kind, (text.as_bytes(), Path::new("table")), Some(vehicle), &mut recordings)
//! };
//! take(TableKind::Navigation, &a, "time,x,y\n0,0,0\n60,90,0\n")?;
//! take(TableKind::Navigation, &b, "time,x,y\n0,300,0\n60,300,0\n")?;
//! take(TableKind::Sent, &a, "time\n10\n20\n30\n40\n")?;
//! take(TableKind::Heard, &b, "time,source\n10.2,a\n20.2,a\n40.2,a\n")?;
//! let rules = Rules { nav_gap_s_max: 60.0, ..Rules::default() };
//! let imported = join(&recordings, None, &Reference::unknown(), &rules)?;
//! let outcomes: Vec<bool> = imported.log.events.iter().map(|event| event.success).collect();
//! // The first and the last reception only tell when b's modem was at work: they are heard by their choice, so they do not count.
//! assert_eq!(outcomes, [true, false]);
//! # Ok::<(), pingmap_import::ImportError>(())
//! ```

#![forbid(unsafe_code)]

// In the order of the flow: each module uses only those above it.
mod time;
mod reference;
mod recording;
mod error;
mod columns;
mod ids;
mod told;
mod lines;
mod lcm_words;
mod lcm_types;
mod sentence;
mod arriving;
mod micromodem;
mod navigation;
mod goby;
mod moos;
mod tables;
mod waypoints;
mod capture;
mod cdr;
mod spoken;
mod bag;
mod mcap_file;
mod lcm;
mod sqlite;
mod recognise;
mod record;
mod schedule;
mod rules;
mod message;
mod track;
mod clock;
mod fleet;
mod transmission;
mod clocks;
mod matching;
mod listening;
mod report;
mod join;

pub use clock::{Clock, Piece};
pub use columns::{Columns, Role, TableKind};
pub use error::ImportError;
pub use ids::Ids;
pub use join::join;
pub use lcm_types::LcmTypes;
pub use moos::PREFIX;
pub use recognise::{RecordKind, head};
pub use record::{Source, Taken, resolve};
pub use recording::{Arrival, Fix, Recording, Recordings, Sent, Unknown};
pub use reference::{Place, Reference, ReferenceError};
pub use report::{ClockFound, Imported, LeftOut, Pair, Proofs};
pub use rules::{AlwaysSend, Rules};
pub use schedule::Schedule;
pub use sentence::nmea_checksum;
pub use tables::Reading;
pub use time::{TIME, parse_time, time_in_words};
pub use told::Skipped;
pub use transmission::Proof;
pub use waypoints::{Waypoint, read_waypoints};
