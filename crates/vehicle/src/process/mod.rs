//! The process of one vehicle: one reader thread, one writer thread, and one owner of the vehicle.
//!
//! The reader splits the input into lines and reads messages. The owner handles one message after the other, and stores
//! records before it sends their consequences. The writer writes answers. Both queues are bounded. If the queue of the
//! owner is full, the reader answers a line with the code `busy`. If the queue of the writer is full, owner and reader
//! wait for the host.

// In the order of the flow: each file uses only those above it.
pub(crate) mod error;
pub(crate) mod log;
pub(crate) mod stop_request;
pub(crate) mod lines;
pub(crate) mod connection;
#[cfg(unix)]
mod unix_socket;
pub(crate) mod listener;
pub(crate) mod reader;
pub(crate) mod writer;
pub(crate) mod start;
pub(crate) mod check;
pub(crate) mod owner;
pub(crate) mod run;
