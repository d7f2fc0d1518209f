//! The process of one vehicle, as a host sees it.

mod host;
mod journal;
mod mission;

mod bad_lines;
mod kill;
mod recovery;
mod refusals;
mod settings;
mod slow_host;
mod sockets;
mod times;
