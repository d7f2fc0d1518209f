//! The mean field, as dense and sparse iterations return it.

use super::stagnation::FitStop;
use crate::linalg::Matrix;
use crate::sites::Sites;

/// Smallest tilt. Below it, ω̄ differs from its limit ¼ by less than rounding.
pub(super) const TILT_MIN: f64 = 1e-9;

/// Default initial tilt.
pub(super) const TILT_START: f64 = 1.0;

/// Returns ω̄ of an event at its tilt. The result is never zero.
pub(super) fn omega(weight: f64, tilt: f64) -> f64 {
    omega_and_ln_2_cosh(weight, tilt).0
}

/// Returns ω̄ of an event at its tilt, never zero, and ln 2 cosh(c/2). Both need the same exponential.
pub(super) fn omega_and_ln_2_cosh(weight: f64, tilt: f64) -> (f64, f64) {
    // exp_m1 computes e^−c − 1 without cancellation, so tanh(c/2) is accurate in all digits.
    let loss = (-tilt).exp_m1();
    let tanh = -loss / (2.0 + loss);
    ((0.5 * weight * tanh / tilt).max(f64::MIN_POSITIVE), 0.5 * tilt + (2.0 + loss).ln())
}

/// The end of a mean-field iteration. Every list has one entry per event.
#[derive(Debug, Clone)]
pub(crate) struct MeanField {
    /// The sites at the mean ω̄ = tanh(c/2)/(2c).
    pub(crate) sites: Sites,
    /// Posterior means of f at the events.
    pub(crate) mean: Vec<f64>,
    /// Posterior variances of f at the events.
    pub(crate) variance: Vec<f64>,
    /// The part of `variance` that inducing points leave unexplained; zeros for a dense fit.
    pub(crate) residual: Vec<f64>,
    /// The tilts c_n = √E\[f_n²\] from which ω̄ was computed.
    pub(crate) tilts: Vec<f64>,
    /// E, in nats.
    pub(crate) evidence: f64,
    pub(crate) iterations: usize,
    /// Largest change of a tilt in the last iteration.
    pub(crate) change: f64,
    pub(crate) stop: FitStop,
    /// Jitter on the diagonal of K_MM.
    pub(crate) jitter: f64,
    /// Weights of the events.
    pub(crate) weights: Vec<f64>,
    /// Ĝ and b̂ of the events of a sparse fit at its inducing points.
    pub(crate) condensed: Option<(Matrix, Vec<f64>)>,
}

impl MeanField {
    /// Returns the mean field of some of the events, by their indices. Their sites and moments stay as they are.
    pub(super) fn select(&self, events: &[usize]) -> Self {
        let of = |values: &[f64]| events.iter().map(|&event| values[event]).collect();
        Self {
            sites: self.sites.select(events),
            mean: of(&self.mean),
            variance: of(&self.variance),
            residual: of(&self.residual),
            tilts: of(&self.tilts),
            weights: of(&self.weights),
            condensed: None,
            ..*self
        }
    }
}
