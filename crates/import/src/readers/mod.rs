//! Readers of the file formats. Each turns one kind of file into a `Recording`.

// Each file uses only those above it.
pub(crate) mod lines;
pub(crate) mod navigation;
pub(crate) mod tables;
pub(crate) mod message_fields;
pub(crate) mod sink;
pub(crate) mod modem;
pub(crate) mod bags;
pub(crate) mod lcm;
pub(crate) mod moos;
pub(crate) mod record_reader;
pub(crate) mod table_records;
pub(crate) mod event_table;
pub(crate) mod file_owner;
pub(crate) mod file_kind;
pub(crate) mod record_file;
