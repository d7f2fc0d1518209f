//! Kernels are symmetric and positive semi-definite, and reciprocal terms are invariant under reflection.

use super::problems::*;
use crate::common::*;
use dgpc::*;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(400))]

    #[test]
    fn grams_are_symmetric_and_semidefinite(problem in problems(1..=20)) {
        let kernel = problem.prior.kernel();
        let gram = problem.gram();
        prop_assert_eq!(&gram, &transposed(&gram));
        assert_near_matrix("cross", &rows(&kernel.cross(problem.inputs(), problem.inputs()).unwrap()), &gram, 1e-14);
        let diagonal: Vec<f64> = (0..gram.len()).map(|n| gram[n][n]).collect();
        assert_near("diagonal", &kernel.diagonal(problem.inputs()).unwrap(), &diagonal, 1e-14);
        // No eigenvalue is below −1e-12 of the trace.
        let lifted = sum(&gram, &diagonal_matrix(gram.iter().map(|_| 1e-12 * trace(&gram))));
        prop_assert!(cholesky(&lifted).is_some());
    }

    #[test]
    fn reciprocal_kernels_add_a_share_of_the_image(problem in problems(1..=10)) {
        let dimension = problem.inputs().dimension();
        let terms = problem.prior.kernel().terms().iter().take(1).cloned();
        let terms: Vec<Term> = terms.filter(|term| term.reflection().is_some()).collect();
        prop_assume!(!terms.is_empty());
        let kernel = Kernel::new(terms).unwrap();
        let images = swapped(problem.inputs());
        let gram = rows(&kernel.cross(problem.inputs(), &problem.elsewhere).unwrap());
        let term = &kernel.terms()[0];
        // Both reflected: equal. One reflected: equal if the term is reciprocal in whole.
        let both = (&images, &swapped(&problem.elsewhere));
        let one = [(&images, &problem.elsewhere), (problem.inputs(), &swapped(&problem.elsewhere))];
        for (a, b) in one.into_iter().filter(|_| term.reciprocity() == 1.0).chain([both]) {
            assert_near_matrix("swapped", &rows(&kernel.cross(a, b).unwrap()), &gram, 1e-13);
        }
        // Half of the plain kernel at x′, plus half of the reciprocity times the plain kernel at the image.
        let plain = term.correlations().iter().cloned();
        let mut plain = plain;
        let first = Term::of(term.variance(), plain.next().unwrap()).unwrap();
        let plain = plain.fold(first, |term, correlation| term.times(correlation).unwrap());
        let plain = Kernel::new(vec![plain]).unwrap();
        let direct = rows(&plain.cross(problem.inputs(), &problem.elsewhere).unwrap());
        let reflected = rows(&plain.cross(&images, &problem.elsewhere).unwrap());
        let scaled = |rows: &Dense, factor: f64| -> Dense {
            rows.iter().map(|row| row.iter().map(|entry| factor * entry).collect()).collect()
        };
        let expected = sum(&scaled(&direct, 0.5), &scaled(&reflected, 0.5 * term.reciprocity()));
        assert_near_matrix("halves", &gram, &expected, 1e-13);
        prop_assert_eq!(dimension, images.dimension());
    }

    #[test]
    fn untied_length_scales_are_refused(first in 0.1..5.0f64, ratio in prop_oneof![1.0000001..3.0f64, 0.3..0.9999999]) {
        let second = first * ratio;
        let term = Term::new(Shape::Matern32, 1.0, &[0, 1, 2, 3], &[first, 1.0, second, 1.0]).unwrap();
        let refused = term.reciprocal(swap(4));
        prop_assert_eq!(refused, Err(Error::NotReciprocal {
            column: 0,
            partner: 2,
            length_scale: first,
            partner_length_scale: Some(second),
        }));
        // A column without its partner is refused, too.
        let term = Term::new(Shape::Matern32, 1.0, &[0, 1, 3], &[first, 1.0, 1.0]).unwrap();
        let refused = term.reciprocal(swap(4));
        let alone = matches!(
            refused,
            Err(Error::NotReciprocal { column: 0, partner: 2, partner_length_scale: None, .. })
        );
        prop_assert!(alone);
    }
}
