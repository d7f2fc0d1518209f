//! Errors of encoding and decoding, with the values that caused them.

use alloc::format;
use alloc::string::String;

/// Why a message cannot be encoded or decoded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is outside its bounds or not finite.
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
    /// A repeated field, a text or a byte string has the wrong length.
    #[error("{field} must have {} elements, found {found}", range(*min, *max))]
    Count {
        /// The field.
        field: String,
        /// Smallest number of elements.
        min: usize,
        /// Largest number of elements.
        max: usize,
        /// Number of elements found.
        found: usize,
    },
    /// A required field is not set.
    #[error("{field} is required, but not set")]
    Missing {
        /// The field.
        field: String,
    },
    /// A value has no field in the schema.
    #[error("{field} is not a field of this message")]
    Unknown {
        /// The field.
        field: String,
    },
    /// More than one member of a `oneof` is set.
    #[error("{field}: another member of the same oneof is set")]
    TwoOfOne {
        /// The second member that is set.
        field: String,
    },
    /// A schema violates a requirement of DCCL.
    #[error("schema: {field} must have {expected}")]
    Schema {
        /// The field, or the message itself.
        field: String,
        /// The requirement that the field violates.
        expected: &'static str,
    },
    /// A value has the wrong kind, or a name does not belong to the enum.
    #[error("{field} must be {expected}")]
    Kind {
        /// The field.
        field: String,
        /// The expected kind of value.
        expected: &'static str,
    },
    /// The bytes end before the message does.
    #[error("the bytes end inside {field}, after {length}")]
    Short {
        /// The field being read.
        field: String,
        /// Number of bytes found.
        length: usize,
    },
    /// Bytes follow after the end of the message.
    #[error("{extra} bytes are left over after the message")]
    Long {
        /// Number of bytes after the message.
        extra: usize,
    },
    /// A padding bit is set, or outcomes are not in their shortest form.
    #[error("the bytes are not the canonical encoding of a message")]
    Padding,
    /// The bytes contain a message of another type.
    #[error("{}, expected {expected}", id(*found))]
    Id {
        /// The id at the start of the bytes, if they are long enough.
        found: Option<u16>,
        /// The id of the schema, or "that of a map message".
        expected: String,
    },
    /// A message, or the longest form of a schema, exceeds the allowed length.
    #[error("the message takes {length} bytes, at most {max} are allowed")]
    TooLong {
        /// Its length.
        length: usize,
        /// The schema's `max_bytes`.
        max: usize,
    },
    /// The authentication tag does not match these bytes and this key.
    #[error("the authentication tag does not match")]
    Forged,
    /// The tag was made with this key for another context. One in 65 536 forgeries gives this error as well.
    #[error("authenticated with this key for a team with other settings")]
    OtherContext,
    /// All bytes of the key are equal.
    #[error("all bytes of the key are equal, so it is not secret")]
    WeakKey,
    /// An authenticated message without a key, or a plain message with a key.
    #[error("{0}")]
    Authentication(&'static str),
}

fn range(min: usize, max: usize) -> String {
    if min == max { format!("{min}") } else { format!("{min} to {max}") }
}

fn id(found: Option<u16>) -> String {
    found.map_or_else(|| "no message id".into(), |found| format!("message id {found}"))
}
