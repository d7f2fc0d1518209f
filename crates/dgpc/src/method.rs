#![doc = include_str!("../docs/rustdoc-links.md")]
#![doc = include_str!("../docs/method.md")]
//!
#![doc = include_str!("../docs/symbols.md")]

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/likelihood.md")]
///
/// # In the crate
///
/// [`Sites`](crate::Sites), [`Observations`](crate::Observations), [`polya_gamma`](crate::polya_gamma).
pub mod likelihood {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/inference.md")]
///
/// # In the crate
///
/// [`Gibbs`](crate::Gibbs), [`effective_sample_size`](crate::effective_sample_size), [`fit()`](crate::fit()),
/// [`Fit::amended`](crate::Fit::amended), [`Fit::summary_of_part`](crate::Fit::summary_of_part),
/// [`Fit::propagated_with`](crate::Fit::propagated_with).
pub mod inference {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/kernels.md")]
///
/// # In the crate
///
/// [`Kernel`](crate::Kernel), [`Term`](crate::Term), [`Shape`](crate::Shape), [`PriorMean`](crate::PriorMean).
pub mod kernels {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/inducing-points.md")]
///
/// # In the crate
///
/// [`Candidates`](crate::Candidates), [`Certificate`](crate::Certificate), [`greedy_judged`](crate::greedy_judged),
/// [`greedy_by_variance`](crate::greedy_by_variance), [`LocalityRegion`](crate::LocalityRegion).
pub mod inducing_points {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/summaries.md")]
///
/// # In the crate
///
/// [`Summary`](crate::Summary), [`Factor`](crate::Factor), [`Posterior::summarise`](crate::Posterior::summarise),
/// [`Posterior::residual`](crate::Posterior::residual).
pub mod summaries {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/fusion.md")]
///
/// # In the crate
///
/// [`Concatenation`](crate::Concatenation), [`Posterior::fuse`](crate::Posterior::fuse),
/// [`Posterior::absorb_events`](crate::Posterior::absorb_events), [`Latent`](crate::Latent),
/// [`success_probability`](crate::success_probability).
pub mod fusion {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/increments.md")]
///
/// # In the crate
///
/// [`Posterior::residual`](crate::Posterior::residual), [`Candidates::for_residual`](crate::Candidates::for_residual).
pub mod increments {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/consistency.md")]
///
/// # In the crate
///
/// [`Shift`](crate::Shift), [`Posterior::contradiction`](crate::Posterior::contradiction).
pub mod consistency {}

#[doc = include_str!("../docs/rustdoc-links.md")]
#[doc = include_str!("../docs/learning.md")]
///
/// # In the crate
///
/// [`evidence()`](crate::evidence()), [`Fit::corrected_evidence`](crate::Fit::corrected_evidence),
/// [`Fit::leave_one_out`](crate::Fit::leave_one_out), and `learn` with the feature of that name.
pub mod learning {}
