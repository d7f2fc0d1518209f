//! Kernel terms as they stand in a model file.

use dgpc::{Correlation, Shape, Term};
use serde::{Deserialize, Serialize};

use crate::bounds::{self, Bounds};
use crate::model::InputSpec;
use crate::model_file_error::ModelFileError;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TermLayout {
    #[serde(with = "shape_name")]
    shape: Shape,
    variance: f64,
    columns: Vec<String>,
    length_scale_m: LengthScales,
    /// See [`CorrelationLayout`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    ties: Vec<usize>,
    #[serde(default)]
    reciprocal: bool,
    /// Further correlations that the first one is multiplied by.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    times: Vec<CorrelationLayout>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CorrelationLayout {
    #[serde(with = "shape_name")]
    shape: Shape,
    columns: Vec<String>,
    length_scale_m: LengthScales,
    /// Columns with equal numbers share a length-scale when it is learned; left out where all do, or none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    ties: Vec<usize>,
}

/// A shape as its name.
mod shape_name {
    use dgpc::Shape;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(super) fn serialize<S: Serializer>(shape: &Shape, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(shape)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Shape, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

/// One for all columns, or one for each.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum LengthScales {
    Tied(f64),
    Each(Vec<f64>),
}

impl CorrelationLayout {
    /// One that reading refuses.
    fn nothing() -> Self {
        let length_scale_m = LengthScales::Each(Vec::new());
        Self { shape: Shape::Matern32, columns: Vec::new(), length_scale_m, ties: Vec::new() }
    }

    fn write(correlation: &Correlation, names: &[String]) -> Self {
        let ties = correlation.ties();
        let (all_are_tied, none_is) = (ties.iter().all(|&tie| tie == 0), ties.iter().copied().eq(0..ties.len()));
        let length_scale_m = match correlation.length_scales() {
            [first, ..] if all_are_tied => LengthScales::Tied(*first),
            each => LengthScales::Each(each.to_vec()),
        };
        // A column that links do not have is named all the same, so that reading refuses it.
        let name = |&column: &usize| names.get(column).cloned().unwrap_or_else(|| format!("column {column}"));
        let columns = correlation.columns().iter().map(name).collect();
        let ties = if all_are_tied || none_is { Vec::new() } else { ties.to_vec() };
        Self { shape: correlation.shape(), columns, length_scale_m, ties }
    }

    fn read(&self, term: usize, names: &[String]) -> Result<Correlation, ModelFileError> {
        let column = |name: &String| {
            names.iter().position(|known| known == name).ok_or_else(|| ModelFileError::UnknownColumn {
                term,
                column: name.clone(),
                known: names.join(", "),
            })
        };
        let columns = self.columns.iter().map(column).collect::<Result<Vec<_>, _>>()?;
        let correlation = match &self.length_scale_m {
            LengthScales::Tied(length_scale) => {
                in_term(term, "length-scale", *length_scale)?;
                Correlation::isotropic(self.shape, &columns, *length_scale)
            }
            LengthScales::Each(each) if each.len() != columns.len() => {
                let (expected, found) = (columns.len(), each.len());
                return Err(ModelFileError::LengthScales { term, expected, found });
            }
            LengthScales::Each(each) => {
                each.iter().try_for_each(|&length_scale| in_term(term, "length-scale", length_scale))?;
                Correlation::new(self.shape, &columns, each)
            }
        };
        let tied = |correlation: Correlation| {
            if self.ties.is_empty() { Ok(correlation) } else { correlation.tied(&self.ties) }
        };
        correlation.and_then(tied).map_err(|source| ModelFileError::Term { term, source })
    }
}

/// Checks a variance or length-scale.
fn in_term(term: usize, what: &'static str, value: f64) -> Result<(), ModelFileError> {
    let Bounds { words, .. } = bounds::KERNEL_NUMBER;
    match bounds::KERNEL_NUMBER.check(value) {
        Some(_) => Ok(()),
        None => Err(ModelFileError::Term { term, source: dgpc::Error::OutOfRange { what, expected: words, value } }),
    }
}

impl TermLayout {
    pub(crate) fn write(term: &Term, inputs: InputSpec) -> Self {
        let names = inputs.column_names();
        let mut layouts = term.correlations().iter().map(|correlation| CorrelationLayout::write(correlation, &names));
        // A term has at least one.
        let first = layouts.next();
        let times = layouts.collect();
        let CorrelationLayout { shape, columns, length_scale_m, ties } =
            first.unwrap_or_else(CorrelationLayout::nothing);
        let (variance, reciprocal) = (term.variance(), term.is_reciprocal());
        Self { shape, variance, columns, length_scale_m, ties, reciprocal, times }
    }

    pub(crate) fn read(self, number: usize, inputs: InputSpec) -> Result<Term, ModelFileError> {
        let names = inputs.column_names();
        let Self { shape, variance, columns, length_scale_m, ties, reciprocal, times } = self;
        in_term(number, "kernel variance", variance)?;
        let failed = |source| ModelFileError::Term { term: number, source };
        let first = CorrelationLayout { shape, columns, length_scale_m, ties }.read(number, &names)?;
        let mut term = Term::of(variance, first).map_err(failed)?;
        for layout in times {
            term = term.times(layout.read(number, &names)?).map_err(failed)?;
        }
        if !reciprocal {
            return Ok(term);
        }
        inputs.swap_ends().and_then(|swap| term.reciprocal(swap)).map_err(|error| match error {
            dgpc::Error::NotReciprocal { column, partner, length_scale, partner_length_scale } => {
                let (column, partner) = (names[column].clone(), names[partner].clone());
                ModelFileError::NotReciprocal { term: number, column, partner, length_scale, partner_length_scale }
            }
            other => failed(other),
        })
    }
}
