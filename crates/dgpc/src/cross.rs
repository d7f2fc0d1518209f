//! Covariances of events with inducing points, and sums over the events, block by block. Each event is a row.

use std::borrow::Cow;
use std::ops::Range;

use crate::error::Result;
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::linalg::{
    Cholesky, Matrix, add_scaled, add_symmetric_product_lower, squared_norms_of_rows, write_scaled_transpose,
};
use crate::parts::{BLOCK, blocks, on_parts, parts};

/// Returns the largest number of covariances of N events that are kept in memory: 59 MB for few events, none from a
/// million events on. They would then be a small share of all covariances. Covariances that are not kept are computed
/// each time they are needed.
pub(crate) fn kept_max(events: usize) -> usize {
    7 * (1_usize << 20).saturating_sub(events)
}

/// The covariances K_NM of N events with M inducing points.
pub(crate) struct Cross<'a> {
    kernel: &'a Kernel,
    points: &'a Inputs,
    inputs: &'a Inputs,
    /// The first blocks of K_NM.
    kept: Cow<'a, [Matrix]>,
}

impl<'a> Cross<'a> {
    /// Creates the covariances without keeping any of them. This suits callers that need each covariance once.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`].
    pub(crate) fn new(kernel: &'a Kernel, points: &'a Inputs, inputs: &'a Inputs) -> Result<Self> {
        kernel.check(points)?;
        kernel.check(inputs)?;
        Ok(Self { kernel, points, inputs, kept: Cow::Borrowed(&[]) })
    }

    /// Creates covariances whose first blocks are already computed.
    pub(crate) fn of_kept(kernel: &'a Kernel, points: &'a Inputs, inputs: &'a Inputs, kept: Cow<'a, [Matrix]>) -> Self {
        Self { kernel, points, inputs, kept }
    }

    /// Computes and keeps the first covariances, at most `numbers_max` of them. O(NMd).
    pub(crate) fn kept(self, numbers_max: usize) -> Result<Self> {
        let blocks_max = numbers_max / (BLOCK * self.points.len()).max(1);
        let whole = blocks(0..self.inputs.len()).take(blocks_max).collect();
        let compute = |block| -> Result<Matrix> { self.kernel.cross(&self.inputs.slice(block), self.points) };
        let kept = on_parts(whole, compute).into_iter().collect::<Result<_>>()?;
        Ok(Self { kept: Cow::Owned(kept), ..self })
    }

    /// Returns the first blocks of the covariances, which are kept.
    pub(crate) fn into_kept(self) -> Vec<Matrix> {
        self.kept.into_owned()
    }

    /// Writes the features of one block of events, Φ = KL⁻ᵀ. O(M²) an event.
    pub(crate) fn write_features(&self, block: Range<usize>, factor: &Cholesky, out: &mut Matrix) -> Result<()> {
        out.resize(block.len(), self.points.len());
        match self.kept.get(block.start / BLOCK) {
            Some(kept) => out.copy_from(kept),
            None => self.kernel.write_cross(&self.inputs.slice(block), self.points, out)?,
        }
        factor.solve_rows(out);
        Ok(())
    }

    /// Splits the events into the parts over which sums are computed.
    pub(crate) fn parts(&self) -> Vec<Range<usize>> {
        parts(self.inputs.len(), self.points.len() * self.points.len())
    }
}

/// The sums ΦᵀΩΦ and Φᵀκ̃ over some of the events, for features Φ of M columns.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// ΦᵀΩΦ, M×M. Only the lower triangle is valid until the caller mirrors it.
    pub(crate) precision: Matrix,
    /// Φᵀκ̃, M.
    pub(crate) shift: Vec<f64>,
}

impl Sums {
    pub(crate) fn zeros(points: usize) -> Self {
        Self { precision: Matrix::zeros(points, points), shift: vec![0.0; points] }
    }

    /// Adds a block of events with the given features (an event a row), ω and κ̃. The work matrix `scratch` is resized
    /// to the size of the features. O(M²) an event.
    pub(crate) fn add(&mut self, features: &Matrix, omega: &[f64], shift: &[f64], scratch: &mut Matrix) {
        add_scaled(1.0, &features.transposed_times(shift), &mut self.shift);
        let roots: Vec<f64> = omega.iter().map(|omega| omega.sqrt()).collect();
        write_scaled_transpose(features, &roots, scratch);
        add_symmetric_product_lower(1.0, scratch.view(), &mut self.precision);
    }

    pub(crate) fn merge(&mut self, other: &Sums) {
        self.precision.add_scaled(1.0, &other.precision);
        add_scaled(1.0, &other.shift, &mut self.shift);
    }
}

/// Returns Ĝ = ΦᵀΩΦ and b̂ = Φᵀκ̃ of events with the given ω and κ̃, Φ = K_NM L⁻ᵀ. O(NM²) time, O(M²) memory.
pub(crate) fn condense(cross: &Cross<'_>, cholesky: &Cholesky, omega: &[f64], shift: &[f64]) -> Result<Sums> {
    let of_part = |part| -> Result<Sums> {
        let (mut sums, mut features, mut scratch) =
            (Sums::zeros(cholesky.size()), Matrix::default(), Matrix::default());
        for block in blocks(part) {
            cross.write_features(block.clone(), cholesky, &mut features)?;
            sums.add(&features, &omega[block.clone()], &shift[block], &mut scratch);
        }
        Ok(sums)
    };
    let mut total = Sums::zeros(cholesky.size());
    for sums in on_parts(cross.parts(), of_part) {
        total.merge(&sums?);
    }
    total.precision.mirror_lower();
    Ok(total)
}

/// Returns diag(K_NN − ΦΦᵀ), N: the prior variance of every event that the inducing points leave unexplained. Values
/// that rounding made negative become 0. O(NM²).
pub(crate) fn residual(cross: &Cross<'_>, cholesky: &Cholesky) -> Result<Vec<f64>> {
    let of_part = |part: Range<usize>| -> Result<Vec<f64>> {
        let (mut residual, mut features) = (Vec::with_capacity(part.len()), Matrix::default());
        for block in blocks(part) {
            cross.write_features(block.clone(), cholesky, &mut features)?;
            let diagonal = cross.kernel.diagonal(&cross.inputs.slice(block))?;
            let explained = squared_norms_of_rows(&features);
            residual.extend(diagonal.iter().zip(explained).map(|(k, explained)| (k - explained).max(0.0)));
        }
        Ok(residual)
    };
    Ok(on_parts(cross.parts(), of_part).into_iter().collect::<Result<Vec<_>>>()?.concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Shape, Term};
    use crate::linalg::product;

    #[test]
    fn kept_and_recomputed_covariances_give_the_same_sums() {
        let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 2.0, 0.7, 1).unwrap()]).unwrap();
        let inputs = Inputs::new((0..700).map(|n| f64::from(n) * 0.01).collect(), 1).unwrap();
        let points = Inputs::new((0..9).map(f64::from).collect(), 1).unwrap();
        let cholesky = Cholesky::new("K_MM", kernel.gram(&points).unwrap()).unwrap();
        let omega: Vec<f64> = (0..700).map(|n| 0.05 + 0.2 * f64::from(n % 7) / 7.0).collect();
        let shift: Vec<f64> = (0..700).map(|n| if n % 3 == 0 { 0.5 } else { -0.5 }).collect();
        let recomputed = Cross::new(&kernel, &points, &inputs).unwrap();
        let kept = Cross::new(&kernel, &points, &inputs).unwrap().kept(kept_max(inputs.len())).unwrap();
        assert_eq!((recomputed.kept.len(), kept.kept.len()), (0, 3));
        let [one, other] = [&recomputed, &kept].map(|cross| condense(cross, &cholesky, &omega, &shift).unwrap());
        assert_eq!((&one.precision, &one.shift), (&other.precision, &other.shift));
        assert_eq!(residual(&recomputed, &cholesky).unwrap(), residual(&kept, &cholesky).unwrap());

        // The sums by their definition.
        let mut features = kernel.cross(&points, &inputs).unwrap();
        cholesky.solve_lower_matrix(&mut features);
        let expected = features.times(&shift);
        assert!(one.shift.iter().zip(&expected).all(|(found, expected)| (found - expected).abs() < 1e-10));
        let scaled = Matrix::from_fn(9, 700, |row, column| features[(row, column)] * omega[column]);
        let expected = product(scaled.view(), features.t());
        let far = one.precision.entries().zip(expected.entries()).map(|(found, expected)| (found - expected).abs());
        assert!(far.fold(0.0, f64::max) < 1e-10);
    }
}
