//! The reader of all file formats, and its options.

use crate::model::modem_ids::ModemIds;
use crate::model::time::TimeZone;
use crate::readers::lcm::types::LcmTypes;
use crate::readers::moos::MOOS_PREFIX;
use crate::readers::tables::columns::Columns;

/// Reads tables and logs with these options.
#[derive(Debug, Clone)]
pub struct RecordReader {
    /// Columns with unusual names.
    pub columns: Columns,
    /// The zone of dates and times in tables that name none.
    pub time_zone: TimeZone,
    /// The vehicles behind modem ids.
    pub ids: ModemIds,
    /// Prefix of the modem's variables in MOOS logs.
    pub moos_prefix: String,
    /// Types of the messages in LCM logs.
    pub lcm_types: LcmTypes,
}

impl Default for RecordReader {
    /// Usual names of columns and variables, and no ids or types.
    fn default() -> Self {
        Self {
            columns: Columns::default(),
            time_zone: TimeZone::UTC,
            ids: ModemIds::default(),
            moos_prefix: MOOS_PREFIX.to_owned(),
            lcm_types: LcmTypes::default(),
        }
    }
}
