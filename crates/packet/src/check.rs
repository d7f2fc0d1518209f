//! Whether a schema describes messages at all.

use crate::error::Error;
use crate::schema::{Field, Kind, Number, Rule, Schema};
use crate::widths::path;

/// Most elements of a repeated field, and most bytes of a text.
const LENGTH_MAX: usize = 1 << 16;

/// Codes beyond this are not whole numbers of f64 any more.
const CODES_MAX: f64 = 9_007_199_254_740_992.0;

impl Schema {
    /// Checks what encoding and decoding rely on.
    ///
    /// # Errors
    /// [`Error::Schema`] with the field and what it should have.
    pub fn check(&self) -> Result<(), Error> {
        if self.id.is_some_and(|id| id > 32767) {
            return Err(Error::Schema { field: self.name.clone(), expected: "an id of at most 32767" });
        }
        check_fields(&self.fields, "")
    }
}

fn check_fields(fields: &[Field], around: &str) -> Result<(), Error> {
    fields.iter().try_for_each(|field| {
        let name = path(around, &field.name);
        match (problem(field), &field.kind) {
            (Some(expected), _) => Err(Error::Schema { field: name, expected }),
            (None, Kind::Message(inside)) => check_fields(inside, &name),
            (None, _) => Ok(()),
        }
    })
}

/// What a field should have and has not.
fn problem(field: &Field) -> Option<&'static str> {
    if field.oneof.is_some() && (field.in_head || matches!(field.rule, Rule::Repeated { .. })) {
        return Some("no place in the head and no repetition, as a member of a oneof");
    }
    if let Rule::Repeated { min, max } = field.rule
        && (min > max || max > LENGTH_MAX)
    {
        return Some("at most 65536 elements, and no more at least than at most");
    }
    match &field.kind {
        Kind::Number(Number { min, max, resolution, .. }) => {
            let fits = min.is_finite() && max.is_finite() && min <= max && resolution.is_finite() && *resolution > 0.0;
            (!fits || (max - min) / resolution >= CODES_MAX)
                .then_some("finite bounds in order and a positive resolution, with fewer than 2^53 values")
        }
        Kind::Enum { values, .. } => values.is_empty().then_some("at least one value"),
        Kind::Bytes { length_max } | Kind::Text { length_max } => {
            (*length_max > LENGTH_MAX).then_some("at most 65536 bytes")
        }
        Kind::Bool | Kind::Message(_) => None,
    }
}
