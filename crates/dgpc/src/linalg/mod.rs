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
    View, add_scaled, add_symmetric_product, add_symmetric_product_lower, dot, lower_gram, multiply_lower,
    multiply_rows, multiply_vector, product, scale_into, squared_norm,
};
pub(crate) use wide::{MultiplyAdd, Wide, exp_of_negative, widest};
