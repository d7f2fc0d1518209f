//! Whether a schema describes messages at all: what DCCL refuses when it loads a message is refused here too.

use crate::error::Error;
use crate::schema::{Field, Kind, Number, Rule, Schema};
use crate::widths::path;

/// Largest id that 15 bits hold.
const ID_MAX: u16 = 32767;

/// Most elements of a repeated field, and most bytes of a text.
const LENGTH_MAX: usize = 1 << 16;

/// Codes beyond this are not whole numbers of f64 any more.
const CODES_MAX: f64 = 9_007_199_254_740_992.0;

/// The two parts of a message.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Head,
    Body,
}

impl Schema {
    /// Checks what encoding and decoding rely on, and what DCCL (codec versions 3 and 4) asks of a message: in the head
    /// only fields that always take equally many bits, bounds that are multiples of the resolution, and a longest form
    /// of at most [`Schema::bytes_max`].
    ///
    /// # Errors
    /// [`Error::Schema`] with the field and what it should have, [`Error::TooLong`] for a message that might not fit.
    pub fn check(&self) -> Result<(), Error> {
        if self.id.is_some_and(|id| id > ID_MAX) {
            return Err(Error::Schema { field: self.name.clone(), expected: "an id of at most 32767" });
        }
        self.fields.iter().try_for_each(|field| {
            let part = if field.in_head { Part::Head } else { Part::Body };
            check_field(field, "", part)
        })?;
        let (length, max) = (self.length(), self.bytes_max);
        if length > max { Err(Error::TooLong { length, max }) } else { Ok(()) }
    }
}

/// Checks a field of this part of the message, and the fields inside it.
fn check_field(field: &Field, around: &str, part: Part) -> Result<(), Error> {
    let name = path(around, &field.name);
    if let Some(expected) = problem(field).or_else(|| misplacement(field, part)) {
        return Err(Error::Schema { field: name, expected });
    }
    if let Kind::Message(inside) = &field.kind {
        inside.iter().try_for_each(|field| check_field(field, &name, part))?;
    }
    // After the fields inside: the error should name the one that varies, not the message around it.
    if part == Part::Head && field.bits_min() != field.bits_max() {
        return Err(Error::Schema { field: name, expected: "a fixed size in bits, as a part of the head" });
    }
    Ok(())
}

/// What a field should have and has not, wherever it stands.
fn problem(field: &Field) -> Option<&'static str> {
    if field.oneof.is_some() && matches!(field.rule, Rule::Repeated { .. }) {
        return Some("no repetition, as a member of a oneof");
    }
    if let Rule::Repeated { min, max } = field.rule
        && (!(1..=LENGTH_MAX).contains(&max) || min > max)
    {
        return Some("a largest number of elements from 1 to 65536, not below the smallest");
    }
    match &field.kind {
        Kind::Number(number) => number_problem(number),
        Kind::Enum { values, .. } => values.is_empty().then_some("at least one value"),
        Kind::Bytes { length_max } | Kind::Text { length_max } => {
            (*length_max > LENGTH_MAX).then_some("at most 65536 bytes")
        }
        Kind::Bool | Kind::Message(_) => None,
    }
}

fn number_problem(number: &Number) -> Option<&'static str> {
    let Number { min, max, resolution, integer } = *number;
    let is_ordered = min.is_finite() && max.is_finite() && min <= max;
    if !is_ordered || !resolution.is_finite() || resolution <= 0.0 {
        return Some("finite bounds in order and a positive resolution");
    }
    // DCCL compares logarithms. Beside them the quotient itself: what rounds to the limit in logarithms may lie beyond
    // it.
    let is_countable = libm::log2(max - min) - libm::log2(resolution) <= f64::from(f64::MANTISSA_DIGITS);
    if !is_countable || (max - min) / resolution >= CODES_MAX {
        return Some("at most 2^53 values between its bounds");
    }
    if !number.has_bounds_on_steps() {
        return Some("bounds that are multiples of its resolution");
    }
    // Other steps would round whole values to fractions, which a field of whole numbers does not take back.
    let steps = if resolution >= 1.0 { resolution } else { 1.0 / resolution };
    (integer && steps != libm::floor(steps)).then_some("a resolution that is whole or divides 1")
}

/// What a field should have and has not in this part of the message.
fn misplacement(field: &Field, part: Part) -> Option<&'static str> {
    match part {
        Part::Head if field.oneof.is_some() => Some("no place in the head, as a member of a oneof"),
        // DCCL does not encode it in the head either, and its versions do not agree where they do.
        Part::Body if field.in_head => Some("no place in the head, as the message around it is in the body"),
        _ => None,
    }
}
