//! Widths of ids, fields and values in bits.

use alloc::string::String;
use alloc::vec::Vec;
use alloc::{format, vec};

use crate::schema::{Field, Kind, Rule, Schema};

impl Schema {
    /// Returns the id at the start of these bytes. An id below 128 in two bytes is not valid, so each message has
    /// exactly one encoding.
    pub fn id_of(bytes: &[u8]) -> Option<u16> {
        let (&first, rest) = bytes.split_first()?;
        if first & 1 == 0 {
            return Some(u16::from(first >> 1));
        }
        let id = (u16::from(*rest.first()?) << 8 | u16::from(first)) >> 1;
        (id >= 128).then_some(id)
    }

    /// Returns the number of bits of the message id.
    pub fn id_bits(&self) -> u64 {
        self.id.map_or(0, id_bits)
    }

    /// Returns the length of the message's longest form in bytes.
    pub fn length(&self) -> usize {
        let bits = |head: bool| {
            let fields = self.fields.iter().filter(|field| field.in_head == head && field.oneof.is_none());
            sum(fields.map(Field::bits_max))
        };
        let id_bytes = self.id_bits() / 8;
        let body = bits(false).saturating_add(oneof_bits(&self.fields));
        usize::try_from(bits(true).div_ceil(8).saturating_add(body.div_ceil(8)).saturating_add(id_bytes))
            .unwrap_or(usize::MAX)
    }

    /// Returns the largest number of bits of every field, in the order of declaration. Head and body are each padded to
    /// a whole byte in addition.
    pub fn bits(&self) -> Vec<(&str, u64)> {
        self.fields.iter().map(|field| (field.name.as_str(), field.bits_max())).collect()
    }
}

impl Field {
    /// Returns the number of bits of the longest form.
    pub(crate) fn bits_max(&self) -> u64 {
        if self.oneof.is_some() {
            return self.kind.bits_max();
        }
        match self.rule {
            Rule::Required => self.kind.bits_max(),
            Rule::Optional => self.kind.bits_max().saturating_add(self.optional_bits()),
            Rule::Repeated { min, max } => {
                (max as u64).saturating_mul(self.kind.bits_max()).saturating_add(count_bits(min, max))
            }
        }
    }

    /// Returns the number of bits of the shortest form, in which an optional field is unset.
    pub(crate) fn bits_min(&self) -> u64 {
        if self.oneof.is_some() {
            return 0;
        }
        match self.rule {
            Rule::Required => self.kind.bits_min(),
            Rule::Optional if has_presence_bit(self) => 1,
            Rule::Optional => self.bits_max(),
            Rule::Repeated { min, max } => {
                (min as u64).saturating_mul(self.kind.bits_min()).saturating_add(count_bits(min, max))
            }
        }
    }

    /// Returns the number of bits that an optional field takes in addition to a required field.
    fn optional_bits(&self) -> u64 {
        match &self.kind {
            Kind::Number(number) if !self.presence => grown(number.codes()),
            Kind::Enum { values, packed } if !self.presence => grown(enum_range(values, *packed).1),
            _ => 1,
        }
    }
}

impl Kind {
    /// Returns the number of bits of the longest value in required form.
    pub(crate) fn bits_max(&self) -> u64 {
        match self {
            Kind::Bytes { length_max } | Kind::Text { length_max } => {
                (*length_max as u64).saturating_mul(8).saturating_add(self.bits_min())
            }
            Kind::Message(fields) => {
                let alone = fields.iter().filter(|field| field.oneof.is_none());
                sum(alone.map(Field::bits_max)).saturating_add(oneof_bits(fields))
            }
            _ => self.bits_min(),
        }
    }

    /// Returns the number of bits of the shortest value in required form.
    pub(crate) fn bits_min(&self) -> u64 {
        match self {
            Kind::Bool => 1,
            Kind::Number(number) => width(number.codes()).into(),
            Kind::Enum { values, packed } => width(enum_range(values, *packed).1).into(),
            Kind::Bytes { length_max } | Kind::Text { length_max } => {
                width((*length_max as u64).saturating_add(1)).into()
            }
            Kind::Message(fields) => {
                let choices = oneofs(fields).into_iter().map(|(_, members)| choice_bits(members.len()));
                sum(fields.iter().map(Field::bits_min)).saturating_add(sum(choices))
            }
        }
    }
}

/// Returns the number of bits of a message id.
pub(crate) fn id_bits(id: u16) -> u64 {
    if id < 128 { 8 } else { 16 }
}

/// Returns the number of bits of an element count.
fn count_bits(min: usize, max: usize) -> u64 {
    width((max.saturating_sub(min) as u64).saturating_add(1)).into()
}

/// Returns the number of bits for the choice of a oneof with this number of members.
fn choice_bits(members: usize) -> u64 {
    width(members as u64 + 1).into()
}

/// Returns the number of bits that an additional code takes.
fn grown(codes: u64) -> u64 {
    u64::from(width(codes.saturating_add(1)) - width(codes))
}

/// Returns the saturating sum.
fn sum(bits: impl Iterator<Item = u64>) -> u64 {
    bits.fold(0, u64::saturating_add)
}

/// Returns the number of bits for this number of codes.
pub(crate) fn width(codes: u64) -> u32 {
    u64::BITS - codes.saturating_sub(1).leading_zeros()
}

/// Returns the smallest code value and the number of codes: positions in the declaration, or the span of the numbers.
pub(crate) fn enum_range(values: &[(String, i32)], packed: bool) -> (i64, u64) {
    if packed {
        return (0, values.len() as u64);
    }
    let numbers = || values.iter().map(|(_, number)| i64::from(*number));
    let (min, max) = (numbers().min().unwrap_or(0), numbers().max().unwrap_or(0));
    (min, (max - min) as u64 + 1)
}

/// Returns whether an optional field has a presence bit. Otherwise code 0 means "not set".
pub(crate) fn has_presence_bit(field: &Field) -> bool {
    field.presence || matches!(field.kind, Kind::Bytes { .. } | Kind::Text { .. } | Kind::Message(_))
}

/// Returns the number of bits of an optional field whose code 0 means "not set".
pub(crate) fn optional_width(kind: &Kind) -> u32 {
    match kind {
        Kind::Bool => 2,
        Kind::Number(number) => width(number.codes() + 1),
        Kind::Enum { values, packed } => width(enum_range(values, *packed).1 + 1),
        Kind::Bytes { .. } | Kind::Text { .. } | Kind::Message(_) => 1,
    }
}

/// Returns the names of the oneofs with their members, in the order of declaration.
pub(crate) fn oneofs(fields: &[Field]) -> Vec<(&str, Vec<&Field>)> {
    let mut all: Vec<(&str, Vec<&Field>)> = Vec::new();
    for field in fields {
        if let Some(name) = field.oneof.as_deref() {
            match all.iter_mut().find(|(known, _)| *known == name) {
                Some((_, members)) => members.push(field),
                None => all.push((name, vec![field])),
            }
        }
    }
    all
}

/// Returns the largest number of bits of the oneofs: the choices and the longest member of each.
fn oneof_bits(fields: &[Field]) -> u64 {
    let longest = |members: &[&Field]| members.iter().map(|member| member.kind.bits_max()).max().unwrap_or(0);
    let bits = |members: &Vec<&Field>| longest(members).saturating_add(choice_bits(members.len()));
    sum(oneofs(fields).iter().map(|(_, members)| bits(members)))
}

/// Returns the path of a field, including the names of the messages around it.
pub(crate) fn path(around: &str, name: &str) -> String {
    if around.is_empty() { name.into() } else { format!("{around}.{name}") }
}
