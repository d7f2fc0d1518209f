//! Bits on the water.
//!
//! * [`Schema`], [`Fields`], [`Value`]: the part of DCCL (codec version 4, and 3 where it is the same) that our
//!   messages and most of a fleet's own need. Unlike the reference implementation, values out of bounds are refused
//!   both ways, by name.
//! * [`MapMessage`]: what a vehicle tells of its map, in frames of 32, 64 or 256 bytes. Its `.proto` ships beside this
//!   crate (`proto/pingmap.proto`) and says the same as [`Layout::schema`].
//! * [`Report`]: what a vehicle heard and missed, slot by slot, and where it was meanwhile; in frames of any size.
//! * [`Recent`]: the latest of that in a few spare bits of a message that a host sends anyway.
//! * [`Key`]: authentication of whole frames.
//!
//! The crate knows integers only: what a cell or a level means is the team's chart and packet model. No I/O, no panics,
//! no `std`.
//!
//! ```
//! use pingmap_packet::{Block, Layout, MapMessage};
//!
//! let layout = Layout::for_frame(32, false, false).expect("there is one for frames of 32 bytes");
//! let message = MapMessage { sender: 3, counter: 17, model: 0x2a5, blocks: vec![Block::silent(layout)] };
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
mod seal;
mod point;
mod layout;
mod map_message;
mod outcomes;
mod report;
mod recent;

pub use error::Error;
pub use hex::{from_hex, to_hex};
pub use layout::{
    CORRELATION_LEVELS, DEPTH_CELLS, HORIZONTAL_CELLS, INFORMATION_LEVELS, LAYOUTS, Layout, MEAN_LEVELS, PROTO,
    TIME_CELLS,
};
pub use map_message::{Block, MapMessage};
pub use outcomes::{Outcome, OutcomeCounts};
pub use point::{Cell, Point};
pub use recent::Recent;
pub use report::{
    Earlier, KNOT_CELLS, KNOT_DEPTH_CELLS, KNOTS_MAX, Knot, OUTCOME_BYTES_MAX, REPORT_LAYOUTS, Report, ReportLayout,
    SLOTS,
};
pub use schema::{Field, Kind, Number, Rule, Schema};
pub use seal::{Key, Seal, digest};
pub use value::{Fields, Value};
