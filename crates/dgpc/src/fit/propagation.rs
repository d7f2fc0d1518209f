//! Expectation propagation: Gaussian sites that match the moments of the likelihood ([`crate::method::inference`]).

use std::sync::Arc;

use super::dense::Dense;
use super::mean_field::MeanField;
use super::posterior::posterior_of;
use super::sparse::{Coordinator, EventCovariances, Site};
use crate::cross::kept_max;
use crate::error::Result;
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::monitor::{Monitor, Progress};
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::special::ln_logistic;
use crate::summary::Summary;

/// The iteration stops when no site's ω or κ changes by more than this.
const TOLERANCE: f64 = 1e-5;

/// The iteration stops after this number of iterations even without convergence.
const ITERATIONS_MAX: usize = 200;

/// The share of a step that is taken at first, and its smallest value.
const STEP: (f64, f64) = (0.9, 0.05);

/// Number of quadrature nodes on either side of the centre.
const NODES: i32 = 64;
/// Reach of the quadrature nodes in standard deviations.
const REACH: f64 = 9.0;

/// Below this variance the likelihood counts as constant over the cavity.
const VARIANCE_MIN: f64 = 1e-9;

/// The result of expectation propagation: the events and messages of a fit with sites that match the moments of the
/// likelihood.
#[derive(Debug, Clone)]
pub struct Propagated {
    prior: Prior,
    sites: Sites,
    messages: Vec<Summary>,
    condensed: Option<Summary>,
    iterations: usize,
    change: f64,
}

impl Propagated {
    /// Returns the posterior of the events and the messages. The cost is that of [`crate::Fit::posterior`].
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior(&self) -> Result<Posterior> {
        let messages: Vec<&Summary> = self.messages.iter().collect();
        posterior_of(&self.prior, &self.sites, self.condensed.as_ref(), &messages)
    }

    /// Returns the Gaussian sites of the events.
    pub fn sites(&self) -> &Sites {
        &self.sites
    }

    /// Returns the number of iterations.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Returns the largest change of an ω or a κ in the last iteration.
    pub fn change(&self) -> f64 {
        self.change
    }

    /// Returns whether [`Propagated::change`] is at most 1e-5.
    pub fn converged(&self) -> bool {
        self.change <= TOLERANCE
    }
}

/// Runs expectation propagation from the sites of a mean field, with the given messages. The run is sparse if there are
/// inducing points, and dense otherwise. Every iteration is reported to the monitor.
pub(super) fn propagate(
    prior: &Prior,
    mean_field: &MeanField,
    inducing_points: Option<&Inputs>,
    messages: &[&Summary],
    monitor: Monitor<'_>,
) -> Result<Propagated> {
    let outcomes = mean_field.sites.kappa().iter().map(|&kappa| kappa > 0.0).collect();
    let observations = Observations::weighted(mean_field.sites.inputs().clone(), outcomes, mean_field.weights.clone())?;
    let likelihood = Likelihood::new(&observations, messages)?;
    let mut run = Run::new(monitor);
    let (omega, kappa) = match inducing_points {
        Some(points) => {
            let mut support = points.clone();
            // The support already contains the points of messages that the fit was given.
            for point in messages.iter().flat_map(|message| message.inducing_points().rows()) {
                if !points.rows().any(|known| known == point) {
                    support.append(&Inputs::new(point.to_vec(), point.len())?)?;
                }
            }
            run.on_points(prior, mean_field, &likelihood, &support)?
        }
        None => run.on_events(prior, mean_field, &likelihood)?,
    };
    let sites = Sites::gaussian(observations.inputs().clone(), omega, kappa);
    let condensed = inducing_points.map(|points| Summary::variational(prior, &sites, points)).transpose()?;
    let messages = messages.iter().map(|&message| message.clone()).collect();
    let Run { iterations, change, .. } = run;
    Ok(Propagated { prior: prior.clone(), sites, messages, condensed, iterations, change })
}

/// ω and κ of the events.
type OmegaKappa = (Vec<f64>, Vec<f64>);

/// State of the iteration.
struct Run<'a> {
    monitor: Monitor<'a>,
    step: f64,
    iterations: usize,
    change: f64,
}

impl<'a> Run<'a> {
    fn new(monitor: Monitor<'a>) -> Self {
        Self { monitor, step: STEP.0, iterations: 0, change: f64::INFINITY }
    }

    fn is_unfinished(&self) -> bool {
        self.iterations < ITERATIONS_MAX && self.change > TOLERANCE
    }

    /// Records the largest change of an iteration. If the change grew, the step is shortened, because all sites move at
    /// once and may overshoot.
    fn record(&mut self, change: f64) -> Result<()> {
        self.iterations += 1;
        if change > self.change {
            self.step = f64::max(0.5 * self.step, STEP.1);
        }
        self.change = change;
        self.monitor.report(Progress::Iteration { iterations: self.iterations, change })
    }

    fn on_events(&mut self, prior: &Prior, mean_field: &MeanField, likelihood: &Likelihood<'_>) -> Result<OmegaKappa> {
        let (events, size) = (likelihood.events(), likelihood.len());
        let prior_mean = likelihood.prior_mean(prior.mean())?;
        // The sites of messages stay fixed.
        let (mut omega, mut kappa) = (vec![1.0; size], likelihood.kappa());
        omega[..events].copy_from_slice(mean_field.sites.omega());
        let (mut mean, mut variance) = (vec![0.0; size], vec![0.0; size]);
        let mut engine = Dense::new(prior, likelihood)?;
        while self.is_unfinished() {
            let sites = kappa.iter().zip(&omega).zip(&prior_mean);
            let shift: Vec<f64> = sites.map(|((kappa, omega), mean)| kappa - omega * mean).collect();
            engine.pass(&omega, &shift, &mut mean, &mut variance)?;
            let mut change = 0.0;
            for n in 0..events {
                let cavity = Cavity::without((omega[n], kappa[n]), prior_mean[n] + mean[n], variance[n], 0.0);
                let site = (&mut omega[n], &mut kappa[n]);
                change = f64::max(change, cavity.move_site(site, likelihood.observations, n, self.step));
            }
            self.record(change)?;
        }
        omega.truncate(events);
        kappa.truncate(events);
        Ok((omega, kappa))
    }

    fn on_points(
        &mut self,
        prior: &Prior,
        mean_field: &MeanField,
        likelihood: &Likelihood<'_>,
        points: &Inputs,
    ) -> Result<OmegaKappa> {
        let mut coordinator = Coordinator::new(prior, likelihood, points)?;
        let inputs = likelihood.observations.inputs();
        let mut events =
            EventCovariances::new(prior, inputs, points, Arc::clone(coordinator.cholesky()), kept_max(inputs.len()))?;
        let (mut omega, mut kappa) = (mean_field.sites.omega().to_vec(), mean_field.sites.kappa().to_vec());
        let mut walk = events.begin(inputs, |n| (omega[n], kappa[n]))?;
        while self.is_unfinished() {
            coordinator.take(&walk.sums)?;
            let step = self.step;
            walk = events.walk(
                inputs,
                coordinator.posterior(),
                [&mut omega, &mut kappa],
                |n, moments, [omega, kappa]| {
                    let cavity = Cavity::without((*omega, *kappa), moments.mean, moments.explained, moments.residual);
                    let change = cavity.move_site((&mut *omega, &mut *kappa), likelihood.observations, n, step);
                    Site { omega: *omega, kappa: *kappa, bound: 0.0, change }
                },
            )?;
            self.record(walk.change)?;
        }
        Ok((omega, kappa))
    }
}

/// Moments of the latent function at an event without the event's own site.
struct Cavity {
    mean: f64,
    explained: f64,
    /// The variance that inducing points leave unexplained. No site can change it.
    residual: f64,
}

impl Cavity {
    /// Removes a site from the posterior moments.
    fn without((omega, kappa): (f64, f64), mean: f64, explained: f64, residual: f64) -> Self {
        let share = (1.0 - omega * explained).max(f64::EPSILON);
        Self { mean: (mean - explained * kappa) / share, explained: explained / share, residual }
    }

    /// Moves the site of event `n` by `step` towards the site that matches the moments of cavity times likelihood.
    /// Returns the change of a full step.
    fn move_site(&self, site: (&mut f64, &mut f64), events: &Observations, n: usize, step: f64) -> f64 {
        let Cavity { mean, explained, residual } = *self;
        let (slope, curvature) = tilted(events.outcomes()[n], events.weights()[n], mean, explained + residual);
        let left = (1.0 + explained * curvature).max(f64::EPSILON);
        let omega = (-curvature / left).max(f64::MIN_POSITIVE);
        let kappa = (slope - mean * curvature) / left;
        let change = f64::max((omega - *site.0).abs(), (kappa - *site.1).abs());
        *site.0 += step * (omega - *site.0);
        *site.1 += step * (kappa - *site.1);
        change
    }
}

/// Returns the first and second derivative by the mean of ln ∫ p(outcome | f)^weight N(f; mean, variance) df.
fn tilted(outcome: bool, weight: f64, mean: f64, variance: f64) -> (f64, f64) {
    let sign = if outcome { 1.0 } else { -1.0 };
    if variance < VARIANCE_MIN {
        let other = ln_logistic(-sign * mean).exp();
        return (sign * weight * other, -weight * other * (1.0 - other));
    }
    let deviation = variance.sqrt();
    let node = |n: i32| REACH * f64::from(n) / f64::from(NODES);
    let log = |n: i32| {
        let z = node(n);
        weight * ln_logistic(sign * (mean + deviation * z)) - 0.5 * z * z
    };
    let highest = (-NODES..=NODES).map(log).fold(f64::NEG_INFINITY, f64::max);
    let (mut total, mut first, mut second) = (0.0, 0.0, 0.0);
    for n in -NODES..=NODES {
        let (z, mass) = (node(n), (log(n) - highest).exp());
        total += mass;
        first += mass * z;
        second += mass * z * z;
    }
    let (first, second) = (first / total, second / total);
    (first / deviation, (second - first * first - 1.0) / variance)
}
