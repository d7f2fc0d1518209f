//! What can be wrong with a message, with the offending values.

use alloc::format;
use alloc::string::String;

/// Why a message cannot be encoded or decoded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is outside its bounds, or not a number.
    #[error("{field} must lie between {min} and {max}, found {value}")]
    OutOfBounds {
        /// The field, with the names of the messages around it.
        field: String,
        /// Its smallest value.
        min: f64,
        /// Its largest value.
        max: f64,
        /// The value.
        value: f64,
    },
    /// A repeated field, a text or bytes of the wrong length.
    #[error("{field} must have {} elements, found {found}", range(*min, *max))]
    Count {
        /// The field.
        field: String,
        /// Fewest elements.
        min: usize,
        /// Most elements.
        max: usize,
        /// How many there are.
        found: usize,
    },
    /// A required field is not set.
    #[error("{field} is required, but not set")]
    Missing {
        /// The field.
        field: String,
    },
    /// A value is set that the schema does not know.
    #[error("{field} is not a field of this message")]
    Unknown {
        /// The field.
        field: String,
    },
    /// More than one member of a `oneof` is set.
    #[error("{field}: another member of its oneof is set already")]
    TwoOfOne {
        /// The second one.
        field: String,
    },
    /// A schema that describes no message.
    #[error("schema: {field} must have {expected}")]
    Schema {
        /// The field, or the message itself.
        field: String,
        /// What it should have and has not.
        expected: &'static str,
    },
    /// A value of the wrong kind, or a name that the enum does not have.
    #[error("{field} must be {expected}")]
    Kind {
        /// The field.
        field: String,
        /// What it should be.
        expected: &'static str,
    },
    /// The bytes end before the message does.
    #[error("the bytes end inside {field}, after {length}")]
    Short {
        /// The field being read.
        field: String,
        /// How many bytes there are.
        length: usize,
    },
    /// There are more bytes than the message has.
    #[error("{extra} bytes are left over after the message")]
    Long {
        /// How many.
        extra: usize,
    },
    /// Bits that fill up a byte must be zero.
    #[error("a padding bit is set")]
    Padding,
    /// Another message than the one expected.
    #[error("{}, expected {expected}", id(*found))]
    Id {
        /// What the bytes begin with, if they are long enough.
        found: Option<u16>,
        /// What the schema says, or "that of a map message".
        expected: String,
    },
    /// A message longer than allowed, or a schema whose longest form is.
    #[error("the message takes {length} bytes, at most {max} are allowed")]
    TooLong {
        /// Its length.
        length: usize,
        /// The schema's `max_bytes`.
        max: usize,
    },
    /// The tag is not that of these bytes under this key.
    #[error("the authentication tag does not fit")]
    Forged,
    /// A tag made with this key for another context: one in 65 536 forgeries looks like this, too.
    #[error("sealed with this key under another agreement")]
    OtherContext,
    /// A key that anybody would try first.
    #[error("all bytes of the key are equal: that is no secret")]
    WeakKey,
    /// A sealed message and no key, or a key and an open message.
    #[error("{0}")]
    Seal(&'static str),
}

fn range(min: usize, max: usize) -> String {
    if min == max { format!("{min}") } else { format!("{min} to {max}") }
}

fn id(found: Option<u16>) -> String {
    found.map_or_else(|| "no message id".into(), |found| format!("message id {found}"))
}
