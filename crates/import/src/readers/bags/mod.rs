//! ROS 2 bags in MCAP and SQLite files.

pub(crate) mod cdr;
pub(crate) mod bag_parser;
pub(crate) mod mcap_file;
pub(crate) mod sqlite;
