//! Requests and contributions as lists of numbers, for transport between processes.

use std::sync::Arc;

use super::events::Walk;
use super::point_posterior::{PointPosterior, lower, lower_entries};
use super::shard::{Contribution, Posteriors, ShardContribution, ShardRequest, Task};
use crate::cross::Sums;
use crate::error::{Error, Result, all_finite, in_range, same_size};
use crate::linalg::{Cholesky, Matrix};

/// Largest number of inducing points in a list of numbers.
const POINTS_MAX: f64 = 65_535.0;

impl ShardRequest {
    /// Returns the request as a list of at most M² + 3M + 4 numbers, for M inducing points.
    pub fn to_numbers(&self) -> Vec<f64> {
        let (code, posteriors) = match &self.task {
            Task::Begin => (0.0, None),
            Task::Walk(posteriors) => (1.0, Some(posteriors)),
            Task::Store(posteriors) => (2.0, Some(posteriors)),
            Task::Gradient(posteriors) => (3.0, Some(posteriors)),
        };
        let mut numbers = vec![f64::from(self.round), code];
        for posterior in posteriors.iter().flat_map(|both| [Some(&both.at), both.before.as_ref()]).flatten() {
            numbers.push(posterior.weights.len() as f64);
            numbers.extend(lower(&posterior.inner));
            numbers.extend(&posterior.weights);
        }
        numbers
    }

    /// Reads a request from its list of numbers.
    ///
    /// # Errors
    /// [`Error::OutOfRange`], [`Error::NotFinite`] or [`Error::SizeMismatch`] for a list that is no request.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self> {
        let mut reader = Reader(numbers);
        let (round, code) = (reader.round()?, reader.whole("code of a request", 3.0)?);
        let task = if code == 0 {
            Task::Begin
        } else {
            let at = reader.posterior()?;
            let before = if reader.0.is_empty() { None } else { Some(reader.posterior()?) };
            if let Some(before) = &before {
                same_size("inducing points of a request", at.weights.len(), before.weights.len())?;
            }
            let posteriors = Posteriors { at, before };
            match code {
                1 => Task::Walk(posteriors),
                2 => Task::Store(posteriors),
                _ => Task::Gradient(posteriors),
            }
        };
        reader.end()?;
        Ok(Self { round, task })
    }
}

impl ShardContribution {
    /// Returns the contribution as a list of numbers: M(M + 3)/2 + 5 numbers for a walk with M inducing points.
    pub fn to_numbers(&self) -> Vec<f64> {
        let round = f64::from(self.round);
        match &self.result {
            Contribution::Walk(walk) => {
                let mut numbers = vec![round, 0.0, walk.bound, walk.change, walk.sums.shift.len() as f64];
                numbers.extend(lower_entries(&walk.sums.precision));
                numbers.extend(&walk.sums.shift);
                numbers
            }
            Contribution::Gradient(gradient) => [&[round, 1.0, gradient.len() as f64], &gradient[..]].concat(),
            Contribution::Stored => vec![round, 2.0],
        }
    }

    /// Reads a contribution from its list of numbers.
    ///
    /// # Errors
    /// [`Error::OutOfRange`], [`Error::NotFinite`] or [`Error::SizeMismatch`] for a list that is no contribution.
    pub fn from_numbers(numbers: &[f64]) -> Result<Self> {
        let mut reader = Reader(numbers);
        let (round, code) = (reader.round()?, reader.whole("code of a contribution", 2.0)?);
        let result = match code {
            0 => {
                let (bound, change) = (reader.number()?, reader.number()?);
                let (mut precision, shift) = reader.triangle_and_vector()?;
                precision.mirror_lower();
                Contribution::Walk(Walk { sums: Sums { precision, shift }, bound, change })
            }
            1 => {
                let size = reader.whole("parameters of a gradient", POINTS_MAX)?;
                Contribution::Gradient(reader.take(size)?.to_vec())
            }
            _ => Contribution::Stored,
        };
        reader.end()?;
        Ok(Self { round, result })
    }
}

/// The numbers that are not yet read.
struct Reader<'a>(&'a [f64]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [f64]> {
        let Some((taken, rest)) = self.0.split_at_checked(count) else {
            return Err(Error::SizeMismatch {
                what: "numbers of a request or contribution",
                expected: count,
                found: self.0.len(),
            });
        };
        all_finite("request or contribution", taken)?;
        self.0 = rest;
        Ok(taken)
    }

    fn number(&mut self) -> Result<f64> {
        Ok(self.take(1)?[0])
    }

    fn whole(&mut self, what: &'static str, most: f64) -> Result<usize> {
        let value = self.number()?;
        let expected = "a whole number of the list's format";
        if value.fract() != 0.0 {
            return Err(Error::OutOfRange { what, expected, value });
        }
        Ok(in_range(what, value, 0.0..=most, expected)? as usize)
    }

    fn round(&mut self) -> Result<u32> {
        Ok(self.whole("round of a request", f64::from(u32::MAX))? as u32)
    }

    /// Reads a number M, the lower triangle of an M×M matrix, and a vector of M numbers.
    fn triangle_and_vector(&mut self) -> Result<(Matrix, Vec<f64>)> {
        let size = self.whole("number of inducing points", POINTS_MAX)?;
        let mut entries = self.take(size * (size + 1) / 2)?;
        let mut matrix = Matrix::zeros(size, size);
        for column in 0..size {
            let (of_column, rest) = entries.split_at(size - column);
            matrix.column_mut(column)[column..].copy_from_slice(of_column);
            entries = rest;
        }
        Ok((matrix, self.take(size)?.to_vec()))
    }

    fn posterior(&mut self) -> Result<Arc<PointPosterior>> {
        let (factor, weights) = self.triangle_and_vector()?;
        Ok(Arc::new(PointPosterior { inner: Cholesky::of_lower("I + ΦᵀΩΦ", factor)?, weights }))
    }

    fn end(&self) -> Result<()> {
        same_size("numbers after a request or contribution", 0, self.0.len())
    }
}
