//! What a message looks like: its fields, their bounds and their order.

use alloc::string::String;
use alloc::vec::Vec;

/// A message: what a `.proto` says about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Schema {
    /// The message's name.
    pub name: String,
    /// Its DCCL id, up to 32767; `None` for a message with `omit_id`.
    pub id: Option<u16>,
    /// Bytes that its longest form may take at most.
    pub bytes_max: usize,
    /// Its fields, in the order of declaration.
    pub fields: Vec<Field>,
}

/// One field.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// What its values are.
    pub kind: Kind,
    /// How often it occurs.
    pub rule: Rule,
    /// Whether it stands in the head of the message. Fields inside a message stand where the message does.
    pub in_head: bool,
    /// Whether an optional number has a presence bit of its own (`codec: "dccl.presence"`).
    pub presence: bool,
    /// The `oneof` it is a member of, if any.
    pub oneof: Option<String>,
}

/// How often a field occurs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Exactly once.
    Required,
    /// Once or not at all.
    Optional,
    /// So many times.
    Repeated {
        /// Fewest.
        min: usize,
        /// Most.
        max: usize,
    },
}

/// What the values of a field are.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// True or false.
    Bool,
    /// A bounded number.
    Number(Number),
    /// One of some names, each with its number in the `.proto`.
    Enum {
        /// Names and numbers, in the order of declaration.
        values: Vec<(String, i32)>,
        /// Whether the place in the declaration is sent (the default of DCCL) instead of the number.
        packed: bool,
    },
    /// At most so many bytes.
    Bytes {
        /// Most bytes.
        length_max: usize,
    },
    /// A text of at most so many bytes.
    Text {
        /// Most bytes.
        length_max: usize,
    },
    /// A message inside.
    Message(Vec<Field>),
}

/// Bounds and resolution of a number. Every multiple of the resolution between the bounds has a code; the bounds are
/// multiples, too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Distance between neighbouring values.
    pub resolution: f64,
    /// Whether the values are whole numbers (an integer field of the `.proto`).
    pub integer: bool,
}

impl Field {
    /// A required field of the body.
    pub fn required(name: &str, kind: Kind) -> Self {
        Self { name: name.into(), kind, rule: Rule::Required, in_head: false, presence: false, oneof: None }
    }

    /// The same, optional.
    pub fn optional(name: &str, kind: Kind) -> Self {
        Self { rule: Rule::Optional, ..Self::required(name, kind) }
    }

    /// The same, `min` to `max` times.
    pub fn repeated(name: &str, kind: Kind, min: usize, max: usize) -> Self {
        Self { rule: Rule::Repeated { min, max }, ..Self::required(name, kind) }
    }

    /// The same field in the head.
    pub fn in_head(self) -> Self {
        Self { in_head: true, ..self }
    }

    /// The same field with a presence bit.
    pub fn with_presence_bit(self) -> Self {
        Self { presence: true, ..self }
    }

    /// The same field as a member of a `oneof`.
    pub fn member_of(self, oneof: &str) -> Self {
        Self { oneof: Some(oneof.into()), ..self }
    }
}

impl Kind {
    /// A whole number with resolution 1.
    pub fn integer(min: f64, max: f64) -> Self {
        Kind::Number(Number { min, max, resolution: 1.0, integer: true })
    }

    /// A number with this distance between neighbouring values (10^−precision, or the `resolution` of the `.proto`).
    pub fn decimal(min: f64, max: f64, resolution: f64) -> Self {
        Kind::Number(Number { min, max, resolution, integer: false })
    }
}
