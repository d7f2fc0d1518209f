//! Faults of a message: what was wrong, where, and what was expected.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum FaultCode {
    /// The line is longer than 64 KiB.
    LineTooLong,
    /// The line is not a JSON object, has a key twice, or has invalid UTF-8.
    NotJson,
    /// The type of the message is unknown or missing.
    UnknownType,
    /// A field is unknown, missing, or of another type.
    WrongField,
    /// A number or a text is out of bounds.
    OutOfBounds,
    /// A message came before `hello`, or a second `hello`.
    NotGreeted,
    /// The host expects another version, vehicle or team.
    Mismatch,
    /// The vehicle that is named is not a member, or not another member.
    UnknownMember,
    /// The time lies too far ahead of the clock, or too far behind.
    WrongTime,
    /// The place is off the chart, or needs a reference system.
    WrongPlace,
    /// No frame has this token.
    UnknownToken,
    /// The vehicle has too much to do; the message was not handled. Send it again later.
    Busy,
    /// The store failed. The vehicle continues in memory, and sends nothing.
    StoreFailed,
    /// A computation failed.
    Failed,
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[error("{message}")]
pub struct Fault {
    /// Its kind.
    pub code: FaultCode,
    /// The field that is wrong, if one is.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub field: Option<String>,
    /// The value that was found.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub found: Option<String>,
    /// The value that was expected.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub expected: Option<String>,
    /// The fault in words.
    pub message: String,
}

impl Fault {
    /// Returns a fault with a message alone.
    pub fn new(code: FaultCode, message: impl Into<String>) -> Self {
        Self { code, field: None, found: None, expected: None, message: message.into() }
    }

    /// Returns a fault of one field.
    pub fn of_field(code: FaultCode, field: &str, found: impl ToString, expected: impl ToString) -> Self {
        let (found, expected) = (shortened(found.to_string()), expected.to_string());
        let message = format!("{field} must be {expected}, found {found}");
        Self { code, field: Some(field.into()), found: Some(found), expected: Some(expected), message }
    }
}

/// Characters of a value that are quoted.
const QUOTED_MAX: usize = 80;

fn shortened(text: String) -> String {
    match text.char_indices().nth(QUOTED_MAX) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}
