//! Decentralised Gaussian process classification.
//!
//! Several agents see binary outcomes of one latent function, each at its own inputs, and can exchange only a few numbers. Each
//! fits its events ([`mean_field`], [`Gibbs`]), chooses a few inducing points that stand for a region ([`Candidates`]),
//! certifies the choice ([`Certificate`]), condenses the events there into a [`Summary`], and fuses what it receives with its own
//! events into a [`Posterior`] that predicts anywhere.
//!
//! The crate is pure: no input or output, no clock, no threads, no global state; randomness is passed in. Inputs have any
//! dimension; nothing here knows what they mean. The mathematics is in the project's `docs/method.md`, whose sections the
//! documentation cites.
//!
//! ```
//! use dgpc::{mean_field, Candidates, Inputs, Kernel, Observations, Posterior, Prior, PriorMean, Shape, Summary, Term};
//!
//! // One agent's events, and a prior.
//! let inputs = Inputs::from_rows(&[[0.0, 0.1], [0.2, 0.0], [0.1, 0.3], [2.0, 2.1], [2.2, 1.9]])?;
//! let events = Observations::new(inputs, vec![true, true, true, false, false])?;
//! let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 2.0, 0.8, 2)?])?;
//! let prior = Prior::new(kernel, PriorMean::Zero)?;
//!
//! // Fit, choose two points, summarise: this is what the agent sends.
//! let fit = mean_field::dense(&prior, &events, &Default::default())?;
//! let chosen = Candidates::new(prior.kernel(), events.inputs())?.good(2);
//! let packet = Summary::marginal(&prior, &fit.sites, &events.inputs().select(&chosen.indices))?;
//!
//! // Another agent, without events of its own, fuses it and predicts.
//! let fused = Posterior::fuse(&prior, &dgpc::Sites::empty(2), &[&packet])?;
//! let probability = fused.probability(&Inputs::from_rows(&[[0.1, 0.1], [2.1, 2.0]])?)?;
//! assert!(probability[0] > 0.6 && probability[1] < 0.4);
//! # Ok::<(), dgpc::Error>(())
//! ```

mod anderson;
mod bound;
mod chain;
mod data;
mod dense;
mod error;
pub mod evidence;
mod gibbs;
mod inducing;
mod inputs;
mod kernel;
pub mod learn;
mod linalg;
pub mod mean_field;
pub mod polya_gamma;
mod posterior;
mod predict;
mod prior_mean;
mod region;
mod search;
mod sites;
mod sparse;
mod summary;

pub use bound::{Certificate, log_evidence};
pub use chain::effective_sample_size;
pub use error::{Error, Result};
pub use evidence::Evidence;
pub use gibbs::Gibbs;
pub use inducing::{Candidates, DISTINCT_SHARE, Selection};
pub use inputs::Inputs;
pub use kernel::{Kernel, Reflection, Shape, Term};
pub use linalg::Matrix;
pub use mean_field::MeanField;
pub use posterior::Posterior;
pub use predict::{Latent, success_probability};
pub use prior_mean::{Prior, PriorMean};
pub use region::LocalityRegion;
pub use sites::{Observations, Sites};
pub use summary::{Factor, Summary};
