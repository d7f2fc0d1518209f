//! Priors: kernels and prior means.

mod kernel;
mod mean;
mod term;

pub use kernel::{AnyKernel, Kernel};
pub use mean::{Prior, RangeMean};
pub use term::{Correlation, Term};
