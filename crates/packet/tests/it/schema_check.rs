//! Validity of schemas: exactly the schemas that DCCL refuses are refused, with the name of the field.

use crate::generators::{any_schemas, is_fixed, message, number, schema_of};
use pingmap_packet::*;
use proptest::prelude::*;

/// Whether all fields are in an allowed part and have room for an element. The rules are repeated here without counting
/// bits.
fn is_valid(field: &Field, is_in_head: bool) -> bool {
    let is_in_place = if is_in_head { is_fixed(field) } else { !field.in_head };
    let has_room = !matches!(field.rule, Rule::Repeated { max: 0, .. });
    let is_inside_valid = match &field.kind {
        Kind::Message(inside) => inside.iter().all(|field| is_valid(field, is_in_head)),
        _ => true,
    };
    is_in_place && has_room && is_inside_valid
}

/// A body with the field eight times. The number of bytes of such a message is the number of bits of the field.
fn eightfold(field: &Field) -> Schema {
    let fields = (0..8).map(|copy| Field { name: format!("{copy}"), ..in_body(field.clone()) });
    schema_of(None, fields.collect())
}

fn in_body(field: Field) -> Field {
    let kind = match field.kind {
        Kind::Message(inside) => Kind::Message(inside.into_iter().map(in_body).collect()),
        kind => kind,
    };
    Field { kind, in_head: false, ..field }
}

/// Number of bits of a field in a message.
fn bits(field: &Field, message: &Fields) -> usize {
    let schema = eightfold(field);
    let mut eight = Fields::new();
    if let Some(value) = message.get(&field.name) {
        schema.fields.iter().for_each(|copy| eight.set(&copy.name, value.clone()));
    }
    schema.encode(&eight).unwrap().len()
}

/// A valid schema, and two messages for it.
fn pairs_of_messages() -> impl Strategy<Value = (Schema, Fields, Fields)> {
    let valid = any_schemas().prop_filter("invalid", |schema| schema.check().is_ok());
    valid.prop_flat_map(|schema| {
        let pairs = (message(&schema.fields), message(&schema.fields));
        pairs.prop_map(move |(first, second)| (schema.clone(), first, second))
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn exactly_the_valid_schemas_are_accepted(schema in any_schemas(), missing in 0..2_usize) {
        let expected = schema.fields.iter().all(|field| is_valid(field, field.in_head));
        prop_assert_eq!(schema.check().is_ok(), expected);
        let (length, max) = (schema.length(), schema.length().saturating_sub(missing));
        let tight = Schema { bytes_max: max, ..schema };
        let expected = if max < length && expected { Err(Error::TooLong { length, max }) } else { tight.check() };
        prop_assert_eq!(tight.check(), expected.clone());
        // Encoding and decoding check the schema first.
        if expected.is_err() {
            prop_assert_eq!(tight.encode(&Fields::new()), Err(expected.clone().unwrap_err()));
            prop_assert_eq!(tight.decode(&[]), Err(expected.unwrap_err()));
        }
    }

    #[test]
    fn a_field_in_the_head_has_the_same_width_for_all_values((schema, first, second) in pairs_of_messages()) {
        for (field, (_, bits_max)) in schema.fields.iter().zip(schema.bits()).filter(|(field, _)| field.in_head) {
            prop_assert_eq!(bits(field, &first), bits(field, &second), "{}", field.name);
            prop_assert_eq!(bits(field, &first) as u64, bits_max, "{}", field.name);
        }
    }

    #[test]
    fn bounds_are_refused_exactly_if_they_are_not_multiples_of_the_resolution(
        number in number(),
        (below, above) in (0..4_u8, 0..4_u8),
        integer in any::<bool>(),
    ) {
        // A quarter of the smallest resolution, 0.001, is far above rounding errors.
        let quarter = number.resolution / 4.0;
        let (min, max) = (number.min - f64::from(below) * quarter, number.max + f64::from(above) * quarter);
        let integer = integer && number.integer;
        let schema = schema_of(None, vec![Field::required("level", Kind::Number(Number { min, max, integer, ..number }))]);
        prop_assert_eq!(schema.check().is_ok(), below == 0 && above == 0);
    }
}

fn number_of(min: f64, max: f64, resolution: f64, integer: bool) -> Field {
    Field::required("f", Kind::Number(Number { min, max, resolution, integer }))
}

fn text(length_max: usize) -> Kind {
    Kind::Text { length_max }
}

/// An inner message with this field.
fn around(inside: Field) -> Kind {
    Kind::Message(vec![inside])
}

/// Asserts that the first field is refused with this path, and that the second field is accepted.
fn assert_neighbours(cases: &[(Field, &str, Field)]) {
    for (refused, wrong, accepted) in cases {
        let error = schema_of(Some(5), vec![refused.clone()]).check().unwrap_err();
        assert!(matches!(&error, Error::Schema { field, .. } if field == wrong), "{refused:?}: {error}");
        let accepted = schema_of(Some(5), vec![accepted.clone()]);
        assert_eq!(accepted.check(), Ok(()), "{accepted:?}");
    }
}

#[test]
fn fields_of_varying_size_are_refused_in_the_head() {
    let small = || Kind::integer(0.0, 7.0);
    let one_value = || Kind::integer(3.0, 3.0);
    let head = |kind| Field::required("f", kind).in_head();
    let maybe = |kind| Field::optional("f", kind).in_head();
    let list = |kind, min, max| Field::repeated("f", kind, min, max).in_head();
    assert_neighbours(&[
        (maybe(small()).with_presence_bit(), "f", maybe(small())),
        (maybe(Kind::Bool).with_presence_bit(), "f", head(Kind::Bool).with_presence_bit()),
        (maybe(small()).with_presence_bit(), "f", maybe(one_value()).with_presence_bit()),
        (head(text(1)), "f", head(text(0))),
        (head(text(1)), "f", Field::required("f", text(1))),
        (maybe(Kind::Bytes { length_max: 1 }), "f", maybe(Kind::Bytes { length_max: 0 })),
        (list(small(), 1, 2), "f", list(small(), 2, 2)),
        (list(small(), 1, 2), "f", list(one_value(), 1, 2)),
        (list(text(1), 2, 2), "f", list(text(0), 2, 2)),
    ]);
}

#[test]
fn messages_of_varying_size_are_refused_in_the_head() {
    let inner = |kind| Field::required("inner", kind);
    let head = |inside| Field::required("f", around(inside)).in_head();
    let maybe = |inside| Field::optional("f", around(inside)).in_head();
    let deep = |kind| Field::required("f", around(Field::required("g", around(inner(kind)))));
    assert_neighbours(&[
        (head(inner(text(3))), "f.inner", head(inner(Kind::Bool))),
        (deep(text(3)).in_head(), "f.g.inner", deep(text(3))),
        (deep(text(3)).in_head(), "f.g.inner", deep(Kind::Bool).in_head()),
        (maybe(inner(Kind::Bool)), "f", maybe(inner(Kind::integer(3.0, 3.0)))),
        (maybe(inner(Kind::Bool)), "f", Field::optional("f", around(inner(Kind::Bool)))),
    ]);
}

#[test]
fn oneofs_are_refused_in_the_head() {
    let member = |kind| Field::optional("inner", kind).member_of("choice");
    let alone = |kind| Field::optional("inner", kind);
    let head = |inside| Field::required("f", around(inside)).in_head();
    assert_neighbours(&[
        (member(Kind::Bool).in_head(), "inner", member(Kind::Bool)),
        (member(Kind::Bool).in_head(), "inner", alone(Kind::Bool).in_head()),
        (head(member(Kind::Bool)), "f.inner", head(alone(Kind::Bool))),
        // This member has a fixed size, but the head of DCCL has no bits for the choice of a member.
        (head(member(Kind::integer(3.0, 3.0))), "f.inner", head(alone(Kind::integer(3.0, 3.0)))),
    ]);
}

#[test]
fn fields_of_an_inner_message_are_in_the_same_part_as_the_message() {
    let inner = || Field::required("inner", Kind::Bool);
    let outer = |inside| Field::required("f", around(inside));
    assert_neighbours(&[
        (outer(inner().in_head()), "f.inner", outer(inner().in_head()).in_head()),
        (outer(inner().in_head()), "f.inner", outer(inner())),
        (outer(outer(inner().in_head())), "f.f.inner", outer(outer(inner().in_head())).in_head()),
    ]);
}

#[test]
fn bounds_between_multiples_of_the_resolution_are_refused() {
    let decimal = |min, max, resolution| number_of(min, max, resolution, false);
    let integer = |min, max, resolution| number_of(min, max, resolution, true);
    assert_neighbours(&[
        (decimal(0.05, 1.0, 0.1), "f", decimal(0.1, 1.0, 0.1)),
        (decimal(0.0, 0.95, 0.1), "f", decimal(0.0, 0.9, 0.1)),
        (decimal(-30.0, 40.0, 20.0), "f", decimal(-40.0, 40.0, 20.0)),
        (integer(2.0, 20.0, 5.0), "f", integer(0.0, 20.0, 5.0)),
        (integer(-20.0, 18.0, 5.0), "f", integer(-20.0, 20.0, 5.0)),
        (integer(0.5, 3.0, 1.0), "f", integer(0.0, 3.0, 1.0)),
        // The tolerance is that of DCCL.
        (decimal(0.0, 1.0 + 2e-10, 0.1), "f", decimal(0.0, 1.0 + 5e-11, 0.1)),
        (decimal(-1.0 - 2e-10, 1.0, 0.1), "f", decimal(-1.0 - 5e-11, 1.0, 0.1)),
    ]);
}

#[test]
fn ranges_with_more_values_than_doubles_represent_are_refused() {
    let codes = 2.0_f64.powi(53);
    let decimal = |min, max, resolution| number_of(min, max, resolution, false);
    let integer = |min, max, resolution| number_of(min, max, resolution, true);
    assert_neighbours(&[
        (decimal(0.0, codes, 1.0), "f", decimal(0.0, codes - 2.0, 1.0)),
        (decimal(-1e308, 1e308, 1.0), "f", decimal(-1e307, 1e307, 1e307)),
        (decimal(0.0, 1e10, 1e-9), "f", decimal(0.0, 1.0, 1e-9)),
        (decimal(0.0, 1e300, 1e-9), "f", decimal(7.0, 7.0, 1e-9)),
        (decimal(1.0, 0.0, 1.0), "f", decimal(1.0, 1.0, 1.0)),
        (decimal(0.0, 1.0, 0.0), "f", decimal(0.0, 1.0, 1.0)),
        (decimal(0.0, 1.0, -1.0), "f", decimal(0.0, 1.0, 1.0)),
        (decimal(0.0, 1.0, f64::NAN), "f", decimal(0.0, 1.0, 0.5)),
        (decimal(f64::NEG_INFINITY, 0.0, 1.0), "f", decimal(-1.0, 0.0, 1.0)),
        (decimal(f64::NAN, 0.0, 1.0), "f", decimal(-1.0, 0.0, 1.0)),
        // These resolutions would round integers to fractions.
        (integer(0.0, 5.0, 2.5), "f", decimal(0.0, 5.0, 2.5)),
        (integer(0.0, 3.0, 0.3), "f", integer(0.0, 3.0, 0.5)),
    ]);
}

#[test]
fn wrong_numbers_of_elements_are_refused() {
    let list = |min, max| Field::repeated("f", Kind::Bool, min, max);
    let bytes = |length_max| Field::required("f", Kind::Bytes { length_max });
    let names = |count: i32| Kind::Enum { values: (0..count).map(|n| (format!("N{n}"), n)).collect(), packed: true };
    assert_neighbours(&[
        (list(0, 0), "f", list(0, 1)),
        (list(3, 2), "f", list(2, 2)),
        (list(0, 65_537), "f", list(0, 65_536)),
        (list(0, usize::MAX), "f", list(0, 65_536)),
        (list(1, 2).member_of("choice"), "f", Field::optional("f", Kind::Bool).member_of("choice")),
        (bytes(65_537), "f", bytes(65_536)),
        (bytes(usize::MAX), "f", bytes(0)),
        (Field::required("f", names(0)), "f", Field::required("f", names(1))),
    ]);
    let inside = |field| Field::required("outer", around(field));
    assert_neighbours(&[(inside(list(0, 0)), "outer.f", inside(list(0, 1)))]);
}

#[test]
fn a_schema_whose_longest_message_does_not_fit_is_refused() {
    // Id and head fill 12 bits, so 2 bytes; the body fills 9 bits, so 2 bytes.
    let fields =
        [Field::required("a", Kind::integer(0.0, 15.0)).in_head(), Field::required("b", Kind::integer(0.0, 511.0))];
    let schema = |bytes_max| Schema { name: "M".into(), id: Some(5), bytes_max, fields: fields.to_vec() };
    assert_eq!(schema(3).check(), Err(Error::TooLong { length: 4, max: 3 }));
    assert_eq!(schema(4).check(), Ok(()));
    let long_id = |bytes_max| Schema { id: Some(128), ..schema(bytes_max) };
    assert_eq!(long_id(4).check(), Err(Error::TooLong { length: 5, max: 4 }));
    assert_eq!(long_id(5).check(), Ok(()));
}

#[test]
fn an_id_of_more_than_15_bits_is_refused() {
    let schema = |id| schema_of(Some(id), vec![Field::required("f", Kind::Bool)]);
    assert!(matches!(schema(32_768).check(), Err(Error::Schema { field, .. }) if field == "Test"));
    assert_eq!(schema(32_767).check(), Ok(()));
}
