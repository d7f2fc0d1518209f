//! Dense linear algebra: the only folder that names the linear-algebra crate.
//!
//! Everything runs on the calling thread, so that results do not depend on how many threads a caller uses.

mod wide;
mod matrix;
mod cholesky;
mod eigen;

pub(crate) use cholesky::{Cholesky, CholeskyScratch, fill_scaled};
pub(crate) use eigen::{semidefinite_root, symmetric_eigen};
pub use matrix::Matrix;
pub(crate) use matrix::{
    add_lower_gram, add_scaled, add_symmetric_product, dot, multiply_rows, multiply_vector, product, squared_norm,
};
pub(crate) use wide::{MultiplyAdd, Wide, exp_of_negative, widest};
