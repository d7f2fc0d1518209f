//! Messages of pingmap as bits, for acoustic modems.
//!
//! * [`Schema`], [`Fields`], [`Value`]: a subset of DCCL (codec version 4, and 3 where it is identical). It suffices
//!   for the messages of pingmap and most messages of a fleet. Values out of bounds are refused in both directions,
//!   with the name of the field; the reference implementation does not refuse them.
//! * [`MapMessage`]: a summary of a vehicle's map, in frames of 32, 64 or 256 bytes. The file `proto/pingmap.proto` of
//!   this crate describes the same message as [`Layout::schema`].
//! * [`Report`]: the outcomes of a vehicle, slot by slot, and its waypoints. Reports have any length.
//! * [`OutcomeBitmap`]: the newest outcomes in a few unused bits of a message that a host sends anyway.
//! * [`Key`]: authentication of whole frames.
//!
//! The crate handles integers only. The team's chart and quantizer define the meaning of a cell or a level. The crate
//! does no I/O, does not panic and does not need `std`.
//!
//! ```
//! use pingmap_packet::{Block, Layout, MapMessage};
//!
//! let layout = Layout::for_frame(32, false, false).expect("there is one for frames of 32 bytes");
//! let message = MapMessage { sender: 3, counter: 17, model: 0x2a5, blocks: vec![Block::empty(layout)] };
//! let bytes = message.encode(layout, None)?;
//! assert_eq!(bytes.len(), 32);
//! let (found, again) = MapMessage::decode(&bytes, None)?;
//! assert_eq!((found.id, again), (layout.id, message));
//! # Ok::<(), pingmap_packet::Error>(())
//! ```

#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;
#[cfg(test)]
extern crate std;

// In the order of the flow: each module uses only those above it.
mod error;
mod hex;
mod bits;
mod value;
mod schema;
mod number;
mod widths;
mod check;
mod encode;
mod decode;
mod authenticator;
mod point;
mod layout;
mod map_message;
mod outcomes;
mod report;
mod outcome_bitmap;

pub use authenticator::{Authenticator, Key, digest};
pub use error::Error;
pub use hex::{from_hex, to_hex};
pub use layout::{
    CORRELATION_LEVELS, DEPTH_CELLS, HORIZONTAL_CELLS, INFORMATION_LEVELS, LAYOUTS, Layout, MEAN_LEVELS, PROTO,
    TIME_CELLS,
};
pub use map_message::{Block, MapMessage};
pub use outcome_bitmap::OutcomeBitmap;
pub use outcomes::{Outcome, OutcomeCounts};
pub use point::{Cell, Point};
pub use report::{
    OUTCOME_BYTES_MAX, REPORT_LAYOUTS, Report, ReportLayout, SLOTS, WAYPOINT_CELLS, WAYPOINT_DEPTH_CELLS,
    WAYPOINTS_MAX, Waypoint,
};
pub use schema::{Field, Kind, Number, Rule, Schema};
pub use value::{Fields, Value};
