//! Correlations of points over some of their columns, the factors of kernel terms.

use super::reflection::Reflection;
use super::scaled::Scaled;
use super::shape::Shape;
use crate::error::{Error, Result, finite, in_range, positive, same_size};
use crate::inputs::{Inputs, check_column};
use crate::linalg::dot;
use crate::parameter::Parameter;

/// The correlation of two points over some columns: a shape of their distance, with each column divided by its
/// length-scale.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Correlation {
    shape: Shape,
    columns: Vec<usize>,
    /// One length-scale per column.
    length_scales: Vec<f64>,
    /// See [`Correlation::ties`].
    ties: Vec<usize>,
}

/// Compares the values only. Ties between parameters, which only learning uses, do not count.
impl PartialEq for Correlation {
    fn eq(&self, other: &Self) -> bool {
        self.shape == other.shape && self.columns == other.columns && self.length_scales == other.length_scales
    }
}

impl Correlation {
    /// Creates a correlation over `columns` with one length-scale per column. Each length-scale is learned separately
    /// (see [`Correlation::tied`]).
    ///
    /// # Errors
    /// * [`Error::OutOfRange`] for a length-scale that is not finite and positive, and for a parameter of the shape
    ///   outside its range.
    /// * [`Error::OutOfRange`] for an empty list of columns, and for a column beyond [`crate::COLUMN_MAX`].
    /// * [`Error::NotFinite`] for a length-scale whose reciprocal overflows.
    /// * [`Error::SizeMismatch`] if the numbers of length-scales and columns differ.
    /// * [`Error::RepeatedColumn`] if a column is named twice.
    pub fn new(shape: Shape, columns: &[usize], length_scales: &[f64]) -> Result<Self> {
        shape.check()?;
        positive("number of kernel columns", columns.len() as f64)?;
        same_size("length-scales, one per kernel column", columns.len(), length_scales.len())?;
        for &length_scale in length_scales {
            positive("length-scale", length_scale)?;
            finite("reciprocal of a length-scale", length_scale.recip())?;
        }
        for (i, &column) in columns.iter().enumerate() {
            check_column(column)?;
            if columns[..i].contains(&column) {
                return Err(Error::RepeatedColumn { what: "kernel term", column });
            }
        }
        let ties = (0..columns.len()).collect();
        Ok(Self { shape, columns: columns.to_vec(), length_scales: length_scales.to_vec(), ties })
    }

    /// Creates a correlation over columns that share one length-scale.
    ///
    /// # Errors
    /// As [`Correlation::new`].
    pub fn isotropic(shape: Shape, columns: &[usize], length_scale: f64) -> Result<Self> {
        Self::new(shape, columns, &vec![length_scale; columns.len()])?.tied(&vec![0; columns.len()])
    }

    /// Ties the length-scales of columns that have the same number in `ties` (one per column). Tied length-scales are
    /// one parameter when the kernel is learned.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the numbers of ties and columns differ, [`Error::UnequalLengthScales`] if tied
    /// length-scales differ.
    pub fn tied(mut self, ties: &[usize]) -> Result<Self> {
        same_size("ties of length-scales, one per kernel column", self.columns.len(), ties.len())?;
        for (place, &tie) in ties.iter().enumerate() {
            let first = ties.iter().position(|&other| other == tie).unwrap_or(place);
            if self.length_scales[first] != self.length_scales[place] {
                return Err(Error::UnequalLengthScales {
                    columns: [self.columns[first], self.columns[place]],
                    length_scales: [self.length_scales[first], self.length_scales[place]],
                });
            }
        }
        self.ties = renumbered(ties);
        Ok(self)
    }

    /// Returns the correlation with another shape.
    pub(super) fn with_shape(&self, shape: Shape) -> Result<Self> {
        shape.check()?;
        Ok(Self { shape, ..self.clone() })
    }

    /// Returns the correlation with one of its untied length-scales multiplied by a factor.
    pub(super) fn with_length_scale_times(&self, number: usize, factor: f64) -> Result<Self> {
        in_range(
            "number of a length-scale",
            number as f64,
            0.0..=self.length_scale_count() as f64 - 1.0,
            "below the number of length-scales",
        )?;
        let mut parameters: Vec<f64> = self.log_parameters().collect();
        parameters[number] += factor.ln();
        self.with_log_parameters(&parameters)
    }

    /// Returns the shape: correlation as a function of scaled distance.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Returns the input columns of the correlation.
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Returns one length-scale per column, in the order of [`Correlation::columns`].
    pub fn length_scales(&self) -> &[f64] {
        &self.length_scales
    }

    /// Returns, for every column, the number of its length-scale when the kernel is learned. Tied columns have equal
    /// numbers. The numbers start from 0, in the order of first columns.
    pub fn ties(&self) -> &[usize] {
        &self.ties
    }

    /// Creates a correlation over columns of labels ([`Shape::Label`]).
    ///
    /// # Errors
    /// As [`Correlation::new`].
    pub fn of_labels(columns: &[usize]) -> Result<Self> {
        Self::new(Shape::Label, columns, &vec![1.0; columns.len()])
    }

    /// Returns the number of untied length-scales; 0 for labels.
    pub(super) fn length_scale_count(&self) -> usize {
        if self.shape.is_of_labels() {
            return 0;
        }
        self.ties.iter().max().map_or(0, |last| last + 1)
    }

    /// Returns the number of learned parameters: untied length-scales, then those of the shape.
    pub(super) fn parameter_count(&self) -> usize {
        self.length_scale_count() + self.shape.parameters().len()
    }

    /// Returns the kind of each parameter.
    pub(super) fn parameters(&self) -> impl Iterator<Item = Parameter> {
        let length_scales = std::iter::repeat_n(Parameter::LengthScale, self.length_scale_count());
        length_scales.chain(self.shape.parameters().iter().map(|_| Parameter::Shape))
    }

    /// Returns ln of every untied length-scale and of every parameter of the shape.
    pub(super) fn log_parameters(&self) -> impl Iterator<Item = f64> {
        let length_scale = |tie: usize| {
            let column = self.ties.iter().position(|&other| other == tie).unwrap_or_default();
            self.length_scales[column].ln()
        };
        let of_shape = self.shape.parameters().iter().map(|parameter| parameter.ln());
        (0..self.length_scale_count()).map(length_scale).chain(of_shape)
    }

    /// Returns the correlation with other parameters, in the order of [`Correlation::log_parameters`].
    pub(super) fn with_log_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let length_scales: Vec<f64> = match self.shape.is_of_labels() {
            true => self.length_scales.clone(),
            false => self.ties.iter().map(|&tie| parameters[tie].exp()).collect(),
        };
        let of_shape: Vec<f64> = parameters[self.length_scale_count()..].iter().map(|ln| ln.exp()).collect();
        let checked = Self::new(self.shape.with_parameters(&of_shape)?, &self.columns, &length_scales)?;
        Ok(Self { ties: self.ties.clone(), ..checked })
    }

    /// Returns whether the two correlations differ in learned parameters only.
    pub(super) fn has_structure_of(&self, other: &Self) -> bool {
        self.shape.name() == other.shape.name() && self.columns == other.columns && self.ties == other.ties
    }

    /// Ties the columns that the reflection exchanges.
    ///
    /// # Errors
    /// [`Error::NotReciprocal`] if the reflection maps a column to a column outside the correlation, or exchanges
    /// columns of different length-scales.
    pub(super) fn tied_by(mut self, reflection: &Reflection) -> Result<Self> {
        for place in 0..self.columns.len() {
            let (column, length_scale) = (self.columns[place], self.length_scales[place]);
            let (partner, _) = reflection.image(column);
            let at = self.columns.iter().position(|&c| c == partner);
            let partner_length_scale = at.map(|at| self.length_scales[at]);
            let Some(at) = at.filter(|_| partner_length_scale == Some(length_scale)) else {
                return Err(Error::NotReciprocal { column, partner, length_scale, partner_length_scale });
            };
            let (own, other) = (self.ties[place], self.ties[at]);
            self.ties.iter_mut().filter(|tie| **tie == other).for_each(|tie| *tie = own);
        }
        self.ties = renumbered(&self.ties);
        Ok(self)
    }

    /// Returns the columns of every point, reflected if requested, divided by their length-scales.
    pub(super) fn scaled(&self, inputs: &Inputs, reflection: Option<&Reflection>) -> Scaled {
        let pick = |(&column, &length_scale): (&usize, &f64)| match reflection.map(|r| r.image(column)) {
            Some((source, true)) => (source, -1.0 / length_scale),
            Some((source, false)) => (source, 1.0 / length_scale),
            None => (column, 1.0 / length_scale),
        };
        let mut values = Vec::with_capacity(self.columns.len() * inputs.len());
        for (column, factor) in self.columns.iter().zip(&self.length_scales).map(pick) {
            values.extend(inputs.rows().map(|row| row[column] * factor));
        }
        if self.shape.is_of_labels() {
            // A negative label becomes a NaN, so that its distance from every label, including itself, is a NaN.
            values.iter_mut().filter(|label| **label < 0.0).for_each(|label| *label = f64::NAN);
        }
        Scaled::new(values, inputs.len())
    }

    /// Writes the correlation between point `n` of `points` and each of `others` from `first` on.
    pub(super) fn write_to(&self, (points, n): (&Scaled, usize), others: (&Scaled, usize), out: &mut [f64]) {
        points.squared_distances(n, others, out);
        self.shape.correlations(out);
    }

    /// Adds weighted sums over the pairs of point `n` of `points` and `others` from `first` on to `sums`.
    ///
    /// The weights multiply three kinds of terms: the correlation, its derivative by r² times each column's part of r²,
    /// and its derivatives by the shape's parameters.
    pub(super) fn add_slopes(
        &self,
        (points, n): (&Scaled, usize),
        others: (&Scaled, usize),
        weights: &[f64],
        sums: &mut Slopes,
    ) {
        let Slopes { correlation, columns, shape, values, slopes } = sums;
        values.resize(weights.len(), 0.0);
        slopes.resize(weights.len(), 0.0);
        points.squared_distances(n, others, values);
        if !shape.is_empty() {
            let pairs = weights.iter().zip(&*values);
            pairs.for_each(|(weight, squared)| self.shape.add_parameter_slopes(*weight, *squared, shape));
        }
        self.shape.correlations_and_slopes(values, slopes);
        *correlation += dot(weights, values);
        slopes.iter_mut().zip(weights).for_each(|(slope, weight)| *slope *= weight);
        points.add_weighted_squares(n, others, slopes, columns);
    }

    /// Returns sums for [`Correlation::add_slopes`], all zero.
    pub(super) fn slopes(&self) -> Slopes {
        let width = self.columns.len();
        let shape = vec![0.0; self.shape.parameters().len()];
        Slopes { correlation: 0.0, columns: vec![0.0; width], shape, values: Vec::new(), slopes: Vec::new() }
    }

    /// Adds `factor` · the sums to a gradient by the parameters. ∂r²/∂ln ℓ_c is −2 · (column c's part of r²).
    pub(super) fn add_gradient(&self, factor: f64, sums: &Slopes, gradient: &mut [f64]) {
        let length_scales = self.length_scale_count();
        for (sum, &tie) in sums.columns.iter().zip(&self.ties).filter(|(_, tie)| **tie < length_scales) {
            gradient[tie] -= 2.0 * factor * sum;
        }
        let of_shape = gradient[length_scales..].iter_mut().zip(&sums.shape);
        of_shape.for_each(|(entry, sum)| *entry += factor * sum);
    }
}

/// Sums over pairs of points, with work areas.
pub(super) struct Slopes {
    /// Sum of the correlations.
    pub(super) correlation: f64,
    columns: Vec<f64>,
    shape: Vec<f64>,
    /// Work areas for the pairs at hand.
    values: Vec<f64>,
    slopes: Vec<f64>,
}

/// Returns the same partition with groups numbered from 0, in the order of their first members.
fn renumbered(groups: &[usize]) -> Vec<usize> {
    let mut seen: Vec<usize> = Vec::new();
    let number = |&group: &usize| {
        seen.iter().position(|&other| other == group).unwrap_or_else(|| {
            seen.push(group);
            seen.len() - 1
        })
    };
    groups.iter().map(number).collect()
}

/// The serialised form of [`Correlation`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    shape: Shape,
    columns: Vec<usize>,
    length_scales: Vec<f64>,
    ties: Vec<usize>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Correlation {
    type Error = Error;

    fn try_from(Parts { shape, columns, length_scales, ties }: Parts) -> Result<Self> {
        Self::new(shape, &columns, &length_scales)?.tied(&ties)
    }
}

#[cfg(feature = "serde")]
impl From<Correlation> for Parts {
    fn from(Correlation { shape, columns, length_scales, ties }: Correlation) -> Self {
        Self { shape, columns, length_scales, ties }
    }
}
