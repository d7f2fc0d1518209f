//! The messages of peers at the inducing points of a sparse fit.

use crate::cross::Sums;
use crate::error::Result;
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::linalg::{Cholesky, Matrix, squared_norms_of_rows};
use crate::prior::Prior;

/// The messages of peers, which stay fixed.
pub(super) struct Messages {
    /// Φ of the messages' observations.
    pub(super) features: Matrix,
    /// κ̃ of the messages' observations, whose ω is 1.
    pub(super) shift: Vec<f64>,
    /// Ĝ and b̂ of the messages.
    pub(super) sums: Sums,
    /// The messages' terms of E.
    pub(super) bound: f64,
}

impl Messages {
    /// Condenses the messages of `likelihood` at `points`, with K_MM = LLᵀ of these points.
    pub(super) fn new(
        prior: &Prior,
        likelihood: &Likelihood<'_>,
        points: &Inputs,
        cholesky: &Cholesky,
    ) -> Result<Self> {
        let mut features = likelihood.message_cross(prior.kernel(), points)?;
        cholesky.solve_rows(&mut features);
        let (mut bound, mut shift) = (0.0, Vec::with_capacity(features.rows()));
        let diagonal = likelihood.message_diagonal(prior.kernel())?;
        let unexplained =
            diagonal.into_iter().zip(squared_norms_of_rows(&features)).map(|(k, explained)| k - explained);
        let prior_mean = likelihood.message_prior_mean(prior.mean())?;
        for ((unexplained, kappa), mean) in unexplained.zip(likelihood.message_kappa()).zip(prior_mean) {
            shift.push(kappa - mean);
            bound += (kappa - 0.5 * mean) * mean - 0.5 * unexplained.max(0.0);
        }
        let mut sums = Sums::zeros(points.len());
        sums.add(&features, &vec![1.0; shift.len()], &shift, &mut Matrix::default());
        sums.precision.mirror_lower();
        Ok(Self { features, shift, sums, bound })
    }
}
