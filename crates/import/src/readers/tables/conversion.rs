//! Differences of a table from plain CSV.

use std::fmt;

use crate::model::time::EpochUnit;

/// A difference of a table from plain CSV with known columns, which the reader recognised.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Conversion {
    /// The text is in Windows-1252 instead of UTF-8.
    Windows1252,
    /// Numbers have decimal commas.
    DecimalCommas,
    /// Times count from 1970 in this unit.
    Epoch(EpochUnit),
    /// These columns have no role and are ignored.
    UnusedColumns(Vec<String>),
}

impl fmt::Display for Conversion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Conversion::Windows1252 => formatter.write_str("text in Windows-1252"),
            Conversion::DecimalCommas => formatter.write_str("decimal commas"),
            Conversion::UnusedColumns(columns) => write!(formatter, "ignored columns: {}", columns.join(", ")),
            Conversion::Epoch(unit) => write!(formatter, "times in {} since 1970", unit.name()),
        }
    }
}
