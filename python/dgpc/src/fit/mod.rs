//! Fits of events, learning of priors, and sampling.

mod options;
mod propagated;
mod stored;
mod fitted;
mod mean_field;
mod learning;
mod sampling;
mod sharding;
mod polya_gamma;

pub use fitted::Fit;
pub use learning::{Learned, learn};
pub use mean_field::{evidence, fit};
pub use polya_gamma::{polya_gamma_draws, polya_gamma_moments, success_probabilities};
pub use propagated::Propagated;
pub use sampling::{effective_sample_size, gibbs};
pub use sharding::{Shard, ShardedFit};
