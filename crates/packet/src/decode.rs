//! Decoding of bits to messages. The rules are those of DCCL, but bounds and padding are checked in addition.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use crate::bits::BitReader;
use crate::error::Error;
use crate::schema::{Field, Kind, Number, Rule, Schema};
use crate::value::{Fields, Value};
use crate::widths::{enum_range, has_presence_bit, oneofs, optional_width, path, width};

impl Schema {
    /// Decodes `bytes`, which must contain one message and nothing else.
    ///
    /// # Errors
    /// The errors of [`Schema::check`], and [`Error`] for another id, for too few or too many bytes, and for a field
    /// with a value outside its bounds.
    pub fn decode(&self, bytes: &[u8]) -> Result<Fields, Error> {
        self.check()?;
        self.read(bytes)
    }

    /// Decodes `bytes` without checking the schema, which must have passed [`Schema::check`].
    pub(crate) fn read(&self, bytes: &[u8]) -> Result<Fields, Error> {
        let (message, length) = self.read_first(bytes)?;
        match bytes.len() - length {
            0 => Ok(message),
            extra => Err(Error::Long { extra }),
        }
    }

    /// Decodes the message at the start of `bytes`, and returns it with its length in bytes. Like [`Schema::read`], it
    /// does not check the schema.
    pub(crate) fn read_first(&self, bytes: &[u8]) -> Result<(Fields, usize), Error> {
        let mut reader = Reader { bits: BitReader::new(bytes), length: bytes.len() };
        if let Some(expected) = self.id {
            let found = Schema::id_of(bytes);
            if found != Some(expected) {
                return Err(Error::Id { found, expected: format!("{expected}") });
            }
            reader.read(self.id_bits() as u32, "the message id")?;
        }
        let mut message = Fields::new();
        for field in self.fields.iter().filter(|field| field.in_head) {
            reader.field(field, None, "", &mut message)?;
        }
        reader.align()?;
        let chosen = reader.oneofs(&self.fields)?;
        for field in self.fields.iter().filter(|field| !field.in_head) {
            reader.field(field, Some(&chosen), "", &mut message)?;
        }
        reader.align()?;
        Ok((message, bytes.len() - reader.bits.bytes_left()))
    }
}

struct Reader<'a> {
    bits: BitReader<'a>,
    /// Total number of bytes, for errors.
    length: usize,
}

impl Reader<'_> {
    fn read(&mut self, width: u32, name: &str) -> Result<u64, Error> {
        self.bits.read(width).ok_or_else(|| Error::Short { field: name.into(), length: self.length })
    }

    fn align(&mut self) -> Result<(), Error> {
        if self.bits.align() { Ok(()) } else { Err(Error::Padding) }
    }

    /// Reads the names of the chosen members.
    fn oneofs(&mut self, fields: &[Field]) -> Result<Vec<String>, Error> {
        let mut chosen = Vec::new();
        for (name, members) in oneofs(fields) {
            let code = self.code(members.len() as u64 + 1, name, 0.0)?;
            if let Some(member) = (code as usize).checked_sub(1).and_then(|place| members.get(place)) {
                chosen.push(member.name.clone());
            }
        }
        Ok(chosen)
    }

    /// Reads a code below `codes`. The error for a larger code counts from `min`.
    fn code(&mut self, codes: u64, name: &str, min: f64) -> Result<u64, Error> {
        let code = self.read(width(codes), name)?;
        if code >= codes {
            let max = min + (codes - 1) as f64;
            return Err(Error::OutOfBounds { field: name.into(), min, max, value: min + code as f64 });
        }
        Ok(code)
    }

    /// Reads a field. A member of a oneof is read only if it is among the `chosen`.
    fn field(
        &mut self,
        field: &Field,
        chosen: Option<&[String]>,
        around: &str,
        message: &mut Fields,
    ) -> Result<(), Error> {
        let name = path(around, &field.name);
        if field.oneof.is_some() {
            if chosen.is_some_and(|chosen| chosen.contains(&field.name)) {
                message.set(&field.name, self.value(&field.kind, &name)?);
            }
            return Ok(());
        }
        let value = match field.rule {
            Rule::Required => Some(self.value(&field.kind, &name)?),
            Rule::Repeated { min, max } => {
                let count = min + self.code((max - min) as u64 + 1, &name, min as f64)? as usize;
                let elements = (0..count).map(|_| self.value(&field.kind, &name)).collect::<Result<Vec<_>, _>>()?;
                Some(Value::List(elements))
            }
            Rule::Optional if has_presence_bit(field) => match self.read(1, &name)? {
                0 => None,
                _ => Some(self.value(&field.kind, &name)?),
            },
            Rule::Optional => self.shifted(&field.kind, &name)?,
        };
        if let Some(value) = value {
            message.set(&field.name, value);
        }
        Ok(())
    }

    /// Reads a value in its required form.
    fn value(&mut self, kind: &Kind, name: &str) -> Result<Value, Error> {
        match kind {
            Kind::Bytes { length_max } => Ok(Value::Bytes(self.some_bytes(*length_max, name)?)),
            Kind::Text { length_max } => {
                let bytes = self.some_bytes(*length_max, name)?;
                let text = String::from_utf8(bytes);
                text.map(Value::Text).map_err(|_| Error::Kind { field: name.into(), expected: "a text in UTF-8" })
            }
            Kind::Message(fields) => {
                let chosen = self.oneofs(fields)?;
                let mut message = Fields::new();
                for field in fields {
                    self.field(field, Some(&chosen), name, &mut message)?;
                }
                Ok(Value::Message(message))
            }
            Kind::Bool => Ok(Value::Bool(self.read(1, name)? == 1)),
            Kind::Number(number) => {
                let code = self.read(width(number.codes()), name)?;
                number_value(number, code, name)
            }
            Kind::Enum { values, packed } => {
                let code = self.read(width(enum_range(values, *packed).1), name)?;
                enum_value(values, *packed, code, name)
            }
        }
    }

    /// Reads a value whose code 0 means "not set".
    fn shifted(&mut self, kind: &Kind, name: &str) -> Result<Option<Value>, Error> {
        let code = self.read(optional_width(kind), name)?;
        let Some(code) = code.checked_sub(1) else { return Ok(None) };
        let value = match kind {
            Kind::Number(number) => number_value(number, code, name)?,
            Kind::Enum { values, packed } => enum_value(values, *packed, code, name)?,
            _ if code > 1 => {
                return Err(Error::OutOfBounds { field: name.into(), min: 0.0, max: 2.0, value: code as f64 + 1.0 });
            }
            _ => Value::Bool(code == 1),
        };
        Ok(Some(value))
    }

    fn some_bytes(&mut self, length_max: usize, name: &str) -> Result<Vec<u8>, Error> {
        let length = self.code(length_max as u64 + 1, name, 0.0)?;
        (0..length).map(|_| Ok(self.read(8, name)? as u8)).collect()
    }
}

fn number_value(number: &Number, code: u64, name: &str) -> Result<Value, Error> {
    // A code that the encoder would not write is refused, so each message has exactly one encoding.
    let value = number.value(code);
    if number.code(value) != Some(code) {
        let value = number.min + code as f64 * number.resolution;
        return Err(Error::OutOfBounds { field: name.into(), min: number.min, max: number.max, value });
    }
    Ok(Value::Number(value))
}

fn enum_value(values: &[(String, i32)], packed: bool, code: u64, name: &str) -> Result<Value, Error> {
    let (min, codes) = enum_range(values, packed);
    let known = if packed {
        values.get(code as usize)
    } else {
        values.iter().find(|(_, number)| i64::from(*number) - min == code as i64)
    };
    match known {
        Some((known, _)) => Ok(Value::Enum(known.clone())),
        None => {
            let value = code as f64 + min as f64;
            Err(Error::OutOfBounds { field: name.into(), min: min as f64, max: min as f64 + (codes - 1) as f64, value })
        }
    }
}
