//! Readers of tables (CSV), and the roles of their columns.

// Each file uses only those above it.
pub(crate) mod roles;
pub(crate) mod columns;
pub(crate) mod conversion;
pub(crate) mod units;
pub(crate) mod role_table;
pub(crate) mod position;
pub(crate) mod waypoints;
