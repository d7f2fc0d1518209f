//! Dense linear algebra. No other folder uses the linear-algebra crate.
//!
//! All functions run on the calling thread, so that results do not depend on the number of threads. `parts.rs`
//! distributes work over threads.

mod wide;
mod panels;
mod matrix;
mod rows;
mod cholesky;
mod growing;
mod eigen;

pub(crate) use cholesky::{Cholesky, CholeskyScratch, fill_scaled};
pub(crate) use eigen::{semidefinite_root, symmetric_eigen};
pub(crate) use growing::{Extension, GrowingCholesky};
pub use matrix::Matrix;
pub(crate) use matrix::{
    add_scaled, add_symmetric_product, add_symmetric_product_lower, dot, lower_gram, multiply_columns, multiply_rows,
    multiply_vector, product, squared_norm,
};
pub(crate) use rows::{products_and_squared_norms, squared_norms_of_rows, write_scaled_transpose};
pub(crate) use wide::{MultiplyAdd, Wide, exp_of_negative, widest};
