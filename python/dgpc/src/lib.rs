//! Python binding of the crate `dgpc`. The package `dgpc` in `python/` exports everything here.
//!
//! The binding translates arrays, errors and random seeds, and leaves the method to the crate. All classes are
//! immutable, so several threads may share their objects. Long computations run without the interpreter's lock.

#![forbid(unsafe_code)]

// In the order of the data flow: each folder uses only folders above it.
mod border;
mod prior;
mod posterior;
mod selection;
mod fit;

use pyo3::prelude::*;

/// Gaussian process classification: the compiled part of the package `dgpc`.
#[pymodule]
mod _dgpc {
    #[pymodule_export]
    use crate::border::Error;
    #[pymodule_export]
    use crate::fit::{
        Fit, Learned, Propagated, Shard, ShardedFit, effective_sample_size, evidence, fit, gibbs, learn,
        polya_gamma_draws, polya_gamma_moments, success_probabilities,
    };
    #[pymodule_export]
    use crate::posterior::{Concatenation, Posterior, Shift, Sites, Summary};
    #[pymodule_export]
    use crate::prior::{Correlation, Kernel, Prior, RangeMean, Term};
    #[pymodule_export]
    use crate::selection::{
        Candidates, Certificate, LocalityRegion, Selection, busiest_region, greedy_by_variance, greedy_judged,
        log_evidence, region_around,
    };

    use super::*;

    #[pymodule_init]
    fn prepare(_module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::border::remember_process();
        Ok(())
    }
}
