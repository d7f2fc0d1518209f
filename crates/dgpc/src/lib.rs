//! Decentralised Gaussian process classification.
//!
//! Several agents see binary outcomes of one latent function, each at its own inputs, and can exchange only a few
//! numbers. This crate lets each of them
//!
//! 1. **fit** what it saw: [`Observations`] under a [`Prior`] (a [`Kernel`] and a [`PriorMean`]) to a [`Fit`], with
//!    [`fit()`];
//! 2. **predict** anywhere, with the uncertainty that is left: [`Fit::posterior`], [`Posterior::probability`];
//! 3. **share** what it learned in a few numbers: choose [`Candidates`] that stand for a [`LocalityRegion`], certify
//!    the choice ([`Certificate`]), condense the events into a [`Summary`], say only the [`Posterior::residual`] of
//!    what others know already, and take in what they say ([`Fit::posterior_with`], [`Posterior::absorb_summaries`]);
//! 4. **learn** the prior itself from its events and from what others said: `learn`, with the feature of the same name.
//!
//! The crate is pure: no input or output, no clock, no threads but with the feature `parallel`, no global state; randomness is passed in. Inputs have
//! any dimension; nothing here knows what they mean. The mathematics is in [`method`], whose sections the documentation
//! cites.
//!
//! # Fit and predict
//!
//! ```
//! use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
//!
//! // What one agent saw: successes near the origin, failures farther out.
//! let inputs = Inputs::from_rows(&[[0.0, 0.1], [0.2, 0.0], [0.1, 0.3], [2.0, 2.1], [2.2, 1.9]])?;
//! let events = Observations::new(inputs, vec![true, true, true, false, false])?;
//!
//! // What it expected before: a smooth function of variance 2 that changes over distances of 0.8.
//! let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 2.0, 0.8, 2)?])?;
//! let prior = Prior::new(kernel, PriorMean::Zero)?;
//!
//! let fit = fit(&prior, &events, &FitOptions::default())?;
//! let posterior = fit.posterior()?;
//! let probability = posterior.probability(&Inputs::from_rows(&[[0.1, 0.1], [2.1, 2.0]])?)?;
//! assert!(probability[0] > 0.6 && probability[1] < 0.4);
//! # Ok::<(), dgpc::Error>(())
//! ```
//!
//! # Share
//!
//! ```
//! use dgpc::{Candidates, FitOptions, Inputs, Kernel, Observations, Posterior, Prior, PriorMean, Shape, Term, fit};
//! # let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 2.0, 0.8, 2)?])?;
//! # let prior = Prior::new(kernel, PriorMean::Zero)?;
//! # let inputs = Inputs::from_rows(&[[0.0, 0.1], [0.2, 0.0], [0.1, 0.3], [2.0, 2.1], [2.2, 1.9]])?;
//! # let events = Observations::new(inputs, vec![true, true, true, false, false])?;
//! # let own = fit(&prior, &events, &FitOptions::default())?.posterior()?;
//!
//! // Two points that stand for the five events, and what `own` says there: this is what the agent sends.
//! let chosen = Candidates::new(prior.kernel(), events.inputs())?.minimise_trace(2);
//! let message = own.summarise(&events.inputs().select(&chosen.indices))?;
//!
//! // Another agent, without events of its own, takes it in and predicts.
//! let mut theirs = Posterior::prior_alone(&prior, 2);
//! theirs.absorb_summaries(&[&message])?;
//! let probability = theirs.probability(&Inputs::from_rows(&[[0.1, 0.1], [2.1, 2.0]])?)?;
//! assert!(probability[0] > 0.6 && probability[1] < 0.4);
//!
//! // What it still misses at another point is the residual: the next message.
//! let next = own.residual(&theirs, &events.inputs().select(&[2]))?;
//! theirs.absorb_summaries(&[&next])?;
//! # Ok::<(), dgpc::Error>(())
//! ```
//!
//! # Learn
//!
//! ```
//! # #[cfg(feature = "learn")] {
//! use dgpc::{Inputs, Kernel, LearnOptions, Observations, Prior, PriorMean, Shape, Term, learn};
//!
//! // Success within a distance of 2, and a template whose length-scale is far too short.
//! let inputs = Inputs::new((0..60).map(|n| f64::from(n) * 0.1 - 3.0).collect(), 1)?;
//! let outcomes = inputs.rows().map(|x| x[0].abs() < 2.0).collect();
//! let events = Observations::new(inputs, outcomes)?;
//! let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 0.1, 1)?])?;
//!
//! let learned = learn(&Prior::new(kernel, PriorMean::Zero)?, &events, &LearnOptions::default())?;
//! assert!(learned.prior.kernel().terms()[0].correlations()[0].length_scales()[0] > 0.3);
//! # }
//! # Ok::<(), dgpc::Error>(())
//! ```
//!
//! # Features
//!
//! * `learn` (default): learning a prior. Without it the crate pulls no optimiser.
//! * `parallel`: sums over many events (sparse fits, summaries, certificates) and predictions of many places use all threads of
//!   `rayon`'s pool. Results are the same to the bit without it.
//! * `serde`: priors, kernels, summaries and factors can be written down, and are checked when they are read back.

#![forbid(unsafe_code)]

// In the order of the flow: each module uses only those above it.
mod error;
mod special;
mod linalg;
mod inputs;
mod parts;
mod parameter;
mod kernel;
mod prior_mean;
mod prior;
mod observations;
mod sites;
pub mod polya_gamma;
mod latent;
mod cross;
mod factor;
mod summary;
mod unwhitened;
mod posterior;
mod shift;
mod contradiction;
mod concatenation;
mod likelihood;
mod fit;
mod evidence;
mod gibbs;
mod chain;
mod region;
mod remainder;
mod candidates;
mod many;
mod certificate;
#[cfg(feature = "learn")]
mod learn;

#[doc = include_str!("../docs/method.md")]
pub mod method {}

pub use candidates::{Candidates, DISTINCT_SHARE, Selection};
pub use certificate::{Certificate, log_evidence};
pub use chain::effective_sample_size;
pub use concatenation::Concatenation;
pub use error::{Error, Place, Result};
pub use evidence::{Evidence, evidence};
pub use factor::Factor;
pub use fit::{Fit, FitOptions, Propagated, absorb_observations, fit, sites_given};
pub use gibbs::Gibbs;
pub use inputs::{COLUMN_MAX, Inputs, spread_out};
pub use kernel::{Correlation, Image, Kernel, Reflection, Shape, Term};
pub use latent::{Latent, success_probability};
#[cfg(feature = "learn")]
pub use learn::{Calibration, HyperPrior, LearnOptions, Learned, Start, Stop, common_length_scales, learn};
pub use linalg::Matrix;
pub use many::{greedy_by_variance, greedy_judged};
pub use observations::Observations;
pub use parameter::Parameter;
pub use posterior::Posterior;
pub use prior::Prior;
pub use prior_mean::{PriorMean, RangeMean};
/// The traits of randomness that this crate's interface asks for.
pub use rand;
pub use region::LocalityRegion;
pub use shift::Shift;
pub use sites::Sites;
pub use summary::Summary;

/// The example of the crate's README compiles and holds.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadMe;
