//! Random schemas, valid or not, and messages for them.

use std::collections::BTreeSet;

use pingmap_packet::*;
use proptest::collection::{btree_set, vec};
use proptest::prelude::*;
use proptest::sample::select;

/// Resolutions in use: powers of ten below one, binary fractions, and whole numbers.
const RESOLUTIONS: [f64; 7] = [0.001, 0.1, 0.25, 1.0, 2.0, 5.0, 20.0];

/// A multiple of the resolution, rounded to a double.
fn multiple(times: i32, resolution: f64) -> f64 {
    if resolution < 1.0 { f64::from(times) / (1.0 / resolution) } else { f64::from(times) * resolution }
}

pub fn number() -> impl Strategy<Value = Number> {
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
    plain.prop_recursive(2, 12, 4, |inner| fields(inner, 0.03).prop_map(Kind::Message))
}

/// Fields of every form, named by their positions. This share of them is in the head.
fn fields(kind: impl Strategy<Value = Kind>, share: f64) -> impl Strategy<Value = Vec<Field>> {
    let form = prop_oneof![
        Just(Field::required("", Kind::Bool)),
        any::<bool>().prop_map(|presence| Field { presence, ..Field::optional("", Kind::Bool) }),
        (0..3_usize, 0..4_usize).prop_map(|(min, more)| Field::repeated("", Kind::Bool, min, min + more)),
        select(&["either", "other"][..]).prop_map(|oneof| Field::optional("", Kind::Bool).member_of(oneof)),
    ];
    let form = (form, prop::bool::weighted(share)).prop_map(|(form, in_head)| Field { in_head, ..form });
    let named = |(place, (kind, form)): (usize, (Kind, Field))| Field { name: format!("f{place}"), kind, ..form };
    vec((kind, form), 1..6).prop_map(move |parts| parts.into_iter().enumerate().map(named).collect())
}

pub fn schema_of(id: Option<u16>, fields: Vec<Field>) -> Schema {
    let schema = Schema { name: "Test".into(), id, bytes_max: 0, fields };
    Schema { bytes_max: schema.length(), ..schema }
}

/// Schemas that may be invalid in the positions of fields and the numbers of elements only.
pub fn any_schemas() -> impl Strategy<Value = Schema> {
    let ids = select(&[None, Some(0), Some(5), Some(127), Some(128), Some(300), Some(32767)][..]);
    (ids, fields(kind(), 0.3)).prop_map(|(id, fields)| schema_of(id, fields))
}

/// Whether a field has the same width for all values, so it may be in the head.
pub fn is_fixed(field: &Field) -> bool {
    let is_kind_fixed = match &field.kind {
        Kind::Bool | Kind::Number(_) | Kind::Enum { .. } => true,
        Kind::Bytes { .. } | Kind::Text { .. } => is_empty(&field.kind),
        Kind::Message(fields) => fields.iter().all(is_fixed),
    };
    let has_code_for_unset = !field.presence && matches!(field.kind, Kind::Bool | Kind::Number(_) | Kind::Enum { .. });
    field.oneof.is_none()
        && match field.rule {
            Rule::Required => is_kind_fixed,
            Rule::Optional => has_code_for_unset || is_empty(&field.kind),
            Rule::Repeated { min, max } => is_kind_fixed && min == max || is_empty(&field.kind),
        }
}

/// Whether a value of this kind takes no bits because the kind has only one value.
fn is_empty(kind: &Kind) -> bool {
    match kind {
        Kind::Bool => false,
        Kind::Number(number) => number.min == number.max,
        Kind::Enum { values, .. } => values.len() == 1,
        Kind::Bytes { length_max } | Kind::Text { length_max } => *length_max == 0,
        Kind::Message(fields) => fields.iter().all(|field| {
            let is_once = match field.rule {
                Rule::Required => true,
                Rule::Optional => false,
                Rule::Repeated { min, max } => min == max,
            };
            field.oneof.is_none() && is_once && is_empty(&field.kind)
        }),
    }
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

/// Random values within bounds, with at most one member of each oneof.
pub fn message(fields: &[Field]) -> BoxedStrategy<Fields> {
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
