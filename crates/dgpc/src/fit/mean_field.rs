//! What a mean field is, by whichever Gaussian posterior it was found.

use crate::linalg::Matrix;
use crate::sites::Sites;

/// Tilts below this are this: ω̄ differs from its limit ¼ by less than rounding.
pub(super) const TILT_MIN: f64 = 1e-9;

/// Where tilts start from unless somebody knows better.
pub(super) const TILT_START: f64 = 1.0;

/// ω̄ of an event at its tilt, never zero.
pub(super) fn omega(weight: f64, tilt: f64) -> f64 {
    omega_and_ln_2_cosh(weight, tilt).0
}

/// ω̄ of an event at its tilt, never zero, and ln 2 cosh(c/2), both from one exponential.
pub(super) fn omega_and_ln_2_cosh(weight: f64, tilt: f64) -> (f64, f64) {
    // e^−c − 1, of which tanh(c/2) has all digits.
    let loss = (-tilt).exp_m1();
    let tanh = -loss / (2.0 + loss);
    ((0.5 * weight * tanh / tilt).max(f64::MIN_POSITIVE), 0.5 * tilt + (2.0 + loss).ln())
}

/// Where the iteration ended. One entry per event in every list.
#[derive(Debug, Clone)]
pub(crate) struct MeanField {
    /// At the mean ω̄ = tanh(c/2)/(2c).
    pub(crate) sites: Sites,
    /// Posterior means of f at the events.
    pub(crate) mean: Vec<f64>,
    /// Posterior variances of f at the events.
    pub(crate) variance: Vec<f64>,
    /// The part of `variance` that inducing points leave unexplained; zeros without any.
    pub(crate) residual: Vec<f64>,
    /// c_n = √E\[f_n²\] that ω̄ was computed from.
    pub(crate) tilts: Vec<f64>,
    /// E, in nats.
    pub(crate) evidence: f64,
    pub(crate) iterations: usize,
    /// Largest change of a tilt in the last iteration.
    pub(crate) change: f64,
    /// Whether `change` came below the tolerance.
    pub(crate) converged: bool,
    /// What was added to the diagonal of K_MM.
    pub(crate) jitter: f64,
    /// Weights of the events.
    pub(crate) weights: Vec<f64>,
    /// What a sparse fit says of its events at its inducing points: Ĝ and b̂.
    pub(crate) condensed: Option<(Matrix, Vec<f64>)>,
}

impl MeanField {
    /// The same of some of the events, by their places: what is known of each stays as it is.
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
