//! The records of a store.

use pingmap_agent::Entry;
use serde::{Deserialize, Serialize};

use crate::vehicle::ledger::LedgerRecord;
use crate::vehicle::trust::Score;

/// One record of the store, after the base.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Record {
    /// An entry of the memory of the agent.
    Entry(Entry),
    /// A change of the ledger of slots.
    Ledger(LedgerRecord),
    /// Predictions of an event before it was learned.
    Score(Score),
}

/// A record that is stored as JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Text {
    Ledger(LedgerRecord),
    Score(Score),
}

const ENTRY: u8 = 0;
const TEXT: u8 = 1;

impl Record {
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let text = match self {
            Record::Entry(entry) => return [&[ENTRY], entry.to_bytes().as_slice()].concat(),
            Record::Ledger(record) => Text::Ledger(record.clone()),
            Record::Score(score) => Text::Score(score.clone()),
        };
        // Numbers are finite and keys are texts, so that this cannot fail.
        [&[TEXT], serde_json::to_vec(&text).unwrap_or_default().as_slice()].concat()
    }

    /// Returns the record, or a description of the problem.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        match bytes.split_first() {
            Some((&ENTRY, entry)) => Entry::from_bytes(entry).map(Record::Entry).map_err(|error| error.to_string()),
            Some((&TEXT, text)) => match serde_json::from_slice(text) {
                Ok(Text::Ledger(record)) => Ok(Record::Ledger(record)),
                Ok(Text::Score(score)) => Ok(Record::Score(score)),
                Err(error) => Err(error.to_string()),
            },
            Some((kind, _)) => Err(format!("kind {kind} is unknown")),
            None => Err("a record is empty".into()),
        }
    }
}
