//! Validity of schemas. This module refuses the schemas that DCCL refuses when it loads a message.

use crate::error::Error;
use crate::schema::{Field, Kind, Number, Rule, Schema};
use crate::widths::path;

/// Largest id that 15 bits hold.
const ID_MAX: u16 = 32767;

/// Largest number of elements of a repeated field, and of bytes of a text.
const LENGTH_MAX: usize = 1 << 16;

/// Largest code that f64 represents as a whole number, plus one.
const CODES_MAX: f64 = 9_007_199_254_740_992.0;

/// The two parts of a message.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Head,
    Body,
}

impl Schema {
    /// Checks the requirements of encoding and decoding, and those of DCCL (codec versions 3 and 4).
    ///
    /// * Fields in the head have a fixed number of bits.
    /// * Bounds are multiples of the resolution.
    /// * The longest form has at most [`Schema::bytes_max`] bytes.
    ///
    /// # Errors
    /// [`Error::Schema`] with the field and the requirement that it violates. [`Error::TooLong`] if the longest form
    /// does not fit.
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

/// Checks a field of this part of the message, and the fields inside the field.
fn check_field(field: &Field, around: &str, part: Part) -> Result<(), Error> {
    let name = path(around, &field.name);
    if let Some(expected) = problem(field).or_else(|| misplacement(field, part)) {
        return Err(Error::Schema { field: name, expected });
    }
    if let Kind::Message(inside) = &field.kind {
        inside.iter().try_for_each(|field| check_field(field, &name, part))?;
    }
    // The fields inside are checked first: the error names the innermost field of varying size.
    if part == Part::Head && field.bits_min() != field.bits_max() {
        return Err(Error::Schema { field: name, expected: "a fixed size in bits, as a part of the head" });
    }
    Ok(())
}

/// Returns the requirement that a field violates independently of its position.
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
    // DCCL compares logarithms. The quotient itself is compared as well: its logarithm may be rounded down to the
    // limit.
    let is_countable = libm::log2(max - min) - libm::log2(resolution) <= f64::from(f64::MANTISSA_DIGITS);
    if !is_countable || (max - min) / resolution >= CODES_MAX {
        return Some("at most 2^53 values between its bounds");
    }
    if !number.has_bounds_on_steps() {
        return Some("bounds that are multiples of its resolution");
    }
    // Other steps would round whole values to fractions, which an integer field does not accept.
    let steps = if resolution >= 1.0 { resolution } else { 1.0 / resolution };
    (integer && steps != libm::floor(steps)).then_some("a resolution that is whole or divides 1")
}

/// Returns the requirement that a field violates in this part of the message.
fn misplacement(field: &Field, part: Part) -> Option<&'static str> {
    match part {
        Part::Head if field.oneof.is_some() => Some("a position in the body, as a member of a oneof"),
        // DCCL does not encode such a field in the head either, and its versions disagree on the position.
        Part::Body if field.in_head => Some("a position in the body, as part of a message in the body"),
        _ => None,
    }
}
