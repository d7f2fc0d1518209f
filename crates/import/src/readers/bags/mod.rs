//! ROS 2 bags in MCAP and SQLite files.

pub(crate) mod cdr;
pub(crate) mod encoding;
pub(crate) mod lost_spans;
pub(crate) mod bag_parser;
pub(crate) mod mcap_file;
pub(crate) mod sqlite_wal;
pub(crate) mod sqlite;
