//! Cavities: the latent function at an event given all other events, without a second fit
//! ([`crate::method::learning`]).

use super::mean_field::MeanField;
use crate::latent::success_probability;
use crate::polya_gamma;
use crate::special::ln_2_cosh;

/// Returns the approximate ln p(y_n | all other events) of every event.
pub(super) fn leave_one_out(fit: &MeanField) -> Vec<f64> {
    (0..fit.mean.len()).map(|n| Cavity::of(fit, n).log_predictive()).collect()
}

/// Returns E with every event's site replaced by its likelihood, integrated against its cavity.
pub(crate) fn corrected_evidence(fit: &MeanField) -> f64 {
    let slack = |n: usize| {
        let cavity = Cavity::of(fit, n);
        fit.weights[n] * (cavity.log_predictive() - cavity.log_site(fit.tilts[n]))
    };
    fit.evidence + (0..fit.mean.len()).map(slack).sum::<f64>()
}

/// Moments of the latent function at an event, without the event's own site.
struct Cavity {
    kappa: f64,
    mean: f64,
    explained: f64,
    /// The variance that inducing points leave unexplained.
    residual: f64,
}

impl Cavity {
    /// Returns the cavity of event `n` of a fit.
    fn of(fit: &MeanField, n: usize) -> Self {
        let (omega, kappa) = (fit.sites.omega()[n], fit.sites.kappa()[n]);
        // Sites change only the explained variance. explained⁻¹ − ω is positive except for rounding.
        let explained = (fit.variance[n] - fit.residual[n]).max(0.0);
        let share = (1.0 - omega * explained).max(f64::EPSILON);
        let mean = (fit.mean[n] - explained * kappa) / share;
        Self { kappa: 0.5 * kappa.signum(), mean, explained: explained / share, residual: fit.residual[n] }
    }

    /// Returns ln of the probability of the event's outcome.
    fn log_predictive(&self) -> f64 {
        let probability = success_probability(self.mean * self.kappa.signum(), self.explained + self.residual);
        probability.max(f64::MIN_POSITIVE).ln()
    }

    /// Returns ln of the integral of the event's Gaussian site exp(κf − ½ωf² + ½ωc² − ln 2cosh(c/2)).
    fn log_site(&self, tilt: f64) -> f64 {
        let Cavity { kappa, mean, explained, residual } = self;
        let omega = polya_gamma::mean(1.0, tilt);
        let share = 1.0 + omega * explained;
        let quadratic = kappa * mean + 0.5 * kappa * kappa * explained - 0.5 * omega * mean * mean;
        0.5 * omega * (tilt * tilt - residual) - ln_2_cosh(0.5 * tilt) + quadratic / share - 0.5 * share.ln()
    }
}
