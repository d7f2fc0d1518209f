//! The options of all readers.

use crate::model::modem_ids::ModemIds;
use crate::readers::columns::Columns;
use crate::readers::lcm::types::LcmTypes;
use crate::readers::moos::MOOS_PREFIX;

/// How tables are read.
#[derive(Debug, Clone)]
pub struct RecordReader {
    /// How columns are called that are called otherwise.
    pub columns: Columns,
    /// Who is meant by ids.
    pub ids: ModemIds,
    /// What stands before the names of the modem's variables in logs of MOOS.
    pub moos_prefix: String,
    /// Types of the messages in logs of LCM.
    pub lcm_types: LcmTypes,
}

impl Default for RecordReader {
    /// Usual names, and nobody's id.
    fn default() -> Self {
        Self {
            columns: Columns::default(),
            ids: ModemIds::default(),
            moos_prefix: MOOS_PREFIX.to_owned(),
            lcm_types: LcmTypes::default(),
        }
    }
}
