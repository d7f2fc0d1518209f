//! Reference operations of the machine, for comparison with all other benchmarks.

use std::hint::black_box;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, Par};

use crate::data::{synthetic, truth};

/// Multiply-adds of doubles in one run: two floating-point operations each.
pub const MULTIPLY_ADDS: usize = ROUNDS * CHAINS * LANES;

const ROUNDS: usize = 200_000;
const CHAINS: usize = 16;
const LANES: usize = 8;

/// Returns the covariance of `size` events, with 1 added to its diagonal.
fn covariance(size: usize) -> Mat<f64> {
    let gram = truth().kernel().gram(synthetic(size).inputs()).expect("finite places");
    Mat::from_fn(size, size, |i, j| gram[(i, j)] + f64::from(u8::from(i == j)))
}

/// Factorises a symmetric matrix in allocated memory.
pub fn factorisations(size: usize, repeats: usize) -> Box<dyn FnMut() -> f64> {
    let matrix = covariance(size);
    let mut factor = matrix.clone();
    let need = llt::factor::cholesky_in_place_scratch::<f64>(size, Par::Seq, Default::default());
    let mut memory = MemBuffer::new(need);
    Box::new(move || {
        for _ in 0..repeats {
            factor.copy_from(&matrix);
            let stack = MemStack::new(&mut memory);
            llt::factor::cholesky_in_place(factor.as_mut(), Default::default(), Par::Seq, stack, Default::default())
                .expect("positive definite");
        }
        black_box(&factor);
        f64::NAN
    })
}

/// Computes one triangle of A·Aᵀ.
pub fn symmetric_products(size: usize, repeats: usize) -> Box<dyn FnMut() -> f64> {
    let matrix = covariance(size);
    let mut out = Mat::zeros(size, size);
    Box::new(move || {
        let (lower, whole) = (BlockStructure::TriangularLower, BlockStructure::Rectangular);
        for _ in 0..repeats {
            let (a, b) = (matrix.as_ref(), matrix.transpose());
            triangular::matmul(out.as_mut(), lower, Accum::Replace, a, whole, b, whole, 1.0, Par::Seq);
        }
        black_box(&out);
        f64::NAN
    })
}

/// Computes products of two matrices of 500 × 500, an eighth of a billion multiply-adds each.
pub fn products(count: usize) -> Box<dyn FnMut() -> f64> {
    let matrix = covariance(500);
    let mut out = Mat::zeros(500, 500);
    Box::new(move || {
        for _ in 0..count {
            matmul(out.as_mut(), Accum::Replace, matrix.as_ref(), matrix.as_ref(), 1.0, Par::Seq);
        }
        black_box(&out);
        f64::NAN
    })
}

/// Computes fused multiply-adds in the widest registers of the machine.
pub fn multiply_adds() -> Box<dyn FnMut() -> f64> {
    Box::new(|| {
        let start = black_box([[1.0; LANES]; CHAINS]);
        let sums = chains(start, black_box(0.999_999), black_box(1e-6));
        black_box(sums)[0][0]
    })
}

type Sums = [[f64; LANES]; CHAINS];

#[cfg(target_arch = "x86_64")]
fn chains(start: Sums, factor: f64, term: f64) -> Sums {
    if is_x86_feature_detected!("avx512f") {
        // SAFETY: the processor was asked.
        unsafe { with_avx512(start, factor, term) }
    } else if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        // SAFETY: the processor was asked.
        unsafe { with_avx2(start, factor, term) }
    } else {
        plain(start, factor, term)
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn chains(start: Sums, factor: f64, term: f64) -> Sums {
    plain(start, factor, term)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn with_avx512(start: Sums, factor: f64, term: f64) -> Sums {
    plain(start, factor, term)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2(start: Sums, factor: f64, term: f64) -> Sums {
    plain(start, factor, term)
}

#[inline(always)]
fn plain(mut sums: Sums, factor: f64, term: f64) -> Sums {
    for _ in 0..ROUNDS {
        for sum in sums.as_flattened_mut() {
            *sum = sum.mul_add(factor, term);
        }
    }
    sums
}
