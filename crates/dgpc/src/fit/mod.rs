//! Fitting: from events and a prior to sites, a posterior and the evidence bound, by mean field (sections 2 and 7 of
//! [`crate::method`]).

mod amended;
mod anderson;
mod cavity;
mod dense;
mod fixed_point;
mod mean_field;
mod natural;
mod newton;
mod options;
mod pass;
mod propagation;
mod single;
mod solve;
mod sparse;
mod sparse_gradient;
mod together;

#[cfg(feature = "learn")]
pub(crate) use cavity::corrected_evidence;
pub(crate) use mean_field::MeanField;
pub use options::FitOptions;
pub use propagation::Propagated;
pub use single::{absorb_observations, sites_given};
pub(crate) use solve::{solve, solve_with_gradient};

use amended::append;
use propagation::propagate;
use together::put_together;

use std::collections::HashMap;

use crate::cross::{Cross, residual};
use crate::error::Result;
use crate::inputs::Inputs;
use crate::latent::{Latent, success_probability};
use crate::likelihood::Likelihood;
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// A fitted mean field: what events say under a prior.
#[derive(Debug, Clone)]
pub struct Fit {
    prior: Prior,
    found: MeanField,
    /// What it was given of others.
    messages: Vec<Summary>,
    /// What a sparse fit says of its events, at its inducing points.
    condensed: Option<Summary>,
}

/// Fits `observations` by mean field: the ω that make the evidence bound E largest, and the Gaussian posterior that
/// goes with them. Dense, O(N³) an iteration and 4N² memory, or with [`FitOptions::inducing_points`] O(NM²) and O(N + M²)
/// memory beside 59 MB of covariances at most, for N events and observations that messages stand for.
///
/// ```
/// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
///
/// let inputs = Inputs::from_rows(&[[0.0], [1.0], [2.0], [3.0]])?;
/// let observations = Observations::new(inputs, vec![true, true, false, false])?;
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
/// let fit = fit(&Prior::new(kernel, PriorMean::Zero)?, &observations, &FitOptions::default())?;
/// assert!(fit.converged() && fit.mean()[0] > 0.0 && fit.mean()[3] < 0.0);
///
/// let probability = fit.posterior()?.probability(&Inputs::from_rows(&[[0.5], [2.5]])?)?;
/// assert!(probability[0] > 0.5 && probability[1] < 0.5);
/// # Ok::<(), dgpc::Error>(())
/// ```
///
/// # Errors
/// [`crate::Error::BadColumn`] when the prior needs columns that the inputs do not have; [`crate::Error::OutOfRange`]
/// or [`crate::Error::SizeMismatch`] for options that make no sense; [`crate::Error::NotPositiveDefinite`] when
/// inducing points coincide too closely for any small jitter; that or [`crate::Error::NotFinite`] when numbers near the
/// end of the range overflow; [`crate::Error::NegativeEigenvalue`] for a message that is none.
pub fn fit(prior: &Prior, observations: &Observations, options: &FitOptions<'_>) -> Result<Fit> {
    let likelihood = Likelihood::new(observations, options.messages)?;
    let support = options.support()?;
    let found = solve(prior, &likelihood, support.as_ref(), options)?;
    Fit::new(prior, found, support.as_ref(), options.messages)
}

impl Fit {
    pub(crate) fn new(
        prior: &Prior,
        mut found: MeanField,
        inducing_points: Option<&Inputs>,
        messages: &[&Summary],
    ) -> Result<Self> {
        let condense = |points| match found.condensed.take() {
            Some((precision, shift)) => Summary::from_whitened(prior, points, precision, shift),
            None => Summary::variational(prior, &found.sites, points),
        };
        let condensed = inducing_points.map(condense).transpose()?;
        let messages = messages.iter().map(|&message| message.clone()).collect();
        Ok(Self { prior: prior.clone(), found, messages, condensed })
    }

    /// The posterior that was fitted: of the events, and of the messages that the fit was given. At the events a dense one
    /// has [`Fit::mean`] and [`Fit::variance`], a sparse one the means as nearly as the iteration came. O(n³) for n events
    /// of a dense fit or M inducing points of a sparse one, and the inducing points of the messages.
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior(&self) -> Result<Posterior> {
        self.posterior_with(&self.messages.iter().collect::<Vec<_>>())
    }

    /// The posterior of the events and of `summaries`, in place of the messages that the fit was given: `&[]` for the
    /// events alone. The sites of the events stay as they are; summaries of another prior are read under that of the
    /// fit. As dear as [`Fit::posterior`].
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior_with(&self, summaries: &[&Summary]) -> Result<Posterior> {
        put_together(&self.prior, &self.found.sites, self.condensed.as_ref(), summaries)
    }

    /// The same of some of its events, by their places: what somebody knows who was told of these alone. Their sites stay as
    /// they are with all events. Of a sparse fit O(mM²) for the m events that are in or not in, whichever are fewer, beside O(n³) as
    /// for [`Fit::posterior`].
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
    ///
    /// let inputs = Inputs::from_rows(&[[0.0], [1.0], [5.0]])?;
    /// let observations = Observations::new(inputs.clone(), vec![true, true, false])?;
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
    /// let fit = fit(&Prior::new(kernel, PriorMean::Zero)?, &observations, &FitOptions::default())?;
    /// let told = fit.posterior_of_part(&[0, 1], &[])?.latent(&inputs)?;
    /// assert!(told.mean[0] > 0.5 && told.mean[2].abs() < 1e-3);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior_of_part(&self, events: &[usize], summaries: &[&Summary]) -> Result<Posterior> {
        let sites = self.found.sites.select(events);
        put_together(&self.prior, &sites, self.summary_of_part(events)?.as_ref(), summaries)
    }

    /// What some of the events of a sparse fit say at its inducing points: summed up, or all but the others, whichever are fewer. With
    /// [`Summary::observe`] and [`Summary::forget`] of [`Fit::sites`] it goes from one part to another. `None` of a dense fit. O(mM²).
    ///
    /// # Errors
    /// As [`Summary::variational`].
    pub fn summary_of_part(&self, events: &[usize]) -> Result<Option<Summary>> {
        let Some(all) = &self.condensed else { return Ok(None) };
        let others = self.others_than(events);
        // An event that is named twice counts twice.
        if others.len() >= events.len() || events.len() + others.len() > self.found.sites.len() {
            return Summary::variational(&self.prior, &self.found.sites.select(events), all.inducing_points())
                .map(Some);
        }
        let mut part = all.clone();
        part.forget(&self.found.sites.select(&others))?;
        Ok(Some(part))
    }

    /// The events that are not named.
    fn others_than(&self, events: &[usize]) -> Vec<usize> {
        let mut is_named = vec![false; self.found.sites.len()];
        events.iter().for_each(|&event| is_named[event] = true);
        (0..is_named.len()).filter(|&event| !is_named[event]).collect()
    }

    /// This sparse fit without some of its events, by their places, and with others behind those that stay: each at the site that it
    /// has beside all before it, told at the inducing points that are there. O(mM²) for m events that come or go, however many
    /// stay; `None` of a dense fit. What stays keeps its sites, so that this is not quite what a fit of all would find:
    /// [`Fit::mean`] and [`Fit::variance`] of these, [`Fit::evidence`], [`Fit::iterations`], [`Fit::change`] and
    /// [`Fit::converged`] are of the fit that they were found by.
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
    ///
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
    /// let prior = Prior::new(kernel, PriorMean::Zero)?;
    /// let points = Inputs::from_rows(&[[0.0], [1.0], [2.0]])?;
    /// let events = |x: &[[f64; 1]], y| Observations::new(Inputs::from_rows(x)?, y);
    /// let first = events(&[[0.0], [0.2], [0.4]], vec![true, true, true])?;
    /// let before = fit(&prior, &first, &FitOptions::default().inducing_points(&points))?;
    /// let after = before.amended(&[0], &events(&[[1.8], [2.0]], vec![false, false])?)?.expect("it is sparse");
    /// assert_eq!(after.sites().len(), 4);
    /// let far = Inputs::from_rows(&[[2.0]])?;
    /// assert!(after.posterior()?.probability(&far)? < before.posterior()?.probability(&far)?);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`crate::sites_given`] and [`Fit::posterior`].
    pub fn amended(&self, gone: &[usize], new: &Observations) -> Result<Option<Self>> {
        let Some(mut condensed) = self.condensed.clone() else { return Ok(None) };
        let staying = self.others_than(gone);
        // An event that is named twice goes once.
        condensed.forget(&self.found.sites.select(&self.others_than(&staying)))?;
        let found = self.found.select(&staying);
        let (prior, messages) = (self.prior.clone(), self.messages.clone());
        let mut amended = Self { prior, found, messages, condensed: Some(condensed) };
        let known = amended.posterior()?;
        let sites = append(&mut amended.found, known, new)?;
        if let Some(condensed) = &mut amended.condensed {
            condensed.observe(&sites)?;
            let cross = Cross::new(amended.prior.kernel(), condensed.inducing_points(), new.inputs())?;
            amended.found.residual.extend(residual(&cross, condensed.cholesky())?);
        }
        Ok(Some(amended))
    }

    /// Expectation propagation from the sites of this fit on, with `summaries` in place of the messages that the fit was
    /// given. The mean field's variances are too small, by a factor of several where all outcomes are of one kind; these are
    /// nearly those of the exact posterior. Ten to thirty iterations, each as dear as one of the fit.
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
    ///
    /// let inputs = Inputs::from_rows(&[[0.0], [0.1], [0.2], [0.3]])?;
    /// let observations = Observations::new(inputs.clone(), vec![true; 4])?;
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 16.0, 1.0, 1)?])?;
    /// let fit = fit(&Prior::new(kernel, PriorMean::Zero)?, &observations, &FitOptions::default())?;
    /// let wide = fit.propagated_with(&[])?.posterior()?.latent(&inputs)?;
    /// assert!(wide.variance[0] > 1.5 * fit.variance()[0]);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`fit`].
    pub fn propagated_with(&self, summaries: &[&Summary]) -> Result<Propagated> {
        let inducing_points = self.condensed.as_ref().map(Summary::inducing_points);
        propagate(&self.prior, &self.found, inducing_points, summaries)
    }

    /// The prior that it was fitted under.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// The Gaussian sites of the events at the mean ω̄ = tanh(c/2)/(2c).
    pub fn sites(&self) -> &Sites {
        &self.found.sites
    }

    /// The inducing points of a sparse fit, those of its messages included; `None` of a dense one.
    pub fn inducing_points(&self) -> Option<&Inputs> {
        self.condensed.as_ref().map(Summary::inducing_points)
    }

    /// Posterior means of f at the events, N.
    pub fn mean(&self) -> &[f64] {
        &self.found.mean
    }

    /// Posterior variances of f at the events, N.
    pub fn variance(&self) -> &[f64] {
        &self.found.variance
    }

    /// What [`Fit::posterior`] says at points each of which is an event of this fit, as far as the prior looks: known
    /// from the fit, so that nothing is solved. `None` where one is no event, and of a sparse fit, whose variances are others. O(N ·
    /// columns).
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
    ///
    /// let events = Observations::new(Inputs::from_rows(&[[0.0], [1.0], [2.0]])?, vec![true, true, false])?;
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
    /// let fit = fit(&Prior::new(kernel, PriorMean::Zero)?, &events, &FitOptions::default())?;
    /// let known = fit.latent_at_events(&Inputs::from_rows(&[[2.0], [0.0]])?).expect("two of its events");
    /// assert_eq!(known.mean, [fit.mean()[2], fit.mean()[0]]);
    /// assert_eq!(fit.latent_at_events(&Inputs::from_rows(&[[0.5]])?), None);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    pub fn latent_at_events(&self, inputs: &Inputs) -> Option<Latent> {
        if self.condensed.is_some() {
            return None;
        }
        let columns = self.prior.columns();
        let seen = |row: &[f64]| columns.iter().map(|&column| row.get(column).map(|x| x.to_bits())).collect::<Vec<_>>();
        let events: HashMap<_, usize> = self.found.sites.inputs().rows().map(seen).zip(0..).collect();
        let places = inputs.rows().map(|row| events.get(&seen(row)).copied()).collect::<Option<Vec<usize>>>()?;
        let at = |values: &[f64]| places.iter().map(|&place| values[place]).collect();
        Some(Latent { mean: at(&self.found.mean), variance: at(&self.found.variance) })
    }

    /// Probabilities of success at the events, N.
    pub fn probabilities(&self) -> Vec<f64> {
        let moments = self.found.mean.iter().zip(&self.found.variance);
        moments.map(|(&mean, &variance)| success_probability(mean, variance)).collect()
    }

    /// Tilts c_n = √E\[f_n²\] that ω̄ was computed from, N.
    pub fn tilts(&self) -> &[f64] {
        &self.found.tilts
    }

    /// How much each event counts, N.
    pub fn weights(&self) -> &[f64] {
        &self.found.weights
    }

    /// The evidence bound E, in nats: a lower bound on the log marginal likelihood.
    pub fn evidence(&self) -> f64 {
        self.found.evidence
    }

    /// Iterations used.
    pub fn iterations(&self) -> usize {
        self.found.iterations
    }

    /// Largest change of a tilt in the last iteration.
    pub fn change(&self) -> f64 {
        self.found.change
    }

    /// Whether [`Fit::change`] came below the tolerance.
    pub fn converged(&self) -> bool {
        self.found.converged
    }

    /// What was added to the diagonal of K_MM (0 for a dense fit, which factorises nothing but I + Ω^½KΩ^½).
    pub fn jitter(&self) -> f64 {
        self.found.jitter
    }

    /// ln p(y_n | all other events), nearly: what every event's posterior becomes when its own site is taken away,
    /// without a second fit. Optimistic, because ω_n has seen y_n, and the more so the larger the variance. Weights do
    /// not count. N, in nats. O(N) (section 7 of [`crate::method`]).
    pub fn leave_one_out(&self) -> Vec<f64> {
        cavity::leave_one_out(&self.found)
    }

    /// E with its slack taken out event by event: the Gaussian site that bounds an event's likelihood from below is
    /// replaced by the likelihood itself, integrated against what all other events say. No bound any more, but much
    /// nearer to the log marginal likelihood: expectation propagation's estimate of it, at the sites of the mean field.
    /// O(N) (section 7 of [`crate::method`]).
    pub fn corrected_evidence(&self) -> f64 {
        cavity::corrected_evidence(&self.found)
    }
}
