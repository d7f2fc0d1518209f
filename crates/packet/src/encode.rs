//! Encoding of messages to bits. The rules are those of DCCL, but bounds are checked in addition.

use alloc::vec::Vec;

use crate::bits::BitWriter;
use crate::error::Error;
use crate::schema::{Field, Kind, Rule, Schema};
use crate::value::{Fields, Value};
use crate::widths::{enum_range, has_presence_bit, oneofs, optional_width, path, width};

impl Schema {
    /// Encodes the message: id and head, then body, each padded to a whole byte.
    ///
    /// # Errors
    /// The errors of [`Schema::check`], and [`Error`] with the field's name, its bounds and a value that does not fit.
    /// The encoder never truncates a value.
    pub fn encode(&self, message: &Fields) -> Result<Vec<u8>, Error> {
        self.check()?;
        self.write(message)
    }

    /// Encodes the message without checking the schema, which must have passed [`Schema::check`].
    pub(crate) fn write(&self, message: &Fields) -> Result<Vec<u8>, Error> {
        check_names(&self.fields, message, "")?;
        let mut head = BitWriter::default();
        match self.id {
            Some(id @ ..128) => head.write(u64::from(id) << 1, 8),
            Some(id) => head.write(u64::from(id) << 1 | 1, 16),
            None => {}
        }
        let mut body = BitWriter::default();
        write_oneofs(&self.fields, message, &mut body)?;
        for field in &self.fields {
            let part = if field.in_head { &mut head } else { &mut body };
            write_field(field, message, "", part)?;
        }
        let mut bytes = head.into_bytes();
        bytes.extend(body.into_bytes());
        Ok(bytes)
    }
}

/// Refuses values without a field in the schema.
fn check_names(fields: &[Field], message: &Fields, around: &str) -> Result<(), Error> {
    match message.iter().find(|(name, _)| fields.iter().all(|field| field.name != *name)) {
        Some((name, _)) => Err(Error::Unknown { field: path(around, name) }),
        None => Ok(()),
    }
}

/// Writes which member of each oneof is set.
fn write_oneofs(fields: &[Field], message: &Fields, out: &mut BitWriter) -> Result<(), Error> {
    for (_, members) in oneofs(fields) {
        let mut set = members.iter().enumerate().filter(|(_, member)| message.get(&member.name).is_some());
        let chosen = set.next();
        if let Some((_, second)) = set.next() {
            return Err(Error::TwoOfOne { field: second.name.clone() });
        }
        out.write(chosen.map_or(0, |(place, _)| place as u64 + 1), width(members.len() as u64 + 1));
    }
    Ok(())
}

fn write_field(field: &Field, message: &Fields, around: &str, out: &mut BitWriter) -> Result<(), Error> {
    let name = path(around, &field.name);
    let value = message.get(&field.name);
    match (field.rule, value) {
        (Rule::Repeated { min, max }, value) => {
            let elements = match value {
                None => &[][..],
                Some(Value::List(elements)) => elements,
                Some(_) => return Err(Error::Kind { field: name, expected: "a list" }),
            };
            if elements.len() < min || elements.len() > max {
                return Err(Error::Count { field: name, min, max, found: elements.len() });
            }
            out.write((elements.len() - min) as u64, width((max - min) as u64 + 1));
            elements.iter().try_for_each(|element| write_value(&field.kind, element, false, &name, out))
        }
        (_, None) if field.oneof.is_some() => Ok(()),
        (_, Some(value)) if field.oneof.is_some() => write_value(&field.kind, value, false, &name, out),
        (Rule::Required, None) => Err(Error::Missing { field: name }),
        (Rule::Required, Some(value)) => write_value(&field.kind, value, false, &name, out),
        (Rule::Optional, None) => {
            out.write(0, if has_presence_bit(field) { 1 } else { optional_width(&field.kind) });
            Ok(())
        }
        (Rule::Optional, Some(value)) if has_presence_bit(field) => {
            out.write(1, 1);
            write_value(&field.kind, value, false, &name, out)
        }
        (Rule::Optional, Some(value)) => write_value(&field.kind, value, true, &name, out),
    }
}

/// Writes one value. Its code is `shifted` by one if code 0 means "not set".
fn write_value(kind: &Kind, value: &Value, shifted: bool, name: &str, out: &mut BitWriter) -> Result<(), Error> {
    let wrong = |expected| Err(Error::Kind { field: name.into(), expected });
    let shift = u64::from(shifted);
    match (kind, value) {
        (Kind::Bool, Value::Bool(value)) => out.write(u64::from(*value) + shift, 1 + u32::from(shifted)),
        (Kind::Bool, _) => return wrong("true or false"),
        (Kind::Number(number), Value::Number(value)) => {
            let Some(code) = number.code(*value) else {
                return Err(Error::OutOfBounds { field: name.into(), min: number.min, max: number.max, value: *value });
            };
            out.write(code + shift, width(number.codes() + shift));
        }
        (Kind::Number(_), _) => return wrong("a number"),
        (Kind::Enum { values, packed }, Value::Enum(value)) => {
            let Some(place) = values.iter().position(|(known, _)| known == value) else {
                return wrong("a name of its enum");
            };
            let (min, codes) = enum_range(values, *packed);
            let code = if *packed { place as u64 } else { (i64::from(values[place].1) - min) as u64 };
            out.write(code + shift, width(codes + shift));
        }
        (Kind::Enum { .. }, _) => return wrong("a name of its enum"),
        (Kind::Bytes { length_max }, Value::Bytes(bytes)) => write_bytes(bytes, *length_max, name, out)?,
        (Kind::Bytes { .. }, _) => return wrong("bytes"),
        (Kind::Text { length_max }, Value::Text(text)) => write_bytes(text.as_bytes(), *length_max, name, out)?,
        (Kind::Text { .. }, _) => return wrong("a text"),
        (Kind::Message(fields), Value::Message(message)) => {
            check_names(fields, message, name)?;
            write_oneofs(fields, message, out)?;
            fields.iter().try_for_each(|field| write_field(field, message, name, out))?;
        }
        (Kind::Message(_), _) => return wrong("a message"),
    }
    Ok(())
}

fn write_bytes(bytes: &[u8], length_max: usize, name: &str, out: &mut BitWriter) -> Result<(), Error> {
    if bytes.len() > length_max {
        return Err(Error::Count { field: name.into(), min: 0, max: length_max, found: bytes.len() });
    }
    out.write(bytes.len() as u64, width(length_max as u64 + 1));
    bytes.iter().for_each(|&byte| out.write(u64::from(byte), 8));
    Ok(())
}
