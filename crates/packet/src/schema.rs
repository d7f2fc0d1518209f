//! Schemas of messages: the fields, their bounds and their order.

use alloc::string::String;
use alloc::vec::Vec;

/// The description of a message, as in a `.proto` file.
#[derive(Debug, Clone, PartialEq)]
pub struct Schema {
    /// The message's name.
    pub name: String,
    /// The DCCL id, up to 32767; `None` for a message with `omit_id`.
    pub id: Option<u16>,
    /// Largest allowed length in bytes.
    pub bytes_max: usize,
    /// The fields, in the order of declaration.
    pub fields: Vec<Field>,
}

/// One field of a message.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// The name of the field.
    pub name: String,
    /// The kind of its values.
    pub kind: Kind,
    /// The allowed number of occurrences.
    pub rule: Rule,
    /// Whether the field is in the head of the message. Fields of an inner message are in the same part as the inner
    /// message.
    pub in_head: bool,
    /// Whether an optional number has a presence bit of its own (`codec: "dccl.presence"`).
    pub presence: bool,
    /// The `oneof` that the field belongs to, if any.
    pub oneof: Option<String>,
}

/// The allowed number of occurrences of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Exactly once.
    Required,
    /// At most once.
    Optional,
    /// Between `min` and `max` times.
    Repeated {
        /// Smallest number of elements.
        min: usize,
        /// Largest number of elements.
        max: usize,
    },
}

/// The kind of a field's values.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// True or false.
    Bool,
    /// A bounded number.
    Number(Number),
    /// A name from a list, each with its number in the `.proto`.
    Enum {
        /// Names and numbers, in the order of declaration.
        values: Vec<(String, i32)>,
        /// Whether the position in the declaration is sent (the default of DCCL) instead of the number.
        packed: bool,
    },
    /// Bytes, at most `length_max`.
    Bytes {
        /// Largest number of bytes.
        length_max: usize,
    },
    /// A text of at most `length_max` bytes.
    Text {
        /// Largest number of bytes.
        length_max: usize,
    },
    /// An inner message.
    Message(Vec<Field>),
}

/// Bounds and resolution of a number. Every multiple of the resolution between the bounds has a code. The bounds are
/// multiples of the resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Distance between neighbouring values.
    pub resolution: f64,
    /// Whether the values are integers (an integer field of the `.proto`).
    pub integer: bool,
}

impl Field {
    /// Returns a required field of the body.
    pub fn required(name: &str, kind: Kind) -> Self {
        Self { name: name.into(), kind, rule: Rule::Required, in_head: false, presence: false, oneof: None }
    }

    /// Returns an optional field of the body.
    pub fn optional(name: &str, kind: Kind) -> Self {
        Self { rule: Rule::Optional, ..Self::required(name, kind) }
    }

    /// Returns a field of the body that is repeated `min` to `max` times.
    pub fn repeated(name: &str, kind: Kind, min: usize, max: usize) -> Self {
        Self { rule: Rule::Repeated { min, max }, ..Self::required(name, kind) }
    }

    /// Moves the field to the head.
    pub fn in_head(self) -> Self {
        Self { in_head: true, ..self }
    }

    /// Adds a presence bit to the field.
    pub fn with_presence_bit(self) -> Self {
        Self { presence: true, ..self }
    }

    /// Makes the field a member of a `oneof`.
    pub fn member_of(self, oneof: &str) -> Self {
        Self { oneof: Some(oneof.into()), ..self }
    }
}

impl Kind {
    /// Returns the kind of an integer with resolution 1.
    pub fn integer(min: f64, max: f64) -> Self {
        Kind::Number(Number { min, max, resolution: 1.0, integer: true })
    }

    /// Returns the kind of a number with this distance between neighbouring values (10^−precision, or the `resolution`
    /// of the `.proto`).
    pub fn decimal(min: f64, max: f64, resolution: f64) -> Self {
        Kind::Number(Number { min, max, resolution, integer: false })
    }
}
