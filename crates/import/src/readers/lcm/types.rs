//! LCM message types: parser of their definitions (`.lcm`), fingerprints, and decoder.
//!
//! The parser is written by hand, because no maintained crate decodes LCM messages with types known only at run time.

use std::collections::BTreeMap;

use crate::readers::lcm::tokens::split_tokens;

/// Deepest nesting of types.
const DEPTH_MAX: usize = 16;

/// Largest number of values in a message, with the elements of arrays counted singly.
const LEAVES_MAX: usize = 1 << 20;

/// Types by their full name, with the package.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LcmTypes(BTreeMap<String, Struct>);

#[derive(Debug, Clone, Default, PartialEq)]
struct Struct {
    members: Vec<Member>,
}

#[derive(Debug, Clone, PartialEq)]
struct Member {
    name: String,
    kind: Kind,
    dimensions: Vec<Dimension>,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    /// The name of a numeric type, and its size in bytes.
    Number(&'static str, usize),
    Text,
    Struct(String),
}

#[derive(Debug, Clone, PartialEq)]
enum Dimension {
    /// A size, and its text in the definition.
    Fixed(usize, String),
    Member(String),
}

/// A decoded value of a member that is no struct.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Leaf<'a> {
    Flag(bool),
    Number(f64),
    Text(&'a str),
    Bytes(&'a [u8]),
}

const NUMBERS: [(&str, usize); 8] = [
    ("int8_t", 1),
    ("int16_t", 2),
    ("int32_t", 4),
    ("int64_t", 8),
    ("byte", 1),
    ("boolean", 1),
    ("float", 4),
    ("double", 8),
];

/// Parses a size in decimal or C hexadecimal notation.
fn parse_size(text: &str) -> Option<usize> {
    match text.strip_prefix("0x").or(text.strip_prefix("0X")) {
        Some(digits) => usize::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
}

impl LcmTypes {
    /// Returns whether a text starts like a definition.
    pub(crate) fn is_definition(text: &str) -> bool {
        let tokens = split_tokens(text);
        let tokens: Vec<&str> = tokens.iter().map(String::as_str).collect();
        matches!(tokens[..], ["package", _, ";", "struct", _, "{", ..] | ["struct", _, "{", ..])
    }

    /// Reads the definitions in a file.
    ///
    /// # Errors
    /// The text that was found and what was expected.
    pub(crate) fn read(&mut self, text: &str) -> Result<(), String> {
        let tokens = split_tokens(text);
        let mut tokens = tokens.iter().map(String::as_str).peekable();
        let mut package = String::new();
        while let Some(token) = tokens.next() {
            match token {
                "package" => {
                    package = tokens
                        .next()
                        .filter(|token| is_name(token))
                        .map(|name| format!("{name}."))
                        .ok_or("a package without a name")?;
                    expect(tokens.next(), ";", "the package")?;
                }
                "struct" => {
                    let name = tokens.next().filter(|token| is_name(token)).ok_or("a struct without a name")?;
                    let read =
                        Struct::read(&mut tokens, &package).map_err(|problem| format!("struct {name}: {problem}"))?;
                    self.0.insert(format!("{package}{name}"), read);
                    if tokens.peek() == Some(&";") {
                        tokens.next();
                    }
                }
                other => return Err(format!("found {other:?}; expected package or struct")),
            }
        }
        Ok(())
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the name of each type by its fingerprint, with which its messages start.
    pub(crate) fn by_fingerprint(&self) -> BTreeMap<u64, &str> {
        self.0.keys().map(|name| (self.fingerprint(name, &mut Vec::new()), name.as_str())).collect()
    }

    fn fingerprint<'a>(&'a self, name: &'a str, parents: &mut Vec<&'a str>) -> u64 {
        let Some(found) = self.0.get(name).filter(|_| !parents.contains(&name) && parents.len() < DEPTH_MAX) else {
            return 0;
        };
        parents.push(name);
        let nested = found.members.iter().filter_map(|member| match &member.kind {
            Kind::Struct(name) => Some(self.fingerprint(name, parents)),
            Kind::Number(..) | Kind::Text => None,
        });
        let nested: Vec<u64> = nested.collect();
        parents.pop();
        nested.into_iter().fold(found.own_fingerprint(), u64::wrapping_add).rotate_left(1)
    }

    /// Decodes the part of a message behind its fingerprint, and emits every value with the name of its member.
    ///
    /// Returns `None` if the message is too short, or a type is unknown.
    pub(crate) fn decode<'b>(&self, name: &str, bytes: &'b [u8], emit: &mut dyn FnMut(&str, Leaf<'b>)) -> Option<()> {
        let mut decoder = Decoder { types: self, rest: bytes, leaves: 0, emit };
        decoder.decode_struct(name, 0)
    }
}

fn expect(found: Option<&str>, expected: &str, after: &str) -> Result<(), String> {
    if found == Some(expected) {
        return Ok(());
    }
    Err(format!("found {:?} after {after}; expected {expected}", found.unwrap_or("the end")))
}

impl Struct {
    fn read<'a>(tokens: &mut impl Iterator<Item = &'a str>, package: &str) -> Result<Self, String> {
        expect(tokens.next(), "{", "its name")?;
        let mut found = Self::default();
        let mut constants: BTreeMap<&str, &str> = BTreeMap::new();
        loop {
            let token = tokens.next().ok_or("it does not end")?;
            match token {
                "}" => return Ok(found),
                ";" => {}
                "const" => {
                    // A type, and one or more pairs of a name and a value, separated by commas.
                    tokens.next();
                    loop {
                        let name = tokens.next().ok_or("a constant without a name")?;
                        expect(tokens.next(), "=", name)?;
                        constants.insert(name, tokens.next().ok_or("a constant without a value")?);
                        match tokens.next() {
                            Some(",") => {}
                            Some(";") => break,
                            other => expect(other, ";", name)?,
                        }
                    }
                }
                kind if is_name(kind) => found.read_members(kind, tokens, (package, &constants))?,
                other => return Err(format!("found {other:?}; expected a member")),
            }
        }
    }

    /// Reads the members of one type, separated by commas.
    fn read_members<'a>(
        &mut self,
        kind: &str,
        tokens: &mut impl Iterator<Item = &'a str>,
        (package, constants): (&str, &BTreeMap<&str, &str>),
    ) -> Result<(), String> {
        let kind = match NUMBERS.iter().find(|(name, _)| *name == kind) {
            Some((name, bytes)) => Kind::Number(name, *bytes),
            None if kind == "string" => Kind::Text,
            None if kind.contains('.') => Kind::Struct(kind.to_owned()),
            None => Kind::Struct(format!("{package}{kind}")),
        };
        loop {
            let name = tokens.next().filter(|token| is_name(token)).ok_or("a member without a name")?;
            let mut dimensions = Vec::new();
            loop {
                match tokens.next() {
                    Some("[") => {
                        let size = tokens.next().ok_or("an array without a size")?;
                        let value = constants.get(size).copied().unwrap_or(size);
                        dimensions.push(match parse_size(value) {
                            Some(size) => Dimension::Fixed(size, value.to_owned()),
                            None => Dimension::Member(value.to_owned()),
                        });
                        expect(tokens.next(), "]", size)?;
                    }
                    Some(end @ ("," | ";")) => {
                        self.members.push(Member { name: name.to_owned(), kind: kind.clone(), dimensions });
                        if end == ";" {
                            return Ok(());
                        }
                        break;
                    }
                    other => expect(other, ";", name)?,
                }
            }
        }
    }

    /// Hashes the names, types and sizes of the members. The fingerprints of nested types are not included.
    fn own_fingerprint(&self) -> u64 {
        let mut found = Fingerprint(0x1234_5678);
        for Member { name, kind, dimensions } in &self.members {
            found.text(name);
            match kind {
                Kind::Number(name, _) => found.text(name),
                Kind::Text => found.text("string"),
                Kind::Struct(_) => {}
            }
            found.byte(dimensions.len() as u8);
            for dimension in dimensions {
                match dimension {
                    Dimension::Fixed(_, text) => {
                        found.byte(0);
                        found.text(text);
                    }
                    Dimension::Member(name) => {
                        found.byte(1);
                        found.text(name);
                    }
                }
            }
        }
        found.0 as u64
    }
}

struct Fingerprint(i64);

impl Fingerprint {
    fn byte(&mut self, byte: u8) {
        self.0 = ((self.0 << 8) ^ (self.0 >> 55)).wrapping_add(i64::from(byte as i8));
    }

    fn text(&mut self, text: &str) {
        self.byte(text.len() as u8);
        text.bytes().for_each(|byte| self.byte(byte));
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

    const TEXT: &str = "package pm; // navigation\nstruct point_t { double lat; double lon; }\n/* two\nlines */ struct nav_t {\n\
        const int32_t VERSION = 2, OTHER = 3; int64_t utime; point_t where; double depth; int8_t n; byte raw[n]; float cov[OTHER][2];\n\
        string name; boolean ok; }\nstruct modem_t { int64_t utime; string nmea; };";

    /// The expected values are those that the generator of LCM 1.5.3 writes for these types.
    #[test]
    fn fingerprints_agree_with_the_lcm_generator() {
        let mut types = LcmTypes::default();
        types.read(TEXT).unwrap();
        let own = |name: &str| types.0[name].own_fingerprint();
        assert_eq!(own("pm.modem_t"), 0x00c2_4517_2bc5_521f);
        assert_eq!(own("pm.point_t"), 0xd8ee_bdba_b19f_f671);
        assert_eq!(own("pm.nav_t"), 0x8fa9_0313_e0c7_4205);
        let mut types = LcmTypes::default();
        types.read("struct d_t { double a[3]; } struct e_t { int32_t k; e_t next[k]; d_t d; }").unwrap();
        assert_eq!(types.0["d_t"].own_fingerprint(), 0x21f0_a398_3cf3_355a);
        assert_eq!(types.0["e_t"].own_fingerprint(), 0x2fc5_951d_e629_0c92);
        let whole = 0x2fc5_951d_e629_0c92u64.wrapping_add(0x21f0_a398_3cf3_355a_u64.rotate_left(1)).rotate_left(1);
        assert!(types.by_fingerprint().contains_key(&whole));
    }

    #[test]
    fn invalid_definitions_are_refused_and_decoding_is_bounded() {
        for text in [
            "struct",
            "struct a",
            "struct a {",
            "struct a { int32_t }",
            "struct a { int32_t x",
            "package",
            "int32_t x;",
            "struct a { int32_t x[; }",
        ] {
            assert!(LcmTypes::default().read(text).is_err(), "{text}");
        }
        let mut types = LcmTypes::default();
        types.read("struct a { int32_t n; b x[n]; } struct b { } struct c { c x[3]; } struct d { double x[9000000000][9000000000]; }").unwrap();
        let decode = |name: &str, bytes: &[u8]| types.decode(name, bytes, &mut |_, _| {});
        assert_eq!(decode("a", &[0, 0, 0, 5]), Some(()));
        for (name, bytes) in
            [("a", &[127, 255, 255, 255][..]), ("a", &[255; 4]), ("c", &[]), ("d", &[0; 64]), ("e", &[])]
        {
            assert_eq!(decode(name, bytes), None, "{name}");
        }
    }
}
