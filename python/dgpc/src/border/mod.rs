//! The border between Python and the crate: numbers, errors, threads and bytes.

mod arrays;
mod bytes;
mod errors;
mod work;

pub use arrays::{
    Count, Deviation, Finite, Numbers, Outcomes, Points, Share, Square, Table, Vector, Whole, array, indices, matrix,
    vector,
};
pub use bytes::{decode, encode, reduce};
pub use errors::{Error, bad_input};
pub use work::{
    check_memory, generator, interruptible, locked, long_work, predicted, remember_process, report_step, watched, work,
    work_on,
};
