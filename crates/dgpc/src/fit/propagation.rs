//! Expectation propagation: Gaussian sites as wide as the outcomes leave them (section 2 of [`crate::method`]).

use super::dense::Dense;
use super::fixed_point::{Engine, MeanField};
use super::sparse::Sparse;
use super::together::put_together;
use crate::error::Result;
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::observations::Observations;
use crate::posterior::Posterior;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::special::ln_logistic;
use crate::summary::Summary;

/// Iterations stop when no site's ω or κ changes by more than this.
const TOLERANCE: f64 = 1e-5;

/// They stop here all the same.
const ITERATIONS_MAX: usize = 200;

/// Share of a step that is taken at first, and the least.
const STEP: (f64, f64) = (0.9, 0.05);

/// Nodes of the quadrature to either side, and how many standard deviations they reach.
const NODES: i32 = 64;
const REACH: f64 = 9.0;

/// Below this variance the likelihood is its own average.
const VARIANCE_MIN: f64 = 1e-9;

/// What expectation propagation makes of a fit: the same events and messages with other sites, as wide as the outcomes
/// leave them.
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
    /// The posterior of the events and the messages. As dear as [`crate::Fit::posterior`].
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn posterior(&self) -> Result<Posterior> {
        let messages: Vec<&Summary> = self.messages.iter().collect();
        put_together(&self.prior, &self.sites, self.condensed.as_ref(), &messages)
    }

    /// The Gaussian sites of the events.
    pub fn sites(&self) -> &Sites {
        &self.sites
    }

    /// Iterations used.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Largest change of an ω or a κ in the last iteration.
    pub fn change(&self) -> f64 {
        self.change
    }

    /// Whether [`Propagated::change`] came below 1e-5.
    pub fn converged(&self) -> bool {
        self.change <= TOLERANCE
    }
}

/// Runs from the sites of a mean field, on its inducing points if it has any, with these messages.
pub(super) fn propagate(
    prior: &Prior,
    found: &MeanField,
    inducing_points: Option<&Inputs>,
    messages: &[&Summary],
) -> Result<Propagated> {
    let outcomes = found.sites.kappa().iter().map(|&kappa| kappa > 0.0).collect();
    let observations = Observations::weighted(found.sites.inputs().clone(), outcomes, found.weights.clone())?;
    let likelihood = Likelihood::new(&observations, messages)?;
    let mut run = Run::new(prior, found, &likelihood)?;
    match inducing_points {
        Some(points) => {
            let mut support = points.clone();
            // Those of messages that the fit was given are there.
            for point in messages.iter().flat_map(|message| message.inducing_points().rows()) {
                if !points.rows().any(|known| known == point) {
                    support.append(&Inputs::new(point.to_vec(), point.len())?)?;
                }
            }
            run.iterate(&mut Sparse::new(prior, &likelihood, &support)?)?;
        }
        None => run.iterate(&mut Dense::new(prior, &likelihood)?)?,
    }
    let Run { mut omega, mut kappa, iterations, change, .. } = run;
    omega.truncate(observations.len());
    kappa.truncate(observations.len());
    let sites = Sites::gaussian(observations.inputs().clone(), omega, kappa);
    let condensed = inducing_points.map(|points| Summary::variational(prior, &sites, points)).transpose()?;
    let messages = messages.iter().map(|&message| message.clone()).collect();
    Ok(Propagated { prior: prior.clone(), sites, messages, condensed, iterations, change })
}

/// The sites under way: ω and κ of everything observed, of which those of messages stay as they are.
struct Run<'a> {
    observations: &'a Observations,
    prior_mean: Vec<f64>,
    omega: Vec<f64>,
    kappa: Vec<f64>,
    /// Moments of everything observed, about the prior mean.
    mean: Vec<f64>,
    variance: Vec<f64>,
    iterations: usize,
    change: f64,
}

impl<'a> Run<'a> {
    fn new(prior: &Prior, found: &MeanField, likelihood: &Likelihood<'a>) -> Result<Self> {
        let size = likelihood.len();
        let (mut omega, kappa) = (vec![1.0; size], likelihood.kappa());
        omega[..likelihood.events()].copy_from_slice(found.sites.omega());
        Ok(Self {
            observations: likelihood.observations,
            prior_mean: likelihood.prior_mean(prior.mean())?,
            omega,
            kappa,
            mean: vec![0.0; size],
            variance: vec![0.0; size],
            iterations: 0,
            change: f64::INFINITY,
        })
    }

    fn iterate(&mut self, engine: &mut impl Engine) -> Result<()> {
        let residual = engine.residual(self.observations.len());
        let mut step = STEP.0;
        while self.iterations < ITERATIONS_MAX && self.change > TOLERANCE {
            self.iterations += 1;
            let moved = self.kappa.iter().zip(&self.omega).zip(&self.prior_mean);
            let shift: Vec<f64> = moved.map(|((kappa, omega), mean)| kappa - omega * mean).collect();
            engine.pass(&self.omega, &shift, &mut self.mean, &mut self.variance)?;
            let last = std::mem::take(&mut self.change);
            residual.iter().enumerate().for_each(|(n, &residual)| self.move_site(n, residual, step));
            // All sites move at once, and may move too far.
            if self.change > last {
                step = f64::max(0.5 * step, STEP.1);
            }
        }
        Ok(())
    }

    /// Moves the site of one event to where the moments of its cavity times its likelihood are. Inducing points leave
    /// `residual` of the variance unexplained, which no site can change.
    fn move_site(&mut self, n: usize, residual: f64, step: f64) {
        let explained = (self.variance[n] - residual).max(0.0);
        let share = (1.0 - self.omega[n] * explained).max(f64::EPSILON);
        let mean = (self.prior_mean[n] + self.mean[n] - explained * self.kappa[n]) / share;
        let (outcome, weight) = (self.observations.outcomes()[n], self.observations.weights()[n]);
        let (slope, curvature) = tilted(outcome, weight, mean, explained / share + residual);
        let left = (1.0 + explained / share * curvature).max(f64::EPSILON);
        let omega = (-curvature / left).max(f64::MIN_POSITIVE);
        let kappa = (slope - mean * curvature) / left;
        for (site, found) in [(&mut self.omega[n], omega), (&mut self.kappa[n], kappa)] {
            self.change = f64::max(self.change, (found - *site).abs());
            *site += step * (found - *site);
        }
    }
}

/// First and second derivative by the mean of ln ∫ p(outcome | f)^weight N(f; mean, variance) df.
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
