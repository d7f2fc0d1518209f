//! Covariances of events with inducing points, and sums over them, block by block. Events lie in rows.

use std::ops::Range;

use crate::error::Result;
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::linalg::{
    Cholesky, Matrix, add_scaled, add_symmetric_product_lower, squared_norms_of_rows, write_scaled_transpose,
};
use crate::parts::{BLOCK, blocks, on_parts, parts};

/// So many covariances are kept, 59 MB of them; what is beyond is worked out anew whenever it is asked for.
const KEPT_MAX: usize = 7 << 20;

/// K_NM of N events against M inducing points.
pub(crate) struct Cross<'a> {
    kernel: &'a Kernel,
    points: &'a Inputs,
    inputs: &'a Inputs,
    /// The first blocks.
    kept: Vec<Matrix>,
}

impl<'a> Cross<'a> {
    /// Nothing kept. What is asked for once is asked for here.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`].
    pub(crate) fn new(kernel: &'a Kernel, points: &'a Inputs, inputs: &'a Inputs) -> Result<Self> {
        kernel.check(points)?;
        kernel.check(inputs)?;
        Ok(Self { kernel, points, inputs, kept: Vec::new() })
    }

    /// The same with as much kept as is worth it. O(NMd), 59 MB of memory at most.
    pub(crate) fn kept(self) -> Result<Self> {
        let blocks_max = KEPT_MAX / (BLOCK * self.points.len()).max(1);
        let whole = blocks(0..self.inputs.len()).take(blocks_max).collect();
        let compute = |block| -> Result<Matrix> { self.kernel.cross(&self.inputs.slice(block), self.points) };
        let kept = on_parts(whole, compute).into_iter().collect::<Result<_>>()?;
        Ok(Self { kept, ..self })
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

    /// The events.
    pub(crate) fn inputs(&self) -> &'a Inputs {
        self.inputs
    }

    /// In how many parts a sum over the events is worth doing.
    pub(crate) fn parts(&self) -> Vec<Range<usize>> {
        parts(self.inputs.len(), self.points.len() * self.points.len())
    }
}

/// ΦᵀΩΦ and Φᵀκ̃ over some of the events, for features Φ of M columns.
#[derive(Clone)]
pub(crate) struct Sums {
    /// M×M; of what is added up as yet, the lower triangle alone.
    pub(crate) precision: Matrix,
    /// M.
    pub(crate) shift: Vec<f64>,
}

impl Sums {
    pub(crate) fn zeros(points: usize) -> Self {
        Self { precision: Matrix::zeros(points, points), shift: vec![0.0; points] }
    }

    /// Adds a block of events by their features, an event a row, and the ω and κ̃ of each, with `room` for as many numbers as the
    /// features. O(M²) an event.
    pub(crate) fn add(&mut self, features: &Matrix, omega: &[f64], shift: &[f64], room: &mut Matrix) {
        add_scaled(1.0, &features.transposed_times(shift), &mut self.shift);
        let roots: Vec<f64> = omega.iter().map(|omega| omega.sqrt()).collect();
        write_scaled_transpose(features, &roots, room);
        add_symmetric_product_lower(1.0, room.view(), &mut self.precision);
    }

    pub(crate) fn merge(&mut self, other: &Sums) {
        self.precision.add_scaled(1.0, &other.precision);
        add_scaled(1.0, &other.shift, &mut self.shift);
    }
}

/// Ĝ = ΦᵀΩΦ and b̂ = Φᵀκ̃ of events with these ω and κ̃, Φ = K_NM L⁻ᵀ. O(NM²) time, O(M²) memory.
pub(crate) fn condense(cross: &Cross<'_>, cholesky: &Cholesky, omega: &[f64], shift: &[f64]) -> Result<Sums> {
    let of_part = |part| -> Result<Sums> {
        let (mut sums, mut features, mut room) = (Sums::zeros(cholesky.size()), Matrix::default(), Matrix::default());
        for block in blocks(part) {
            cross.write_features(block.clone(), cholesky, &mut features)?;
            sums.add(&features, &omega[block.clone()], &shift[block], &mut room);
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

/// diag(K_NN − ΦΦᵀ), N, not negative: the prior variance of every event that the inducing points leave unexplained. O(NM²).
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
    fn what_is_kept_and_what_is_worked_out_anew_are_the_same_sums() {
        let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 2.0, 0.7, 1).unwrap()]).unwrap();
        let inputs = Inputs::new((0..700).map(|n| f64::from(n) * 0.01).collect(), 1).unwrap();
        let points = Inputs::new((0..9).map(f64::from).collect(), 1).unwrap();
        let cholesky = Cholesky::new("K_MM", kernel.gram(&points).unwrap()).unwrap();
        let omega: Vec<f64> = (0..700).map(|n| 0.05 + 0.2 * f64::from(n % 7) / 7.0).collect();
        let shift: Vec<f64> = (0..700).map(|n| if n % 3 == 0 { 0.5 } else { -0.5 }).collect();
        let anew = Cross::new(&kernel, &points, &inputs).unwrap();
        let kept = Cross::new(&kernel, &points, &inputs).unwrap().kept().unwrap();
        assert_eq!((anew.kept.len(), kept.kept.len()), (0, 3));
        let [one, other] = [&anew, &kept].map(|cross| condense(cross, &cholesky, &omega, &shift).unwrap());
        assert_eq!((&one.precision, &one.shift), (&other.precision, &other.shift));
        assert_eq!(residual(&anew, &cholesky).unwrap(), residual(&kept, &cholesky).unwrap());

        // By the definition.
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
