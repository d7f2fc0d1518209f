//! Decoder of LCM messages of types that are known only at run time.

use std::collections::BTreeMap;

use crate::readers::lcm::types::{DEPTH_MAX, Dimension, Kind, LcmTypes};

/// Largest number of values in a message, with the elements of arrays counted singly.
const LEAVES_MAX: usize = 1 << 20;

/// A decoded value of a member that is no struct.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Leaf<'a> {
    Flag(bool),
    Number(f64),
    Text(&'a str),
    Bytes(&'a [u8]),
}

impl LcmTypes {
    /// Decodes the part of a message behind its fingerprint, and emits every value with the name of its member.
    ///
    /// Returns `None` if the message is too short, or a type is unknown.
    pub(crate) fn decode<'b>(&self, name: &str, bytes: &'b [u8], emit: &mut dyn FnMut(&str, Leaf<'b>)) -> Option<()> {
        let mut decoder = Decoder { types: self, rest: bytes, leaves: 0, emit };
        decoder.decode_struct(name, 0)
    }
}

/// A message that is being decoded.
struct Decoder<'a, 'b> {
    types: &'a LcmTypes,
    rest: &'b [u8],
    leaves: usize,
    emit: &'a mut dyn FnMut(&str, Leaf<'b>),
}

impl<'b> Decoder<'_, 'b> {
    fn take(&mut self, count: usize) -> Option<&'b [u8]> {
        let (taken, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(taken)
    }

    fn decode_struct(&mut self, name: &str, depth: usize) -> Option<()> {
        let types = self.types;
        let found = types.0.get(name).filter(|_| depth < DEPTH_MAX)?;
        let mut sizes: BTreeMap<&str, usize> = BTreeMap::new();
        for member in &found.members {
            let mut count: usize = 1;
            for dimension in &member.dimensions {
                let size = match dimension {
                    Dimension::Fixed(size, _) => *size,
                    Dimension::Member(name) => *sizes.get(name.as_str())?,
                };
                count = count.checked_mul(size)?;
            }
            if let (Kind::Number("byte" | "int8_t", 1), false) = (&member.kind, member.dimensions.is_empty()) {
                let bytes = self.take(count)?;
                (self.emit)(&member.name, Leaf::Bytes(bytes));
                continue;
            }
            for _ in 0..count {
                self.leaves += 1;
                if self.leaves > LEAVES_MAX {
                    return None;
                }
                match &member.kind {
                    Kind::Struct(name) => self.decode_struct(name, depth + 1)?,
                    Kind::Text => {
                        let length = u32::from_be_bytes(self.take(4)?.try_into().ok()?) as usize;
                        let bytes = self.take(length)?;
                        let text = std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()?;
                        (self.emit)(&member.name, Leaf::Text(text));
                    }
                    Kind::Number(kind, bytes) => {
                        let number = decode_number(kind, self.take(*bytes)?)?;
                        sizes.extend(
                            (number >= 0.0 && number.fract() == 0.0).then_some((member.name.as_str(), number as usize)),
                        );
                        let leaf = if *kind == "boolean" { Leaf::Flag(number != 0.0) } else { Leaf::Number(number) };
                        (self.emit)(&member.name, leaf);
                    }
                }
            }
        }
        Some(())
    }
}

fn decode_number(kind: &str, bytes: &[u8]) -> Option<f64> {
    Some(match kind {
        "double" => f64::from_be_bytes(bytes.try_into().ok()?),
        "float" => f64::from(f32::from_be_bytes(bytes.try_into().ok()?)),
        "int64_t" => i64::from_be_bytes(bytes.try_into().ok()?) as f64,
        "int32_t" => f64::from(i32::from_be_bytes(bytes.try_into().ok()?)),
        "int16_t" => f64::from(i16::from_be_bytes(bytes.try_into().ok()?)),
        "byte" => f64::from(bytes[0]),
        _ => f64::from(bytes[0] as i8),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decoding_is_bounded() {
        let mut types = LcmTypes::default();
        types
            .read(
                "struct a { int32_t n; b x[n]; } struct b { byte y; } struct c { c x[3]; } \
                 struct d { double x[9000000000][9000000000]; }",
            )
            .unwrap();
        let decode = |name: &str, bytes: &[u8]| types.decode(name, bytes, &mut |_, _| {});
        assert_eq!(decode("a", &[0, 0, 0, 2, 7, 7]), Some(()));
        for (name, bytes) in
            [("a", &[127, 255, 255, 255][..]), ("a", &[255; 4]), ("c", &[]), ("d", &[0; 64]), ("e", &[])]
        {
            assert_eq!(decode(name, bytes), None, "{name}");
        }
    }
}
