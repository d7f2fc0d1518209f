//! Decentralised Gaussian process classification.
//!
//! Several agents observe binary outcomes of one latent function, each at its own inputs. They can exchange only a few
//! numbers. With this crate, each agent can do the following:
//!
//! 1. **fit** its events: [`fit()`] turns [`Observations`] and a [`Prior`] (a [`Kernel`] and a [`PriorMean`]) into a
//!    [`Fit`];
//! 2. **predict** anywhere, with the remaining uncertainty: [`Fit::posterior`], [`Posterior::probability`];
//! 3. **share** its evidence in a few numbers:
//!    * choose inducing points from [`Candidates`] for a [`LocalityRegion`], and certify the choice ([`Certificate`]);
//!    * condense the events into a [`Summary`], or send only its [`Posterior::residual`] beyond the peers' knowledge;
//!    * fuse the summaries of its peers ([`Fit::posterior_with`], [`Posterior::absorb_summaries`]);
//! 4. **learn** the prior itself from its events and from the summaries of its peers: `learn`, with the feature
//!    `learn`.
//!
//! The crate is pure: it has no input or output, no clock and no global state. The caller passes in the random number
//! generator. The crate starts threads only with the feature `parallel`. Inputs have any dimension, and their meaning
//! is left to the caller. The module [`method`] describes the mathematics; the documentation cites its pages.
//!
//! # Fit and predict
//!
//! ```
//! use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
//!
//! // The events of one agent: successes near the origin, failures farther out.
//! let inputs = Inputs::from_rows(&[[0.0, 0.1], [0.2, 0.0], [0.1, 0.3], [2.0, 2.1], [2.2, 1.9]])?;
//! let events = Observations::new(inputs, vec![true, true, true, false, false])?;
//!
//! // The prior: a smooth function of variance 2 with a length-scale of 0.8.
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
//! // Two inducing points that represent the five events, and the summary of `own` there. The agent sends this summary.
//! let chosen = Candidates::new(prior.kernel(), events.inputs())?.minimise_trace(2);
//! let message = own.summarise(&events.inputs().select(&chosen.indices))?;
//!
//! // Another agent, without events of its own, absorbs the summary and predicts.
//! let mut theirs = Posterior::prior_alone(&prior, 2);
//! theirs.absorb_summaries(&[&message])?;
//! let probability = theirs.probability(&Inputs::from_rows(&[[0.1, 0.1], [2.1, 2.0]])?)?;
//! assert!(probability[0] > 0.6 && probability[1] < 0.4);
//!
//! // The next message is the residual: the evidence at another point that the receiver still lacks.
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
//! // Successes within a distance of 2, and a template whose length-scale is far too short.
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
//! * `learn` (default): learning a prior. Without it the crate does not depend on an optimiser.
//! * `parallel`: sums over many events (sparse fits, summaries, certificates) and predictions at many points use all
//!   threads of `rayon`'s pool. The results are bitwise the same as without the feature.
//! * `serde`: priors, kernels, summaries and factors can be serialised. Deserialisation checks them.

#![forbid(unsafe_code)]

// In the order of the data flow: each module uses only modules above it.
mod error;
mod monitor;
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
mod at_points;
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
mod greedy;
mod certificate;
#[cfg(feature = "learn")]
mod learn;
pub mod method;

pub use at_points::PosteriorAtPoints;
pub use candidates::{Candidates, DISTINCT_SHARE, Selection};
pub use certificate::{Certificate, log_evidence};
pub use chain::effective_sample_size;
pub use concatenation::Concatenation;
pub use error::{Error, Place, Result};
pub use evidence::{Evidence, evidence};
pub use factor::Factor;
pub use fit::{
    Fit, FitOptions, FitStop, Propagated, Shard, ShardContribution, ShardRequest, ShardedFit, absorb_observations, fit,
    sites_given,
};
pub use gibbs::Gibbs;
pub use greedy::{greedy_by_variance, greedy_judged};
pub use inputs::{COLUMN_MAX, Inputs, spread_out};
pub use kernel::{Correlation, Image, Kernel, Reflection, Shape, Term};
pub use latent::{Latent, success_probability};
#[cfg(feature = "learn")]
pub use learn::{Bounds, Calibration, HyperPrior, LearnOptions, Learned, Start, Stop, common_length_scales, learn};
pub use linalg::Matrix;
pub use monitor::{Monitor, Progress};
pub use observations::Observations;
pub use parameter::Parameter;
pub use posterior::Posterior;
pub use prior::Prior;
pub use prior_mean::{PriorMean, RangeMean};
/// The random number traits that appear in this crate's interface.
pub use rand;
pub use region::LocalityRegion;
pub use shift::Shift;
pub use sites::Sites;
pub use summary::Summary;

/// Compiles and runs the example of the crate's README as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadMe;
