//! What must hold for the codec whatever the schema is: values come back quantised, and everything else is refused by name.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;

use pingmap_packet::*;
use proptest::collection::{btree_set, vec};
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// Resolutions in use: powers of ten below one, binary fractions, and whole numbers.
const RESOLUTIONS: [f64; 7] = [0.001, 0.1, 0.25, 1.0, 2.0, 5.0, 20.0];

/// So many times the resolution, as near as a double comes.
fn multiple(times: i32, resolution: f64) -> f64 {
    if resolution < 1.0 { f64::from(times) / (1.0 / resolution) } else { f64::from(times) * resolution }
}

fn number() -> impl Strategy<Value = Number> {
    let steps = prop_oneof![0..10, 0..100_000];
    let fields = (select(&RESOLUTIONS[..]), -1000..1000, steps, any::<bool>());
    fields.prop_map(|(resolution, low, steps, whole)| Number {
        min: multiple(low, resolution),
        max: multiple(low + steps, resolution),
        resolution,
        integer: whole && resolution >= 1.0,
    })
}

fn kind() -> impl Strategy<Value = Kind> {
    let numbers = btree_set(-20..300, 1..6).prop_map(Vec::from_iter).prop_shuffle();
    let names = |numbers: Vec<i32>| numbers.into_iter().map(|number| (format!("N{number}"), number)).collect();
    let plain = prop_oneof![
        Just(Kind::Bool),
        number().prop_map(Kind::Number),
        (numbers, any::<bool>()).prop_map(move |(numbers, packed)| Kind::Enum { values: names(numbers), packed }),
        (0..6_usize).prop_map(|length_max| Kind::Bytes { length_max }),
        (0..6_usize).prop_map(|length_max| Kind::Text { length_max }),
    ];
    plain.prop_recursive(2, 12, 4, |inner| fields(inner).prop_map(Kind::Message))
}

/// Fields of every form, named by their places.
fn fields(kind: impl Strategy<Value = Kind>) -> impl Strategy<Value = Vec<Field>> {
    let form = prop_oneof![
        any::<bool>().prop_map(|in_head| Field { in_head, ..Field::required("", Kind::Bool) }),
        any::<bool>().prop_map(|in_head| Field { in_head, ..Field::optional("", Kind::Bool) }),
        any::<bool>().prop_map(|presence| Field { presence, ..Field::optional("", Kind::Bool) }),
        (0..3_usize, 0..4_usize).prop_map(|(min, more)| Field::repeated("", Kind::Bool, min, min + more)),
        select(&["either", "other"][..]).prop_map(|oneof| Field::optional("", Kind::Bool).member_of(oneof)),
    ];
    let named = |(place, (kind, form)): (usize, (Kind, Field))| Field { name: format!("f{place}"), kind, ..form };
    vec((kind, form), 1..6).prop_map(move |parts| parts.into_iter().enumerate().map(named).collect())
}

fn schema_of(id: Option<u16>, fields: Vec<Field>) -> Schema {
    let schema = Schema { name: "Test".into(), id, bytes_max: 0, fields };
    Schema { bytes_max: schema.length(), ..schema }
}

fn schemas() -> impl Strategy<Value = Schema> {
    let ids = select(&[None, Some(0), Some(5), Some(127), Some(128), Some(300), Some(32767)][..]);
    (ids, fields(kind())).prop_map(|(id, fields)| schema_of(id, fields))
}

/// Any value within bounds.
fn value(kind: &Kind) -> BoxedStrategy<Value> {
    match kind.clone() {
        Kind::Bool => any::<bool>().prop_map(Value::Bool).boxed(),
        Kind::Number(number) => number_within(number).prop_map(Value::Number).boxed(),
        Kind::Enum { values, .. } => select(values).prop_map(|(name, _)| Value::Enum(name)).boxed(),
        Kind::Bytes { length_max } => vec(any::<u8>(), 0..=length_max).prop_map(Value::Bytes).boxed(),
        Kind::Text { length_max } => {
            let shortened = move |characters: Vec<char>| {
                let ends = characters.iter().scan(0, |end, character| {
                    *end += character.len_utf8();
                    Some(*end)
                });
                let count = ends.take_while(|end| *end <= length_max).count();
                Value::Text(characters[..count].iter().collect())
            };
            vec(prop_oneof![any::<char>(), proptest::char::range('a', 'z')], 0..=length_max).prop_map(shortened).boxed()
        }
        Kind::Message(fields) => message(&fields).prop_map(Value::Message).boxed(),
    }
}

fn number_within(number: Number) -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(1.0), 0.0..1.0].prop_map(move |share| {
        let value = number.min + share * (number.max - number.min);
        if number.integer { value.floor() } else { value.min(number.max) }
    })
}

/// Any values within bounds; of a oneof only the first that would be set.
fn message(fields: &[Field]) -> BoxedStrategy<Fields> {
    let maybe = |kind: &Kind| proptest::option::of(value(kind)).boxed();
    let values = fields.iter().map(|field| match field.rule {
        Rule::Required => value(&field.kind).prop_map(Some).boxed(),
        Rule::Optional => maybe(&field.kind),
        Rule::Repeated { min, max } => {
            vec(value(&field.kind), min..=max).prop_map(|elements| Some(Value::List(elements))).boxed()
        }
    });
    let fields = fields.to_vec();
    let set = move |values: Vec<Option<Value>>| {
        let (mut message, mut taken) = (Fields::new(), BTreeSet::new());
        for (field, value) in fields.iter().zip(values) {
            if let Some(value) = value
                && field.oneof.as_ref().is_none_or(|oneof| taken.insert(oneof))
            {
                message.set(&field.name, value);
            }
        }
        message
    };
    values.collect::<Vec<_>>().prop_map(set).boxed()
}

fn schemas_and_messages() -> impl Strategy<Value = (Schema, Fields)> {
    schemas().prop_flat_map(|schema| message(&schema.fields).prop_map(move |message| (schema.clone(), message)))
}

/// Whether the same is set, and every number is as near as the resolution lets it be.
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

/// Whatever the bytes are, they are refused, or say something within bounds and are the only way to say it.
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
    fn every_message_comes_back_quantised((schema, message) in schemas_and_messages()) {
        let bytes = schema.encode(&message).unwrap();
        prop_assert!(bytes.len() <= schema.length());
        let found = schema.decode(&bytes).unwrap();
        prop_assert!(is_near(&schema.fields, &found, &message), "{found:?}");
        prop_assert_eq!(schema.encode(&found), Ok(bytes));
    }

    #[test]
    fn any_bytes_are_refused_or_canonical(schema in schemas(), bytes in vec(any::<u8>(), 0..60)) {
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

    /// DCCL asks for bounds that are multiples of the resolution. Where they are not, nothing may be cut off silently either.
    #[test]
    fn bounds_between_the_steps_lose_no_value_silently(
        (low, span, resolution) in (-100.0..100.0_f64, 0.0..100.0_f64, prop_oneof![0.01..10.0_f64, select(&RESOLUTIONS[..])]),
        (share, integer, code) in (0.0..=1.0_f64, any::<bool>(), any::<u16>()),
    ) {
        let resolution = if integer { f64::max(resolution.floor(), 1.0) } else { resolution };
        let number = Number { min: low, max: low + span, resolution, integer };
        let schema = schema_of(None, vec![Field::required("level", Kind::Number(number))]);
        let value = low + share * span;
        let message = one("level", Value::Number(if integer { value.floor() } else { value }));
        if let Ok(bytes) = schema.encode(&message) {
            let found = schema.decode(&bytes).unwrap();
            prop_assert!(is_near(&schema.fields, &found, &message), "{found:?}");
            prop_assert_eq!(schema.encode(&found), Ok(bytes));
        }
        check_canonical(&schema, &code.to_le_bytes()[..schema.length().min(2)])?;
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

/// A field of every form, all of the same kind.
fn forms(kind: &Kind) -> Vec<Field> {
    let inner = || Kind::Message(vec![Field::required("inner", kind.clone())]);
    vec![
        Field::optional("head", kind.clone()).in_head(),
        Field::optional("optional", kind.clone()),
        Field::optional("present", kind.clone()).with_presence_bit(),
        Field::repeated("repeated", kind.clone(), 0, 3),
        Field::optional("message", inner()),
        Field::repeated("messages", inner(), 0, 2),
        Field::optional("member", kind.clone()).member_of("either"),
    ]
}

/// The value in each of the [`forms`] by itself, and the path of its field.
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

/// The value is refused in every form, by an error that names its field.
fn assert_refused(kind: &Kind, value: &Value) {
    let schema = schema_of(Some(5), forms(kind));
    for (path, message) in in_each_form(value) {
        let error = schema.encode(&message).unwrap_err();
        assert_eq!(field_of(&error), Some(path), "{error}");
        assert!(error.to_string().contains(path), "{error}");
    }
}

#[test]
fn what_is_not_a_finite_number_is_refused_by_name() {
    for kind in [Kind::integer(-5.0, 5.0), Kind::decimal(-5.0, 5.0, 0.1), Kind::decimal(-40.0, 40.0, 20.0)] {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_refused(&kind, &Value::Number(value));
        }
    }
}

#[test]
fn what_does_not_fit_its_kind_is_refused_by_name() {
    let mode = Kind::Enum { values: vec![("IDLE".into(), 0), ("SHARE".into(), 9)], packed: false };
    // Four codes, of which rounding the smallest value down to 0 would leave none for the largest.
    let uneven = Kind::Number(Number { min: 2.0, max: 20.0, resolution: 5.0, integer: true });
    let misfits = [
        (uneven, Value::Number(20.0)),
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
fn wrong_sets_of_fields_are_refused_by_name() {
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
fn the_longest_message_is_as_long_as_the_schema_says() {
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

#[test]
fn what_describes_no_message_is_refused_and_never_panics() {
    let number = |min, max, resolution| Kind::Number(Number { min, max, resolution, integer: false });
    let wrong = [
        Field::required("f", number(0.0, 1.0, 0.0)),
        Field::required("f", number(0.0, 1.0, f64::NAN)),
        Field::required("f", number(1.0, 0.0, 1.0)),
        Field::required("f", number(f64::NEG_INFINITY, 0.0, 1.0)),
        Field::required("f", number(0.0, 1e300, 1e-9)),
        Field::repeated("f", Kind::Bool, 3, 2),
        Field::repeated("f", Kind::Bool, 0, usize::MAX),
        Field::required("f", Kind::Enum { values: Vec::new(), packed: true }),
        Field::required("f", Kind::Bytes { length_max: usize::MAX }),
        Field::optional("f", Kind::Bool).member_of("choice").in_head(),
    ];
    for field in wrong {
        let inside = Field::required("outer", Kind::Message(vec![field.clone()]));
        for (field, name) in [(field, "f"), (inside, "outer.f")] {
            let schema = Schema { name: "M".into(), id: Some(200), bytes_max: 64, fields: vec![field] };
            for error in [schema.encode(&Fields::new()).unwrap_err(), schema.decode(&[0; 8]).unwrap_err()] {
                assert!(matches!(&error, Error::Schema { field, .. } if field == name), "{error}");
            }
        }
    }
    let schema = Schema { name: "M".into(), id: Some(40_000), bytes_max: 64, fields: Vec::new() };
    assert!(matches!(schema.check(), Err(Error::Schema { .. })));
}
