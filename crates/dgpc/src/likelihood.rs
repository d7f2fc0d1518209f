//! The data of a fit: own events, and messages from peers ([`crate::method::learning`]).

use std::borrow::Cow;

use crate::error::{Result, same_size};
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::linalg::{Matrix, dot, multiply_rows, product, squared_norm};
use crate::observations::Observations;
use crate::prior_mean::PriorMean;

use crate::summary::Summary;

/// Smallest whitened precision of a message in any direction, because a shift without precision is not an observation.
/// Compared with the prior's precision of 1 it carries no information.
const PRECISION_MIN: f64 = 1e-8;

/// Events, and messages as further Gaussian observations.
///
/// A message with kernel-free factor (P, η) at Z, P = RRᵀ, is the observation of Rᵀf(Z) with unit noise. It acts as M
/// more events with ω = 1 and κ = R⁻¹η.
pub(crate) struct Likelihood<'a> {
    pub(crate) observations: &'a Observations,
    /// The inducing points of all messages, stacked.
    points: Inputs,
    /// Kernel-free R of each message.
    roots: Vec<Matrix>,
    /// R⁻¹η of all messages, stacked.
    shift: Vec<f64>,
    /// Inputs of the events, then `points`.
    support: Cow<'a, Inputs>,
}

impl<'a> Likelihood<'a> {
    /// Collects events and messages. Messages may be formed under any prior. O(M³) a message.
    pub(crate) fn new(observations: &'a Observations, summaries: &[&Summary]) -> Result<Self> {
        let mut points = Inputs::empty(observations.inputs().dimension());
        let (mut roots, mut shift) = (Vec::new(), Vec::new());
        for summary in summaries {
            same_size("input dimension", points.dimension(), summary.inducing_points().dimension())?;
            points.append(summary.inducing_points())?;
            // R = L⁻ᵀQ with Ĝ = QQᵀ and orthogonal columns of Q; R⁻¹η = Q⁻¹b̂ + Rᵀμ₀.
            let mut root = summary.root_above(PRECISION_MIN)?;
            let whitened_entry = |column| {
                let column = root.column(column);
                dot(column, summary.whitened_shift()) / squared_norm(column)
            };
            let whitened: Vec<f64> = (0..root.columns()).map(whitened_entry).collect();
            summary.cholesky().solve_upper_matrix(&mut root);
            let offset = root.transposed_times(&summary.prior().mean().values(summary.inducing_points())?);
            shift.extend(whitened.iter().zip(&offset).map(|(shift, offset)| shift + offset));
            roots.push(root);
        }
        let mut support = Cow::Borrowed(observations.inputs());
        if !points.is_empty() {
            support.to_mut().append(&points)?;
        }
        Ok(Self { observations, points, roots, shift, support })
    }

    /// Returns the number of events N.
    pub(crate) fn events(&self) -> usize {
        self.observations.len()
    }

    /// Returns the number of observations n: events, and the observations that messages represent.
    pub(crate) fn len(&self) -> usize {
        self.support.len()
    }

    /// Returns κ of the events, then R⁻¹η of the messages.
    pub(crate) fn kappa(&self) -> Vec<f64> {
        [self.observations.kappa(), self.shift.clone()].concat()
    }

    /// Returns R⁻¹η of the messages.
    pub(crate) fn message_kappa(&self) -> &[f64] {
        &self.shift
    }

    /// Returns the prior mean of all observations, n.
    pub(crate) fn prior_mean(&self, mean: &PriorMean) -> Result<Vec<f64>> {
        let mut values = mean.values(&self.support)?;
        self.compress(&mut values, self.events());
        Ok(values)
    }

    /// Returns the prior mean of the message observations, m.
    pub(crate) fn message_prior_mean(&self, mean: &PriorMean) -> Result<Vec<f64>> {
        let mut values = mean.values(&self.points)?;
        self.compress(&mut values, 0);
        Ok(values)
    }

    /// Writes the prior covariance of all observations to an n×n matrix.
    pub(crate) fn write_gram(&self, kernel: &Kernel, gram: &mut Matrix) -> Result<()> {
        if !self.has_messages() {
            return kernel.write_gram(&self.support, gram);
        }
        let mut wide = kernel.gram(&self.support)?;
        self.compress_rows(&mut wide, self.events());
        *gram = wide.transposed();
        self.compress_rows(gram, self.events());
        gram.symmetrise();
        Ok(())
    }

    /// Returns the prior covariance of the m message observations with f at `points`, m×M.
    pub(crate) fn message_cross(&self, kernel: &Kernel, points: &Inputs) -> Result<Matrix> {
        let mut cross = kernel.cross(&self.points, points)?;
        self.compress_rows(&mut cross, 0);
        Ok(cross)
    }

    /// Returns the prior variance of the message observations, m.
    pub(crate) fn message_diagonal(&self, kernel: &Kernel) -> Result<Vec<f64>> {
        let mut diagonal = Vec::with_capacity(self.points.len());
        for (root, first) in self.blocks(0) {
            let gram = kernel.gram(&self.points.slice(first..first + root.rows()))?;
            let half = product(gram.view(), root.view());
            diagonal.extend((0..root.columns()).map(|column| dot(root.column(column), half.column(column))));
        }
        Ok(diagonal)
    }

    /// Returns the gradient by the prior mean's parameters, from the derivative by the prior mean of all observations.
    pub(crate) fn mean_gradient(&self, mean: &PriorMean, weights: &[f64]) -> Vec<f64> {
        mean.gradient(&self.support, &self.expanded(weights, self.events()))
    }

    /// Returns the gradient by the prior mean's parameters, from the derivative by the prior mean of the message
    /// observations.
    pub(crate) fn message_mean_gradient(&self, mean: &PriorMean, weights: &[f64]) -> Vec<f64> {
        mean.gradient(&self.points, &self.expanded(weights, 0))
    }

    /// Returns the gradient by the kernel's parameters, from the lower triangle of the derivative by
    /// [`Likelihood::write_gram`]. Overwrites `weights` with the derivative by the gram matrix of the events and the
    /// messages' points.
    pub(crate) fn gram_gradient(&self, kernel: &Kernel, weights: &mut Matrix) -> Vec<f64> {
        if self.has_messages() {
            weights.mirror_lower();
            self.expand_rows(weights, self.events());
            *weights = weights.transposed();
            self.expand_rows(weights, self.events());
        }
        kernel.gram_gradient(&self.support, weights)
    }

    /// Returns the gradient by the kernel's parameters, from the derivative by [`Likelihood::message_cross`].
    pub(crate) fn message_cross_gradient(&self, kernel: &Kernel, points: &Inputs, mut weights: Matrix) -> Vec<f64> {
        self.expand_rows(&mut weights, 0);
        kernel.cross_gradient(&self.points, points, &weights)
    }

    /// Returns the gradient by the kernel's parameters of `factor` · Σ of [`Likelihood::message_diagonal`].
    pub(crate) fn message_diagonal_gradient(&self, kernel: &Kernel, factor: f64) -> Vec<f64> {
        let mut gradient = vec![0.0; kernel.parameter_count()];
        for (root, first) in self.blocks(0) {
            let points = self.points.slice(first..first + root.rows());
            let block = kernel.gram_gradient(&points, &product(root.view(), root.t()));
            gradient.iter_mut().zip(&block).for_each(|(sum, entry)| *sum += factor * entry);
        }
        gradient
    }

    /// Returns whether there are messages.
    pub(crate) fn has_messages(&self) -> bool {
        !self.roots.is_empty()
    }

    /// Returns every R with the index of its first row, if the rows of the first message start at `first`.
    fn blocks(&self, first: usize) -> impl Iterator<Item = (&Matrix, usize)> {
        self.roots.iter().scan(first, |next, root| {
            let first = *next;
            *next += root.rows();
            Some((root, first))
        })
    }

    /// Multiplies the entries from `first` on by blockdiag(Rᵀ).
    fn compress(&self, values: &mut [f64], first: usize) {
        for (root, first) in self.blocks(first) {
            let part = root.transposed_times(&values[first..first + root.rows()]);
            values[first..first + root.rows()].copy_from_slice(&part);
        }
    }

    /// Returns `values` with the entries from `first` on multiplied by blockdiag(R).
    fn expanded(&self, values: &[f64], first: usize) -> Vec<f64> {
        let mut values = values.to_vec();
        for (root, first) in self.blocks(first) {
            let part = root.times(&values[first..first + root.rows()]);
            values[first..first + root.rows()].copy_from_slice(&part);
        }
        values
    }

    /// Multiplies the rows from `first` on by blockdiag(Rᵀ).
    fn compress_rows(&self, matrix: &mut Matrix, first: usize) {
        self.blocks(first).for_each(|(root, first)| multiply_rows(root.t(), matrix, first));
    }

    /// Multiplies the rows from `first` on by blockdiag(R).
    fn expand_rows(&self, matrix: &mut Matrix, first: usize) {
        self.blocks(first).for_each(|(root, first)| multiply_rows(root.view(), matrix, first));
    }
}
