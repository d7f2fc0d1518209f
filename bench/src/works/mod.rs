//! All benchmarks.

mod agent;
mod inference;
mod learning;
mod machine;
mod selection;

pub use inference::{fits as dense_fits, predictions, sparse_iterations as sparse_iterations_on};
pub use selection::greedy_of_many as selections;

use crate::Work;

/// The benchmarks, in the order of the table that `compare` prints.
pub const WORKS: &[Work] = &[
    Work::short("draw 0", 200_000, || inference::draws(0.0)),
    Work::short("draw 0.5", 200_000, || inference::draws(0.5)),
    Work::short("draw 2", 200_000, || inference::draws(2.0)),
    Work::short("draw 5", 200_000, || inference::draws(5.0)),
    Work::short("draw 20", 200_000, || inference::draws(20.0)),
    Work::short("draw mixed", 200_000, inference::mixed_draws),
    Work::short("sweep 200", 20, || inference::sweeps(200, 20)),
    Work::short("sweep 446", 5, || inference::sweeps(446, 5)),
    Work::short("sweep 1000", 1, || inference::sweeps(1000, 1)),
    Work::long("sweep 2000", 1, || inference::sweeps(2000, 1)),
    Work::short("factorise 200", 20, || machine::factorisations(200, 20)),
    Work::short("factorise 446", 5, || machine::factorisations(446, 5)),
    Work::short("factorise 1000", 1, || machine::factorisations(1000, 1)),
    Work::long("factorise 2000", 1, || machine::factorisations(2000, 1)),
    Work::short("product 446", 5, || machine::symmetric_products(446, 5)),
    Work::long("product 2000", 1, || machine::symmetric_products(2000, 1)),
    Work::short("multiply-add", machine::MULTIPLY_ADDS, machine::multiply_adds),
    Work::short("best pair 446", 2, || selection::best_pair(446, 2)),
    Work::long("best pair 2000", 1, || selection::best_pair(2000, 1)),
    Work::short("greedy 50 of 446", 1, selection::greedy),
    Work::short("exchange 50 of 446", 1, selection::exchange),
    Work::long("greedy 50 of 10000", 1, || selection::greedy_of_many(10_000)),
    Work::short("greedy 50 of 10000 by variance", 1, selection::greedy_by_variance_of_many),
    Work::short("fit 446", 1, || inference::fits(446)),
    Work::long("fit 1000", 1, || inference::fits(1000)),
    Work::long("walk over 100000 on 100", 12, || inference::sparse_iterations(100_000, 100)),
    Work::long("product of a billion", 1, || machine::products(8)),
    Work::long("learn 1000", 1, learning::dense),
    Work::long("learn 100000", 1, learning::sparse),
    Work::short("predict 10000 from 446", 1, || inference::predictions(446)),
    Work::long("predict 10000 from 1000", 1, || inference::predictions(1000)),
    Work::short("agent: next frame of 32 bytes", agent::FRAMES, || agent::next_frames(32)),
    Work::long("agent: next frame of 256 bytes", agent::FRAMES, || agent::next_frames(256)),
    Work::short("agent: record and query", 48, || agent::record_and_query(48)),
    Work::short("agent: record and query with a peer", 48, || agent::record_and_query_with_peer(48)),
    Work::short("agent: refit and query", 1, agent::refit_and_query),
    Work::long("agent: 10000 queries", 1, agent::queries),
];
