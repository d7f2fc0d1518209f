//! The values of a message.

use alloc::string::String;
use alloc::vec::Vec;

/// One value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// True or false.
    Bool(bool),
    /// A number, integer or decimal.
    Number(f64),
    /// The name of an enum's value.
    Enum(String),
    /// A byte string.
    Bytes(Vec<u8>),
    /// A text.
    Text(String),
    /// An inner message.
    Message(Fields),
    /// The elements of a repeated field.
    List(Vec<Value>),
}

/// The values of a message by field name. Unset fields are absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Fields(Vec<(String, Value)>);

impl Fields {
    /// Returns a message without values.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets a field. A second value replaces the first.
    pub fn set(&mut self, name: &str, value: Value) {
        match self.0.iter_mut().find(|(known, _)| known == name) {
            Some((_, known)) => *known = value,
            None => self.0.push((name.into(), value)),
        }
    }

    /// Returns the value of a field, if it is set.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.0.iter().find(|(known, _)| known == name).map(|(_, value)| value)
    }

    /// Iterates over the values that are set, in the order of setting.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value))
    }
}

/// Returns a number as a value.
pub(crate) fn number(value: impl Into<f64>) -> Value {
    Value::Number(value.into())
}

/// Iterates over the numbers of a field, repeated or not.
pub(crate) fn numbers<'a>(fields: &'a Fields, name: &str) -> impl Iterator<Item = f64> + use<'a> {
    let elements = match fields.get(name) {
        Some(Value::List(elements)) => elements.as_slice(),
        Some(single) => core::slice::from_ref(single),
        None => &[],
    };
    elements.iter().filter_map(|value| if let Value::Number(value) = value { Some(*value) } else { None })
}
