//! Summaries: Gaussian messages about the latent function at a few inducing points ([`crate::method::summaries`]).

use std::borrow::Cow;

use crate::cross::{Cross, condense};
use crate::error::{Error, Result, all_finite, same_size};
use crate::factor::Factor;
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, fill_scaled, product, semidefinite_root, symmetric_eigen};
use crate::prior::Prior;
use crate::sites::Sites;

/// Name of Ĝ in errors.
const PRECISION: &str = "summary precision";

/// A Gaussian message about f at M inducing points Z, under a prior.
///
/// The message is stored whitened. With K_ZZ = LLᵀ these are the precision Ĝ = L⁻¹GL⁻ᵀ and the shift b̂ = L⁻¹b, both
/// independent of the conditioning of K_ZZ. Summaries of one prior and one Z form a commutative group:
/// [`Summary::merge`] adds, [`Summary::subtract`] subtracts.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Summary {
    prior: Prior,
    inducing_points: Inputs,
    cholesky: Cholesky,
    precision: Matrix,
    shift: Vec<f64>,
}

impl Summary {
    /// Creates a summary without information: Ĝ = 0, b̂ = 0. O(M³).
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] if inducing points coincide too closely for any small jitter;
    /// [`Error::BadColumn`] if the prior needs columns that the points do not have.
    pub fn empty(prior: &Prior, inducing_points: &Inputs) -> Result<Self> {
        let points = inducing_points.len();
        Self::from_whitened(prior, inducing_points, Matrix::zeros(points, points), vec![0.0; points])
    }

    /// Creates a summary from its whitened parts, Ĝ (M×M, positive semi-definite) and b̂ (M). Only the symmetric part
    /// of Ĝ is used. O(M³).
    ///
    /// # Errors
    /// As [`Summary::empty`], [`Error::SizeMismatch`], and [`Error::NotFinite`]. Negative eigenvalues of Ĝ are not
    /// detected here but when the summary is used.
    pub fn from_whitened(prior: &Prior, inducing_points: &Inputs, precision: Matrix, shift: Vec<f64>) -> Result<Self> {
        let points = inducing_points.len();
        same_size("rows of a summary's precision, one per inducing point", points, precision.rows())?;
        same_size("columns of a summary's precision, one per inducing point", points, precision.columns())?;
        same_size("entries of a summary's shift, one per inducing point", points, shift.len())?;
        prior.check(inducing_points)?;
        all_finite("summary shift", &shift)?;
        precision.check_finite(PRECISION)?;
        let mut precision = precision;
        precision.symmetrise();
        let cholesky = Cholesky::with_jitter("K_MM", &prior.kernel().gram(inducing_points)?)?;
        Ok(Self { prior: prior.clone(), inducing_points: inducing_points.clone(), cholesky, precision, shift })
    }

    /// Creates the variational summary of `sites` (the paper's): G = K_MN Ω K_NM, b = K_MN κ̃. It is additive over
    /// events. It ignores the part of the prior variance that the inducing points do not explain. O(NM²).
    ///
    /// # Errors
    /// As [`Summary::empty`].
    pub fn variational(prior: &Prior, sites: &Sites, inducing_points: &Inputs) -> Result<Self> {
        let mut summary = Self::empty(prior, inducing_points)?;
        summary.observe(sites)?;
        Ok(summary)
    }

    /// Creates the marginal summary of `sites`: the exact message of these events about f(Z), with (K̃ + Ω⁻¹)⁻¹ in
    /// place of Ω. It is never overconfident, and not additive over events. O(N³ + NM²).
    ///
    /// # Errors
    /// As [`Summary::empty`].
    pub fn marginal(prior: &Prior, sites: &Sites, inducing_points: &Inputs) -> Result<Self> {
        let mut summary = Self::empty(prior, inducing_points)?;
        if sites.is_empty() {
            return Ok(summary);
        }
        let mut features = prior.kernel().cross(inducing_points, sites.inputs())?;
        summary.cholesky.solve_lower_matrix(&mut features);
        // K̃ = K_NN − ΦΦᵀ; B = I + Ω^½K̃Ω^½ = L_bL_bᵀ; V = L_b⁻¹Ω^½Φ.
        let mut residual = prior.kernel().gram(sites.inputs())?;
        residual.add_scaled(-1.0, &product(features.t(), features.view()));
        let roots: Vec<f64> = sites.omega().iter().map(|omega| omega.sqrt()).collect();
        let mut b = Matrix::zeros(sites.len(), sites.len());
        fill_scaled(&mut b, &residual, &roots);
        let b = Cholesky::new("I + Ω^½K̃Ω^½", b)?;
        let mut v = Matrix::from_fn(sites.len(), inducing_points.len(), |n, m| roots[n] * features[(m, n)]);
        b.solve_lower_matrix(&mut v);
        let mut target: Vec<f64> =
            sites.shift(prior.mean())?.iter().zip(&roots).map(|(shift, root)| shift / root).collect();
        b.solve_lower(&mut target);
        summary.precision = product(v.t(), v.view());
        summary.precision.symmetrise();
        summary.shift = v.transposed_times(&target);
        Ok(summary)
    }

    /// Creates the message that turns the prior at Z into the posterior of the given moments: the mean minus the prior
    /// mean (M), and the covariance (M×M, not above the prior's).
    pub(crate) fn from_moments(
        prior: &Prior,
        inducing_points: &Inputs,
        mean: &[f64],
        covariance: &Matrix,
    ) -> Result<Self> {
        let mut summary = Self::empty(prior, inducing_points)?;
        // S = L⁻¹ΣL⁻ᵀ has eigenvalues in (0, 1]; Ĝ = S⁻¹ − I, b̂ = S⁻¹L⁻¹m.
        let mut whitened = summary.cholesky.whiten(covariance.clone());
        whitened.symmetrise();
        let (values, vectors) = symmetric_eigen("posterior covariance at the inducing points", &whitened)?;
        let mut target = mean.to_vec();
        summary.cholesky.solve_lower(&mut target);
        let mut scaled = vectors.clone();
        let mut rotated = vectors.transposed_times(&target);
        for (column, value) in values.iter().enumerate() {
            let value = value.clamp(f64::EPSILON, 1.0);
            let gain = 1.0 / value - 1.0;
            scaled.column_mut(column).iter_mut().for_each(|entry| *entry *= gain);
            rotated[column] /= value;
        }
        summary.precision = product(scaled.view(), vectors.t());
        summary.precision.symmetrise();
        summary.shift = vectors.times(&rotated);
        Ok(summary)
    }

    /// Adds the variational message of more events. O(NM²).
    ///
    /// # Errors
    /// [`Error::BadColumn`] or [`Error::SizeMismatch`] if the events' inputs do not fit.
    pub fn observe(&mut self, sites: &Sites) -> Result<()> {
        self.observe_times(1.0, sites)
    }

    /// Removes the variational message of events that were added with [`Summary::observe`]. O(NM²).
    ///
    /// # Errors
    /// As [`Summary::observe`].
    pub fn forget(&mut self, sites: &Sites) -> Result<()> {
        self.observe_times(-1.0, sites)
    }

    fn observe_times(&mut self, factor: f64, sites: &Sites) -> Result<()> {
        if sites.is_empty() || self.is_empty() {
            return Ok(());
        }
        let cross = Cross::new(self.prior.kernel(), &self.inducing_points, sites.inputs())?;
        let message = condense(&cross, &self.cholesky, sites.omega(), &sites.shift(self.prior.mean())?)?;
        self.add(factor, &message.precision, &message.shift);
        Ok(())
    }

    /// Adds the message of another summary at the same points. The sum is the message of both sets of events. O(M²).
    ///
    /// # Errors
    /// [`Error::DifferentPriors`] or [`Error::DifferentInducingPoints`].
    pub fn merge(&mut self, other: &Summary) -> Result<()> {
        self.check_alike(other)?;
        self.add(1.0, &other.precision, &other.shift);
        Ok(())
    }

    /// Subtracts the message of another summary at the same points. The result is a valid message only if the events
    /// of the other summary are among those of this summary.
    ///
    /// # Errors
    /// [`Error::DifferentPriors`] or [`Error::DifferentInducingPoints`].
    pub fn subtract(&mut self, other: &Summary) -> Result<()> {
        self.check_alike(other)?;
        self.add(-1.0, &other.precision, &other.shift);
        Ok(())
    }

    /// Returns the message that turns the posterior of `known` at Z into the posterior of this summary. A receiver that
    /// holds `known` lacks exactly this message.
    ///
    /// `known` can be more certain than this summary, because messages were rounded or the fit moved since. The
    /// residual takes no precision back: the difference of the precisions is clipped to positive semi-definite. The
    /// shift is chosen so that the means agree nevertheless. O(M³).
    ///
    /// # Errors
    /// [`Error::DifferentPriors`] or [`Error::DifferentInducingPoints`], and as [`Summary::moments`].
    pub fn residual(&self, known: &Summary) -> Result<Summary> {
        self.check_alike(known)?;
        let mut difference = self.precision.clone();
        difference.add_scaled(-1.0, &known.precision);
        difference.symmetrise();
        let (values, vectors) = symmetric_eigen("difference of two precisions", &difference)?;
        let mut scaled = vectors.clone();
        for (column, value) in values.iter().enumerate() {
            scaled.column_mut(column).iter_mut().for_each(|entry| *entry *= value.max(0.0));
        }
        let mut precision = product(scaled.view(), vectors.t());
        precision.symmetrise();
        let mut total = precision.clone();
        total.add_scaled(1.0, &known.precision);
        let mean = self.whitened_mean()?;
        let shift =
            mean.iter().zip(total.times(&mean)).zip(&known.shift).map(|((m, t), known)| m + t - known).collect();
        Ok(Self { precision, shift, ..self.clone() })
    }

    /// Returns L⁻¹(μ − μ₀(Z)) = (I + Ĝ)⁻¹b̂: the whitened mean of f(Z) given this message alone. O(M³).
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] if I + Ĝ is not.
    pub fn whitened_mean(&self) -> Result<Vec<f64>> {
        let mut mean = self.shift.clone();
        self.total()?.solve(&mut mean);
        Ok(mean)
    }

    /// Returns the Cholesky factor of I + Ĝ.
    pub(crate) fn total(&self) -> Result<Cholesky> {
        let mut total = self.precision.clone();
        total.add_to_diagonal(1.0);
        Cholesky::new("I + Ĝ", total)
    }

    fn check_alike(&self, other: &Summary) -> Result<()> {
        if self.prior != other.prior {
            return Err(Error::DifferentPriors { what: "two summaries" });
        }
        if self.inducing_points != other.inducing_points {
            return Err(Error::DifferentInducingPoints);
        }
        Ok(())
    }

    /// Returns the message with its factor raised to the power `share`, so that it carries less information. Values of
    /// `share` below 0 count as 0, values above 1 as 1. O(M²).
    #[must_use]
    pub fn tempered(&self, share: f64) -> Summary {
        let share = if share > 0.0 { share.min(1.0) } else { 0.0 };
        let mut tempered = self.clone();
        tempered.add(share - 1.0, &self.precision, &self.shift);
        tempered
    }

    fn add(&mut self, factor: f64, precision: &Matrix, shift: &[f64]) {
        self.precision.add_scaled(factor, precision);
        self.shift.iter_mut().zip(shift).for_each(|(own, other)| *own += factor * other);
    }

    /// Returns the message that has the same kernel-free factor under another prior. With L_s from this summary's prior
    /// and L_r from the other, Ĝ_r = L_rᵀL_s⁻ᵀĜL_s⁻¹L_r. No matrix is inverted. O(M³).
    ///
    /// # Errors
    /// As [`Summary::empty`].
    pub fn under(&self, prior: &Prior) -> Result<Summary> {
        let mut other = Self::empty(prior, &self.inducing_points)?;
        // A = L_s⁻¹L_r.
        let mut change = other.cholesky.lower();
        self.cholesky.solve_lower_matrix(&mut change);
        let half = product(self.precision.view(), change.view());
        other.precision = product(change.t(), half.view());
        other.precision.symmetrise();
        // The shift is relative to the prior mean: b gains P(μ₀ of the old prior − μ₀ of the new one).
        let old_mean = self.prior.mean().values(&self.inducing_points)?;
        let new_mean = prior.mean().values(&self.inducing_points)?;
        let mut moved: Vec<f64> = old_mean.iter().zip(&new_mean).map(|(old, new)| old - new).collect();
        self.cholesky.solve_lower(&mut moved);
        let gained = self.precision.times(&moved);
        let shift: Vec<f64> = self.shift.iter().zip(&gained).map(|(shift, gained)| shift + gained).collect();
        other.shift = change.transposed_times(&shift);
        Ok(other)
    }

    /// Returns the message under `prior`. The summary itself is borrowed if it was formed under that prior.
    ///
    /// # Errors
    /// As [`Summary::under`].
    pub fn read_under(&self, prior: &Prior) -> Result<Cow<'_, Summary>> {
        if self.prior == *prior { Ok(Cow::Borrowed(self)) } else { self.under(prior).map(Cow::Owned) }
    }

    /// Returns the message of a kernel-free factor under a prior: Ĝ = LᵀPL, b̂ = Lᵀ(η − Pμ₀(Z)). O(M³).
    ///
    /// # Errors
    /// As [`Summary::empty`].
    pub fn from_factor(prior: &Prior, factor: &Factor) -> Result<Summary> {
        let mut summary = Self::empty(prior, factor.inducing_points())?;
        let lower = summary.cholesky.lower();
        let half = product(factor.precision().view(), lower.view());
        summary.precision = product(lower.t(), half.view());
        summary.precision.symmetrise();
        let offset = factor.precision().times(&prior.mean().values(factor.inducing_points())?);
        let shift: Vec<f64> = factor.shift().iter().zip(&offset).map(|(shift, offset)| shift - offset).collect();
        summary.shift = lower.transposed_times(&shift);
        summary.precision.check_finite(PRECISION)?;
        all_finite("summary shift", &summary.shift)?;
        Ok(summary)
    }

    /// Returns the number of inducing points M.
    pub fn len(&self) -> usize {
        self.inducing_points.len()
    }

    /// Returns whether there are no inducing points.
    pub fn is_empty(&self) -> bool {
        self.inducing_points.is_empty()
    }

    /// Returns the prior under which the message was formed.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// Returns the inducing points Z, M×d.
    pub fn inducing_points(&self) -> &Inputs {
        &self.inducing_points
    }

    /// Returns the whitened precision Ĝ, M×M.
    pub fn whitened_precision(&self) -> &Matrix {
        &self.precision
    }

    /// Returns the whitened shift b̂, M.
    pub fn whitened_shift(&self) -> &[f64] {
        &self.shift
    }

    /// Returns the jitter that was added to the diagonal of K_MM to factorise it (ordinarily 0).
    pub fn jitter(&self) -> f64 {
        self.cholesky.jitter()
    }

    pub(crate) fn cholesky(&self) -> &Cholesky {
        &self.cholesky
    }

    /// Returns R with Ĝ = RRᵀ, M×M: the Cholesky factor if Ĝ is positive definite, which takes a tenth of the time of
    /// eigenvectors. If rounding made eigenvalues negative, they become 0.
    ///
    /// # Errors
    /// As [`semidefinite_root`].
    pub(crate) fn root(&self) -> Result<Matrix> {
        let factor = Cholesky::new(PRECISION, self.precision.clone());
        factor.map_or_else(|_| self.root_above(0.0), |factor| Ok(factor.lower()))
    }

    /// Returns R with Ĝ = RRᵀ, M×M, with the eigenvalues below `floor` raised to `floor`.
    ///
    /// # Errors
    /// As [`semidefinite_root`].
    pub(crate) fn root_above(&self, floor: f64) -> Result<Matrix> {
        semidefinite_root(PRECISION, &self.precision, floor)
    }
}

/// The serialised form of [`Summary`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    prior: Prior,
    inducing_points: Inputs,
    whitened_precision: Matrix,
    whitened_shift: Vec<f64>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Summary {
    type Error = Error;

    fn try_from(parts: Parts) -> Result<Self> {
        Self::from_whitened(&parts.prior, &parts.inducing_points, parts.whitened_precision, parts.whitened_shift)
    }
}

#[cfg(feature = "serde")]
impl From<Summary> for Parts {
    fn from(Summary { prior, inducing_points, precision, shift, .. }: Summary) -> Self {
        Self { prior, inducing_points, whitened_precision: precision, whitened_shift: shift }
    }
}
