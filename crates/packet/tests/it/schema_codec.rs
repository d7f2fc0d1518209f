//! The codec for arbitrary schemas: values come back quantised, and errors name the field.

use crate::generators::{any_schemas, is_fixed, message, number, schema_of};
use pingmap_packet::*;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// Valid schemas.
fn schemas() -> impl Strategy<Value = Schema> {
    any_schemas().prop_map(|schema| {
        let fields = schema.fields.into_iter().map(|field| {
            let field = mended(field);
            Field { in_head: field.in_head && is_fixed(&field), ..field }
        });
        schema_of(schema.id, fields.collect())
    })
}

/// The field with room for an element, and without inner fields in the head.
fn mended(field: Field) -> Field {
    let kind = match field.kind {
        Kind::Message(inside) => {
            Kind::Message(inside.into_iter().map(|field| Field { in_head: false, ..mended(field) }).collect())
        }
        kind => kind,
    };
    let rule = match field.rule {
        Rule::Repeated { min, max } => Rule::Repeated { min, max: max.max(1) },
        rule => rule,
    };
    Field { kind, rule, ..field }
}

fn schemas_and_messages() -> impl Strategy<Value = (Schema, Fields)> {
    schemas().prop_flat_map(|schema| message(&schema.fields).prop_map(move |message| (schema.clone(), message)))
}

/// Whether the same fields are set, and all numbers are equal up to the resolution.
fn is_near(fields: &[Field], found: &Fields, given: &Fields) -> bool {
    found.iter().count() == given.iter().count()
        && fields.iter().all(|field| match (found.get(&field.name), given.get(&field.name)) {
            (Some(found), Some(given)) => is_value_near(&field.kind, found, given),
            (found, given) => found == given,
        })
}

fn is_value_near(kind: &Kind, found: &Value, given: &Value) -> bool {
    match (kind, found, given) {
        (_, Value::List(found), Value::List(given)) => {
            found.len() == given.len() && found.iter().zip(given).all(|(f, g)| is_value_near(kind, f, g))
        }
        (Kind::Message(fields), Value::Message(found), Value::Message(given)) => is_near(fields, found, given),
        (Kind::Number(number), Value::Number(found), Value::Number(given)) => {
            let distance = (found - given).abs();
            // DCCL rounds negative whole numbers towards zero, however coarse the resolution.
            let is_near = if number.integer {
                distance < number.resolution
            } else {
                distance <= number.resolution * (0.5 + 1e-6)
            };
            is_near && (number.min..=number.max).contains(found)
        }
        _ => found == given,
    }
}

/// Asserts that the bytes are refused, or decode to values within bounds and are their canonical encoding.
fn check_canonical(schema: &Schema, bytes: &[u8]) -> Result<(), TestCaseError> {
    if let Ok(message) = schema.decode(bytes) {
        // Encoding checks every bound.
        prop_assert_eq!(schema.encode(&message), Ok(bytes.to_vec()));
        prop_assert!(is_near(&schema.fields, &message, &message));
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn messages_round_trip_up_to_quantisation((schema, message) in schemas_and_messages()) {
        let bytes = schema.encode(&message).unwrap();
        prop_assert!(bytes.len() <= schema.length());
        let found = schema.decode(&bytes).unwrap();
        prop_assert!(is_near(&schema.fields, &found, &message), "{found:?}");
        prop_assert_eq!(schema.encode(&found), Ok(bytes));
    }

    #[test]
    fn random_bytes_are_refused_or_canonical(schema in schemas(), bytes in vec(any::<u8>(), 0..60)) {
        check_canonical(&schema, &bytes)?;
        check_canonical(&schema, &[id_bytes(&schema), bytes].concat())?;
    }

    #[test]
    fn a_damaged_message_is_refused_or_canonical(
        (schema, message) in schemas_and_messages(),
        flips in vec(any::<Index>(), 1..4),
        length in any::<Index>(),
    ) {
        let mut bytes = schema.encode(&message).unwrap();
        prop_assume!(!bytes.is_empty());
        for bit in flips.iter().map(|flip| flip.index(8 * bytes.len())).collect::<Vec<_>>() {
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        check_canonical(&schema, &bytes)?;
        check_canonical(&schema, &bytes[..length.index(bytes.len())])?;
    }

    #[test]
    fn a_number_outside_its_bounds_is_refused(number in number(), beyond in 1.0..1e9, optional in any::<bool>()) {
        let field = if optional { Field::optional } else { Field::required };
        let schema = schema_of(None, vec![field("level", Kind::Number(number))]);
        let distance = f64::ceil(beyond * number.resolution);
        for value in [number.max + distance, number.min - distance] {
            let expected = Error::OutOfBounds { field: "level".into(), min: number.min, max: number.max, value };
            prop_assert_eq!(schema.encode(&one("level", Value::Number(value))), Err(expected));
        }
    }

    /// A decimal multiple of the resolution is only nearly a multiple in doubles. No value between such bounds may be
    /// refused or lost.
    #[test]
    fn decimal_bounds_and_the_values_between_them_round_trip(
        (resolution, low, steps) in (select(&DECIMALS[..]), -3000..3000, 0..2000),
        (share, code) in (prop_oneof![Just(0.0), Just(1.0), 0.0..=1.0_f64], any::<u16>()),
    ) {
        let decimal = |times: i32| format!("{:.6}", f64::from(times) * resolution).parse::<f64>().unwrap();
        let (min, max) = (decimal(low), decimal(low + steps));
        let schema = schema_of(None, vec![Field::required("level", Kind::decimal(min, max, resolution))]);
        let value = (min + share * (max - min)).clamp(min, max);
        let bytes = schema.encode(&one("level", Value::Number(value))).unwrap();
        let found = schema.decode(&bytes).unwrap();
        prop_assert_eq!(schema.encode(&found), Ok(bytes));
        let Some(Value::Number(found)) = found.get("level") else { panic!() };
        prop_assert!((found - value).abs() <= resolution * (0.5 + 1e-6), "{found} for {value}");
        prop_assert!((min - 1e-10..=max + 1e-10).contains(found), "{found} for {value}");
        let bytes = &code.to_le_bytes()[..schema.length()];
        if let Ok(message) = schema.decode(bytes) {
            prop_assert_eq!(schema.encode(&message), Ok(bytes.to_vec()));
        }
    }
}

/// Resolutions that doubles do not represent exactly. For some of them the inverse is not exact either.
const DECIMALS: [f64; 10] = [0.001, 0.01, 0.02, 0.05, 0.06, 0.1, 0.3, 0.7, 1.1, 2.5];

#[test]
fn integers_round_trip_up_to_the_precision_of_doubles() {
    let max = 2.0_f64.powi(53) - 2.0;
    for field in [Field::required, Field::optional] {
        let schema = schema_of(None, vec![field("count", Kind::integer(0.0, max))]);
        for value in [0.0, 2.0_f64.powi(52) - 1.0, 2.0_f64.powi(52) + 1.0, 2.0_f64.powi(52) + 3.0, max - 1.0, max] {
            let message = one("count", Value::Number(value));
            assert_eq!(schema.decode(&schema.encode(&message).unwrap()), Ok(message));
        }
    }
}

fn id_bytes(schema: &Schema) -> Vec<u8> {
    match schema.id {
        None => vec![],
        Some(id @ ..128) => vec![(id << 1) as u8],
        Some(id) => (id << 1 | 1).to_le_bytes().to_vec(),
    }
}

fn one(name: &str, value: Value) -> Fields {
    let mut message = Fields::new();
    message.set(name, value);
    message
}

/// A field of every form, all of the same kind. One field is in the head if the kind has a fixed size.
fn forms(kind: &Kind) -> Vec<Field> {
    let inner = || Kind::Message(vec![Field::required("inner", kind.clone())]);
    let head = Field::optional("head", kind.clone()).in_head();
    let others = [
        Field::optional("optional", kind.clone()),
        Field::optional("present", kind.clone()).with_presence_bit(),
        Field::repeated("repeated", kind.clone(), 0, 3),
        Field::optional("message", inner()),
        Field::repeated("messages", inner(), 0, 2),
        Field::optional("member", kind.clone()).member_of("either"),
    ];
    Some(head).filter(is_fixed).into_iter().chain(others).collect()
}

/// One message for each of the [`forms`] with this value, and the path of its field.
fn in_each_form(value: &Value) -> Vec<(&'static str, Fields)> {
    let inner = || Value::Message(one("inner", value.clone()));
    let single = |name| (name, one(name, value.clone()));
    vec![
        single("head"),
        single("optional"),
        single("present"),
        single("member"),
        ("repeated", one("repeated", Value::List(vec![value.clone()]))),
        ("message.inner", one("message", inner())),
        ("messages.inner", one("messages", Value::List(vec![inner()]))),
    ]
}

fn field_of(error: &Error) -> Option<&str> {
    match error {
        Error::OutOfBounds { field, .. } | Error::Count { field, .. } | Error::Kind { field, .. } => Some(field),
        Error::Missing { field } | Error::Unknown { field } | Error::TwoOfOne { field } => Some(field),
        _ => None,
    }
}

/// Asserts that every form refuses the value with an error that names its field.
fn assert_refused(kind: &Kind, value: &Value) {
    let schema = schema_of(Some(5), forms(kind));
    let has_head = schema.fields.iter().any(|field| field.in_head);
    for (path, message) in in_each_form(value).into_iter().filter(|(path, _)| *path != "head" || has_head) {
        let error = schema.encode(&message).unwrap_err();
        assert_eq!(field_of(&error), Some(path), "{error}");
        assert!(error.to_string().contains(path), "{error}");
    }
}

#[test]
fn the_error_for_a_number_that_is_not_finite_names_the_field() {
    for kind in [Kind::integer(-5.0, 5.0), Kind::decimal(-5.0, 5.0, 0.1), Kind::decimal(-40.0, 40.0, 20.0)] {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_refused(&kind, &Value::Number(value));
        }
    }
}

#[test]
fn the_error_for_a_value_of_another_kind_or_size_names_the_field() {
    let mode = Kind::Enum { values: vec![("IDLE".into(), 0), ("SHARE".into(), 9)], packed: false };
    let misfits = [
        (Kind::integer(-5.0, 5.0), Value::Number(6.0)),
        (Kind::integer(-5.0, 5.0), Value::Number(0.5)),
        (Kind::integer(-5.0, 5.0), Value::Bool(true)),
        (Kind::decimal(-5.0, 5.0, 0.1), Value::Number(-5.06)),
        (Kind::Bool, Value::Number(1.0)),
        (mode.clone(), Value::Enum("LEARN".into())),
        (mode, Value::Number(9.0)),
        (Kind::Bytes { length_max: 2 }, Value::Bytes(vec![1, 2, 3])),
        (Kind::Bytes { length_max: 2 }, Value::Text("a".into())),
        (Kind::Text { length_max: 2 }, Value::Text("äa".into())),
        (Kind::Text { length_max: 2 }, Value::Bytes(vec![1])),
        (Kind::Message(vec![]), Value::Bool(false)),
    ];
    misfits.iter().for_each(|(kind, value)| assert_refused(kind, value));
}

#[test]
fn the_error_for_missing_unknown_or_surplus_values_names_the_field() {
    let bit = |name| Field::optional(name, Kind::Bool);
    let inner = Kind::Message(vec![Field::required("must", Kind::Bool)]);
    let schema = schema_of(
        None,
        vec![
            Field::repeated("some", Kind::Bool, 1, 2),
            Field::optional("sub", inner),
            bit("left").member_of("either"),
            bit("right").member_of("either"),
        ],
    );
    let yes = || Value::Bool(true);
    let list = |count| Value::List(vec![yes(); count]);
    let cases: [(&[(&str, Value)], &str); 8] = [
        (&[], "some"),
        (&[("some", list(0))], "some"),
        (&[("some", list(3))], "some"),
        (&[("some", yes())], "some"),
        (&[("some", list(1)), ("sub", Value::Message(Fields::new()))], "sub.must"),
        (&[("some", list(1)), ("sub", Value::Message(one("may", yes())))], "sub.may"),
        (&[("some", list(1)), ("more", yes())], "more"),
        (&[("some", list(1)), ("left", yes()), ("right", yes())], "right"),
    ];
    for (values, path) in cases {
        let mut message = Fields::new();
        values.iter().for_each(|(name, value)| message.set(name, value.clone()));
        let error = schema.encode(&message).unwrap_err();
        assert_eq!(field_of(&error), Some(path), "{error}");
    }
}

#[test]
fn the_longest_message_has_the_length_of_the_schema() {
    let bytes = || Kind::Bytes { length_max: 9 };
    let number = || Kind::integer(0.0, 7.0);
    let inner = vec![Field::optional("a", number()), Field::optional("b", bytes()).member_of("either")];
    let fields = vec![
        Field::required("head", number()).in_head(),
        Field::optional("number", number()),
        Field::repeated("list", bytes(), 1, 3),
        Field::optional("short", Kind::Bytes { length_max: 5 }).member_of("either"),
        Field::optional("long", Kind::Message(inner)).member_of("either"),
    ];
    let schema = schema_of(Some(300), fields);
    let (seven, long) = (Value::Number(7.0), Value::Bytes(vec![255; 9]));
    let mut inside = one("a", seven.clone());
    inside.set("b", long.clone());
    let mut message = one("head", seven.clone());
    message.set("number", seven);
    message.set("list", Value::List(vec![long; 3]));
    message.set("long", Value::Message(inside));
    assert_eq!(schema.encode(&message).unwrap().len(), schema.length());
    let tight = Schema { bytes_max: schema.length() - 1, ..schema };
    let expected = Error::TooLong { length: tight.length(), max: tight.length() - 1 };
    assert_eq!(tight.encode(&message), Err(expected));
}
