//! LCM message types, and the parser of their definitions (`.lcm`).
//!
//! The parser is written by hand, because no maintained crate decodes LCM messages with types known only at run time.

use std::collections::BTreeMap;

use crate::readers::lcm::tokens::split_tokens;

/// Deepest nesting of types.
pub(super) const DEPTH_MAX: usize = 16;

/// Types by their full name, with the package.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LcmTypes(pub(super) BTreeMap<String, Struct>);

#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Struct {
    pub(super) members: Vec<Member>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Member {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) dimensions: Vec<Dimension>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    /// The name of a numeric type, and its size in bytes.
    Number(&'static str, usize),
    Text,
    Struct(String),
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Dimension {
    /// A size, and its text in the definition.
    Fixed(usize, String),
    Member(String),
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
                "}" if found.members.is_empty() => return Err("it has no members; expected at least one".into()),
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
                            Some(0) => return Err(format!("found an array {name} of size 0; expected a larger one")),
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_definitions_are_refused() {
        for text in [
            "struct",
            "struct a",
            "struct a {",
            "struct a { int32_t }",
            "struct a { int32_t x",
            "package",
            "int32_t x;",
            "struct a { int32_t x[; }",
            "struct a { }",
            "struct a { const int32_t X = 1; }",
            "struct a { int32_t x[0]; }",
            "struct a { const int32_t N = 0; int32_t x[2][N]; }",
        ] {
            assert!(LcmTypes::default().read(text).is_err(), "{text}");
        }
    }
}
