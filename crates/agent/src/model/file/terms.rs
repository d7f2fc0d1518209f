//! Kernel terms in a model file.

use dgpc::{Correlation, Shape, Term};
use serde::{Deserialize, Serialize};

use crate::model::file::error::ModelFileError;
use crate::model::inputs::{InputSpec, LengthUnit};
use crate::types::bounds::{self, Bounds};

/// The layout of a kernel term in a model file, or of a further correlation of a term.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TermLayout {
    #[serde(with = "shape_name")]
    shape: Shape,
    /// Variance of a term. A further correlation has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    variance: Option<f64>,
    columns: Vec<String>,
    /// Length-scales of position columns, in metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    length_scale_m: Option<LengthScales>,
    /// Length-scales of the time column, in seconds. Label columns have no length-scale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    length_scale_s: Option<LengthScales>,
    /// Length-scales of aspect columns, as chords of the unit circle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    length_scale: Option<LengthScales>,
    /// Ties of length-scales: columns with equal numbers share one learned length-scale. The list is empty if all
    /// columns or none share it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    ties: Vec<usize>,
    /// Correlation of both directions of a path.
    #[serde(default, skip_serializing_if = "is_zero")]
    reciprocity: f64,
    /// Further correlations. The term is the product of all of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    times: Vec<TermLayout>,
}

/// Serialization of a shape as its name.
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

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum LengthScales {
    /// One length-scale for all columns.
    Tied(f64),
    /// One length-scale for each column.
    Each(Vec<f64>),
}

fn is_zero(reciprocity: &f64) -> bool {
    *reciprocity == 0.0
}

impl TermLayout {
    /// Returns the length-scales, in the unit of the columns. `term` is the number of the term, from 1.
    fn length_scales(&self, term: usize, unit: Option<LengthUnit>) -> Result<&LengthScales, ModelFileError> {
        let (given, expected) = match unit {
            None => (Some(&LengthScales::Tied(1.0)), "no length-scale, since its columns are labels"),
            Some(LengthUnit::Metres) => (self.length_scale_m.as_ref(), "length_scale_m alone"),
            Some(LengthUnit::Seconds) => {
                (self.length_scale_s.as_ref(), "length_scale_s alone, since its column is the time")
            }
            Some(LengthUnit::Chords) => {
                (self.length_scale.as_ref(), "length_scale alone, since its columns are aspects")
            }
        };
        let count = [&self.length_scale_m, &self.length_scale_s, &self.length_scale].into_iter().flatten().count();
        let is_alone = count == usize::from(unit.is_some());
        given.filter(|_| is_alone).ok_or(ModelFileError::LengthScaleUnit { term, expected })
    }

    fn write_correlation(correlation: &Correlation, inputs: InputSpec) -> Self {
        let names = inputs.column_names();
        let ties = correlation.ties();
        let (all_are_tied, none_is) = (ties.iter().all(|&tie| tie == 0), ties.iter().copied().eq(0..ties.len()));
        let length_scales = match correlation.length_scales() {
            [first, ..] if all_are_tied => LengthScales::Tied(*first),
            each => LengthScales::Each(each.to_vec()),
        };
        // A column that the inputs do not have gets a name that reading refuses.
        let name = |&column: &usize| names.get(column).cloned().unwrap_or_else(|| format!("column {column}"));
        let columns: Vec<String> = correlation.columns().iter().map(name).collect();
        let ties = if all_are_tied || none_is { Vec::new() } else { ties.to_vec() };
        let (shape, [length_scale_m, length_scale_s, length_scale]) = (correlation.shape(), [None, None, None]);
        let (variance, reciprocity, times) = (None, 0.0, Vec::new());
        let mut layout =
            Self { shape, variance, columns, length_scale_m, length_scale_s, length_scale, ties, reciprocity, times };
        if !shape.is_of_labels() {
            let place = match inputs.length_unit(correlation.columns()) {
                LengthUnit::Metres => &mut layout.length_scale_m,
                LengthUnit::Seconds => &mut layout.length_scale_s,
                LengthUnit::Chords => &mut layout.length_scale,
            };
            *place = Some(length_scales);
        }
        layout
    }

    /// Returns the correlation over columns of these inputs. `term` is the number of the term, from 1.
    fn read_correlation(&self, term: usize, inputs: InputSpec) -> Result<Correlation, ModelFileError> {
        let names = inputs.column_names();
        let column = |name: &String| {
            names.iter().position(|known| known == name).ok_or_else(|| ModelFileError::UnknownColumn {
                term,
                column: name.clone(),
                known: names.join(", "),
            })
        };
        let columns = self.columns.iter().map(column).collect::<Result<Vec<_>, _>>()?;
        let unit = (!self.shape.is_of_labels()).then(|| inputs.length_unit(&columns));
        let correlation = match self.length_scales(term, unit)? {
            // Label columns have no ties.
            LengthScales::Tied(_) if self.shape.is_of_labels() => Correlation::of_labels(&columns),
            LengthScales::Tied(length_scale) => {
                check_kernel_number(term, "length-scale", *length_scale)?;
                Correlation::isotropic(self.shape, &columns, *length_scale)
            }
            LengthScales::Each(each) if each.len() != columns.len() => {
                let (expected, found) = (columns.len(), each.len());
                return Err(ModelFileError::LengthScales { term, expected, found });
            }
            LengthScales::Each(each) => {
                each.iter().try_for_each(|&length_scale| check_kernel_number(term, "length-scale", length_scale))?;
                Correlation::new(self.shape, &columns, each)
            }
        };
        let tied = |correlation: Correlation| {
            if self.ties.is_empty() { Ok(correlation) } else { correlation.tied(&self.ties) }
        };
        correlation.and_then(tied).map_err(|source| ModelFileError::Term { term, source })
    }

    pub(crate) fn write(term: &Term, inputs: InputSpec) -> Self {
        // A term has at least one correlation.
        let (first, others) = (&term.correlations()[0], &term.correlations()[1..]);
        Self {
            variance: Some(term.variance()),
            reciprocity: term.reciprocity(),
            times: others.iter().map(|other| Self::write_correlation(other, inputs)).collect(),
            ..Self::write_correlation(first, inputs)
        }
    }

    /// Returns the kernel term over these inputs. `number` is the number of the term, from 1.
    pub(crate) fn read(self, number: usize, inputs: InputSpec) -> Result<Term, ModelFileError> {
        let syntax = |problem: &str| ModelFileError::Syntax(format!("kernel term {number}: {problem}"));
        let variance = self.variance.ok_or_else(|| syntax("missing field `variance`"))?;
        check_kernel_number(number, "kernel variance", variance)?;
        let failed = |source| ModelFileError::Term { term: number, source };
        let mut term = Term::of(variance, self.read_correlation(number, inputs)?).map_err(failed)?;
        for factor in &self.times {
            if factor.variance.is_some() || factor.reciprocity != 0.0 || !factor.times.is_empty() {
                return Err(syntax("a table `times` cannot have `variance`, `reciprocity` or `times`"));
            }
            term = term.times(factor.read_correlation(number, inputs)?).map_err(failed)?;
        }
        if self.reciprocity == 0.0 {
            return Ok(term);
        }
        let names = inputs.column_names();
        let reciprocal = |swap| term.partly_reciprocal(swap, self.reciprocity);
        inputs.swap_ends().and_then(reciprocal).map_err(|error| match error {
            dgpc::Error::NotReciprocal { column, partner, length_scale, partner_length_scale } => {
                let (column, partner) = (names[column].clone(), names[partner].clone());
                ModelFileError::NotReciprocal { term: number, column, partner, length_scale, partner_length_scale }
            }
            other => failed(other),
        })
    }
}

/// Checks that a variance or length-scale is within bounds.
fn check_kernel_number(term: usize, what: &'static str, value: f64) -> Result<(), ModelFileError> {
    let Bounds { words, .. } = bounds::KERNEL_NUMBER;
    match bounds::KERNEL_NUMBER.check(value) {
        Some(_) => Ok(()),
        None => Err(ModelFileError::Term { term, source: dgpc::Error::OutOfRange { what, expected: words, value } }),
    }
}
