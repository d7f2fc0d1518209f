//! Properties that hold for every problem: random small problems against dense formulas, brute force, and each other.

mod certificate;
mod close_points;
mod contradictions;
mod evidence;
mod fits;
mod increments;
mod kernels;
mod mean_field;
mod no_data;
mod posteriors;
mod probabilities;
mod problems;
mod propagation;
mod refusals;
mod selection;
mod summaries;
