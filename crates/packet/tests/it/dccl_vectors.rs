//! Comparison of the codec with bytes from the reference DCCL tool.
//!
//! The vectors are read from the file in `PACKET_VECTORS`, or from the folder in `PINGMAP_SHARED`.

use std::fs;
use std::path::PathBuf;

use pingmap_packet::{Error, Field, Fields, Kind, Number, Rule, Schema, Value};
use serde_json::Value as Json;

/// Marks messages that the tool cannot decode.
const NOT_DECODABLE: &str = "(not decodable by tool without id)";

/// Number of vectors in the default file, and of those with values out of range.
const VECTORS: usize = 190;
const REFUSED: usize = 1;

#[test]
fn every_vector_of_the_reference_tool_matches_or_is_out_of_bounds() {
    let Some((path, is_default)) = vectors_file() else {
        eprintln!("skipped: PINGMAP_SHARED is not set");
        return;
    };
    let file: Json = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let schemas = schemas();
    let mut refused = Vec::new();
    let vectors = file["vectors"].as_array().unwrap();
    for (place, vector) in vectors.iter().enumerate() {
        let name = vector["message"].as_str().unwrap();
        let schema = schemas.iter().find(|schema| schema.name == name);
        let schema = schema.unwrap_or_else(|| panic!("{name} is not described to the codec"));
        refused.extend(check_encoding(schema, vector, &format!("vector {place}, {name}")));
        check_decoding(schema, vector, &format!("vector {place}, {name}"));
    }
    if is_default {
        assert_eq!((vectors.len(), refused.len()), (VECTORS, REFUSED), "refused: {refused:?}");
        assert!(matches!(&refused[0], Error::OutOfBounds { field, .. } if field == "z.tx_e"), "{refused:?}");
    }
}

/// The file with the vectors, and whether it is the default file.
fn vectors_file() -> Option<(PathBuf, bool)> {
    if let Some(path) = std::env::var_os("PACKET_VECTORS") {
        return Some((path.into(), false));
    }
    let shared = PathBuf::from(std::env::var_os("PINGMAP_SHARED")?);
    Some((shared.join("reference").join("dccl_vectors.json"), true))
}

/// Compares the encoding. Returns the error if a value of the vector is outside the bounds of its field.
fn check_encoding(schema: &Schema, vector: &Json, label: &str) -> Option<Error> {
    let message = from_json(&schema.fields, &vector["fields"]);
    let error = match schema.encode(&message) {
        Ok(bytes) => {
            assert_eq!(bytes, hex(&vector["hex"]), "{label}");
            return None;
        }
        Err(error) => error,
    };
    let (Error::OutOfBounds { field, .. } | Error::Count { field, .. }) = &error else { panic!("{label}: {error}") };
    assert!(offenders(&schema.fields, &message, "").contains(field), "{label}: {error}");
    Some(error)
}

/// Compares the decoded values with those of the tool, and encodes them again.
fn check_decoding(schema: &Schema, vector: &Json, label: &str) {
    let bytes = hex(&vector["hex"]);
    assert_eq!(vector["nbytes"], bytes.len(), "{label}");
    assert!(bytes.len() <= schema.length(), "{label}");
    let found = schema.decode(&bytes).unwrap_or_else(|error| panic!("{label}: {error}"));
    let expected = match vector["decoded_text"].as_str().unwrap() {
        // Messages without an id contain only integers, which quantisation does not change.
        NOT_DECODABLE => from_json(&schema.fields, &vector["fields"]),
        text => from_text(&schema.fields, &parse_text(&mut text.chars().collect::<Vec<_>>().as_slice())),
    };
    assert!(is_same_message(&schema.fields, &found, &expected), "{label}: {found:?}, expected {expected:?}");
    assert_eq!(schema.encode(&found).unwrap(), bytes, "{label}: encoding what was decoded");
}

/// The messages of the file's `.proto`.
fn schemas() -> Vec<Schema> {
    let schema = |name: &str, id, bytes_max, fields| Schema { name: format!("commmap.{name}"), id, bytes_max, fields };
    let flag = || vec![Field::required("b", Kind::Bool)];
    vec![
        schema("MapPacket", Some(125), 32, map_packet()),
        schema("Kinds", Some(1234), 128, kinds()),
        schema("Nest", Some(7), 64, nest()),
        schema("V3", Some(9), 32, version_3()),
        schema("OmitId", None, 8, vec![Field::required("a", Kind::integer(0.0, 1000.0))]),
        schema("Id127", Some(127), 8, flag()),
        schema("Id128", Some(128), 8, flag()),
        schema("Id32767", Some(32767), 8, flag()),
    ]
}

fn map_packet() -> Vec<Field> {
    let place = |name| Field::required(name, Kind::decimal(-5000.0, 5000.0, 5.0));
    let mut inducing_point = ["tx_e", "tx_n", "rx_e", "rx_n"].map(place).to_vec();
    inducing_point.push(Field::required("mu", Kind::decimal(-8.0, 8.0, 0.01)));
    vec![
        Field::required("sender", Kind::integer(0.0, 31.0)).in_head(),
        Field::required("seq", Kind::integer(0.0, 1023.0)).in_head(),
        Field::required("region", Kind::integer(0.0, 255.0)),
        Field::repeated("z", Kind::Message(inducing_point), 0, 2),
        Field::repeated("sigma_log", Kind::decimal(-5.0, 5.0, 0.1), 0, 3),
    ]
}

fn kinds() -> Vec<Field> {
    let mode = |packed| {
        let values = [("IDLE", 0), ("LEARN", 5), ("SHARE", 9)];
        Kind::Enum { values: values.map(|(name, number)| (name.into(), number)).to_vec(), packed }
    };
    vec![
        Field::required("rb", Kind::Bool),
        Field::optional("ob", Kind::Bool),
        Field::required("ri", Kind::integer(-100.0, 100.0)),
        Field::optional("oi", Kind::integer(-100.0, 100.0)),
        Field::required("rd", Kind::decimal(-10000.0, 10000.0, 0.1)),
        Field::optional("od", Kind::decimal(-1.0, 1.0, 0.001)),
        Field::required("re", mode(true)),
        Field::optional("oe", mode(true)),
        Field::optional("ue", mode(false)),
        Field::repeated("rep", Kind::integer(0.0, 15.0), 0, 5),
        Field::repeated("repb", Kind::Bool, 2, 4),
        Field::optional("of", Kind::decimal(0.0, 100.0, 0.25)),
        Field::optional("pres", Kind::decimal(0.0, 1000.0, 1.0)).with_presence_bit(),
        Field::optional("blob", Kind::Bytes { length_max: 8 }),
        Field::required("str", Kind::Text { length_max: 10 }),
        Field::optional("u64", Kind::integer(0.0, 1e12)),
        Field::optional("coarse", Kind::decimal(-2000.0, 2000.0, 20.0)),
    ]
}

fn nest() -> Vec<Field> {
    let sub = || {
        let number = || Kind::integer(0.0, 6.0);
        Kind::Message(vec![Field::required("a", number()), Field::optional("b", number())])
    };
    vec![
        Field::required("req", sub()),
        Field::optional("opt", sub()),
        Field::repeated("rep", sub(), 0, 3),
        Field::optional("ka", Kind::integer(0.0, 9.0)).member_of("kind"),
        Field::optional("kb", Kind::Bool).member_of("kind"),
        Field::optional("tail", Kind::Bool),
    ]
}

fn version_3() -> Vec<Field> {
    vec![
        Field::required("a", Kind::integer(0.0, 1000.0)).in_head(),
        Field::optional("b", Kind::decimal(-3.0, 3.0, 0.1)),
        Field::repeated("c", Kind::decimal(0.0, 30.0, 0.001), 0, 4),
    ]
}

fn hex(text: &Json) -> Vec<u8> {
    let text = text.as_str().unwrap();
    assert!(text.len().is_multiple_of(2), "{text}");
    (0..text.len()).step_by(2).map(|start| u8::from_str_radix(&text[start..start + 2], 16).unwrap()).collect()
}

/// The input values of the tool. A name without a field is an error in the schemas of this test.
fn from_json(fields: &[Field], json: &Json) -> Fields {
    let mut message = Fields::new();
    for (name, value) in json.as_object().unwrap().iter().filter(|(_, value)| !value.is_null()) {
        let field = fields.iter().find(|field| field.name == *name).unwrap();
        let value = match field.rule {
            Rule::Repeated { .. } => {
                let elements = value.as_array().unwrap().iter();
                Value::List(elements.map(|element| value_from_json(&field.kind, element)).collect())
            }
            _ => value_from_json(&field.kind, value),
        };
        message.set(name, value);
    }
    message
}

fn value_from_json(kind: &Kind, json: &Json) -> Value {
    match kind {
        Kind::Bool => Value::Bool(json.as_bool().unwrap()),
        Kind::Number(_) => Value::Number(json.as_f64().unwrap()),
        Kind::Enum { .. } => Value::Enum(json.as_str().unwrap().into()),
        Kind::Bytes { .. } => Value::Bytes(hex(json)),
        Kind::Text { .. } => Value::Text(json.as_str().unwrap().into()),
        Kind::Message(fields) => Value::Message(from_json(fields, json)),
    }
}

/// A value in protobuf's text format, without its kind.
enum Text {
    Word(String),
    Quoted(Vec<u8>),
    Message(Vec<(String, Text)>),
}

/// Names and values up to the end of the text or the brace that closes the message.
fn parse_text(rest: &mut &[char]) -> Vec<(String, Text)> {
    let mut values = Vec::new();
    loop {
        skip_space(rest);
        if rest.is_empty() || eat(rest, '}') {
            return values;
        }
        let name = word(rest);
        eat(rest, ':');
        skip_space(rest);
        let value = match rest[0] {
            '{' => {
                eat(rest, '{');
                Text::Message(parse_text(rest))
            }
            '"' => Text::Quoted(quoted(rest)),
            _ => Text::Word(word(rest)),
        };
        values.push((name, value));
    }
}

fn skip_space(rest: &mut &[char]) {
    while rest.first().is_some_and(|next| next.is_whitespace()) {
        *rest = &rest[1..];
    }
}

/// Consumes this character if it is the next one.
fn eat(rest: &mut &[char], wanted: char) -> bool {
    let found = rest.first() == Some(&wanted);
    if found {
        *rest = &rest[1..];
    }
    found
}

fn word(rest: &mut &[char]) -> String {
    let is_end = |next: &char| next.is_whitespace() || matches!(next, ':' | '{' | '}' | '"');
    let (word, after) = rest.split_at(rest.iter().position(is_end).unwrap_or(rest.len()));
    assert!(!word.is_empty(), "a word is expected before {}", rest.iter().collect::<String>());
    *rest = after;
    word.iter().collect()
}

/// Bytes between quotation marks. A backslash escapes three octal digits or a letter.
fn quoted(rest: &mut &[char]) -> Vec<u8> {
    assert!(eat(rest, '"'));
    let mut bytes = Vec::new();
    while !eat(rest, '"') {
        let next = rest[0];
        *rest = &rest[1..];
        match next {
            '\\' => bytes.push(escaped(rest)),
            _ => bytes.extend(next.to_string().bytes()),
        }
    }
    bytes
}

fn escaped(rest: &mut &[char]) -> u8 {
    let digits: String = rest.iter().take(3).take_while(|digit| digit.is_digit(8)).collect();
    if !digits.is_empty() {
        *rest = &rest[digits.len()..];
        return u8::from_str_radix(&digits, 8).unwrap();
    }
    let letter = rest[0];
    *rest = &rest[1..];
    match letter {
        'n' => b'\n',
        't' => b'\t',
        'r' => b'\r',
        '"' | '\'' | '\\' => letter as u8,
        _ => panic!("unknown escape {letter}"),
    }
}

/// The parsed text as values. As after decoding, repeated fields are set even without elements.
fn from_text(fields: &[Field], text: &[(String, Text)]) -> Fields {
    assert!(text.iter().all(|(name, _)| fields.iter().any(|field| field.name == *name)));
    let mut message = Fields::new();
    for field in fields {
        let mut values = text.iter().filter(|(name, _)| *name == field.name);
        let mut values = values.by_ref().map(|(_, value)| value_from_text(&field.kind, value));
        if let Rule::Repeated { .. } = field.rule {
            message.set(&field.name, Value::List(values.collect()));
        } else if let Some(value) = values.next() {
            message.set(&field.name, value);
            assert!(values.next().is_none(), "{} is there twice", field.name);
        }
    }
    message
}

fn value_from_text(kind: &Kind, text: &Text) -> Value {
    match (kind, text) {
        (Kind::Bool, Text::Word(word)) => Value::Bool(word.parse().unwrap()),
        (Kind::Number(_), Text::Word(word)) => Value::Number(word.parse().unwrap()),
        (Kind::Enum { .. }, Text::Word(word)) => Value::Enum(word.clone()),
        (Kind::Bytes { .. }, Text::Quoted(bytes)) => Value::Bytes(bytes.clone()),
        (Kind::Text { .. }, Text::Quoted(bytes)) => Value::Text(String::from_utf8(bytes.clone()).unwrap()),
        (Kind::Message(fields), Text::Message(text)) => Value::Message(from_text(fields, text)),
        _ => panic!("the text has another kind of value than the schema"),
    }
}

/// Whether the same fields have the same values. A repeated field without elements counts as unset.
fn is_same_message(fields: &[Field], found: &Fields, expected: &Fields) -> bool {
    let set = |message: &Fields, name: &str| message.get(name).filter(|value| **value != Value::List(vec![])).cloned();
    fields.iter().all(|field| match (set(found, &field.name), set(expected, &field.name)) {
        (Some(found), Some(expected)) => is_same(&field.kind, &found, &expected),
        (found, expected) => found == expected,
    })
}

fn is_same(kind: &Kind, found: &Value, expected: &Value) -> bool {
    match (kind, found, expected) {
        (_, Value::List(found), Value::List(expected)) => {
            found.len() == expected.len() && found.iter().zip(expected).all(|(f, e)| is_same(kind, f, e))
        }
        (Kind::Message(fields), Value::Message(found), Value::Message(expected)) => {
            is_same_message(fields, found, expected)
        }
        // The tool prints whole numbers in full, others with as few as 6 digits.
        (Kind::Number(Number { integer: false, .. }), Value::Number(found), Value::Number(expected)) => {
            (found - expected).abs() <= 1e-5 * expected.abs()
        }
        _ => found == expected,
    }
}

/// Paths of the values outside the bounds of their fields.
fn offenders(fields: &[Field], message: &Fields, around: &str) -> Vec<String> {
    let mut paths = Vec::new();
    for field in fields {
        let path = if around.is_empty() { field.name.clone() } else { format!("{around}.{}", field.name) };
        let elements = match message.get(&field.name) {
            None => continue,
            Some(Value::List(elements)) => elements.as_slice(),
            Some(single) => std::slice::from_ref(single),
        };
        let is_count_wrong =
            matches!(field.rule, Rule::Repeated { min, max } if elements.len() < min || elements.len() > max);
        if is_count_wrong || elements.iter().any(|element| is_outside(&field.kind, element)) {
            paths.push(path.clone());
        }
        if let Kind::Message(fields) = &field.kind {
            let inner =
                elements.iter().map(|element| if let Value::Message(inner) = element { inner } else { panic!() });
            paths.extend(inner.flat_map(|inner| offenders(fields, inner, &path)));
        }
    }
    paths
}

fn is_outside(kind: &Kind, value: &Value) -> bool {
    match (kind, value) {
        (Kind::Number(number), Value::Number(value)) => !(number.min..=number.max).contains(value),
        (Kind::Bytes { length_max }, Value::Bytes(bytes)) => bytes.len() > *length_max,
        (Kind::Text { length_max }, Value::Text(text)) => text.len() > *length_max,
        _ => false,
    }
}
