//! Distance of a sparse posterior from the full posterior: bounds on the log evidence given ω, and the KL certificate
//! ([`crate::method::inducing_points`]).

use crate::cross::{Cross, Sums, condense, kept_max, residual};
use crate::error::{Result, finite};
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, fill_scaled, squared_norm};
use crate::prior::Prior;
use crate::sites::Sites;

/// Bounds on KL\[sparse posterior ‖ full posterior\] given ω: the information that a few inducing points omit. No N×N
/// matrix is formed.
///
/// KL ≤ `gap` ≤ `closed_form`, and KL ≤ `gap` ≤ `paper_closed_form`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Certificate {
    /// tr K̃: the prior variance at the events that the inducing points leave unexplained. The selection policies
    /// minimise it.
    pub trace: f64,
    /// Lower bound on log p(y | ω), up to a constant that all bounds share.
    pub lower: f64,
    /// Upper bound on log p(y | ω), up to the same constant.
    pub upper: f64,
    /// `upper` − `lower`: the certificate, in nats.
    pub gap: f64,
    /// ½ p λ + ½ p λ² ‖c‖² / (1 + p λ), with p = tr K̃ and λ = max ω. It vanishes with the trace.
    pub closed_form: f64,
    /// The paper's closed form ½ p λ + ½ ‖κ̃‖² / min ω. It does not vanish with the trace.
    pub paper_closed_form: f64,
    /// Jitter that was added to the diagonal of K_MM to factorise it (ordinarily 0).
    pub jitter: f64,
}

impl Certificate {
    /// Computes the certificate for summarising `sites` by `inducing_points`. O(NM²).
    ///
    /// # Errors
    /// * [`crate::Error::NotPositiveDefinite`] if inducing points coincide too closely for any small jitter.
    /// * [`crate::Error::BadColumn`] if the prior needs columns that inputs do not have.
    /// * [`crate::Error::NotFinite`] if numbers near the end of the floating-point range overflow.
    pub fn new(prior: &Prior, sites: &Sites, inducing_points: &Inputs) -> Result<Self> {
        let points = Cholesky::with_jitter("K_MM", &prior.kernel().gram(inducing_points)?)?;
        let cross = Cross::new(prior.kernel(), inducing_points, sites.inputs())?.kept(kept_max(sites.len()))?;
        let residual = residual(&cross, &points)?;
        let shift = sites.shift(prior.mean())?;
        let trace: f64 = residual.iter().sum();
        let omega = sites.omega();
        let largest = omega.iter().copied().fold(0.0, f64::max);
        let smallest = omega.iter().copied().fold(f64::INFINITY, f64::min);

        let (half_log, fit) = gaussian_terms((&cross, &points), omega, &shift, 0.0)?;
        let (_, slack_fit) = gaussian_terms((&cross, &points), omega, &shift, trace)?;
        let weighted_trace: f64 = omega.iter().zip(&residual).map(|(omega, residual)| omega * residual).sum();
        let lower = -half_log - 0.5 * fit - 0.5 * weighted_trace;
        let upper = -half_log - 0.5 * slack_fit;

        let target: f64 = shift.iter().zip(omega).map(|(shift, omega)| (shift / omega).powi(2)).sum();
        let spread = trace * largest;
        let closed_form = 0.5 * spread + 0.5 * spread * largest * target / (1.0 + spread);
        let paper_closed_form =
            if sites.is_empty() { 0.0 } else { 0.5 * spread + 0.5 * squared_norm(&shift) / smallest };
        let jitter = points.jitter();
        let bounds = [trace, lower, upper, closed_form, paper_closed_form];
        bounds.into_iter().try_for_each(|bound| finite("bound of a certificate", bound).map(drop))?;
        Ok(Self { trace, lower, upper, gap: (upper - lower).max(0.0), closed_form, paper_closed_form, jitter })
    }

    /// Returns the bounded divergence itself, in nats: the [`log_evidence`] of the same sites minus `lower`.
    pub fn divergence(&self, log_evidence: f64) -> f64 {
        // If the points explain everything, the difference is a rounding error of either sign.
        (log_evidence - self.lower).max(0.0)
    }
}

/// Returns ½ ln|A| for A = Ω⁻¹ + Q, and cᵀ(A + pI)⁻¹c for p = `slack`. Both use Woodbury's formula and cost O(NM²). The
/// first result is meaningful only if p = 0.
fn gaussian_terms(
    (cross, points): (&Cross<'_>, &Cholesky),
    omega: &[f64],
    shift: &[f64],
    slack: f64,
) -> Result<(f64, f64)> {
    // Ω_p = (Ω⁻¹ + pI)⁻¹ and Ω_p c, in a form that is exact for p = 0.
    let damped: Vec<f64> = omega.iter().map(|omega| omega / (1.0 + slack * omega)).collect();
    let target: Vec<f64> = shift.iter().zip(omega).map(|(shift, omega)| shift / (1.0 + slack * omega)).collect();
    let Sums { mut precision, shift: mut explained } = condense(cross, points, &damped, &target)?;
    precision.add_to_diagonal(1.0);
    let cholesky = Cholesky::new("I + ΦᵀΩΦ", precision)?;
    cholesky.solve_lower(&mut explained);
    let whole: f64 = shift.iter().zip(omega).zip(&target).map(|((shift, omega), target)| shift / omega * target).sum();
    let log_omega: f64 = omega.iter().map(|omega| omega.ln()).sum();
    Ok((0.5 * (cholesky.log_determinant() - log_omega), whole - squared_norm(&explained)))
}

/// Returns log p(y | ω) = −½ ln|Ω⁻¹ + K| − ½ cᵀ(Ω⁻¹ + K)⁻¹c, up to the constant that [`Certificate`] omits, too. O(N³).
///
/// # Errors
/// [`crate::Error::BadColumn`] if the prior needs columns that the inputs do not have, [`crate::Error::NotFinite`]
/// if numbers near the end of the floating-point range overflow.
pub fn log_evidence(prior: &Prior, sites: &Sites) -> Result<f64> {
    let gram = prior.kernel().gram(sites.inputs())?;
    let roots: Vec<f64> = sites.omega().iter().map(|omega| omega.sqrt()).collect();
    let mut system = Matrix::zeros(sites.len(), sites.len());
    fill_scaled(&mut system, &gram, &roots);
    let cholesky = Cholesky::new("I + Ω^½KΩ^½", system)?;
    let mut target: Vec<f64> =
        sites.shift(prior.mean())?.iter().zip(&roots).map(|(shift, root)| shift / root).collect();
    cholesky.solve_lower(&mut target);
    let log_omega: f64 = sites.omega().iter().map(|omega| omega.ln()).sum();
    finite("log evidence", -0.5 * (cholesky.log_determinant() - log_omega) - 0.5 * squared_norm(&target))
}
