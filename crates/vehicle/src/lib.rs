//! One vehicle as a process.
//!
//! [`Store`] is a file that survives crashes. It holds a snapshot of the vehicle (the *base*) and the entries that were
//! recorded after it. Base and entries are opaque bytes here. A process opens its store by [`open_or_recover`].
//!
//! ```
//! use pingmap_vehicle::{Identity, Opened, Store, open_or_recover};
//!
//! let folder = tempfile::tempdir()?;
//! let (path, snapshot) = (folder.path().join("auv1.redb"), folder.path().join("auv1.snapshot"));
//! let identity = Identity { vehicle: "auv1".into(), team_digest: [7; 32] };
//!
//! let (mut store, opened) = open_or_recover(&path, &snapshot, &identity)?;
//! assert_eq!(opened, Opened::New);
//! store.append(&[b"first".to_vec(), b"second".to_vec()])?;
//! drop(store);
//!
//! let (_, contents) = Store::open(&path, &identity)?;
//! assert_eq!(contents.entries, [b"first".to_vec(), b"second".to_vec()]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

// In the order of the flow: each folder uses only those above it.
mod store;
mod config;
mod protocol;
mod vehicle;
mod process;

pub use config::settings::{
    ClockSettings, ConfigError, HostSettings, Listen, LogFormat, LogSettings, NavigationSettings, SharingSettings,
    SlotSettings, StoreSettings, VEHICLE_EXAMPLE, VEHICLE_SCHEMA, VehicleConfig,
};
pub use process::check::{Checked, check};
pub use process::error::ProcessError;
pub use process::run::run;
pub use process::start::Setup;
pub use protocol::fault::{Fault, FaultCode};
pub use protocol::hex::Hex;
pub use protocol::input::{
    At, Departed, FrameIn, FrameLink, FrameRequest, Heard, Hello, Input, LINKS_MAX, Listening, Nav, Nmea, Peer,
    PeerSource, PiggybackIn, PiggybackRequest, Predict, Token,
};
pub use protocol::line::{LINE_BYTES_MAX, read_line, write_line};
pub use protocol::output::{
    Answer, Greeting, LearnedEvent, MemberReport, Message, PROTOCOL, StatusReport, StoreState, Trust,
};
pub use protocol::place::{End, Place, QueryLink};
pub use store::adoption::adopt_store;
pub use store::error::StoreError;
pub use store::identity::Identity;
pub use store::inspection::{Report, inspect, read_store};
pub use store::recovery::{Opened, open_or_recover};
pub use store::snapshot::{read_snapshot, write_snapshot};
pub use store::tables::Contents;
pub use store::vehicle_store::Store;
pub use vehicle::restore::RestoreError;
pub use vehicle::state::{Output, Vehicle};
