//! Fitting: mean field from events and a prior to sites, a posterior and the evidence bound
//! ([`crate::method::inference`] and [`crate::method::learning`]).

mod append;
mod anderson;
mod cavity;
mod dense;
mod fixed_point;
mod mean_field;
mod newton;
mod options;
mod pass;
mod posterior;
mod propagation;
mod single;
mod solve;
mod sparse;
mod stagnation;

#[cfg(feature = "learn")]
pub(crate) use cavity::corrected_evidence;
pub(crate) use dense::DenseEngines;
pub(crate) use mean_field::MeanField;
pub use options::FitOptions;
pub use propagation::Propagated;
pub use single::{absorb_observations, sites_given};
#[cfg(feature = "learn")]
pub(crate) use solve::solve_with;
pub(crate) use solve::{solve, solve_with_gradient};
pub use sparse::{Shard, ShardContribution, ShardRequest, ShardedFit};
pub use stagnation::FitStop;

use append::append;
use posterior::posterior_of;
use propagation::propagate;

use std::collections::HashMap;

use crate::cross::{Cross, residual};
use crate::error::Result;
use crate::inputs::Inputs;
use crate::latent::{Latent, success_probability};
use crate::likelihood::Likelihood;
use crate::monitor::Monitor;
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// A fitted mean field: the Gaussian approximation to the posterior of events under a prior.
#[derive(Debug, Clone)]
pub struct Fit {
    prior: Prior,
    mean_field: MeanField,
    /// The messages of peers that the fit used.
    messages: Vec<Summary>,
    /// Summary of the events at the inducing points; `None` for a dense fit.
    condensed: Option<Summary>,
}

/// Fits `observations` by mean field: finds the ω that maximise the evidence bound E, and the Gaussian posterior that
/// belongs to them.
///
/// A dense fit costs O(N³) an iteration and 4N² numbers of memory. With [`FitOptions::inducing_points`] it costs O(NM²)
/// an iteration and O(N + M²) memory, plus at most 59 MB of covariances. N counts events and the observations that
/// messages represent.
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
/// * [`crate::Error::BadColumn`] if the prior needs columns that the inputs do not have.
/// * [`crate::Error::OutOfRange`] or [`crate::Error::SizeMismatch`] for invalid options.
/// * [`crate::Error::NotPositiveDefinite`] if inducing points coincide too closely for any small jitter.
/// * [`crate::Error::NotPositiveDefinite`] or [`crate::Error::NotFinite`] if numbers near the end of the floating-point
///   range overflow.
/// * [`crate::Error::NegativeEigenvalue`] for a message whose precision is not positive semi-definite.
/// * [`crate::Error::Stopped`] if the monitor asks to stop.
pub fn fit(prior: &Prior, observations: &Observations, options: &FitOptions<'_>) -> Result<Fit> {
    let likelihood = Likelihood::new(observations, options.messages)?;
    let support = options.support()?;
    let mean_field = solve(prior, &likelihood, support.as_ref(), options)?;
    Fit::new(prior, mean_field, support.as_ref(), options.messages)
}

impl Fit {
    pub(crate) fn new(
        prior: &Prior,
        mut mean_field: MeanField,
        inducing_points: Option<&Inputs>,
        messages: &[&Summary],
    ) -> Result<Self> {
        let condense = |points| match mean_field.condensed.take() {
            Some((precision, shift)) => Summary::from_whitened(prior, points, precision, shift),
            None => Summary::variational(prior, &mean_field.sites, points),
        };
        let condensed = inducing_points.map(condense).transpose()?;
        let messages = messages.iter().map(|&message| message.clone()).collect();
        Ok(Self { prior: prior.clone(), mean_field, messages, condensed })
    }

    /// Returns the fitted posterior: of the events, and of the messages that the fit was given.
    ///
    /// At the events, a dense fit's posterior has the moments [`Fit::mean`] and [`Fit::variance`]. A sparse fit's
    /// posterior has these means up to the convergence error of the iteration. O(n³) for n events of a dense fit or M
    /// inducing points of a sparse fit, plus the inducing points of the messages.
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior(&self) -> Result<Posterior> {
        self.posterior_with(&self.messages.iter().collect::<Vec<_>>())
    }

    /// Returns the posterior of the events and of `summaries`, which replace the messages of the fit. `&[]` gives the
    /// posterior of the events alone. The sites of the events stay as they are. Summaries of another prior are read
    /// under the prior of the fit. The cost is that of [`Fit::posterior`].
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior_with(&self, summaries: &[&Summary]) -> Result<Posterior> {
        posterior_of(&self.prior, &self.mean_field.sites, self.condensed.as_ref(), summaries)
    }

    /// Returns the posterior of some of the events, given by their indices, and of `summaries`. A receiver that holds
    /// only these events knows this posterior. The sites are those of the fit with all events.
    ///
    /// In addition to the O(n³) of [`Fit::posterior`], a sparse fit costs O(mM²) for m events. m counts the included or
    /// the excluded events, whichever are fewer.
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
    ///
    /// let inputs = Inputs::from_rows(&[[0.0], [1.0], [5.0]])?;
    /// let observations = Observations::new(inputs.clone(), vec![true, true, false])?;
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
    /// let fit = fit(&Prior::new(kernel, PriorMean::Zero)?, &observations, &FitOptions::default())?;
    /// let part = fit.posterior_of_part(&[0, 1], &[])?.latent(&inputs)?;
    /// assert!(part.mean[0] > 0.5 && part.mean[2].abs() < 1e-3);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior_of_part(&self, events: &[usize], summaries: &[&Summary]) -> Result<Posterior> {
        let sites = self.mean_field.sites.select(events);
        posterior_of(&self.prior, &sites, self.summary_of_part(events)?.as_ref(), summaries)
    }

    /// Returns the summary of some of the events of a sparse fit at its inducing points, or `None` for a dense fit.
    ///
    /// The included events are summed up, or the excluded events are subtracted from the total, whichever are fewer. To
    /// go from one part to another, use [`Summary::observe`] and [`Summary::forget`] with [`Fit::sites`]. O(mM²).
    ///
    /// # Errors
    /// As [`Summary::variational`].
    pub fn summary_of_part(&self, events: &[usize]) -> Result<Option<Summary>> {
        let Some(all) = &self.condensed else { return Ok(None) };
        let others = self.complement(events);
        // Repeated indices count repeatedly, so the total minus the other events would be wrong.
        if others.len() >= events.len() || events.len() + others.len() > self.mean_field.sites.len() {
            return Summary::variational(&self.prior, &self.mean_field.sites.select(events), all.inducing_points())
                .map(Some);
        }
        let mut part = all.clone();
        part.forget(&self.mean_field.sites.select(&others))?;
        Ok(Some(part))
    }

    /// Returns the indices of the events that `events` does not contain.
    fn complement(&self, events: &[usize]) -> Vec<usize> {
        let mut is_named = vec![false; self.mean_field.sites.len()];
        events.iter().for_each(|&event| is_named[event] = true);
        (0..is_named.len()).filter(|&event| !is_named[event]).collect()
    }

    /// Returns this sparse fit without the events at the indices `removed`, and with the events `new` appended. Returns
    /// `None` for a dense fit.
    ///
    /// Each new event gets its site given all events before it, at the existing inducing points. The remaining events
    /// keep their sites, so the result differs slightly from a new fit of all events. Their [`Fit::mean`] and
    /// [`Fit::variance`] are those of the old fit. [`Fit::evidence`], [`Fit::iterations`], [`Fit::change`] and
    /// [`Fit::stop`] are those of the old fit, too. O(mM²) for m events that are removed or added, however many
    /// remain.
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
    pub fn amended(&self, removed: &[usize], new: &Observations) -> Result<Option<Self>> {
        let Some(mut condensed) = self.condensed.clone() else { return Ok(None) };
        let staying = self.complement(removed);
        // An index that is named twice counts once.
        condensed.forget(&self.mean_field.sites.select(&self.complement(&staying)))?;
        let mean_field = self.mean_field.select(&staying);
        let (prior, messages) = (self.prior.clone(), self.messages.clone());
        let mut amended = Self { prior, mean_field, messages, condensed: Some(condensed) };
        let known = amended.posterior()?;
        let sites = append(&mut amended.mean_field, known, new)?;
        if let Some(condensed) = &mut amended.condensed {
            condensed.observe(&sites)?;
            let cross = Cross::new(amended.prior.kernel(), condensed.inducing_points(), new.inputs())?;
            amended.mean_field.residual.extend(residual(&cross, condensed.cholesky())?);
        }
        Ok(Some(amended))
    }

    /// Runs expectation propagation from the sites of this fit, with `summaries` in place of the messages of the fit.
    ///
    /// The variances of the mean field are too small, by a factor of several if all outcomes are equal. Those of
    /// expectation propagation are nearly those of the exact posterior. It takes 10 to 30 iterations, each at the cost
    /// of an iteration of the fit.
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
        self.propagated_monitored(summaries, Monitor::default())
    }

    /// Runs expectation propagation as [`Fit::propagated_with`] does, and reports every iteration to `monitor`. The
    /// reported change is the largest change of an ω or a κ.
    ///
    /// # Errors
    /// As [`fit`].
    pub fn propagated_monitored(&self, summaries: &[&Summary], monitor: Monitor<'_>) -> Result<Propagated> {
        let inducing_points = self.condensed.as_ref().map(Summary::inducing_points);
        propagate(&self.prior, &self.mean_field, inducing_points, summaries, monitor)
    }

    /// Returns the prior of the fit.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// Returns the Gaussian sites of the events at the mean ω̄ = tanh(c/2)/(2c).
    pub fn sites(&self) -> &Sites {
        &self.mean_field.sites
    }

    /// Returns the inducing points of a sparse fit, or `None` for a dense fit. Points of the summaries that were given
    /// to the fit are included.
    pub fn inducing_points(&self) -> Option<&Inputs> {
        self.condensed.as_ref().map(Summary::inducing_points)
    }

    /// Returns the posterior means of f at the events, N.
    pub fn mean(&self) -> &[f64] {
        &self.mean_field.mean
    }

    /// Returns the posterior variances of f at the events, N.
    pub fn variance(&self) -> &[f64] {
        &self.mean_field.variance
    }

    /// Returns the moments of [`Fit::posterior`] at points that are events of this fit. The moments are known from the
    /// fit, so nothing is solved.
    ///
    /// Points and events are compared in the columns that the prior uses. Returns `None` if a point is not an event.
    /// Also returns `None` for a sparse fit, because its posterior has other variances. O(N · columns).
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
        let key = |row: &[f64]| columns.iter().map(|&column| row.get(column).map(|x| x.to_bits())).collect::<Vec<_>>();
        let events: HashMap<_, usize> = self.mean_field.sites.inputs().rows().map(key).zip(0..).collect();
        let places = inputs.rows().map(|row| events.get(&key(row)).copied()).collect::<Option<Vec<usize>>>()?;
        let at = |values: &[f64]| places.iter().map(|&place| values[place]).collect();
        Some(Latent { mean: at(&self.mean_field.mean), variance: at(&self.mean_field.variance) })
    }

    /// Returns the probabilities of success at the events, N.
    pub fn probabilities(&self) -> Vec<f64> {
        let moments = self.mean_field.mean.iter().zip(&self.mean_field.variance);
        moments.map(|(&mean, &variance)| success_probability(mean, variance)).collect()
    }

    /// Returns the tilts c_n = √E\[f_n²\] from which ω̄ was computed, N.
    pub fn tilts(&self) -> &[f64] {
        &self.mean_field.tilts
    }

    /// Returns the weights of the events, N.
    pub fn weights(&self) -> &[f64] {
        &self.mean_field.weights
    }

    /// Returns the evidence bound E, in nats: a lower bound on the log marginal likelihood.
    pub fn evidence(&self) -> f64 {
        self.mean_field.evidence
    }

    /// Returns the number of iterations.
    pub fn iterations(&self) -> usize {
        self.mean_field.iterations
    }

    /// Returns the largest change of a tilt in the last iteration.
    pub fn change(&self) -> f64 {
        self.mean_field.change
    }

    /// Returns the reason why the iteration ended.
    pub fn stop(&self) -> FitStop {
        self.mean_field.stop
    }

    /// Returns whether [`Fit::change`] reached the tolerance.
    pub fn converged(&self) -> bool {
        self.mean_field.stop == FitStop::Converged
    }

    /// Returns the jitter on the diagonal of K_MM. It is 0 for a dense fit, which factorises only I + Ω^½KΩ^½.
    pub fn jitter(&self) -> f64 {
        self.mean_field.jitter
    }

    /// Returns the approximate leave-one-out log predictive probabilities ln p(y_n | all other events), N, in nats.
    ///
    /// Each event's own site is removed from its posterior, without a second fit. The result is optimistic because ω_n
    /// depends on y_n, and more so for larger variances. Weights do not count. O(N) ([`crate::method::learning`]).
    pub fn leave_one_out(&self) -> Vec<f64> {
        cavity::leave_one_out(&self.mean_field)
    }

    /// Returns the corrected evidence: expectation propagation's estimate of the log marginal likelihood at the mean
    /// field's sites.
    ///
    /// The Gaussian site of each event bounds the event's likelihood from below. The corrected evidence replaces the
    /// site by the likelihood itself, integrated against the posterior of all other events. The result is not a bound,
    /// but it is much nearer to the log marginal likelihood than E. O(N) ([`crate::method::learning`]).
    pub fn corrected_evidence(&self) -> f64 {
        cavity::corrected_evidence(&self.mean_field)
    }
}
